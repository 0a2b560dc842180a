"""IMU numbers: which noise of an IMU goes into a filter, from a log at rest and from a drive.

The Allan deviation at rest shows what the sensor has on a table. The innovations of a drive show what its
filter needs in the vehicle, vibration and all. The factor between them has a cause that the data may show.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lab.analysis import rest
from lab.analysis.identification.identification import Identification
from lab.analysis.identification.renavigation import subject
from lab.analysis.identification.withheld import held_out, outages
from lab.analysis.rest_recording import RestRecords, of_samples
from lab.analysis.rest_samples import Samples
from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import TO_SI
from lab.base.progress import Progress
from lab.data.filter_logs import sensors_beside
from lab.data.log.sensor_log import GnssLog
from lab.experiment.experiment import Experiment
from lab.experiment.log_file import is_opened, mission_name, open_mission
from lab.experiment.log_result import LogResult
from lab.experiment.number_causes import cause, flicker
from lab.experiment.number_table import TERMS, UNITS, Estimate, ImuNumbers, NumberRow
from lab.missions import LogMission, mission
from lab.motion.frames.displacement import displacement
from lab.navigation.solution import Fixes, Imu
from lab.navigation.standstill import at_rest
from lab.run.run import Run
from lab.sensors.cards import Card
from lab.sensors.datum import DENSITY
from lab.sensors.suite import TRIADS

SHORTEST_DRIVE = 45.0
"""Shortest drive [s]: the innovations of the first fifth show the start, and the outages by which the numbers
are judged last 10 s in each 20 s. The shortest log on which they were tried lasts 60 s."""
SHORTEST_REST = 8.0
"""Shortest rest within a drive from which white noise is taken [s]: at 25 Hz it has 200 samples, which show
it within 10 %."""
REST_OF_WALK = 100.0
"""Shortest rest from which a random walk of the bias is taken [s]: in a shorter one, sensors that settle, or
a hand that puts them down, look like one."""
OTHER_RATE = 0.2
"""Relative difference of two rates from which it is reported: clocks and jitter make a few per cent."""
LONG_STEP = 2.5
"""Step between samples, in the usual one, from which it is a gap and no jitter."""
MOVES = 0.5
"""Speed that some fix of a drive must exceed [m/s]; receivers at rest show 0.3 m/s."""
LEAST_MOTION = 10.0
"""Least time in motion of a drive [s]."""
_APART = 5
"""Fixes over which the speed of a receiver without velocity is measured: white errors of 1 m count less."""
NORMAL = 1.96
"""σ in half of a 95 % interval."""
QUIETER = 0.5
"""Part of the white noise at rest below which the samples of the same sensor in motion cannot fall: motion
only adds to them."""
SETTINGS = {TERMS[0]: ("noise_density",), TERMS[1]: ("rate_random_walk", "flicker", "instability")}
"""The settings of each term."""
RULE = 10.0
"""The factor of the common rule, which is tried."""
LARGEST_PART = 0.2
"""Part of the drive at its begin without withheld fixes: the start shows there."""
LETTERS = ("N", "K")
"""The coefficient of IEEE 952 of each term."""
WALK_RATE = 30.0
"""Rate at which the random walk of a vehicle's motion is measured [Hz]: the default rate of
robot_localization, whose filter takes motion as such a walk."""


def numbers(
    static: str | Path | None = None,
    moving: str | Path | Experiment | None = None,
    progress: Progress | None = None,
) -> ImuNumbers:
    """Return the noise of an IMU for a filter, from a log at rest, from a drive, or from both.

    Parameters
    ----------
    static
        File of the IMU at rest, of any format that `lab.analysis.rest.read_log` reads. Without one, the
        longest rest of the drive is taken, if it has any.
    moving
        The mission of a drive with GPS, its log file of any format, or an experiment on it, whose settings
        are kept. Without one, only the numbers at rest are known.
    progress
        Called with a phrase and the fraction done, from 0 to 1.

    Raises
    ------
    MissionError
        If a log cannot be read, the log at rest moved, the drive stands still or is too short, or both are
        not of one IMU.
    ValueError
        If there is no log at all, or the drive cannot be navigated.
    """
    tell = progress or (lambda _stage, _fraction: None)
    if static is None and moving is None:
        raise ValueError("numbers need a log: static, moving, or both")
    tell("reading the log at rest", 0.0)
    records, refusal = None, None
    if static is not None:
        try:
            records = rest.read_log(static)
            _check_still(static, records)
        except MissionError as error:
            refusal = error
    if moving is None:
        if refusal is not None or records is None:
            raise refusal or ValueError("numbers need a log")
        return _of_rest(str(static), records)
    if isinstance(moving, Experiment):
        return _with_drive(static, records, refusal, moving.copy(), tell)
    with open_mission(moving) as drive:
        return _with_drive(static, records, refusal, Experiment(mission=drive), tell)


def _with_drive(
    static: str | Path | None,
    records: RestRecords | None,
    refusal: MissionError | None,
    experiment: Experiment,
    tell: Progress,
) -> ImuNumbers:
    """Return the numbers of a drive, and of a rest, which may be missing or refused."""
    stands = _why_no_drive(experiment)
    if refusal is not None:
        swapped = f" The drive {stands}: were the two logs swapped?" if "stands still" in stands else ""
        raise MissionError(f"{refusal}.{swapped}") from refusal
    if stands:
        raise MissionError(f"{mission_name(experiment.mission)}: the drive {stands}")
    result = experiment.run(lambda stage, part: tell(stage, 0.1 + 0.1 * part))
    assert isinstance(result, LogResult)
    drive = _drive(result)
    where = "" if static is None else str(static)
    if records is None:
        records, where = _own_rest(result)
    if records:
        _check_one_imu(records, drive)
        card = _card(records, where)
        if card is not None:
            experiment.update({"sensors": rest.with_noise(experiment.sensors, card).to_dict()})
            result = experiment.run(lambda stage, part: tell(stage, 0.2 + 0.1 * part))
    found = result.identify(lambda stage, part: tell(stage, 0.3 + 0.7 * part))
    chosen = _by_rule(experiment, found, result)
    return _merge_numbers(where, experiment, records, drive, found, chosen)


def _why_no_drive(experiment: Experiment) -> str:
    """Return why the mission is no drive; empty if it is one."""
    where = mission(experiment.mission)
    if not isinstance(where, LogMission):
        return (
            "is a simulated mission, whose noise is a setting; accepted is a sensor log (ins-lab import "
            "FILE --as log)"
        )
    gnss = where.log.gnss
    if not gnss.time.size:
        return "has no fixes; accepted is a log of an IMU with a GPS receiver"
    length = min(where.duration, float(gnss.time[-1])) - max(0.0, float(gnss.time[0]))
    moving = _fraction_moving(gnss) * length
    if moving < LEAST_MOTION:
        return (
            f"stands still: its fixes move faster than {MOVES:g} m/s for {moving:.0f} s; accepted are at "
            f"least {LEAST_MOTION:g} s of motion"
        )
    if length < SHORTEST_DRIVE:
        return (
            f"has IMU and fixes together for {length:.0f} s; accepted are at least {SHORTEST_DRIVE:g} s: a "
            "shorter drive does not show noise that a filter needs"
        )
    return ""


def _fraction_moving(gnss: GnssLog) -> float:
    """Return the part of the fixes that move."""
    speed = np.linalg.norm(np.nan_to_num(gnss.velocity_n), axis=1)
    if np.isnan(gnss.velocity_n).all():
        far = displacement(gnss.position[:-_APART], gnss.position[_APART:])[:, :2]
        speed = np.linalg.norm(far, axis=1) / (gnss.time[_APART:] - gnss.time[:-_APART])
    return float(np.mean(speed > MOVES)) if speed.size else 0.0


def _check_still(static: str | Path, records: RestRecords) -> None:
    """Raise `MissionError` if a log is at rest for longer than its own fixes stand still.

    An IMU on a vehicle that flies or rolls straight on looks like one at rest.
    """
    beside = sensors_beside(Path(static))
    if isinstance(beside, str) or not beside.gnss.time.size:
        return
    length = float(np.ptp(beside.gnss.time))
    moving, used = _fraction_moving(beside.gnss) * length, max(one.duration for one in records.values())
    if moving >= LEAST_MOTION and used > length - moving:
        raise MissionError(
            f"{static}: the log at rest moved: its fixes move faster than {MOVES:g} m/s for {moving:.0f} s "
            f"of {length:.0f} s; accepted is a log of an IMU that stands still. The rest of a drive is taken "
            "from --moving alone"
        )


def _own_rest(result: LogResult) -> tuple[RestRecords | None, str]:
    """Return the records of the longest rest within a drive and where it is; None if there is none."""
    log, time = result.recorded.log, result.time
    increments = result.gyro.increments, result.accelerometer.increments
    velocity_n = np.nan_to_num(result.fixes.velocity_n)
    fixes = Fixes(result.fix_validity, result.fixes.position, velocity_n)
    still = at_rest(Imu(time, *increments), fixes, result.belief)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], still, [0]))))
    pieces = list(zip(edges[::2], edges[1::2], strict=True))
    if not pieces:
        return None, ""
    first, last = max(pieces, key=lambda piece: time[piece[1]] - time[piece[0]])
    if time[last] - time[first] < SHORTEST_REST:
        return None, ""
    stamps, dt = time[first + 1 : last + 1], np.diff(time[first : last + 1])[:, None]
    samples = {
        triad: Samples(stamps, values[first:last] / dt)
        for triad, values in zip(TRIADS, increments, strict=True)
    }
    try:
        records = of_samples(samples)
    except MissionError:
        return None, ""
    start, end = log.epoch + time[first], log.epoch + time[last]
    return records, f"the drive's own rest, {start:.0f} to {end:.0f} s"


class _Drive(NamedTuple):
    """The samples of a drive: rates [rad/s] and specific forces [m/s²], and their interval [s]."""

    rates: tuple[FloatArray, FloatArray]
    dt: float


def _drive(result: LogResult) -> _Drive:
    dt = np.diff(result.time)
    increments = result.gyro.increments, result.accelerometer.increments
    gyro, accelerometer = (np.asarray(values / dt[:, None]) for values in increments)
    usual = dt[dt < LONG_STEP * np.median(dt)]  # stamps may jitter, so that the median is not the mean
    return _Drive((gyro, accelerometer), float(usual.mean()))


def _check_one_imu(records: RestRecords, drive: _Drive) -> None:
    """Raise `MissionError` if the samples of a drive are quieter than those of its sensor at rest."""
    for triad, moving in zip(TRIADS, drive.rates, strict=True):
        if triad not in records:
            continue
        (still, dt), found = records[triad], []
        # Differences of neighbours over the same time: motion and vibration only add to them.
        for values, step in ((still, dt), (moving, drive.dt)):
            stride = max(1, round(max(dt, drive.dt) / step))
            found.append(float(np.sqrt(np.mean(np.diff(values[::stride], axis=0) ** 2))))
        if found[1] < QUIETER * found[0]:
            raise MissionError(
                f"the {triad}s are quieter in the drive ({found[1]:.3g} from sample to sample) than in the "
                f"log at rest ({found[0]:.3g}): accepted are two logs of one IMU with the same settings"
            )


def _card(records: RestRecords, where: str) -> Card | None:
    try:
        card = rest.card_of("rest", records, where)
    except ValueError:
        return None
    for triad, record in records.items():
        if record.duration < REST_OF_WALK:
            kept = {name: datum for name, datum in card.terms[triad].items() if name == DENSITY}
            card = replace(card, terms={**card.terms, triad: kept})
    return card


def _estimates(records: RestRecords | None) -> dict[tuple[str, str], Estimate]:
    """Return what the records show of each term, root mean square of the axes."""
    found: dict[tuple[str, str], Estimate] = {}
    if records is None:
        return found
    for triad, terms in rest.noise_terms(records).items():
        for letter, term, units in zip(LETTERS, TERMS, UNITS, strict=True):
            if term != TERMS[0] and records[triad].duration < REST_OF_WALK:
                continue
            unit = units[TRIADS.index(triad)]
            values, sigmas = (getattr(terms, name) / TO_SI[unit] for name in (letter, f"{letter}_sigma"))
            known = np.isfinite(values) & np.isfinite(sigmas)
            if not known.any():
                continue
            values, sigmas = values[known], sigmas[known]
            value = float(np.sqrt(np.mean(values**2)))
            # Of the mean square: σ of a square is 2 v σ, or that of a term that may be zero, σ².
            spread = float(np.sqrt(np.sum((2 * values * sigmas) ** 2 + 2 * sigmas**4))) / values.size
            low, high = max(value**2 - NORMAL * spread, 0.0), value**2 + NORMAL * spread
            if high > 0:
                found[triad, term] = Estimate(value, math.sqrt(low), math.sqrt(high))
    return found


def _of_rest(where: str, records: RestRecords) -> ImuNumbers:
    """Return the numbers without a drive."""
    seen = _estimates(records)
    record = next(iter(records.values()))
    unknown = "unknown: there is no drive"
    rows = [
        _row(key, seen.get(key), None, unknown, record.dt, None, f"the Allan deviation of {where}")
        for key in _keys(records)
    ]
    remarks = (
        *_about_rest(records),
        "Without a drive, nothing shows how much more noise the filter needs in the vehicle: vibration, "
        "scale factors and temperature do not show at rest. The factors 10 to 20 that are quoted are of "
        "other vehicles.",
    )
    return ImuNumbers(where, "", 1 / record.dt, tuple(rows), (math.nan, math.nan), None, remarks)


def _about_rest(records: RestRecords | None) -> list[str]:
    """Return the remarks on a rest, with what it is too short for."""
    if not records:
        return ["No log at rest, and the drive has no rest: the factor to rest is unknown."]
    shortest = min(record.duration for record in records.values())
    found = [*records.remarks, *flicker(records)]
    if shortest < REST_OF_WALK:
        found.append(
            f"A random walk of the bias is taken from a rest of {REST_OF_WALK:g} s or more; this one lasts "
            f"{shortest:.0f} s."
        )
    return found


def _about_rates(records: RestRecords | None, drive: _Drive) -> list[str]:
    """Return a remark if both logs have other rates, as two sensors or two settings of one have."""
    rates = {round(1 / record.dt) for record in (records or {}).values()}
    if all(abs(rate * drive.dt - 1) < OTHER_RATE for rate in rates):
        return []
    return [
        f"The log at rest has {min(rates):g} samples a second, and the drive {1 / drive.dt:.0f}: the factor "
        "is that of one IMU only if its range and its filter were the same."
    ]


def _keys(triads: Collection[str]) -> list[tuple[str, str]]:
    return [(triad, term) for term in TERMS for triad in TRIADS if triad in triads]


def _row(
    key: tuple[str, str],
    still: Estimate | None,
    moving: Estimate | None,
    why: str,
    dt: float,
    used: float | None,
    basis: str,
) -> NumberRow:
    triad, term = key
    unit = UNITS[TERMS.index(term)][TRIADS.index(triad)]
    if used is None:
        shown = still is not None and still.low > 0
        used = still.value if still is not None and shown else math.nan
        if not shown:
            basis += ", which does not show it" if still is None else ", which shows an upper end only"
    discrete = used * TO_SI[unit] * (dt**-0.5 if term == TERMS[0] else dt**0.5)
    return NumberRow(triad, term, unit, still, moving, used, discrete, why, basis)


class _Chosen(NamedTuple):
    """The settings that predict withheld fixes best, and the terms that the rule multiplied, and why."""

    experiment: Experiment
    multiplied: frozenset[tuple[str, str]]
    why: str


def _by_rule(experiment: Experiment, found: Identification, result: Run) -> _Chosen:
    """Return what was identified, or with the common rule "times ten" where that predicts fixes better.

    The rule is tried on the terms that the drive does not show, and on all terms at rest.
    """
    now = experiment.copy()
    if found.recommended:
        now.update(found.settings())
    applied = (
        {_key_of_term(name) for name in found.applied if _key_of_term(name)} if found.recommended else set()
    )
    again = subject(result)
    first, last = again.span
    masks = outages(again.stamps, first + LARGEST_PART * (last - first), last)
    dropped = np.zeros(again.stamps.size, np.bool_)
    chosen = _Chosen(now, frozenset(), "")
    before = best = held_out(again, now, masks, dropped)
    for keys in (set(_keys(TRIADS)) - applied, set(_keys(TRIADS))):
        tried = _multiply_terms(now, experiment, keys)
        after = held_out(again, tried, masks, dropped)
        if after.position_error < best.position_error and after.log_likelihood > best.log_likelihood:
            best = after
            figures = (
                f"error {before.position_error:.3g} m without, {after.position_error:.3g} m with the rule"
            )
            chosen = _Chosen(tried, frozenset(keys), figures)
    return chosen


def _key_of_term(name: str) -> tuple[str, str] | None:
    """Return the key of the term that a parameter of an identification is; None for others."""
    triad, _, rest_of_name = name.partition(" ")
    terms = {"noise density": TERMS[0], "bias drive": TERMS[1]}
    return (triad, terms[rest_of_name]) if rest_of_name in terms else None


def _multiply_terms(now: Experiment, still: Experiment, keys: Collection[tuple[str, str]]) -> Experiment:
    """Return settings with some terms as at rest, times `RULE`."""
    tried = now.copy()
    for triad, term in keys:
        for name in SETTINGS[term]:
            path = f"sensors.{triad}.{name}"
            high = still.sensors.groups()[triad].param[name].bounds[1]
            values = np.atleast_1d(np.asarray(still.get(path), dtype=np.float64))
            tried.set(path, np.minimum(RULE * values, high).tolist())
    return tried


def _merge_numbers(
    where: str,
    experiment: Experiment,
    records: RestRecords | None,
    drive: _Drive,
    found: Identification,
    chosen: _Chosen,
) -> ImuNumbers:
    """Return the numbers of a rest, which may be missing, and a drive."""
    seen, rows = _estimates(records), []
    by_key = {_key_of_term(row.parameter): row for row in found.rows}
    trusted = found.recommended
    for key in _keys(TRIADS):
        triad, term = key
        one, still = by_key[key], seen.get(key)
        moving = Estimate(one.after, one.low, one.high) if one.observable else None
        judged = (
            f"fixes withheld for {found.withheld:g} s: error {found.before.position_error:.3g} m before, "
            f"{found.after.position_error:.3g} m after"
        )
        if key in chosen.multiplied:
            setting = SETTINGS[term][0]
            values = np.asarray(chosen.experiment.get(f"sensors.{triad}.{setting}"))
            used = float(np.sqrt(np.mean(values**2))) or math.nan
            basis = (
                f"{RULE:g} times what {where or 'the settings'} gave, which predicts withheld fixes better "
                f"({chosen.why})"
            )
        elif trusted and one.applied:
            how = "chosen with one factor on Q" if found.chosen_by == "factors" else "identified"
            used, basis = one.after, f"{how} in {mission_name(experiment.mission)} by {judged}"
        elif still is not None:
            said = "the drive does not refute it" if trusted else f"the drive gives no better one ({judged})"
            used, basis = None, f"the Allan deviation of {where}; {said}"
        else:
            used = one.before if one.before > 0 else math.nan
            basis = f"what the filter assumed: neither log shows another one ({judged})"
        why = cause(key, still, moving, records, drive.rates[TRIADS.index(triad)], drive.dt)
        rows.append(_row(key, still, moving, why, drive.dt, used, basis))
    remarks = [*_about_rest(records), *_about_rates(records, drive), *found.remarks]
    lasting = None if is_opened(experiment.mission) else chosen.experiment
    name = mission_name(experiment.mission)
    return ImuNumbers(where, name, 1 / drive.dt, tuple(rows), _walks(drive), lasting, tuple(remarks))


def _walks(drive: _Drive) -> tuple[float, float]:
    """Return the intensities of the random walks of rate and acceleration; NaN where noise hides them.

    Differences over a time τ have the variance 2 σ² + Q τ, with white noise σ of the samples: two times tell
    both apart.
    """
    stride = max(1, round(1 / (WALK_RATE * drive.dt)))
    found = []
    for values in drive.rates:
        near, far = (float(np.mean((values[lag:] - values[:-lag]) ** 2)) for lag in (stride, 2 * stride))
        intensity = (far - near) / (stride * drive.dt)
        found.append(intensity if intensity > 0 else math.nan)
    return found[0], found[1]
