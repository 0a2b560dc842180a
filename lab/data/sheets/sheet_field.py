"""Sheet field: the magnetometer out of the sheets of a log, in the axes of its IMU, if it shows the heading.

The field has to be that of the Earth at the place: its horizontal and its vertical part, by the direction of
the specific force, may differ from the World Magnetic Model by what the σ of a magnetic heading allows. Iron
near the sensor and wrong axes show there. Iron that turns the field about the vertical alone does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray, interpolate_columns
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.files.streams import Stream
from lab.data.files.unit_names import UNITS
from lab.data.log.auxiliary_data import Magnetometer
from lab.data.log.sensor_log import SensorLog
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_imu import NAMED, Triad, is_of_another_device, triads
from lab.motion.frames.magnetic_field import magnetic_field

_HEADING_SIGMA = np.radians(10.0)
"""σ of a magnetic heading [rad], as `lab.navigation.alignment.initial_heading` takes it."""
_SIGMAS = 1.5
"""Error of the field, in the σ that turns the heading by this much, up to which the field is the Earth's.
Measured over all directions at 48° N: with iron of 5 µT all pass, with 40 µT 3 %, and none if the phone turns
by 90°."""
_BLOCK = 2.0
"""Time over which the field is levelled by the mean specific force [s]: some steps of a walker."""
_FITTING = 0.8
"""Part of these times in which the field has to be the Earth's: cars and gates pass."""
_MIN_READINGS = 10
"""Fewest readings that differ from the one before: a sensor that is stuck has one."""
_SIZES = (20.0, 70.0)
"""Size of the Earth's field [µT]: 22 to 67 µT at sea level."""


class Found(NamedTuple):
    """The magnetometer of a log, if it may be used.

    Attributes
    ----------
    magnetometer : Magnetometer or None
        In forward, right, down, with the times of the log.
    remarks : tuple of str
        The report: what was taken, or why nothing was.
    """

    magnetometer: Magnetometer | None
    remarks: tuple[str, ...]


def find_magnetometer(sheets: Sequence[Sheet], log: SensorLog, C: FloatArray) -> Found:
    """Return the magnetometer of a log: the best whose field is that of the Earth.

    Parameters
    ----------
    sheets
        The tables of the log.
    log
        Its IMU and receiver, in forward, right, down.
    C : (3, 3) array
        Takes vectors in the axes of the IMU to forward, right, down.
    """
    position = log.gnss.position[np.isfinite(log.gnss.position).all(axis=1)]
    candidates = [one for one in triads(sheets, "field") if not is_of_another_device(one.sheet)]
    if not candidates or not len(position):
        return Found(None, ())
    earth = magnetic_field(position[0])
    refused: list[str] = []
    for triad in candidates:
        found = _checked(triad, log, C, earth)
        if found.magnetometer is not None:
            others = [one.place for one in candidates if one is not triad]
            more = [f"Other magnetometers in the files are not used: {', '.join(others)}."] if others else []
            return Found(found.magnetometer, (*found.remarks, *more))
        refused += found.remarks
    return Found(None, tuple(refused[:1]))


def _checked(triad: Triad, log: SensorLog, C: FloatArray, earth: FloatArray) -> Found:
    """Return one magnetometer in b, if its field is that of the Earth (3,), north, east, down [µT]."""
    stream = _stream(triad, log)
    size = float(np.median(np.linalg.norm(stream.values, axis=1))) if len(stream.time) else 0.0
    if len(stream.time) < _MIN_READINGS or not size > 0:
        return Found(None, (f"The magnetometer {triad.place} is not used: it does not change.",))
    unit, source = triad.unit, NAMED
    if not unit:
        unit = min(UNITS["magnetic field"], key=lambda one: abs(np.log(_size(size, one) / _norm(earth))))
        source = f"guessed: it is {size:.3g} long"
    if not triad.unit and not _SIZES[0] < _size(size, unit) < _SIZES[1]:
        return Found(None, ())  # a short name such as mx may be anything
    field = stream.values @ C.T * UNITS["magnetic field"][unit]
    fitting = _is_of_the_earth(stream.time, field, log, earth)
    share = float(fitting.mean())
    strength = f"{_size(size, unit):.3g} µT long, and the Earth's field there is {_norm(earth):.3g} µT"
    if share < _FITTING:
        return Found(None, (_refusal(triad, strength, size, earth, share),))
    taken = Magnetometer(stream.time[fitting], field[fitting])
    left = f"; {1 - share:.0%} of the time it is not the Earth's, and left out" if share < 1 else ""
    report = triad._replace(unit=unit, source=source).report
    return Found(taken, (f"Magnetometer: {report}, {stream.rate:.3g} Hz; it is {strength}{left}.",))


def _norm(vector: FloatArray) -> float:
    return float(np.linalg.norm(vector))


def _size(size: float, unit: str) -> float:
    """Return a size in a unit in µT."""
    return size * UNITS["magnetic field"][unit]


def _stream(triad: Triad, log: SensorLog) -> Stream:
    """Return readings within a log, in its time; those that a table repeats are left out."""
    time, values = triad.clock.time - log.epoch, triad.values
    within = (time > log.time[0] - _BLOCK) & (time < log.time[-1])
    stream = Stream.of("magnetometer", time, values, within)
    new = np.append(True, (np.diff(stream.values, axis=0) != 0).any(axis=1))[: len(stream.time)]
    return Stream.of("magnetometer", stream.time[new], stream.values[new])


def _is_of_the_earth(
    time: FloatArray, field: FloatArray, log: SensorLog, earth: FloatArray
) -> NDArray[np.bool_]:
    """Return in which readings (n, 3) in b [µT] the field is that of the Earth."""
    force = interpolate_columns(time, log.time[1:], log.rates[1])
    number = np.unique(np.floor(time / _BLOCK), return_inverse=True)[1]
    count = np.bincount(number)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(number, values) / count)

    # At rest the specific force points up, and is g long.
    down = -mean(np.einsum("ij,ij->i", field, force)) / STANDARD_GRAVITY
    level = np.sqrt(np.maximum(mean(np.einsum("ij,ij->i", field, field)) - down**2, 0.0))
    horizontal = float(np.hypot(earth[0], earth[1]))
    most = _SIGMAS * _HEADING_SIGMA * horizontal
    fits = (np.abs(level - horizontal) < most) & (np.abs(down - earth[2]) < most)
    return np.asarray(fits[number])


def _refusal(triad: Triad, strength: str, size: float, earth: FloatArray, share: float) -> str:
    """Return why a magnetometer is not used, with the unit that its numbers look like."""
    fitting = [
        unit for unit in UNITS["magnetic field"]
        if abs(_size(size, unit) / _norm(earth) - 1) < 1 - _FITTING and unit != triad.unit
    ]  # fmt: skip
    hint = f" The numbers look like {fitting[0]}: state the unit." if fitting and triad.unit else ""
    return (
        f"The magnetometer {triad.place} is not used: it is {strength}, and its horizontal and vertical part "
        f"are those of the Earth's for {share:.0%} of the time. Iron nearby, a missing calibration, or "
        f"axes other than the IMU's are likely.{hint}"
    )
