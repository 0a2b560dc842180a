"""Inertial attitude: the attitude reconstructed from inertial rates, specific force and velocity.

Integrated rates give the attitude at all times up to one constant rotation, that of the first instant. The
specific force, resolved by them and integrated, must equal the change of velocity less gravity. The
rotation that fits all intervals best by least squares solves Wahba's problem, by a singular value
decomposition. The method needs no rest at the start, but horizontal accelerations: without them the
heading stays unknown.

References
----------
M. Wu, Y. Wu, X. Hu and D. Hu, *Optimization-based alignment for inertial navigation systems: theory and
algorithm*, Aerospace Science and Technology 15 (2011); F. L. Markley, *Attitude determination using vector
observations and the singular value decomposition*, J. Astronautical Sciences 36 (1988).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames import earth, ecef

_INTERVAL = 1.0
"""Time over which the change of velocity is compared [s]: noise averages out, and turns are still seen."""
_MIN_INTERVALS = 10
"""Fewest of these intervals: the rotation has three unknowns, the residual needs some more."""


@dataclass(frozen=True)
class InertialAttitude:
    """An attitude reconstructed from inertial measurements.

    Attributes
    ----------
    C_nb : (n, 3, 3) array
        The attitude at the times of the velocity.
    residual : float
        Rms of what the fit leaves of the change of velocity in a second [m/s].
    heading_uncertainty : float
        By how much the heading may be off if that were no noise but the same all the time [rad].
    """

    C_nb: FloatArray
    residual: float
    heading_uncertainty: float


def inertial_attitude(
    time: FloatArray,
    place: FloatArray,
    velocity_n: FloatArray,
    imu_time: FloatArray,
    rate: FloatArray,
    force: FloatArray,
) -> InertialAttitude | None:
    """Return the attitude that inertial rates and specific force have, or None if they are too few.

    Parameters
    ----------
    time : (n,) array
        Times of position and velocity, increasing, within those of the rates [s].
    place : (n, 3) array
        Latitude, longitude [rad] and height [m].
    velocity_n : (n, 3) array
        Velocity over the Earth, north, east, down [m/s].
    imu_time : (m,) array
        Times of rates and specific force, increasing [s].
    rate, force : (m, 3) arrays
        ω_ib,b [rad/s] and f_b [m/s²] at these times.
    """
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - slow to import, and only this needs it
    from scipy.spatial.transform import Slerp  # noqa: PLC0415

    from lab.motion.kinematics.running_turns import running_attitudes  # noqa: PLC0415 - likewise

    if time[-1] - time[0] < _MIN_INTERVALS * _INTERVAL:
        return None
    # Attitude against that of the first instant, by the midpoint rule (Groves 5.3, without coning).
    attitude = running_attitudes(np.diff(imu_time)[:, None] * (rate[1:] + rate[:-1]) / 2)
    integral = CubicSpline(imu_time, attitude.apply(force)).antiderivative()
    # The same in inertial axes that are those of the Earth at the first time (Wu 2011, eq. 8).
    C_in = _inertial_axes(time - time[0], place)
    rate_ie_n = earth.RATE * np.column_stack((np.cos(place[:, 0]), np.zeros(len(time)), -np.sin(place[:, 0])))
    gravity_n = np.zeros_like(velocity_n)
    gravity_n[:, 2] = earth.gravity(np.sin(place[:, 0]), place[:, 2])
    inner = np.cross(rate_ie_n, velocity_n) - gravity_n
    moved = np.einsum("nij,nj->ni", C_in, velocity_n)
    pulled = CubicSpline(time, np.einsum("nij,nj->ni", C_in, inner)).antiderivative()
    ends = np.arange(time[0], time[-1], _INTERVAL)
    changes = np.diff(CubicSpline(time, moved)(ends) + pulled(ends), axis=0)
    measured = np.diff(integral(ends), axis=0)
    u, _, v = np.linalg.svd(changes.T @ measured)
    C_ib0 = u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(v)]) @ v
    left = changes - measured @ C_ib0.T
    residual = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
    up = changes.mean(axis=0) / np.linalg.norm(changes.mean(axis=0))
    across = np.sum(changes**2) - np.sum((changes @ up) ** 2)
    uncertainty = residual * np.sqrt(len(changes) / max(float(across), 1e-12))
    at_times = Slerp(imu_time, attitude)(time).as_matrix()
    C_nb = np.einsum("nji,jk,nkl->nil", C_in, C_ib0, at_times)
    return InertialAttitude(C_nb, residual, float(uncertainty))


def _inertial_axes(time: FloatArray, place: FloatArray) -> FloatArray:
    """Return C_in (n, 3, 3): north, east and down in axes that do not turn with the Earth."""
    C_en = ecef.axes(place[:, 0], place[:, 1])
    s, c = np.sin(earth.RATE * time), np.cos(earth.RATE * time)
    C_ie = np.zeros((len(time), 3, 3))
    C_ie[:, 0, 0], C_ie[:, 0, 1] = c, -s
    C_ie[:, 1, 0], C_ie[:, 1, 1] = s, c
    C_ie[:, 2, 2] = 1.0
    return C_ie @ C_en
