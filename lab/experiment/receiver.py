"""Receiver: what the fixes of a receiver are worth, beside what it claims, and what a gate can reject.

The errors are found from the fixes alone, or from the fixes of a sensor log less the motion that its IMU
shows. They are found in the first half of the fixes, too, and judged by the other half.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from lab.analysis.identification.renavigation import subject
from lab.analysis.identification.withheld import held_out, outages
from lab.analysis.receiver_errors import (
    FEWEST,
    VELOCITY_SIGMA,
    AxisErrors,
    FixSeries,
    drop_outliers,
    expected_squares,
    fit,
    fit_memory,
    quarters,
    rounding,
    with_motion,
)
from lab.base.arrays import FloatArray, interpolate_columns, running_sums
from lab.base.files.mission_error import MissionError
from lab.base.progress import Progress
from lab.data.formats import reader_of
from lab.data.protocols.samples import FIX_2D, FIX_3D, FIX_DIFFERENTIAL, FIX_RTK, FIX_RTK_FLOAT
from lab.data.streams.raw_recording import RecordingError
from lab.data.streams.recorded_log import recorded_samples
from lab.experiment.experiment import Experiment
from lab.experiment.log_file import is_log_file, mission_name, open_mission
from lab.experiment.log_result import LogResult
from lab.experiment.receiver_report import (
    ALL,
    KindRow,
    ReceiverReport,
    advice_on,
    metres,
    row_sentence,
    sentence_on_halves,
)
from lab.missions import LogMission, mission
from lab.motion.frames.displacement import displacement
from lab.motion.frames.rotation import C_nb_from_euler

KINDS = {
    FIX_2D: "2-D",
    FIX_3D: "3-D",
    FIX_DIFFERENTIAL: "differential",
    FIX_RTK_FLOAT: "RTK float",
    FIX_RTK: "RTK fixed",
}
"""Kinds of fixes in words; others have no name."""
ALONE, LESS = "the fixes alone", "the fixes less the motion that the IMU shows"
"""What the errors rest on: whichever makes the fixes of a log more likely. A filter that believes a wrong σ
has a wrong attitude, with which the IMU shows a wrong motion."""
MOST = 5000
"""Most fixes that are used, the first ones: a minute of computing."""
SHORTEST_LOG = 30.0
"""Shortest span of fixes whose errors are stated [s]: the errors of fixes last some ten seconds and more, so
that a shorter log shows none of their slow part."""
SIX = 6
"""Components of a fix, over which the gate of the filter tests the innovations."""
GRAVITY = 9.8
"""Gravity along the down axis [m/s²]; what it lacks is a slow acceleration, which the fit has as a state."""
AXES = (("horizontal", slice(0, 2)), ("vertical", slice(2, 3)))
"""Names and axes that are fitted together."""
SATELLITES = ((0, 5), (6, 8), (9, 12), (13, 99))
"""Numbers of satellites that are counted together: four make a fix, and open sky has nine or more."""


class _Fixes(NamedTuple):
    """The fixes by what they rest on, their kinds and satellites, and the run of a log."""

    series: dict[str, FixSeries]
    kinds: tuple[str, ...]
    satellites: NDArray[np.int64]
    result: LogResult | None


def receiver(
    source: str | Path | Experiment, gate: float = 0.999, progress: Progress | None = None
) -> ReceiverReport:
    """Return what the fixes of a receiver are worth.

    Parameters
    ----------
    source
        A sensor log by its mission or its file, or an experiment on it; or a file of fixes alone, such as
        NMEA or UBX.
    gate
        Probability that a good fix passes the gate whose reach is stated.
    progress
        Called with a phrase and the fraction done, from 0 to 1.

    Raises
    ------
    MissionError
        If the source cannot be read, or has too few fixes.
    ValueError
        If the log cannot be navigated.
    """
    tell = progress or (lambda _stage, _fraction: None)
    tell("reading the fixes", 0.0)
    if isinstance(source, Experiment):
        return _examine_fixes(mission_name(source.mission), _of_log(source.copy(), tell), gate, tell)
    alone = _fixes_alone(source)
    if alone is not None:
        return _examine_fixes(str(source), alone, gate, tell)
    with open_mission(source) as name:
        return _examine_fixes(mission_name(name), _of_log(Experiment(mission=name), tell), gate, tell)


def _examine_fixes(name: str, fixes: _Fixes, gate: float, tell: Progress) -> ReceiverReport:
    """Return the report on fixes, if they are enough."""
    count = fixes.satellites.size
    if count > MOST:
        series = {basis: one.rows(slice(0, MOST)) for basis, one in fixes.series.items()}
        fixes = fixes._replace(series=series, satellites=fixes.satellites[:MOST])
    if count < FEWEST:
        raise MissionError(
            f"{name}: has {count} fixes; accepted are at least {FEWEST}: fewer do not show their errors"
        )
    span = float(np.ptp(next(iter(fixes.series.values())).time))
    if span < SHORTEST_LOG:
        raise MissionError(
            f"{name}: its fixes span {span:.0f} s; accepted are at least {SHORTEST_LOG:.0f} s: fewer do not "
            "show errors that change slowly"
        )
    if not _changes(fixes.series[ALONE]):
        raise MissionError(
            f"{name}: its {count} fixes are all at one place, to the last digit: nothing in them was "
            "measured; accepted are fixes of a receiver"
        )
    tell("finding the errors", 0.5)
    return _report(name, fixes, gate, tell)


def _fixes_alone(source: str | Path) -> _Fixes | None:
    """Return the fixes of a receiver's own file; None for a mission, or the log of an IMU and a receiver."""
    path = Path(source)
    if not is_log_file(source) or path.suffix.lower() == ".csv":
        return None
    try:
        return _of_file(path)
    except RecordingError as error:
        try:
            reader = reader_of(path)
        except MissionError:
            raise MissionError(str(error)) from error
        if reader.read_log is None and reader.read_logs is None:
            raise MissionError(
                f"{path}: is {reader.name}, which holds no fixes as a receiver sent them; accepted are the "
                "bytes of a receiver, such as NMEA or UBX, and sensor logs"
            ) from error
        return None


