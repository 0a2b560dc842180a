"""Dead reckoning: the position a velocity leads to, over the ellipsoid."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from lab.base.arrays import FloatArray
from lab.motion.frames.displacement import metres_per_radian

_CONVERGED = 1e-14
"""Change of the latitude in a round below which it is found [rad]: 0.1 µm."""
_MAX_ROUNDS = 60
"""Most iterations of Picard's method; a few are enough, except for the longest motions at the highest
latitudes."""


def integral(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return the integral of a cubic spline through values (n,) or (n, k), from the first time on."""
    curve = CubicSpline(time, values).antiderivative()
    return np.asarray(curve(time) - curve(time[0]))


def position(time: FloatArray, velocity_n: FloatArray, start: FloatArray) -> FloatArray:
    """Return the positions from integrating a velocity over the Earth.

    Solves P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd
    ed., eq. 2.111, by Picard's iteration on splines: the radii change so slowly that a few rounds do.

    Parameters
    ----------
    time : (n,) array
        Times [s].
    velocity_n : (n, 3) array
        Velocity, north, east, down [m/s].
    start : (3,) array
        Latitude, longitude [rad] and height above the ellipsoid [m] at the first time.

    Returns
    -------
    (n, 3) array
        Latitude, longitude [rad] and height [m]; the longitude goes on beyond ±π.
    """
    height = start[2] - integral(time, velocity_n[:, 2])
    latitude = np.full_like(time, start[0])
    for _ in range(_MAX_ROUNDS):
        per_latitude, _ = metres_per_radian(latitude, height)
        following = start[0] + integral(time, velocity_n[:, 0] / per_latitude)
        change = np.abs(following - latitude).max()
        latitude = following
        if change < _CONVERGED:
            break
    _, per_longitude = metres_per_radian(latitude, height)
    longitude = start[1] + integral(time, velocity_n[:, 1] / per_longitude)
    return np.stack((latitude, longitude, height), axis=-1)
