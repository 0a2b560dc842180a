"""FIT IMU: the gyros and accelerometers of cameras and watches in FIT files, as tables with named columns.

A message has up to thirty samples of one sensor, each with its time after that of the message. Samples are
calibrated, or counts of a converter with a calibration: (counts − level shift − offset) factor / divisor,
turned by a matrix. Axes are those of the device, which gravity and motion show.

References
----------
Garmin, *FIT SDK*, messages ``gyroscope_data``, ``accelerometer_data``, ``three_d_sensor_calibration``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray, interpolate_columns
from lab.base.files.mission_error import MissionError
from lab.data.files.fit import NAME, Points, messages, time_of

_GYRO, _ACCELEROMETER, _CALIBRATION = 164, 165, 167
"""Numbers of the messages (FIT profile)."""
_NAMES = {_GYRO: ("gyro", "gyroscope"), _ACCELEROMETER: ("accel", "accelerometer")}
"""How fields begin, and the type of sensor in its calibration."""
_COMPRESSED = 1e-3
"""Unit of compressed accelerations [g]."""
_MOST_STEPS = 2.5
"""Longest time between two samples over which one sensor is interpolated to the times of the other, in usual
steps."""
_FORM = "%.6f,%.9g,%.9g,%.9g,%.9g,%.9g,%.9g\n"
_IMU_HEAD = "time [s],gyr_x [deg/s],gyr_y [deg/s],gyr_z [deg/s],acc_x [g],acc_y [g],acc_z [g]\n"
_FIX_FORM = "%.6f,%.12f,%.12f,%.6g,%.6g,%.6g,%.6g\n"
_FIX_HEAD = "time [s],latitude [deg],longitude [deg],altitude [m],speed [m/s],course [deg],vel_d [m/s]\n"
_BLOCK = 10_000
"""Rows that are made to text at a time."""


@dataclass
class _Sensor:
    """The samples of a sensor, and its latest calibration."""

    name: str
    times: list[FloatArray] = field(default_factory=list)
    values: list[FloatArray] = field(default_factory=list)
    calibration: Mapping[str, Any] | None = None
    uncalibrated: int = 0

    def accept(self, message: Mapping[str, Any]) -> None:
        """Take the samples of a message."""
        after = _numbers(message.get("sample_time_offset"))
        vectors = self._vectors(message)
        count = min(len(vectors), len(after))
        if count:
            self.times.append(time_of(message) + 1e-3 * after[:count])
            self.values.append(vectors[:count])

    def _vectors(self, message: Mapping[str, Any]) -> FloatArray:
        """Return the samples (k, 3) in °/s or g."""
        for begin, unit in (("calibrated_", 1.0), ("compressed_calibrated_", _COMPRESSED)):
            found = _triad(message, begin + self.name)
            if len(found):
                return unit * found
        counts = _triad(message, self.name)
        if not len(counts):
            return counts
        scale = _calibration(self.calibration or {})
        if scale is None:
            self.uncalibrated += len(counts)
            return np.empty((0, 3))
        factor, offset, matrix = scale
        return np.asarray((counts - offset) * factor @ matrix.T)

    @property
    def samples(self) -> tuple[FloatArray, FloatArray]:
        """Times (n,) and values (n, 3) in order of time, each time once, without those unknown."""
        time, values = np.concatenate(self.times), np.concatenate(self.values)
        known = np.isfinite(time) & np.isfinite(values).all(axis=1)
        time, first = np.unique(time[known], return_index=True)
        return time, values[known][first]


def _numbers(value: object) -> FloatArray:
    """Return the numbers (k,) of a field, NaN for those that are none."""
    found = value if isinstance(value, tuple) else (value,)
    if value is None:
        return np.empty(0)
    return np.array([one if isinstance(one, int | float) else np.nan for one in found], dtype=float)


def _triad(message: Mapping[str, Any], name: str) -> FloatArray:
    """Return x, y, z (k, 3) of fields that begin alike."""
    columns = [_numbers(message.get(f"{name}_{axis}")) for axis in "xyz"]
    count = min(map(len, columns))
    return np.column_stack([column[:count] for column in columns])


def _calibration(values: Mapping[str, Any]) -> tuple[float, FloatArray, FloatArray] | None:
    """Return factor, offset (3,) and matrix (3, 3) of a calibration; None if it lacks one."""
    factor = next(
        (one for name, one in values.items() if name.endswith(("cal_factor", "calibration_factor"))), None
    )
    divisor, level = values.get("calibration_divisor"), values.get("level_shift")
    offset, matrix = _numbers(values.get("offset_cal")), _numbers(values.get("orientation_matrix"))
    numbers = [_numbers(one) for one in (factor, divisor, level)]
    if any(len(one) != 1 or not np.isfinite(one).all() for one in numbers) or not numbers[1][0]:
        return None
    if len(offset) != len("xyz") or len(matrix) != len("xyz") ** 2:
        return None
    return float(numbers[0][0] / numbers[1][0]), numbers[2][0] + offset, matrix.reshape(3, 3)


def tables(path: Path, data: bytes) -> list[tuple[str, bytes]]:
    """Return the IMU and the fixes of a file as csv, each with a name.

    Raises
    ------
    MissionError
        If the file has no gyros, no accelerometers or no positions, or fitdecode is not installed.
    """
    points, sensors = Points(), {number: _Sensor(name) for number, (name, _) in _NAMES.items()}
    of_type = {kind: sensors[number] for number, (_, kind) in _NAMES.items()}
    for number, values in messages(path, data, points, (*sensors, _CALIBRATION)):
        if number in sensors:
            sensors[number].accept(values)
        elif number != _CALIBRATION:
            points.accept(number, values)
        elif (sensor := of_type.get(str(values.get("sensor_type")))) is not None:
            sensor.calibration = values
    for number, sensor in sensors.items():
        if not sensor.times:
            why = f": its {sensor.uncalibrated} samples have no calibration" if sensor.uncalibrated else ""
            raise MissionError(
                f"{path}: the {NAME} file has no {_NAMES[number][1]} that can be used{why}; accepted as "
                "a log are files with both and with positions, as of cameras"
            )
    (time, rates), (others, forces) = sensors[_GYRO].samples, sensors[_ACCELEROMETER].samples
    imu = np.column_stack((time, rates, _interpolate_values(time, others, forces)))
    imu = imu[np.isfinite(imu).all(axis=1)]
    kind = points.best(path)
    fixes = kind.fixes
    columns = (fixes.time, fixes.latitude, fixes.longitude, fixes.height, kind.speed, kind.heading, kind.down)
    table = np.column_stack([np.array(column) for column in columns])
    return [
        (f"{path.name} imu", _csv(_IMU_HEAD, _FORM, imu)),
        (f"{path.name} gps", _csv(_FIX_HEAD, _FIX_FORM, table)),
    ]


def _interpolate_values(time: FloatArray, own: FloatArray, values: FloatArray) -> FloatArray:
    """Return values (n, 3) at other times, NaN in gaps."""
    if len(own) < 2:
        return np.full((len(time), 3), np.nan)
    found = interpolate_columns(time, own, values, np.nan)
    steps = np.diff(own)
    after = np.clip(np.searchsorted(own, time), 1, len(own) - 1)
    found[(steps[after - 1] > _MOST_STEPS * np.median(steps)) & (own[after] != time)] = np.nan
    return found


def _csv(head: str, form: str, table: FloatArray) -> bytes:
    """Return a table as text, an empty cell for NaN."""
    blocks = [
        "".join([form % tuple(row) for row in table[start : start + _BLOCK].tolist()])
        for start in range(0, len(table), _BLOCK)
    ]
    return (head + "".join(blocks).replace("nan", "")).encode()
