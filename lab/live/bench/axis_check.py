"""Axis check: the axis map of a device, from positions in which it is held still and from turns by hand.

A device at rest measures the specific force upwards, so a named position tells which of its axes points up.
Two perpendicular positions give the map if the device sends the specific force; three show a mirror image. A
mirror image is the negative of a turn, so positions alone cannot tell a device that sends the negative force
from one with a wrong sign of one axis. The gyros tell: two turns about different axes give the map by
themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.calibration.imu_calibration import GRAVITY_SIGMA
from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.checks.imu_axes import iterate_signed_axes
from lab.data.streams.axis_map import AXES, AxisMap
from lab.live.bench.six_positions import AccelerometerErrors, accelerometer_errors
from lab.live.bench.static_interval import AxisCheckError, StaticInterval, net_turn, static_interval

Axis = tuple[int, int, int]

POSITIONS: Final[dict[str, Axis]] = {
    "level": (0, 0, -1),
    "nose up": (1, 0, 0),
    "right side down": (0, -1, 0),
    "nose down": (-1, 0, 0),
    "left side down": (0, 1, 0),
    "upside down": (0, 0, 1),
}
"""The direction upwards in each position, forward, right, down: that of the specific force."""
TURNS: Final[dict[str, Axis]] = {
    "turn right": (0, 0, 1),
    "turn nose up": (0, 1, 0),
    "turn right side down": (1, 0, 0),
}
"""The axis of each turn from level, forward, right, down, by the right-hand rule."""
TILT: Final = np.radians(20.0)
"""Largest angle between the vertical and the nearest axis of a held device [rad]: a hand errs by 10°, and at
45° the nearest axis is a guess."""
TURN_TILT: Final = np.radians(30.0)
"""Largest angle between a turn by hand and the nearest axis of the device [rad]: hands turn less straight
than they hold."""
LAST: Final = 3.0
"""Time before a person says "take" that is looked at for a still stretch [s]."""
TURN_TIME: Final = 6.0
"""Time before a person says "take" that counts as the turn [s]."""


def in_device_axes(rows: NDArray[np.void], axes: AxisMap) -> NDArray[np.void]:
    """Return samples that an axis map has resolved forward, right, down in the axes of the device again.

    Parameters
    ----------
    rows : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
        Samples.
    axes
        The map in force when they came.
    """
    rows = rows.copy()
    rows["rate"], rows["force"] = axes.unmapped(rows["rate"]), axes.unmapped(rows["force"], force=True)
    return rows


class AxisObservation(NamedTuple):
    """What a position or turn showed.

    Attributes
    ----------
    name : str
        Of `POSITIONS` or `TURNS`.
    named : tuple of int
        The axis of the vehicle that the name stands for.
    shown : tuple of int
        The nearest axis of the device.
    tilt : float
        Angle between what was measured and that axis [rad].
    """

    name: str
    named: Axis
    shown: Axis
    tilt: float


@dataclass(frozen=True, eq=False)
class CheckedAxes:
    """The outcome of a check.

    Attributes
    ----------
    axes : AxisMap
        The axis map of the device.
    sentence : str
        What was found, and what was assumed.
    accelerometer : AccelerometerErrors or None
        Bias and scale factor; None without all six positions.
    """

    axes: AxisMap
    sentence: str
    accelerometer: AccelerometerErrors | None = None


class AxisCheck:
    """Collects positions and turns, and finds the axis map.

    >>> check = AxisCheck()
    >>> check.missing
    'Hold the device still in two perpendicular positions, such as level and nose up.'

    Attributes
    ----------
    positions, turns : dict of str to AxisObservation
        What was taken, by name.
    still : dict of str to StaticInterval
        The means of each position.
    """

    def __init__(self) -> None:
        self.positions: dict[str, AxisObservation] = {}
        self.turns: dict[str, AxisObservation] = {}
        self.still: dict[str, StaticInterval] = {}

    def take(self, name: str, rows: NDArray[np.void]) -> AxisObservation:
        """Take a position or a turn; one of the same name is replaced.

        Parameters
        ----------
        name
            Of `POSITIONS` or `TURNS`.
        rows : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
            The last samples in the axes of the device: `LAST` seconds of a position, `TURN_TIME` of a turn.

        Raises
        ------
        AxisCheckError
            If the device was not held still or not turned, if no axis is vertical, or if another position or
            turn showed the same. Nothing is changed then.
        """
        if name in TURNS:
            return self._observe_turn(name, rows)
        if name not in POSITIONS:
            raise AxisCheckError(f"{name!r}; accepted are {', '.join((*POSITIONS, *TURNS))}")
        found = static_interval(rows)
        shown, tilt = _nearest_axis(found.force)
        if tilt > TILT:
            raise AxisCheckError(
                f"{name}: no axis of the device is vertical; the nearest, {_format_axis(shown)}, is "
                "tilted by "
                f"{np.degrees(tilt):.0f}°; accepted are {np.degrees(TILT):g}°"
            )
        _refuse_alike(name, shown, self.positions)
        self.still[name] = found
        self.positions[name] = AxisObservation(name, POSITIONS[name], shown, tilt)
        return self.positions[name]

    def forget(self) -> None:
        """Begin anew."""
        self.positions.clear()
        self.turns.clear()
        self.still.clear()

    @property
    def missing(self) -> str:
        """What is still needed for an axis map; empty if nothing is."""
        seen = {_line(one.named) for one in (*self.positions.values(), *self.turns.values())}
        if len(seen) >= 2:
            return ""
        if not seen:
            return "Hold the device still in two perpendicular positions, such as level and nose up."
        return "One more position is needed, perpendicular to this one, such as level and nose up."

    def result(self, gravity: float = STANDARD_GRAVITY, gravity_sigma: float = GRAVITY_SIGMA) -> CheckedAxes:
        """Return the axis map.

        Parameters
        ----------
        gravity, gravity_sigma
            Gravity at the place and its σ, for the scale factor of the accelerometers [m/s²].

        Raises
        ------
        AxisCheckError
            If there are too few positions, or they and the turns have no right-handed map in common.
        """
        if self.missing:
            raise AxisCheckError(self.missing)
        maps = [(C, sign) for sign in (1, -1) for C in _TURNS if self._fit(C, sign)]
        if not maps:
            raise AxisCheckError(self._why_none())
        C, sign = maps[0]
        if sign < 0:
            self._refuse_unproved()
        axes = AxisMap(tuple(_name(row) for row in C.tolist()), sign < 0)  # type: ignore[arg-type]
        errors = None
        if len(self.still) == len(POSITIONS):
            force = np.stack([self.still[name].force for name in POSITIONS])
            sigma = np.stack([self.still[name].force_sigma for name in POSITIONS])
            errors = accelerometer_errors(
                axes.mapped(force, force=True), np.abs(axes.mapped(sigma)), gravity, gravity_sigma
            )
        return CheckedAxes(axes, self._sentence(axes, assumed=len(maps) > 1), errors)

    def _observe_turn(self, name: str, rows: NDArray[np.void]) -> AxisObservation:
        # What the gyros showed in the positions is their bias, which six seconds of a turn would add up.
        bias = np.mean([one.rate for one in self.still.values()], axis=0) if self.still else None
        shown, tilt = _nearest_axis(net_turn(rows, bias))
        if tilt > TURN_TILT:
            raise AxisCheckError(
                f"{name}: the device turned about no single axis; the nearest, {_format_axis(shown)}, is "
                f"{np.degrees(tilt):.0f}° off; accepted are {np.degrees(TURN_TILT):g}°"
            )
        _refuse_alike(name, shown, self.turns)
        self.turns[name] = AxisObservation(name, TURNS[name], shown, tilt)
        return self.turns[name]

    def _fit(self, C: FloatArray, sign: int) -> bool:
        return _explains_observation(C, sign, self.positions) and _explains_observation(C, 1, self.turns)

    def _why_none(self) -> str:
        """Return why no right-handed map explains what was seen."""
        forces = [C for C in _ALL if _explains_observation(C, 1, self.positions)]
        if not forces:
            return (
                "The positions contradict each other: opposite faces must show opposite axes, "
                f"perpendicular faces different ones. Seen were {_list_observations(self.positions)}. "
                "Take them again."
            )
        if not any(_explains_observation(C, 1, self.turns) for C in _ALL):
            return (
                f"The turns contradict each other: seen were {_list_observations(self.turns)}. "
                "Take them again."
            )
        if not any(_explains_observation(C, 1, self.turns) for C in _TURNS):
            return (
                "The gyros form a mirror image (left-handed axes): the sign of one gyro is wrong, or a turn "
                f"went the other way. Seen were {_list_observations(self.turns)}."
            )
        return (
            "Gyros and accelerometers disagree: no right-handed axes explain both "
            f"{_list_observations(self.positions)} and {_list_observations(self.turns)}. The sign of one "
            "axis is wrong, or a "
            "position or turn was not the named one."
        )

    def _refuse_unproved(self) -> None:
        """Raise unless an inverted force and the wrong sign of one axis can be told apart.

        The sign of one axis can imitate an inverted force along that axis alone, and in the gyros too.
        """
        lines = [{_line(one.named) for one in seen.values()} for seen in (self.positions, self.turns)]
        if min(map(len, lines)) >= 2:
            return
        raise AxisCheckError(
            "The axes form a mirror image (left-handed): the device sends the negative of the specific "
            "force, or the sign of one axis is wrong. Two positions together with two turns about different "
            "axes show which."
        )

    def _sentence(self, axes: AxisMap, *, assumed: bool) -> str:
        forward, right, down = (axis.replace("-", "−") for axis in axes.axes)
        text = f"Axis {forward} of the device points forward, {right} right and {down} down"
        text += ", and it sends the negative of the specific force." if axes.inverted_force else "."
        if assumed:
            text += (
                " That the device does not send the negative force is assumed: a third perpendicular "
                "position or a turn checks it."
            )
        elif len({_line(one.named) for one in self.turns.values()}) < 2:
            text += " The signs of the gyros are not checked: two turns about different axes check them."
        return text


def _nearest_axis(vector: FloatArray) -> tuple[Axis, float]:
    """Return the signed axis next to a vector (3,), and the angle between them [rad]."""
    k = int(np.abs(vector).argmax())
    axis = [0, 0, 0]
    axis[k] = int(np.sign(vector[k]))
    angle = np.arccos(np.clip(abs(vector[k]) / np.linalg.norm(vector), 0, 1))
    return (axis[0], axis[1], axis[2]), float(angle)


def _refuse_alike(name: str, shown: Axis, others: dict[str, AxisObservation]) -> None:
    for other in others.values():
        if other.name != name and other.shown == shown:
            raise AxisCheckError(
                f"{name}: the device shows {_format_axis(shown)} as in {other.name}, so the two are alike; "
                "accepted is another face or another direction for each name"
            )


def _explains_observation(C: FloatArray, sign: int, seen: dict[str, AxisObservation]) -> bool:
    return all((sign * np.array(one.named) @ C == one.shown).all() for one in seen.values())


def _name(axis: Axis | list[float]) -> str:
    return next(name for name, row in AXES.items() if list(axis) == row)


def _format_axis(axis: Axis) -> str:
    """Return the name of an axis for a reader, with a minus sign."""
    return _name(axis).replace("-", "−")


def _line(axis: Axis) -> int:
    """Return the number of an axis without its sign."""
    return int(np.abs(axis).argmax())


def _list_observations(seen: dict[str, AxisObservation]) -> str:
    return ", ".join(f"{one.name} ({_format_axis(one.shown)})" for one in seen.values())


_ALL = tuple(iterate_signed_axes(range(3)))
"""All 48 arrangements of axes along axes, mirror images included."""
_TURNS = [C for C in _ALL if np.linalg.det(C) > 0]
"""The 24 of them that a device can be turned to."""
