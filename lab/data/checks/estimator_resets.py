"""Estimator resets: where an autopilot's filter jumped to another solution without motion.

A filter that detects a wrong heading, velocity or position resets it within one step. PX4 counts these
resets. Where they are not counted, a reset is a step many times larger than its neighbours and faster than
a vehicle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray, IntArray
from lab.motion.frames import ecef

_NEIGHBOURS = 3
"""Steps on each side with which a step is compared."""
_USUAL = 0.95
"""Quantile of the steps of a path that counts as usual: more are jumps in no recording that is of use."""
_MIN_OUTSTANDING = 4.0
"""Size of a step over the largest of its neighbours from which it stands out."""


@dataclass(frozen=True)
class Kind:
    """A quantity that is reset.

    Attributes
    ----------
    words : str
        Name of the quantity.
    unit : str
        Unit in which its steps are reported.
    steps : callable
        Lengths (n - 1,) of the steps between values (n, k), in that unit.
    counted, seen, fastest : float
        Smallest step that matters where it is counted, and where it only stands out [unit]; how fast no
        vehicle changes the quantity [unit/s].
    """

    words: str
    unit: str
    steps: Callable[[FloatArray], FloatArray]
    counted: float
    seen: float
    fastest: float


def _rotation_steps(q: FloatArray) -> FloatArray:
    attitude = Rotation.from_quat(q, scalar_first=True)
    return np.asarray(np.degrees((attitude[:-1].inv() * attitude[1:]).magnitude()))


def _position_steps(position: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(np.diff(ecef.position(position), axis=0), axis=1))


def _velocity_steps(velocity: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(np.diff(velocity, axis=0), axis=1))


ATTITUDE = Kind("the attitude", "°", _rotation_steps, counted=1.0, seen=3.0, fastest=100.0)
"""Copters tumble at 500 °/s and more, but not for one message: 100 °/s for a single step is no motion."""
VELOCITY = Kind("the velocity", "m/s", _velocity_steps, counted=0.5, seen=3.0, fastest=60.0)
"""A hard landing stops 2 m/s at once; 60 m/s² is six times gravity."""
POSITION = Kind("the position", "m", _position_steps, counted=3.0, seen=10.0, fastest=200.0)
"""Fixes move an estimate by a metre or two; 200 m/s is beyond the vehicles of these autopilots."""
JUMP = Kind("the position", "m", _position_steps, counted=3.0, seen=20.0, fastest=100.0)
"""A reset of an estimator of which nothing else is known: 100 m/s beyond the motion around it, in one
step."""


def resets(kind: Kind, time: FloatArray, values: FloatArray, counter: FloatArray | None) -> IntArray:
    """Return the indices of the first values after each reset.

    Parameters
    ----------
    kind
        What the values are.
    time : (n,) array
        Their times [s].
    values : (n, k) array
        Quaternions, velocities [m/s] or latitude, longitude [rad] and height [m].
    counter : (n,) array or None
        Which changes with each reset, where the log has one.
    """
    if len(time) < 2 * _NEIGHBOURS + 2:
        return np.empty(0, np.int64)
    steps = kind.steps(values)
    around = np.pad(steps, _NEIGHBOURS)
    windows = np.lib.stride_tricks.sliding_window_view(around, 2 * _NEIGHBOURS + 1).copy()
    windows[:, _NEIGHBOURS] = 0.0
    # Remainder of a step after subtraction of the motion before and after it.
    excess = steps - np.median(windows, axis=1)
    if counter is not None:
        found = (np.diff(counter) != 0) & (excess > kind.counted)
    else:
        alone = steps > _MIN_OUTSTANDING * windows.max(axis=1)
        found = alone & (excess > kind.seen) & (excess > kind.fastest * np.diff(time))
    return np.flatnonzero(found) + 1


def jumps(time: FloatArray, position: FloatArray) -> IntArray:
    """Return the indices of the first positions after each jump of a path that nothing says is a reset.

    A path of positions that are held between fixes steps all the time: a jump is far beyond its usual steps.

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    position : (n, 3) array
        Latitude, longitude [rad] and height [m].
    """
    steps = _position_steps(position)
    if not ((steps > JUMP.seen) & (steps > JUMP.fastest * np.diff(time))).any():
        return np.empty(0, np.int64)
    usual = float(np.quantile(steps[steps > 0], _USUAL))
    found = resets(JUMP, time, position, None)
    return found[steps[found - 1] > _MIN_OUTSTANDING * usual]


def reported_step(kind: Kind, values: FloatArray, at: int) -> str:
    """Return how far a quantity jumped."""
    return f"{kind.words} by {kind.steps(values[at - 1 : at + 1])[0]:.3g} {kind.unit}".replace(" °", "°")