def _of_file(path: Path) -> _Fixes:
    """Return the fixes of a receiver's own file."""
    found = recorded_samples(path).fix
    found = found[np.isfinite(found["latitude"]) & (found["fix_type"] >= FIX_2D)]
    time = found["utc"] if np.isfinite(found["utc"]).all() else found["time"]
    found, time = _increasing(found, time)
    if not time.size:
        raise MissionError(f"{path}: holds no fixes")
    place = np.stack((found["latitude"], found["longitude"], found["height"]), axis=-1)
    sigma = np.stack((*(found["horizontal_sigma"],) * 2, found["vertical_sigma"]), axis=-1)
    numbers, kind = np.unique(found["fix_type"], return_inverse=True)
    far, velocity = displacement(np.repeat(place[:1], len(place), axis=0), place), found["velocity_n"]
    series = FixSeries(
        time,
        far,
        np.asarray(velocity, np.float64),
        _positive(sigma),
        _positive(np.repeat(found["speed_sigma"][:, None], 3, axis=1)),
        kind.astype(np.intp),
        (rounding(far), rounding(velocity)),
    )
    names = tuple(KINDS.get(int(one), f"kind {one}") for one in numbers)
    return _Fixes({ALONE: series}, names, found["satellites"].astype(np.int64), None)


def _increasing(found: NDArray[Any], time: FloatArray) -> tuple[NDArray[Any], FloatArray]:
    rows = np.append(True, np.diff(np.maximum.accumulate(time)) > 0)[: time.size]
    return found[rows], time[rows]


def _positive(sigma: FloatArray) -> FloatArray:
    return np.asarray(np.where(sigma > 0, sigma, np.nan))


def _of_log(experiment: Experiment, tell: Progress) -> _Fixes:
    """Return the fixes of a log less the motion that the IMU shows."""
    if not isinstance(mission(experiment.mission), LogMission):
        raise MissionError(
            f"{experiment.mission}: is a simulated mission, whose receiver is a setting; accepted are a "
            "sensor log and a receiver's file"
        )
    result = experiment.run(lambda stage, part: tell(stage, 0.4 * part))
    assert isinstance(result, LogResult)
    log, time = result.recorded.log, result.time
    stamps = log.gnss.time - result.latency
    rows = (stamps >= time[0]) & (stamps <= time[-1])
    place, velocity = log.gnss.position[rows], log.gnss.velocity_n[rows]
    far = displacement(np.repeat(place[:1], len(place), axis=0), place)
    alone = FixSeries(
        stamps[rows],
        far,
        velocity,
        log.gnss.position_sigma[rows],
        log.gnss.velocity_sigma[rows],
        np.zeros(len(far), np.intp),
        (rounding(far), rounding(velocity)),
    )
    moved, speed = _inertial(result, stamps[rows])
    less = alone._replace(position=far - moved, velocity=velocity - speed)
    return _Fixes({ALONE: alone, LESS: less}, (ALL,), np.full(len(far), -1), result)


