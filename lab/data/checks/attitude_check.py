"""Attitude check: whether heading, pitch and roll belong to the motion.

A vehicle that moves where its nose points has its course as heading, but for wind and sideslip. An aircraft
banks into its turns, and its pitch follows the slope of its path. What hangs on its thrust or lift
accelerates where it leans, wherever it points: then the specific force shows that its heading is right
although the course does not. Rates are the change of the attitude.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.data.checks import limits
from lab.data.checks.likeness import Likeness, likeness
from lab.motion.frames.rotation import wrap


class HeadingFound(NamedTuple):
    """A heading that is not the course.

    Attributes
    ----------
    angle : float
        Median angle between both [rad].
    cause : str
        What makes the heading the course; empty if nothing does.
    """

    angle: float
    cause: str


def heading_fault(velocity_n: FloatArray, yaw: FloatArray) -> HeadingFound | None:
    """Return how a heading differs from the course by more than wind explains.

    Parameters
    ----------
    velocity_n : (n, 3) array
        In motion, north, east, down [m/s].
    yaw : (n,) array
        Heading [rad].
    """
    course = np.arctan2(velocity_n[:, 1], velocity_n[:, 0])
    off = _usual_angle(yaw - course)
    if off < limits.LOG.crab:
        return None
    others = {
        "radians read as degrees": np.degrees(yaw),
        "degrees read as radians": np.radians(yaw),
        "it has the opposite sign": -yaw,
        "counted from east, anticlockwise": np.pi / 2 - yaw,
        "it is reversed by 180°": yaw + np.pi,
    }
    left = {cause: _usual_angle(other - course) for cause, other in others.items()}
    best = min(left, key=lambda one: left[one])
    return HeadingFound(off, best if left[best] < limits.LOG.heading_left * off else "")


def compare_lean(time: FloatArray, euler: FloatArray, force_n: FloatArray) -> Likeness:
    """Return how the horizontal specific force follows the lean, ahead + i right of the nose.

    The thrust of a copter, and the lift of an aircraft in a coordinated turn, point up in the body: with
    pitch θ and roll φ they pull −tan θ ahead and tan φ / cos θ to the right, times the vertical force.

    Parameters
    ----------
    time : (n,) array
        Times [s].
    euler : (n, 3) array
        Roll, pitch, yaw [rad].
    force_n : (n, 3) array
        Specific force, north, east, down [m/s²].

    Returns
    -------
    Likeness
        Its angle is by how much the force is to the right of the lean.
    """
    roll, pitch, yaw = euler.T
    pulled = (force_n[:, 0] + 1j * force_n[:, 1]) * np.exp(-1j * yaw)
    steep = limits.LOG.steepest_lean
    tangents = [np.tan(np.clip(wrap(one), -steep, steep)) for one in (pitch, roll)]
    leant = -force_n[:, 2] * (-tangents[0] + 1j * tangents[1] / np.cos(np.clip(pitch, -steep, steep)))
    second = ((time - time[0]) // limits.LOG.leg).astype(np.intp)
    count = np.maximum(np.bincount(second), 1)
    means = [
        (np.bincount(second, one.real) + 1j * np.bincount(second, one.imag)) / count
        for one in (leant, pulled)
    ]
    return likeness(*means)


def is_leaning(like: Likeness, coherence: float) -> bool:
    """Return whether a vehicle accelerates as it leans, with at least some coherence, but for an angle.

    Where this is small, heading, pitch and roll are right; else the force is to the right of the lean by it.
    """
    low, high = limits.LOG.lean_ratio
    return bool(
        like.coherence > coherence and low < like.ratio < high and like.strength > limits.LOG.lively_speed
    )


def bank_fault(bank: FloatArray, roll: FloatArray, pitch: FloatArray) -> tuple[str, float]:
    """Return what is wrong with the roll of an aircraft in its turns, and its factor.

    Parameters
    ----------
    bank, roll, pitch : (n,) arrays
        That of coordinated turns, and those recorded [rad].

    Returns
    -------
    tuple of str and float
        "exchanged" with the pitch, "factor", or empty; and the roll over the bank.
    """
    if np.std(bank) < limits.LOG.banking:
        return "", 1.0
    like = likeness(bank, wrap(roll))
    if (
        like.correlation < limits.LOG.axis_correlation
        and likeness(bank, pitch).correlation > limits.LOG.coherent
    ):
        return "exchanged", like.slope
    low, high = limits.LOG.same_roll
    unlike = abs(like.correlation) > limits.LOG.attitude_correlation and not low < like.slope < high
    return ("factor" if unlike else ""), like.slope


def pitch_fault(velocity_n: FloatArray, pitch: FloatArray) -> float:
    """Return the factor of the pitch on the slope of the path of an aircraft; 1 where nothing is wrong.

    Parameters
    ----------
    velocity_n : (n, 3) array
        In motion, north, east, down [m/s].
    pitch : (n,) array
        Pitch [rad].
    """
    climb = np.arctan2(-velocity_n[:, 2], np.hypot(velocity_n[:, 0], velocity_n[:, 1]))
    if np.std(climb) < limits.LOG.climbing:
        return 1.0
    like = likeness(climb, pitch)
    low, high = limits.LOG.same_pitch
    turned = like.correlation < -limits.LOG.attitude_correlation
    unlike = like.correlation > limits.LOG.attitude_correlation and not low < like.slope < high
    return like.slope if turned or unlike else 1.0


def rates_agree(likes: tuple[Likeness, ...] | None) -> bool:
    """Return whether recorded rates bear out those of an attitude about each axis that turns."""
    low, high = limits.LOG.same_rate
    turning = [one for one in likes or () if one.strength > limits.LOG.increment]
    return bool(turning) and all(
        one.correlation > limits.LOG.axis_correlation and low < one.slope < high for one in turning
    )


def _usual_angle(angle: FloatArray) -> float:
    return float(np.median(np.abs(wrap(angle))))
