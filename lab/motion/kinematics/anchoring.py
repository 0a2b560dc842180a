"""Anchoring: the path from the integrated recorded velocity, tied to recorded positions by a slow correction.

Differentiating velocity once gives far less noise than differentiating rounded positions twice. So the
velocity is splined and integrated over the ellipsoid, and only the slowly growing difference to the positions
is added.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames import ecef
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.kinematics.cubic_spline import cubic_spline, fit_spline

ANCHOR_SPACING = 10.0
"""Knot spacing of the correction that ties the integrated velocity to the positions [s]."""


def anchored_offsets(
    time: FloatArray, position: FloatArray, velocity_n: FloatArray, grid: FloatArray
) -> FloatArray:
    """Return latitude, longitude and height (m, 3) at other times, minus those of the first sample.

    The result is the integral of the recorded velocity over the ellipsoid, plus a slow least-squares spline
    through its difference to the recorded positions. The curvature of the Earth is evaluated at the recorded
    positions: an error of a metre changes it by a few parts in 10⁷.

    Parameters
    ----------
    time : (n,) array
        Times of the samples, from 0 [s].
    position : (n, 3) array
        Latitude, longitude [rad] and height [m], further than 1° from the poles.
    velocity_n : (n, 3) array
        Velocity over the Earth, north, east, down [m/s].
    grid : (m,) array
        Times within those of the samples [s].
    """
    latitude, longitude, height = position.T
    fixes = np.stack((latitude, np.unwrap(longitude), height), axis=-1)
    per_latitude, per_longitude = metres_per_radian(latitude, height)
    to_rate = np.stack((1 / per_latitude, 1 / per_longitude, np.full_like(time, -1.0)), axis=-1)
    # Latitude, longitude and height change by the velocity over these; height against down.
    flown = cubic_spline(time, velocity_n * to_rate).antiderivative()
    correction = slow_spline(time, fixes - fixes[0] - flown(time))
    return np.asarray(flown(grid) + correction(grid))


def anchored_cartesian(
    time: FloatArray, position: FloatArray, velocity_n: FloatArray, grid: FloatArray
) -> FloatArray:
    """Return r_e (m, 3) at other times, minus that of the first sample; as `anchored_offsets`, also at poles.

    Parameters
    ----------
    time : (n,) array
        Times of the samples, from 0 [s].
    position : (n, 3) array
        Latitude, longitude [rad] and height [m].
    velocity_n : (n, 3) array
        Velocity over the Earth, north, east, down [m/s].
    grid : (m,) array
        Times within those of the samples [s].
    """
    fixes = ecef.position(position)
    velocity_e = np.einsum("nij,nj->ni", ecef.axes(position[:, 0], position[:, 1]), velocity_n)
    flown = cubic_spline(time, velocity_e).antiderivative()
    correction = slow_spline(time, fixes - fixes[0] - flown(time))
    return np.asarray(flown(grid) + correction(grid))


def slow_spline(time: FloatArray, values: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the least-squares cubic spline with knots about `ANCHOR_SPACING` apart, with samples between.

    Parameters
    ----------
    time : (n,) array
        Times of the values, from 0 [s].
    values : (n, 3) array
        Values that the spline approximates.
    """
    # A least-squares spline needs samples between its knots: three of them at least.
    pieces = int(np.clip(time[-1] / ANCHOR_SPACING, 1, (len(time) - 1) // 3))
    inner = time[np.linspace(0, len(time) - 1, pieces + 1).astype(int)[1:-1]]
    knots = np.concatenate((np.full(4, time[0]), inner, np.full(4, time[-1])))
    return fit_spline(time, values, knots)
