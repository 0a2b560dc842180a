"""Air data: a flight reconstructed from airspeed, attitude, angle of attack and sideslip.

The velocity through the air, resolved in n by the attitude, plus the wind is the velocity over the Earth; its
integral over the ellipsoid is the path. The wind is given, or fitted to positions.

References
----------
B. L. Stevens, F. L. Lewis, E. N. Johnson, *Aircraft Control and Simulation*, 3rd ed., eq. 2.3-6 (velocity
from airspeed, angle of attack and sideslip).
"""

from __future__ import annotations

import numpy as np
import scipy

from lab.base.arrays import FloatArray
from lab.motion.frames import ecef, rotation

_CONVERGED = 1e-4
"""Change of the positions in a round below which they are found [m]."""
_MAX_ROUNDS = 40
"""Most rounds of Picard's iteration: a few are needed, except close to a pole, where the axes turn fast."""
_FITS = 3
"""Rounds of fitting the wind, each on the positions that the one before led to. A plain choice: the offset is
linear in the wind but for the curvature of the Earth."""


def air_velocity(airspeed: FloatArray, alpha: FloatArray, beta: FloatArray, euler: FloatArray) -> FloatArray:
    """Return the velocity through the air, north, east, down (n, 3) [m/s] (Stevens & Lewis 2.3-6).

    Parameters
    ----------
    airspeed : (n,) array
        True airspeed [m/s].
    alpha, beta : (n,) arrays
        Angle of attack, sideslip [rad].
    euler : (n, 3) array
        Roll, pitch, yaw [rad].
    """
    forward = np.cos(alpha) * np.cos(beta)
    direction_b = np.stack((forward, np.sin(beta), np.sin(alpha) * np.cos(beta)), axis=-1)
    C_nb = rotation.C_nb_from_euler(euler)
    return np.asarray(np.einsum("nij,nj->ni", C_nb, airspeed[:, None] * direction_b))


def integrate_velocity(time: FloatArray, velocity_n: FloatArray, start: FloatArray) -> FloatArray:
    """Return the positions that a velocity leads to: latitude, longitude [rad], height [m], (n, 3).

    Picard's iteration in Earth-fixed axes: the axes north, east, down of each sample are those at its
    position in the round before.

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    velocity_n : (n, 3) array
        Velocity over the Earth, north, east, down [m/s].
    start : (3,) array
        Latitude, longitude [rad] and height [m] at the first time.
    """
    here = np.asarray(start, dtype=np.float64)
    r_start = ecef.position(here[None])
    position = np.tile(here, (len(time), 1))
    for _ in range(_MAX_ROUNDS):
        velocity_e = np.einsum("nij,nj->ni", ecef.axes(position[:, 0], position[:, 1]), velocity_n)
        displacement = scipy.interpolate.CubicSpline(time, velocity_e).antiderivative()(time)
        moved = ecef.geodetic(r_start + displacement)
        change = np.abs(ecef.position(moved) - ecef.position(position)).max()
        position = moved
        if change < _CONVERGED:
            break
    return position


def fit_wind(
    time: FloatArray, through_air: FloatArray, recorded: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the constant wind and the start with which a flight follows recorded positions best.

    Least squares on all three axes; a vertical wind compensates a constant error of the angle of
    attack or the pitch.

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    through_air : (n, 3) array
        Velocity through the air, north, east, down [m/s].
    recorded : (n, 3) array
        Recorded latitude, longitude [rad] and height [m].

    Returns
    -------
    wind : (3,) array
        Velocity of the air over the Earth, north, east, down [m/s].
    start : (3,) array
        Latitude, longitude [rad] and height [m] at the first time.
    """
    wind, start = np.zeros(3), recorded[0].copy()
    design = np.column_stack((np.ones(len(time)), time - time[0]))
    for _ in range(_FITS):
        apart = ecef.displacement(integrate_velocity(time, through_air + wind, start), recorded)
        offset, slope = np.linalg.lstsq(design, apart, rcond=None)[0]
        wind, start = wind + slope, ecef.displaced(start[None], offset[None])[0]
    return wind, start