def _inertial(result: LogResult, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return displacement (m, 3) and velocity (m, 3) of the IMU alone, north, east, down [m], [m/s].

    No fix corrects them but through the attitude; they drift away, as smoothly as the fit allows for.
    """
    time = result.time
    dt = np.diff(time)[:, None]
    C_nb = C_nb_from_euler(result.euler[:-1])
    gained = np.einsum("nij,nj->ni", C_nb, result.accelerometer.increments) + dt * (0.0, 0.0, GRAVITY)
    velocity = running_sums(gained)
    moved = running_sums(dt * (velocity[1:] + velocity[:-1]) / 2)
    return interpolate_columns(at, time, moved), interpolate_columns(at, time, velocity)


class _Axis(NamedTuple):
    """What was found along some axes."""

    basis: str
    series: FixSeries
    errors: AxisErrors
    nis: FloatArray
    degrees: FloatArray
    outliers: NDArray[np.int64]
    halves: tuple[FloatArray, FloatArray, FloatArray] | None
    memory: float = math.nan


def _changes(series: FixSeries) -> bool:
    """Return whether positions differ, as those that a receiver measured do."""
    return bool(np.any(np.diff(series.position, axis=0) != 0))


def _axis(by_basis: Mapping[str, FixSeries], axes: slice) -> _Axis:
    """Return the errors along some axes, by the fixes that are most likely."""
    tried = [(basis, own, fit(own)) for basis, own in ((at, one.along(axes)) for at, one in by_basis.items())]
    basis, own, errors = max(tried, key=lambda one: one[2].likelihood)
    seen = drop_outliers(own, errors)
    half = own.time.size // 2
    halves, memory = None, math.nan
    if half >= FEWEST and _changes(own) and set(own.kind[half:]) <= set(own.kind[:half]):
        sizes = fit(own.rows(slice(0, half)))
        other = drop_outliers(own, with_motion(own.rows(slice(half, None)), sizes))
        begin = drop_outliers(own.rows(slice(0, half)), sizes)
        memory, scale = fit_memory(begin.nis, begin.degrees)
        squares, degrees = (np.append(*both) for both in (
            (begin.nis, other.nis[half:]), (begin.degrees, other.degrees[half:])
        ))  # fmt: skip
        halves = squares[half:], degrees[half:], scale * expected_squares(squares, degrees, memory)[half:]
    outliers = np.asarray(seen.outlier.any(axis=(1, 2)), np.int64)
    return _Axis(basis, own, errors, seen.nis, seen.degrees, outliers, halves, memory)


def _report(name: str, fixes: _Fixes, gate: float, tell: Progress) -> ReceiverReport:
    found = {axis: _axis(fixes.series, place) for axis, place in AXES}
    rows = [
        _row(kind, number, axis, one)
        for number, kind in enumerate(fixes.kinds)
        for axis, one in found.items()
    ]
    level = found["horizontal"]
    claimed = (
        float(np.nanmedian(level.series.velocity_sigma))
        if _is_known(level.series.velocity_sigma)
        else math.nan
    )
    velocity = level.errors.velocity * (VELOCITY_SIGMA if math.isnan(claimed) else claimed)
    changed, before, after = None, math.nan, math.nan
    sentences = list(dict.fromkeys(row_sentence(row) for row in rows))
    if fixes.result is not None:
        tell("withholding fixes", 0.8)
        changed = _apply_sizes(fixes.result.experiment, rows, level.errors.velocity, claimed)
        before, after = _across_outages(fixes.result, changed)
        sentences += _gates(fixes.result, changed, gate)
        sentences.append(advice_on(before, after))
    sentences += [sentence_on_halves(row) for row in rows if math.isfinite(row.nis)]
    if fixes.satellites.size == MOST:
        sentences.append(f"The first {MOST} fixes were used.")
    return ReceiverReport(
        name,
        tuple(rows),
        (claimed, velocity),
        _by_satellites(fixes, found),
        tuple(sentences),
        changed,
        before,
        after,
    )


def _is_known(values: FloatArray) -> bool:
    return bool(np.isfinite(values).any())


def _row(kind: str, number: int, axis: str, one: _Axis) -> KindRow:
    rows = one.series.kind == number
    sigma = one.series.position_sigma[rows]
    claimed = float(np.nanmedian(sigma)) if _is_known(sigma) else math.nan
    white = float(one.errors.white[number]) * (1.0 if math.isnan(claimed) else claimed)
    nis, following, within, varies = math.nan, math.nan, (math.nan, math.nan), False
    if one.halves is not None:
        squares, degrees, expected = (values[rows[rows.size - values.size :]] for values in one.halves)
        if degrees.sum() >= FEWEST:
            nis, following = (float(own.sum() / degrees.sum()) for own in (squares, squares / expected))
        within, varies = quarters(squares, degrees)
    outliers = int(one.outliers[rows].sum())
    slow, tau = one.errors.slow, one.errors.tau
    if rows.sum() < FEWEST or not _changes(one.series):
        white = slow = tau = math.nan
    return KindRow(
        kind, axis, int(rows.sum()), claimed, white, slow, tau, outliers, nis, one.basis, within, varies,
        following, one.memory,
    )  # fmt: skip


def _apply_sizes(
    experiment: Experiment, rows: Sequence[KindRow], velocity: float, claimed: float
) -> Experiment:
    """Return an experiment whose filter takes the found sizes for R, and has a state for a slow error."""
    changed = experiment.copy()
    level, vertical = rows[0], rows[1]
    factors, bounds = [1.0, 1.0, 1.0], changed.sensors.gps.param["position_variance"].bounds
    variances = [float(one) for one in np.broadcast_to(changed.sensors.gps.position_variance, 3)]
    for place, (row, axes) in enumerate(((level, slice(0, 2)), (vertical, slice(2, 3)))):
        if math.isnan(row.white):
            continue
        if math.isfinite(row.claimed):
            factors[place] = (row.white / row.claimed) ** 2
        else:
            variances[axes] = [min(max(row.white**2, bounds[0]), bounds[1])] * (axes.stop - axes.start)
    changed.set("sensors.gps.position_variance", variances)
    if math.isfinite(velocity):
        if math.isnan(claimed):
            low, high = changed.sensors.gps.param["velocity_variance"].bounds
            changed.set(
                "sensors.gps.velocity_variance", min(max((VELOCITY_SIGMA * velocity) ** 2, low), high)
            )
        else:
            factors[2] = velocity**2
    low, high = changed.navigator.param["r_factors"].bounds
    changed.set("navigator.r_factors", [min(max(one, low), high) for one in factors])
    changed.set("navigator.r", None)
    changed.set("navigator.r_scale", 1.0)
    if level.slow > 0 or vertical.slow > 0:
        changed.set("sensors.gps.correlated_sigma", [level.slow, level.slow, vertical.slow])
        times = [row.tau for row in (level, vertical) if row.slow > 0]
        changed.set("sensors.gps.correlation_time", max(times))
        changed.set("navigator.estimate_gps_drift", True)
    return changed


def _across_outages(result: LogResult, changed: Experiment) -> tuple[float, float]:
    """Return the errors of fixes withheld for 10 s, before and after [m]."""
    again = subject(result)
    first, last = again.span
    masks = outages(again.stamps, first + 0.2 * (last - first), last)
    if not masks:
        return math.nan, math.nan
    none = np.zeros(again.stamps.size, np.bool_)
    before, after = (held_out(again, one, masks, none) for one in (result.experiment, changed))
    return before.position_error, after.position_error


def _gates(result: LogResult, changed: Experiment, gate: float) -> list[str]:
    """Return what a gate lets pass, with the filter as it is and with the found sizes."""
    limit = 2 * float(special.gammaincinv(SIX / 2, gate))
    found = []
    for words, run in (("the filter as it is", result), ("the found sizes", changed.run())):
        S = run.solution_arrays.innovation_covariance[run.solution_arrays.fix_sample >= 0]
        level = math.sqrt(limit * float(np.median(np.maximum(S[:, 0, 0], S[:, 1, 1]))))
        down = math.sqrt(limit * float(np.median(S[:, 2, 2])))
        found.append(
            f"With a gate of {gate:g} and {words}, a horizontal error below {metres(level)}, or a vertical "
            f"one below {metres(down)}, passes (median S of the used fixes, χ² of six components); an error "
            "that grows slowly passes at any size, since the filter follows it."
        )
    return found


def _by_satellites(fixes: _Fixes, found: dict[str, _Axis]) -> tuple[tuple[int, int, int, float], ...]:
    """Return the sizes of the innovations by numbers of satellites, if the receiver says and varies them."""
    groups = []
    nis, degrees = (
        np.sum([getattr(one, name) for one in found.values()], axis=0) for name in ("nis", "degrees")
    )
    for low, high in SATELLITES:
        rows = (fixes.satellites >= max(low, 1)) & (fixes.satellites <= high)
        if (count := int(rows.sum())) and degrees[rows].sum() > 0:
            groups.append((low, high, count, float(np.sqrt(nis[rows].sum() / degrees[rows].sum()))))
    return tuple(groups)
