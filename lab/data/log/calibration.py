"""Calibration: the constant errors of a device that are removed from its samples, and their file.

The file is a TOML with a table for each sensor. All is in the axes of the device, as it sends or stores them:

    source = "bench.csv"          # what it was found from
    [accelerometer]               # measured = matrix · true + bias
    bias = [0.02, -0.11, 0.05]    # [m/s²]
    matrix = [[1.002, 0.0, 0.001], [0.0, 0.997, 0.0], [0.001, 0.0, 1.004]]
    [gyro]
    bias = [0.2, -0.1, 0.4]       # [°/s]
    matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    [magnetometer]
    bias = [12.0, -31.0, 4.5]     # hard iron [µT]
    matrix = [[1.1, 0.0, 0.0], [0.0, 0.95, 0.0], [0.0, 0.0, 0.96]]  # soft iron
    [mounting]
    roll_pitch_yaw = [0.0, 0.4, -0.7]  # of the axes in the vehicle, after `axes` [°]
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.atomic_file import write_file
from lab.base.files.description_toml import check_keys, read_toml
from lab.base.files.mission_error import MissionError
from lab.base.parameters.toml_file import toml_text
from lab.data.log.sensor_log import SensorLog
from lab.motion.frames.rotation import C_nb_from_euler

SCALES = {"accelerometer": 1.0, "gyro": float(np.radians(1.0)), "magnetometer": 1.0}
"""SI units (µT for fields) of one unit of the file."""
MOST_BIAS = {"accelerometer": 20.0, "gyro": 50.0, "magnetometer": 1000.0}
"""Largest biases that are accepted, in the units of the file: any more is a wrong unit."""
MOST_NUMBER = 1e6
"""Bound of all numbers of the file: none is ever near it, and not a number is not below it."""
MOST_SHAPE = 0.9
"""Largest difference of an entry of a matrix from the unit matrix: soft iron of half the field makes 0.5."""
LEAST_DETERMINANT = 0.05
"""Least determinant of a matrix: below, it nearly loses an axis."""
MOST_MOUNTING = 45.0
"""Largest angle of a mounting [°]: larger ones are said by `axes`."""
DIGITS = 9
"""Significant digits that are written: 1 ppm of the field and 1e-9 of gravity are below every sensor."""


@dataclass(frozen=True, eq=False)
class Linear:
    """The constant errors of a triad: measured = matrix · true + bias.

    Attributes
    ----------
    bias : (3,) array
        Bias [m/s²], [rad/s], or hard iron [µT].
    matrix : (3, 3) array
        Scale factors and misalignments, or soft iron.
    """

    bias: FloatArray
    matrix: FloatArray

    def removed(
        self, values: FloatArray, C: FloatArray | None = None, dt: FloatArray | None = None
    ) -> FloatArray:
        """Return values without these errors.

        Parameters
        ----------
        values : (n, 3) array
            What was measured, or its integrals over intervals.
        C : (3, 3) array
            Resolves vectors of the device in the axes of the values; None if they are those of the device.
        dt : (n,) array
            Lengths of the intervals [s], if the values are integrals.
        """
        inverse, bias = np.linalg.inv(self.matrix), self.bias
        if C is not None:
            inverse, bias = C @ inverse @ C.T, C @ bias
        return np.asarray((values - (bias if dt is None else dt[:, None] * bias)) @ inverse.T)


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is known of the constant errors of a device.

    Attributes
    ----------
    source : str
        What it was found from.
    accelerometer, gyro, magnetometer : Linear or None
        The errors of each; None if they are not known.
    mounting : (3,) array
        Roll, pitch, yaw of the axes in the vehicle [rad].
    """

    source: str = ""
    accelerometer: Linear | None = None
    gyro: Linear | None = None
    magnetometer: Linear | None = None
    mounting: FloatArray = field(default_factory=lambda: np.zeros(3))

    @property
    def is_empty(self) -> bool:
        """Whether it changes nothing."""
        return not self.linear and not self.mounting.any()

    @property
    def linear(self) -> dict[str, Linear]:
        """The sensors with known errors, by name."""
        found = {name: getattr(self, name) for name in SCALES}
        return {name: one for name, one in found.items() if one is not None}

    @property
    def turn(self) -> FloatArray:
        """Matrix (3, 3) that resolves vectors of the axes in the vehicle."""
        return np.asarray(C_nb_from_euler(self.mounting))

    @property
    def words(self) -> str:
        """What it holds, in words."""
        parts = [f"{name} bias and matrix" for name in self.linear]
        if self.mounting.any():
            roll, pitch, yaw = np.degrees(self.mounting)
            parts.append(f"mounting by roll {roll:.2f}°, pitch {pitch:.2f}°, yaw {yaw:.2f}°")
        return ", ".join(parts).replace("-", "−") or "nothing"

    def with_other(self, other: Calibration) -> Calibration:
        """Return this with what another one knows in its place."""
        own: dict[str, Any] = dict(other.linear)
        mounting = other.mounting if other.mounting.any() else self.mounting
        sources = [one for one in (self.source, other.source) if one]
        return replace(self, **own, mounting=mounting, source=", ".join(dict.fromkeys(sources)))

    def applied(self, log: SensorLog, C: FloatArray | None = None) -> SensorLog:
        """Return a log without these errors.

        Parameters
        ----------
        log
            The log.
        C : (3, 3) array
            Resolves vectors of the device in the axes of the log; None if they are the same.
        """
        dt = np.diff(log.time)
        # In a break there are no increments.
        begins = np.isin(log.time[:-1], log.breaks[:, 0])
        dtheta, dvelocity, auxiliary = log.dtheta, log.dvelocity, log.auxiliary
        if self.gyro is not None:
            dtheta = self.gyro.removed(dtheta, C, dt)
        if self.accelerometer is not None:
            dvelocity = self.accelerometer.removed(dvelocity, C, dt)
        dtheta, dvelocity = dtheta @ self.turn.T, dvelocity @ self.turn.T
        dtheta[begins], dvelocity[begins] = 0.0, 0.0
        if auxiliary.magnetometer is not None:
            measured = auxiliary.magnetometer.field
            if self.magnetometer is not None:
                measured = self.magnetometer.removed(measured, C)
            magnetometer = replace(auxiliary.magnetometer, field=measured @ self.turn.T)
            auxiliary = replace(auxiliary, magnetometer=magnetometer)
        said = f"A calibration was applied (of {self.source or 'an unnamed log'}): {self.words}."
        return replace(
            log,
            dtheta=np.ascontiguousarray(dtheta),
            dvelocity=np.ascontiguousarray(dvelocity),
            auxiliary=auxiliary,
            repairs=(*log.repairs, said),
        )

    def to_toml(self) -> str:
        """Return the text of its file."""
        values: dict[str, Any] = {"source": self.source}
        for name, one in self.linear.items():
            values[name] = {
                "bias": [_round_number(number) for number in one.bias / SCALES[name]],
                "matrix": [[_round_number(number) for number in row] for row in one.matrix],
            }
        if self.mounting.any():
            values["mounting"] = {
                "roll_pitch_yaw": [_round_number(number) for number in np.degrees(self.mounting)]
            }
        return toml_text(values)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write its file, whole or not at all."""
        write_file(Path(path), self.to_toml())


def _round_number(number: float) -> float:
    return float(f"{number:.{DIGITS}g}")


def read_calibration(path: str | os.PathLike[str]) -> Calibration:
    """Return the calibration in a file.

    Raises
    ------
    MissionError
        If the file cannot be read, or has a key or a number that is not accepted.
    """
    path = Path(path)
    values = read_toml(path)
    check_keys(path, values, ("source", *SCALES, "mounting"), ("source",))
    linear = {name: _linear(path, name, values[name]) for name in SCALES if name in values}
    mounting = np.zeros(3)
    if "mounting" in values:
        table = _table(path, "mounting", values["mounting"], ("roll_pitch_yaw",))
        mounting = np.radians(_numbers(path, "mounting.roll_pitch_yaw", table["roll_pitch_yaw"], (3,)))
        if (np.abs(mounting) > np.radians(MOST_MOUNTING)).any():
            raise MissionError(
                f"{path}: mounting.roll_pitch_yaw is beyond {MOST_MOUNTING:g}°; accepted are small "
                "angles, and axes "
                "of the log for the others"
            )
    found = Calibration(source=str(values.get("source", "")), **linear, mounting=mounting)
    if found.is_empty:
        raise MissionError(
            f"{path}: has no calibration; accepted are tables {', '.join(SCALES)} and mounting"
        )
    return found


def _table(path: Path, name: str, table: Any, keys: tuple[str, ...]) -> Mapping[str, Any]:
    if not isinstance(table, Mapping) or set(table) != set(keys):
        raise MissionError(
            f"{path}: {name} is not as accepted: a table with {' and '.join(keys)}, and nothing else"
        )
    return table


def _linear(path: Path, name: str, table: Any) -> Linear:
    table = _table(path, name, table, ("bias", "matrix"))
    bias = _numbers(path, f"{name}.bias", table["bias"], (3,))
    matrix = _numbers(path, f"{name}.matrix", table["matrix"], (3, 3))
    if (np.abs(bias) > MOST_BIAS[name]).any():
        raise MissionError(f"{path}: {name}.bias is beyond {MOST_BIAS[name]:g}; accepted are smaller ones")
    if (np.abs(matrix - np.eye(3)) > MOST_SHAPE).any() or np.linalg.det(matrix) < LEAST_DETERMINANT:
        raise MissionError(
            f"{path}: {name}.matrix is too far from the unit matrix; accepted are entries within "
            f"{MOST_SHAPE:g} of it"
        )
    return Linear(bias * SCALES[name], matrix)


def _numbers(path: Path, name: str, given: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return finite numbers of a shape."""
    flat: Any = (
        given if len(shape) == 1 else [one for row in given for one in row] if _is_rows(given) else None
    )
    right = isinstance(flat, list) and len(flat) == int(np.prod(shape))
    if not right or not all(isinstance(one, int | float) and not isinstance(one, bool) for one in flat):
        count = " by ".join(map(str, shape))
        raise MissionError(f"{path}: {name} = {str(given)[:80]}; accepted are {count} numbers")
    if not all(abs(one) < MOST_NUMBER for one in flat):
        raise MissionError(f"{path}: {name} has a number beyond {MOST_NUMBER:g}; accepted are smaller ones")
    return np.array(flat, dtype=np.float64).reshape(shape)


def _is_rows(given: Any) -> bool:
    rows = [given, *given] if isinstance(given, list) else []
    return len(rows) == 1 + 3 and all(isinstance(one, list) and len(one) == 3 for one in rows)
