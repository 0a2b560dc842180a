"""Rest: the output of an IMU at rest, logged or simulated, and a card made from it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lab.analysis import allan
from lab.base.arrays import FloatArray
from lab.base.files.file_content import check_file
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import STANDARD_GRAVITY, TO_SI
from lab.data.log.sensor_log import SensorLog
from lab.data.sheets.sensor_csv import sheets_of
from lab.data.sheets.sheet_imu import NAMED, imu_of
from lab.sensors import imu
from lab.sensors.cards import Card
from lab.sensors.datum import DENSITY, TWO_SIDED, Datum
from lab.sensors.suite import TRIADS, SensorSuite

LOG_COLUMNS = {
    "gyro": ("gx_rad_s", "gy_rad_s", "gz_rad_s"),
    "accelerometer": ("fx_m_s2", "fy_m_s2", "fz_m_s2"),
}
"""Columns of a log for each triad, besides the time ``t_s``: rates and specific forces in b."""
MAX_LOG_BYTES = 1024 * 2**20
"""Largest log accepted [bytes]."""
SAMPLES = 2**15
"""Number of samples of a simulated record."""
TERMS = {"N": "noise_density", "B": "flicker", "K": "rate_random_walk"}
"""The setting of each fitted noise term."""
SHOWN_AT_REST = (*TERMS.values(), "instability", "bandwidth", "quantisation")
"""Settings that shape the noise at rest: of these, a card of a record has `TERMS`."""
OTHER_TERMS = {
    "Q": ("quantisation_noise", "Quantisation noise", {"gyro": "″", "accelerometer": "mm/s"}),
    "R": ("rate_ramp", "Rate ramp", {"gyro": "°/h²", "accelerometer": "mg/h"}),
}
"""Name, label and units of the fitted terms without a setting."""

_PER_CORNER = 32
"""Number of samples within the averaging time at which bias instability exceeds white noise."""
_SHORTEST = 5e-4
"""Shortest time from sample to sample that is simulated: 2 kHz, the fastest rate of an IMU here [s]."""
_SHOWN = 2.0
"""A record does not show a term below this multiple of its σ. `allan.fit` states σ so that terms that are not
present are at most 1.5 σ and all others more than 4 σ, so any number in between separates them."""
_STILL = 0.5
"""Largest change of the specific force over a record at rest, between means over a hundredth of it [m/s²]."""
_PARTS, _SAMPLES_PER_PART = 100, 4
"""Most parts of a record whose means are compared, and fewest samples of each, which average out noise."""
_LONGEST_STEP = 1.5
"""Longest step between samples, in usual ones: a step over one lost sample takes two."""
OFF_GRAVITY = 0.1
"""Part by which the specific force at rest may differ from gravity: bias and scale factor of a consumer
accelerometer make 0.3 m/s² and 3 %, a wrong unit a factor of 9.8."""


class Record(NamedTuple):
    """The output of a triad at rest.

    Attributes
    ----------
    rates : (n, 3) array
        Rates [rad/s] or specific forces [m/s²].
    dt : float
        Time from sample to sample [s].
    """

    rates: FloatArray
    dt: float

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return len(self.rates) * self.dt


def read_log(path: Path) -> dict[str, Record]:
    """Read a log of an IMU at rest: a csv with the columns ``t_s`` and `LOG_COLUMNS`; others are ignored.

    Other headings are accepted if they name their units (`lab.data.sheets.column_names`).

    Returns
    -------
    dict of str to Record
        The gyros and the accelerometers.

    Raises
    ------
    MissionError
        Naming file, row and column: if the file cannot be read, a column is missing, a cell is not a finite
        number, the samples are not equally spaced, or the IMU was not at rest.
    """
    table = _table(path)
    time = table[:, 0]
    steps = np.diff(time)
    dt = float(np.median(steps))
    bad = np.flatnonzero((steps <= 0) | (steps > _LONGEST_STEP * dt))
    if bad.size or dt <= 0:
        row = int(bad[0]) if bad.size else 0
        raise MissionError(
            f"{path}, row {row + 3}, column t_s: from {time[row]:.9g} to {time[row + 1]:.9g} s; accepted are "
            f"equally spaced samples without gaps (here every {dt:.4g} s)"
        )
    dt = float(time[-1] - time[0]) / (len(time) - 1)
    records = {triad: Record(table[:, 1 + 3 * i : 4 + 3 * i], dt) for i, triad in enumerate(TRIADS)}
    _check_rest(path, records["accelerometer"].rates)
    return records


def of_log(log: SensorLog, length: float) -> dict[str, Record]:
    """Return the beginning of a log, during which the vehicle was at rest.

    Parameters
    ----------
    log
        The log; its samples are treated as equally spaced.
    length
        Duration of the rest [s].
    """
    count = int(np.searchsorted(log.time, length, side="right")) - 1
    dt = float(log.time[count] / count)
    return {triad: Record(rates[:count], dt) for triad, rates in zip(TRIADS, log.rates, strict=True)}


def simulate(sensors: SensorSuite, seed: int = 1) -> dict[str, Record]:
    """Return the simulated output of the sensors at rest, long enough to fit their noise terms.

    It contains only the errors, without the Earth's rate and gravity, which do not affect the Allan
    deviation. The sample interval of each triad is chosen so that white noise and bias instability both show.

    Parameters
    ----------
    sensors
        The errors of the sensors.
    seed
        Seed of the draws.
    """
    records = {}
    for triad in TRIADS:
        errors: Any = sensors.groups()[triad]
        draws = imu.ImuDraws.of(
            seed,
            triad,
            SAMPLES,
            instability=any(errors.instability),
            flicker=any(errors.flicker),
            walk=any(errors.rate_random_walk),
        )
        dt = _spacing(errors)
        increments = imu.measure(np.zeros((SAMPLES, 3)), dt, errors, draws).increments
        records[triad] = Record(increments / dt, dt)
    return records


def noise_terms(records: Mapping[str, Record]) -> dict[str, allan.NoiseTerms]:
    """Return the noise terms fitted to each triad, in SI units."""
    return {triad: allan.fit(allan.deviation(record.rates, record.dt)) for triad, record in records.items()}


def in_setting_units(triad: str, terms: allan.NoiseTerms) -> dict[str, dict[str, Any]]:
    """Return fitted terms by name: label, unit, and a value and σ for each axis.

    The terms of `TERMS` are settings, in their units; those of `OTHER_TERMS` follow.

    Parameters
    ----------
    triad
        ``"gyro"`` or ``"accelerometer"``.
    terms
        Its terms in SI units.
    """
    group = SensorSuite().groups()[triad]
    named = {
        letter: (name, str(group.param[name].label), group.param[name].unit) for letter, name in TERMS.items()
    }
    named |= {letter: (name, label, units[triad]) for letter, (name, label, units) in OTHER_TERMS.items()}
    out = {}
    for letter, (name, label, unit) in named.items():
        values, sigmas = getattr(terms, letter), getattr(terms, f"{letter}_sigma")
        scale = TO_SI[unit]
        out[name] = {"label": label, "unit": unit, "value": values / scale, "sigma": sigmas / scale}
    return out


def misfit(fitted: Mapping[str, allan.NoiseTerms]) -> str:
    """Return a sentence about the axes that the five terms do not explain; empty if there are none.

    Parameters
    ----------
    fitted
        The terms of each triad.
    """
    poor = [
        f"{triad} {axis} (p {p_value:.1g})"
        for triad, terms in fitted.items()
        for axis, p_value in zip("xyz", terms.p_value, strict=True)
        if p_value < allan.FITS
    ]
    if not poor:
        return ""
    return (
        f"The five terms do not explain the Allan deviation of {', '.join(poor)}. Other possible causes are "
        "vibration, a changing temperature, or a bias with a correlation time."
    )


def card_of(name: str, records: Mapping[str, Record], source: str) -> Card:
    """Return a card of an IMU from its record at rest.

    A term that the record does not show (below twice its σ on every axis) is omitted; so are quantisation
    noise and ramp, which have no setting. A record at rest does not show turn-on bias, scale factor, range
    and bandwidth, so these are missing too. The note names poor fits.

    Parameters
    ----------
    name
        Name of the card.
    records
        Records of gyros and accelerometers, such as from `read_log`.
    source
        Source of the records.
    """
    groups, found = {}, noise_terms(records)
    for triad, terms in found.items():
        record = records[triad]
        where = f"Allan deviation of {source}: {record.duration:.0f} s at rest, {1 / record.dt:.5g} Hz"
        groups[triad] = {
            setting: Datum(
                tuple(float(f"{value:.4g}") for value in fitted["value"]),
                fitted["unit"],
                where,
                TWO_SIDED if setting == DENSITY else "",
            )
            for setting, fitted in in_setting_units(triad, terms).items()
            if setting in TERMS.values() and (fitted["value"] > _SHOWN * fitted["sigma"]).any()
        }
    return Card(name=name, maker="", grade="own", note=misfit(found), terms=groups)


def with_noise(sensors: SensorSuite, card: Card) -> SensorSuite:
    """Return sensors with the noise of a card that was made of a record at rest.

    Everything that such a record does not show, such as turn-on bias, scale factor and range, stays. A filter
    that took it for zero would be overconfident by far.

    Parameters
    ----------
    sensors
        The sensors; they are not changed.
    card
        From `card_of`. What it omits of noise, its record did not show: it is zero.
    """
    sensors = sensors.copy()
    for triad in TRIADS:
        for name in SHOWN_AT_REST:
            zero = [0.0] * 3
            sensors.set(f"{triad}.{name}", zero if (value := card.value(triad, name)) is None else value)
    return sensors


def _spacing(errors: Any) -> float:
    white, flicker = (
        float(np.mean(getattr(errors, name))) * TO_SI[errors.param[name].unit]
        for name in ("noise_density", "flicker")
    )
    if not (white and flicker):
        return 1.0
    return max((white / (allan.FLOOR * flicker)) ** 2 / _PER_CORNER, _SHORTEST)


def _table(path: Path) -> FloatArray:
    import pandas as pd  # noqa: PLC0415 - slow to import, and only reading needs it

    check_file(path, MAX_LOG_BYTES)
    columns = ["t_s", *LOG_COLUMNS["gyro"], *LOG_COLUMNS["accelerometer"]]
    try:
        header = pd.read_csv(path, nrows=0, skipinitialspace=True).columns
        missing = [column for column in columns if column not in header]
        if len(missing) > len(columns) - 2:  # other names, and not a slip in one
            return _with_other_names(path)
        if missing:
            raise MissionError(
                f"{path}, row 1: column {missing[0]} missing; accepted are {', '.join(columns)}"
            )
        frame = pd.read_csv(path, usecols=columns, skipinitialspace=True, low_memory=False)[columns]
    except (OSError, ValueError) as error:
        if isinstance(error, MissionError):
            raise
        reason = str(error).strip().partition("\n")[0]
        raise MissionError(f"{path}: cannot be read as a csv: {reason}") from error
    table: FloatArray = frame.apply(pd.to_numeric, errors="coerce").to_numpy(np.float64)
    bad = np.argwhere(~np.isfinite(table))
    if bad.size:
        row, column = bad[0]
        shown = frame.iloc[row, column]
        raise MissionError(
            f"{path}, row {row + 2}, column {columns[column]}: {shown!r}; accepted is a finite number"
        )
    _check_length(path, len(table))
    return table


def _with_other_names(path: Path) -> FloatArray:
    """Return time, rates and specific forces of a csv with other headings, in the axes of the device."""
    imu = imu_of(sheets_of([path], {}))
    for triad in (imu.gyro, imu.accelerometer):
        if triad.source != NAMED:
            raise MissionError(
                f"{path}: the columns {', '.join(one.text for one in triad.headings)} do not name their "
                "unit, and at rest nothing shows it; accepted are headings such as gyro_x_deg_s and accel_x_g"
            )
    known = np.isfinite(imu.samples).all(axis=1)
    _check_length(path, int(known.sum()))
    return np.column_stack((imu.time, imu.samples))[known]


def _check_length(path: Path, samples: int) -> None:
    if samples < allan.MIN_SAMPLES:
        raise MissionError(f"{path}: {samples} samples; accepted are at least {allan.MIN_SAMPLES}")


def _check_rest(path: Path, specific_force: FloatArray) -> None:
    """Raise `MissionError` if this is not the specific force of a body at rest."""
    size = float(np.linalg.norm(specific_force.mean(axis=0)))
    if abs(size - STANDARD_GRAVITY) > OFF_GRAVITY * STANDARD_GRAVITY:
        hint = "; this looks like g" if abs(size - 1) < OFF_GRAVITY else ""
        raise MissionError(
            f"{path}: the mean specific force is {size:.4g} m/s²{hint}; accepted is a record at rest, with "
            "about 9.8 m/s²"
        )
    parts = min(_PARTS, len(specific_force) // _SAMPLES_PER_PART)
    means = np.stack([part.mean(axis=0) for part in np.array_split(specific_force, parts)])
    change = float(np.ptp(means, axis=0).max())
    if change > _STILL:
        raise MissionError(
            f"{path}: the specific force changes by {change:.3g} m/s²; accepted is a record at rest"
        )
