"""Fix causes: latency and lever arm, and what they make of the errors of fixes and of the innovations.

References
----------
A. S. Willsky, H. L. Jones, *A Generalized Likelihood Ratio Approach to the Detection and Estimation of Jumps
in Linear Systems*, IEEE Trans. Automatic Control 21 (1976): the response of the innovations to an error.
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.navigation.error_models import ACCEL_BIAS, ACCEL_SCALE, ATT, GYRO_BIAS, GYRO_SCALE, POS, VEL
from lab.navigation.solution import Imu, Solution
from lab.rotation import C_nb_from_euler, euler_from_quaternion

FloatArray = NDArray[np.float64]

CAUSES = 4
"""Regressors: latency [s], then the lever arm forward, right, down [m]."""
RATE_WINDOW = 0.1
"""Time over which angular rate and acceleration at a fix are averaged [s]."""


class Motion(NamedTuple):
    """The motion at the m fixes used, as estimated: all (m, 3), and C_nb (m, 3, 3)."""

    velocity: FloatArray
    acceleration: FloatArray
    rate_b: FloatArray
    force_n: FloatArray
    C_nb: FloatArray


def motion_at_fixes(solution: Solution, used: NDArray[np.intp], imu: Imu) -> Motion:
    """Return the motion at the fixes, from the samples before each, which its correction does not touch.

    Parameters
    ----------
    solution, imu
        What the navigator computed, and what it was given.
    used : (m,) array
        Numbers of the fixes it used.
    """
    step = float(np.mean(np.diff(imu.time))) if imu.time.size > 1 else 1.0
    width = max(1, round(RATE_WINDOW / step))
    last = np.maximum(solution.fix_sample[used] - 1, 0)
    first = np.maximum(last - width, 0)
    span = np.maximum(imu.time[last] - imu.time[first], step)[:, None]
    turned = np.concatenate((np.zeros((1, 3)), np.cumsum(imu.dtheta, axis=0)))
    C_nb = C_nb_from_euler(euler_from_quaternion(solution.q_nb[last]))
    return Motion(
        velocity=solution.velocity_n[last],
        acceleration=(solution.velocity_n[last] - solution.velocity_n[first]) / span,
        rate_b=(turned[last] - turned[first]) / span,
        force_n=_mean_force(solution, used, imu),
        C_nb=C_nb,
    )


def _mean_force(solution: Solution, used: NDArray[np.intp], imu: Imu) -> FloatArray:
    """Return the specific force (m, 3) in n, averaged from each fix to the next [m/s²]."""
    C_nb = C_nb_from_euler(euler_from_quaternion(solution.q_nb[1:]))
    gained = np.concatenate(
        (np.zeros((1, 3)), np.cumsum(np.einsum("nij,nj->ni", C_nb, imu.dvelocity), axis=0))
    )
    at = np.append(solution.fix_sample[used], imu.time.size - 1)
    span = np.maximum(imu.time[at[1:]] - imu.time[at[:-1]], 1e-9)[:, None]
    return np.asarray((gained[at[1:]] - gained[at[:-1]]) / span)


def causes_of(motion: Motion) -> FloatArray:
    """Return the error (m, 6, CAUSES) of the fixes for each second of latency and metre of lever arm.

    A fix that is late by τ reports p(t − τ) and v(t − τ); one of an antenna at l reports p + C_nb l and
    v + C_nb (ω × l) (Groves 14.3).
    """
    m = motion.velocity.shape[0]
    causes = np.empty((m, 6, CAUSES))
    causes[:, POS, 0], causes[:, VEL, 0] = -motion.velocity, -motion.acceleration
    causes[:, POS, 1:] = motion.C_nb
    causes[:, VEL, 1:] = motion.C_nb @ _skew(motion.rate_b)
    return causes


def response(
    solution: Solution,
    used: NDArray[np.intp],
    time: FloatArray,
    motion: Motion,
    causes: FloatArray,
) -> FloatArray:
    """Return what the causes make of the innovations (m, 6, CAUSES), through the gains of the filter.

    From fix to fix the error grows by the short-term terms of F alone: velocity, specific force, biases.

    Parameters
    ----------
    solution
        What the navigator computed.
    used : (m,) array
        Numbers of the fixes it used.
    time : (n + 1,) array
        Times of the IMU samples [s].
    motion, causes
        Those of these fixes.
    """
    H = solution.fix_H[used]
    gains = solution.fix_covariance[used] @ H.transpose(0, 2, 1) @ np.linalg.inv(solution.fix_R[used])
    n = solution.states
    at = solution.fix_sample[used]
    dt = np.diff(time[at], append=time[-1])[:, None, None]
    F = np.zeros((used.size, n, n))
    F[:, POS, VEL] = np.eye(3)
    F[:, VEL, ATT] = _skew(motion.force_n)
    F[:, VEL, ACCEL_BIAS] = -motion.C_nb
    F[:, ATT, GYRO_BIAS] = motion.C_nb
    if n > GYRO_SCALE.start:
        force_b = np.einsum("mji,mj->mi", motion.C_nb, motion.force_n)
        F[:, ATT, GYRO_SCALE] = motion.C_nb * motion.rate_b[:, None, :]
        F[:, VEL, ACCEL_SCALE] = -motion.C_nb * force_b[:, None, :]
    step = F * dt
    transition = np.eye(n) + step + step @ step / 2 + step @ step @ step / 6
    error = np.zeros((n, CAUSES))
    response = np.empty(causes.shape)
    for k in range(used.size):  # a recursion over fixes, not samples
        response[k] = H[k] @ error - causes[k]
        error = transition[k] @ (error - gains[k] @ response[k])
    return response


def _skew(vectors: FloatArray) -> FloatArray:
    """Return [v ×] (m, 3, 3) of vectors (m, 3)."""
    return np.cross(vectors[:, None, :], np.eye(3)).transpose(0, 2, 1)
