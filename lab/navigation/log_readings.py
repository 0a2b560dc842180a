"""Log readings: what the sensors of a log besides IMU and GPS measured, as a filter uses it.

A sensor without one reading that can be used counts as absent: its states would be estimated from nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import AIDS, SERIES
from lab.base.arrays import FloatArray
from lab.data.log.auxiliary_data import Headings, Magnetometer, Series
from lab.data.log.log_remarks import clock_text, span_text
from lab.data.log.sensor_log import SensorLog
from lab.motion.frames.magnetic_field import magnetic_declination
from lab.sensors.heading_sensor import HEADING, MAGNETOMETER, check_field
from lab.sensors.readings import Readings
from lab.sensors.suite import SensorSuite

NAMES = {aid.name: aid.words for aid in sorted(AIDS, key=lambda aid: aid not in SERIES)}
"""What the groups of other sensors are called in a sentence."""


class LogReadings(NamedTuple):
    """What a log holds of one sensor, whether it can be used or not.

    Attributes
    ----------
    time : (k,) array
        Times of all readings [s].
    usable : (k,) array
        Mask of the readings during the log that show something.
    """

    time: FloatArray
    usable: NDArray[np.bool_]


def collect_readings(log: SensorLog, sensors: SensorSuite) -> dict[str, Readings]:
    """Return what the sensors besides IMU and GPS measured, if they are fitted, by their group.

    A sensor without a usable reading is left out.

    Raises
    ------
    SettingError
        If a magnetic field is to be used where it does not show the heading.
    """
    found = {}
    for name, one in _readings_in_log(log, sensors).items():
        if not sensors.aids()[name].get("fitted") or not one.usable.any():
            continue
        found[name] = _readings(log, sensors, name, one.usable)
    return found


def drop_sensors_without_readings(
    sensors: SensorSuite, readings: Mapping[str, Readings], log: SensorLog
) -> tuple[SensorSuite, list[str]]:
    """Return the sensors with only those fitted of which a log has readings, and remarks about the others."""
    own, remarks = sensors.copy(), []
    held = _readings_in_log(log, sensors)
    for name, words in NAMES.items():
        fitted, there = sensors.aids()[name].get("fitted"), held.get(name)
        if fitted and name not in readings:
            cause = "" if there is None else _cause(log, sensors, name, there)
            remarks.append(
                f"The log has no readings for sensors.{name}.fitted, which has no effect.{cause}"
                f"{_other_source(log, sensors, name)}"
            )
            own.set(f"{name}.fitted", False)
        elif there is not None and there.usable.any() and not fitted:
            remarks.append(
                f"The log has readings of a {words} that are not used; sensors.{name}.fitted = true "
                "uses them."
            )
    return own, remarks


def _readings_in_log(log: SensorLog, sensors: SensorSuite) -> dict[str, LogReadings]:
    """Return what a log holds of each sensor that has a file; of the source of headings that is chosen."""
    auxiliary = log.auxiliary
    magnetic = _is_magnetic(sensors)
    heading = auxiliary.magnetometer if magnetic else auxiliary.headings
    series: dict[str, Series | Magnetometer | Headings] = {**auxiliary.series}
    series |= {} if heading is None else {"heading": heading}
    found = {}
    for name, one in series.items():
        usable = (one.time > log.time[0]) & (one.time <= log.time[-1])
        if isinstance(one, Magnetometer):
            usable &= np.linalg.norm(one.field, axis=1) > 0
        elif isinstance(one, Series):
            usable &= sensors.aids()[name].usable(one.value)
        if not (usable & (one.time > _first_fix(log))).any():
            usable[:] = False  # nothing is navigated before the first fix
        found[name] = LogReadings(one.time, usable)
    return found


def _readings(log: SensorLog, sensors: SensorSuite, name: str, usable: NDArray[np.bool_]) -> Readings:
    """Return the usable readings of a sensor."""
    auxiliary = log.auxiliary
    if name != "heading":
        one = auxiliary.series[name]
        return Readings(one.time[usable], one.value[usable])
    if _is_magnetic(sensors):
        assert auxiliary.magnetometer is not None
        return _of_field(log, auxiliary.magnetometer, usable, float(sensors.heading.period))
    headings = auxiliary.headings
    assert headings is not None
    return Readings(headings.time[usable], headings.heading[usable], sigma=headings.sigma[usable])


def _of_field(
    log: SensorLog, magnetometer: Magnetometer, usable: NDArray[np.bool_], period: float
) -> Readings:
    """Return the magnetic field once in a period [s], since its errors are those of the vehicle's iron.

    The declination is that of the log, or of the World Magnetic Model at the first fix.

    Raises
    ------
    SettingError
        If it does not show the heading there.
    """
    check_field(log.gnss.position)
    rows = np.flatnonzero(usable)
    number = np.floor((magnetometer.time[rows] - log.time[0]) / period)
    rows = rows[np.flatnonzero(np.diff(number, prepend=-1.0))]
    declination = magnetometer.declination
    if not np.isfinite(declination):
        declination, _ = magnetic_declination(log.gnss.position[0])
    field = magnetometer.field[rows]
    field = field / np.linalg.norm(field, axis=1, keepdims=True)
    return Readings(magnetometer.time[rows], np.full(rows.size, declination), field)


def _cause(log: SensorLog, sensors: SensorSuite, name: str, one: LogReadings) -> str:
    """Return in a sentence why none of the readings that a log holds can be used."""
    what = "magnetometer" if name == "heading" and _is_magnetic(sensors) else NAMES[name]
    if not one.time.size:
        return f" The file of the {what} holds none."
    within = (one.time > log.time[0]) & (one.time <= log.time[-1])
    if within.any() and not (within & (one.time > _first_fix(log))).any():
        return (
            f" The readings of the {what} are of {span_text(one.time + log.epoch)}, and nothing is navigated "
            f"before the first fix at {clock_text(_first_fix(log) + log.epoch)} s."
        )
    if not within.any():
        return (
            f" The readings of the {what} are of {span_text(one.time + log.epoch)}, but the IMU recorded "
            f"{span_text(log.time + log.epoch)}: another clock is likely; accepted are readings of the clock "
            "of the IMU and of the same time."
        )
    return f" The readings of the {what} are all {sensors.aids()[name].UNUSED}."


def _first_fix(log: SensorLog) -> float:
    return float(log.gnss.time[0] - log.gnss.latency)


def _other_source(log: SensorLog, sensors: SensorSuite, name: str) -> str:
    """Return in a sentence which other source of headings a log has; empty if it has none."""
    magnetic = _is_magnetic(sensors)
    other = log.auxiliary.headings if magnetic else log.auxiliary.magnetometer
    if name != "heading" or other is None or not other.time.size:
        return ""
    return f" With sensors.heading.source = {HEADING if magnetic else MAGNETOMETER} it has some."


def _is_magnetic(sensors: SensorSuite) -> bool:
    return bool(sensors.heading.source == MAGNETOMETER)
