"""Geodesy over the ellipsoid: the position a velocity leads to, and the shortest path between two points."""

from __future__ import annotations

import numpy as np
import scipy

from lab.base.arrays import FloatArray
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.earth import FLATTENING, SEMI_MAJOR_AXIS

_LATITUDE_FOUND = 1e-14
"""Change of the latitude in a round below which it is found [rad]: 0.1 µm."""
_MAX_PICARD_ROUNDS = 60
"""Most iterations of Picard's method; a few are enough, except for the longest motions at the highest
latitudes."""
_SEMI_MINOR_AXIS = SEMI_MAJOR_AXIS * (1 - FLATTENING)
"""Polar radius [m]."""
_MAX_VINCENTY_ROUNDS = 200
"""Most rounds of Vincenty's iteration: a few do, but for points nearly opposite each other."""
_LONGITUDE_FOUND = 1e-13
"""Change of the longitude in a round below which it is found [rad]: 1 µm."""
_NOT_CONVERGED = 1e-9
"""Change in the last round from which points are nearly opposite each other [rad]: 6 mm."""


def integral(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return the integral of a cubic spline through values (n,) or (n, k), from the first time on."""
    curve = scipy.interpolate.CubicSpline(time, values).antiderivative()
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
    for _ in range(_MAX_PICARD_ROUNDS):
        per_latitude, _ = metres_per_radian(latitude, height)
        following = start[0] + integral(time, velocity_n[:, 0] / per_latitude)
        change = np.abs(following - latitude).max()
        latitude = following
        if change < _LATITUDE_FOUND:
            break
    _, per_longitude = metres_per_radian(latitude, height)
    longitude = start[1] + integral(time, velocity_n[:, 1] / per_longitude)
    return np.stack((latitude, longitude, height), axis=-1)


def geodesic(
    latitude: FloatArray, longitude: FloatArray, to_latitude: FloatArray, to_longitude: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the geodesics between points.

    T. Vincenty, *Direct and Inverse Solutions of Geodesics on the Ellipsoid*, Survey Review 23 (1975), eqs.
    13 to 21. Length within 0.1 mm; not for points nearly opposite each other on the Earth.

    Parameters
    ----------
    latitude, longitude, to_latitude, to_longitude : (n,) arrays
        Geodetic positions on WGS-84 [rad].

    Returns
    -------
    length : (n,) array
        At height 0 [m]; not a number where the points are nearly opposite each other.
    course, to_course : (n,) arrays
        True courses at the begin and at the end [rad]; of no meaning where the points coincide.
    """
    u1, u2 = (np.arctan((1 - FLATTENING) * np.tan(angle)) for angle in (latitude, to_latitude))
    s1, c1, s2, c2 = np.sin(u1), np.cos(u1), np.sin(u2), np.cos(u2)
    across = np.remainder(to_longitude - longitude + np.pi, 2 * np.pi) - np.pi
    lam, change = across, np.full_like(across, np.inf)
    for _ in range(_MAX_VINCENTY_ROUNDS):
        sin_sigma = np.hypot(c2 * np.sin(lam), c1 * s2 - s1 * c2 * np.cos(lam))
        cos_sigma = s1 * s2 + c1 * c2 * np.cos(lam)
        sigma = np.arctan2(sin_sigma, cos_sigma)
        sin_alpha = c1 * c2 * np.sin(lam) / np.where(sin_sigma > 0, sin_sigma, 1.0)
        cos2_alpha = np.maximum(1 - sin_alpha**2, 0.0)
        # On the equator any number does: it is multiplied by cos² α.
        middle = cos_sigma - np.where(
            cos2_alpha > 0, 2 * s1 * s2 / np.where(cos2_alpha > 0, cos2_alpha, 1), 0
        )
        c = FLATTENING / 16 * cos2_alpha * (4 + FLATTENING * (4 - 3 * cos2_alpha))
        inner = sigma + c * sin_sigma * (middle + c * cos_sigma * (2 * middle**2 - 1))
        following = across + (1 - c) * FLATTENING * sin_alpha * inner
        lam, change = following, np.abs(following - lam)
        if (change < _LONGITUDE_FOUND).all():
            break
    square = cos2_alpha * (SEMI_MAJOR_AXIS**2 / _SEMI_MINOR_AXIS**2 - 1)
    a = 1 + square / 16384 * (4096 + square * (-768 + square * (320 - 175 * square)))
    b = square / 1024 * (256 + square * (-128 + square * (74 - 47 * square)))
    far = cos_sigma * (2 * middle**2 - 1)
    far -= b / 6 * middle * (4 * sin_sigma**2 - 3) * (4 * middle**2 - 3)
    length = _SEMI_MINOR_AXIS * a * (sigma - b * sin_sigma * (middle + b / 4 * far))
    course = np.arctan2(c2 * np.sin(lam), c1 * s2 - s1 * c2 * np.cos(lam))
    to_course = np.arctan2(c1 * np.sin(lam), c1 * s2 * np.cos(lam) - s1 * c2)
    opposite = (change > _NOT_CONVERGED) | (np.abs(lam) > np.pi)
    return np.where(opposite, np.nan, length), course, to_course
