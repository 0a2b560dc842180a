"""Hand-made motions: exact IMU increments of closed-form rates and forces, and the navigator run on them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames import earth
from lab.motion.frames.rotation import wrap
from lab.navigation.navigator import Belief, Fixes, Imu, Solution, Start, navigate

Vectors = Callable[[FloatArray], FloatArray]

NO_FIXES = Fixes(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
NO_FILTER = Belief(np.zeros((15, 15)), np.eye(6), np.zeros(12), np.zeros(6))
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def increments(time: FloatArray, omega_ib_b: Vectors, f_b: Vectors) -> Imu:
    """Return the integrals of a body's angular rate [rad/s] and specific force [m/s²] over each interval.

    Eight-point Gauss-Legendre quadrature: exact to roundoff where the interval is short beside the motion.
    """
    dt = np.diff(time)
    at = time[:-1, None] + dt[:, None] * (0.5 + 0.5 * NODES)
    dtheta, dvelocity = (
        np.einsum("kgi,g,k->ki", vectors(at.ravel()).reshape(*at.shape, 3), 0.5 * WEIGHTS, dt)
        for vectors in (omega_ib_b, f_b)
    )
    return Imu(time, dtheta, dvelocity)


def steady(vector: ArrayLike) -> Vectors:
    """Return a vector that does not change in time."""
    return lambda t: np.broadcast_to(np.asarray(vector, dtype=np.float64), (t.size, 3))


def start(
    latitude: float,
    attitude: Rotation | None = None,
    velocity_n: ArrayLike = (0, 0, 0),
    *,
    longitude: float = 1.0,
    height: float = 300.0,
) -> Start:
    """Return a start; the attitude C_nb is level and to the north unless given."""
    attitude = attitude or Rotation.identity()
    return Start(
        np.array([latitude, longitude, height]),
        np.asarray(velocity_n, dtype=np.float64),
        attitude.as_quat(scalar_first=True),
    )


def unaided(imu: Imu, begin: Start) -> Solution:
    """Navigate without fixes."""
    return navigate(imu, NO_FIXES, begin, NO_FILTER)


def resting_imu(time: FloatArray, latitude: float, attitude: Rotation, height: float = 300.0) -> Imu:
    """Return what an IMU feels that rests on the Earth."""
    g = earth.gravity(np.sin(latitude), height)
    omega_b = attitude.apply(earth_rate_n(latitude), inverse=True)
    f_b = attitude.apply([0, 0, -g], inverse=True)
    return increments(time, steady(omega_b), steady(f_b))


def earth_rate_n(latitude: float) -> FloatArray:
    """Return ω_ie,n [rad/s]."""
    return earth.RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])


def offset(solution: Solution, begin: Start) -> FloatArray:
    """Return the way from the start (n + 1, 3), north, east, down [m]."""
    latitude, longitude, height = begin.position
    meridian, transverse = earth.radii(float(np.sin(latitude)))
    north = (solution.position[:, 0] - latitude) * (meridian + height)
    east = wrap(solution.position[:, 1] - longitude) * (transverse + height) * np.cos(latitude)
    return np.stack((north, east, height - solution.position[:, 2]), axis=-1)


def turned(solution: Solution, attitude: Rotation) -> FloatArray:
    """Return φ (n + 1, 3) [rad] of Ĉ_nb = exp(−[φ×]) C_nb, for one true attitude or as many as samples."""
    return -(Rotation.from_quat(solution.q_nb, scalar_first=True) * attitude.inv()).as_rotvec()
