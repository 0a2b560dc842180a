"""Start fixes: the fixes with which the start of a navigator is found, and the σ of their velocities.

The filter gives no weight to a velocity that was not measured. The start takes it from the positions, with
the σ that follows from theirs.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames.displacement import metres_per_radian
from lab.navigation.solution import Fixes

_APART = 1.0
"""Time between two positions whose difference is a velocity [s]: at 10 Hz, the difference of two neighbours
has ten times its error. In a steady turn, their difference has the course of the middle."""


def start_fixes(fixes: Fixes, measured: FloatArray, variances: FloatArray) -> tuple[Fixes, FloatArray]:
    """Return the fixes with which the start is found, and the σ (k, 3) of their velocities [m/s].

    If no fix has a measured velocity, they are those about a second apart, with the velocities of their
    positions; otherwise all.

    Parameters
    ----------
    fixes
        The fixes, with the velocities that the filter uses.
    measured : (m, 3) array
        The measured velocities; NaN if unmeasured [m/s].
    variances : (m, 6) array
        Variances of position and velocity that the filter uses [m²], [(m/s)²].
    """
    unknown, sigma = np.isnan(measured), np.sqrt(variances)
    if unknown[:, :2].all():
        rows = np.flatnonzero(np.diff(np.floor((fixes.time - fixes.time[0]) / _APART), prepend=-1.0))
        if rows.size > 1:
            time, position = fixes.time[rows], fixes.position[rows]
            velocity = velocity_of_positions(time, position)
            velocity[:, 2] = fixes.velocity_n[rows, 2]
            fixes, unknown, sigma = Fixes(time, position, velocity), unknown[rows], sigma[rows]
    over = np.diff(fixes.time, append=fixes.time[-1]) + np.diff(fixes.time, prepend=fixes.time[0])
    unknown[:, 2] = False  # a vertical velocity is not derived from positions
    with np.errstate(divide="ignore"):
        derived = np.sqrt(2) * sigma[:, :3] / over[:, None]
    return fixes, np.where(unknown, derived, sigma[:, 3:])


def velocity_of_positions(time: FloatArray, position: FloatArray) -> FloatArray:
    """Return the velocity (m, 3) north, east, down from differences of positions; down is zero [m/s].

    Parameters
    ----------
    time : (m,) array
        At least two times [s].
    position : (m, 3) array
        Latitude, longitude [rad] and height [m].
    """
    latitude, longitude = position[:, 0], np.unwrap(position[:, 1])
    per_latitude, per_longitude = metres_per_radian(latitude, 0.0)
    north = np.gradient(latitude, time) * per_latitude
    east = np.gradient(longitude, time) * per_longitude
    return np.stack((north, east, np.zeros_like(north)), axis=-1)
