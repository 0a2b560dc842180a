"""Errors: the errors of a navigation solution, and their σ according to the filter.

Errors are estimate minus truth. Position and velocity errors are given east, north, up; attitude errors are
differences of roll, pitch and heading, and the Jacobian maps the filter's covariance of φ to them
(`rotation.euler_jacobian`). Close to a pole, positions are compared in Earth-fixed Cartesian axes.

In Earth-fixed axes e, the errors are vectors: no axis turns along the path, so that a pole is a place like
any other. The output of a filter is along north, east and down of the estimate, which turn from place to
place by δθ = Θ δr:

    δv = δv_c + v × δθ,   φ = ψ + δθ

with δv_c and ψ the errors in e, resolved in n (as the error model `psi` has them).

A thousand runs with all samples would not fit into memory, so that an ensemble keeps errors over a whole
flight ten times a second.

References
----------
D. O. Benson, *A comparison of two approaches to pure-inertial and Doppler-inertial error analysis*, IEEE
Trans. AES 11 (1975).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames import earth, ecef
from lab.motion.frames.displacement import displacement
from lab.motion.frames.east_north_up import east_north_up
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.motion.truth.trajectory import Truth
from lab.navigation.filters.error_models import ACCEL_BIAS, ACCEL_SCALE, ATT, GYRO_BIAS, GYRO_SCALE, POS, VEL
from lab.navigation.solution import Solution

APART = 0.1
"""Time between two samples of the path [s]: errors change little in it, and the rms by 0.1 %."""
SMALLEST = 1e-15
"""Smallest cos L, which stands for all below: 6 nm from a pole, where a filter bounds tan L, too."""


def position_error(position: FloatArray, truth: Truth) -> FloatArray:
    """Return the position error (n, 3), north, east, down [m].

    Parameters
    ----------
    position : (n, 3) array
        Latitude, longitude [rad], height [m].
    truth
        Truth at the same times.
    """
    return displacement(truth.position, position)


def attitude_error(q_nb: FloatArray, truth_q_nb: FloatArray) -> FloatArray:
    """Return φ (n, 3) of Ĉ_nb = exp(−[φ×]) C_nb [rad], from estimated and true quaternions (n, 4)."""
    w, x, y, z = q_nb.T
    a, b, c, d = truth_q_nb.T
    # q̂ ⊗ q*, the rotation by −φ.
    scalar = w * a + x * b + y * c + z * d
    vector = np.stack(
        (-w * b + x * a - y * d + z * c, -w * c + x * d + y * a - z * b, -w * d - x * c + y * b + z * a),
        axis=-1,
    )
    length = np.linalg.norm(vector, axis=-1)
    angle = 2 * np.arctan2(length, np.abs(scalar))
    # 2 is the limit of angle over length where both vanish.
    factor = np.divide(angle, length, out=np.full_like(length, 2.0), where=length > 1e-12)
    # q and −q are one rotation: of the two, that by less than half a turn.
    return np.asarray(-vector * (factor * np.sign(scalar + (scalar == 0)))[:, None])


def error_state(
    solution: Solution,
    samples: NDArray[np.int64],
    truth: Truth,
    bias: FloatArray,
    scale: FloatArray | None = None,
    further: FloatArray | None = None,
) -> FloatArray:
    """Return the error states (m, states) at some samples, in the filter's order and units.

    Parameters
    ----------
    solution
        The solution.
    samples : (m,) array
        Indices of the samples.
    truth
        Truth at all samples.
    bias : (n, 6) array
        True gyro and accelerometer biases at all samples [rad/s], [m/s²].
    scale : (n, 6) array
        True scale factor errors of gyros and accelerometers at all samples, if the filter has states for
        them.
    further : (n, k) array
        True values of its further states at all samples, if it has any.
    """
    there = truth.taken(samples)
    x = np.empty((samples.size, solution.states))
    x[:, POS] = position_error(solution.position[samples], there)
    x[:, VEL] = solution.velocity_n[samples] - there.velocity_n
    x[:, ATT] = attitude_error(solution.q_nb[samples], there.q_nb)
    x[:, GYRO_BIAS.start : ACCEL_BIAS.stop] = solution.bias[samples] - bias[samples]
    near = ecef.near_pole(there.latitude)
    if near.any():
        at_pole = there.taken(near)
        x[near, :9] = _error_near_pole(solution, samples[near], at_pole)
    if solution.scale.shape[1]:
        assert scale is not None
        x[:, GYRO_SCALE.start : ACCEL_SCALE.stop] = solution.scale[samples] - scale[samples]
    if solution.further.shape[1]:
        assert further is not None
        x[:, solution.states - further.shape[1] :] = solution.further[samples] - further[samples]
    return x


def _error_near_pole(solution: Solution, samples: NDArray[np.int64], truth: Truth) -> FloatArray:
    """Return the errors of position, velocity and attitude (m, 9) close to a pole.

    Computed in e, where they are small, and converted to n to first order, as the filter's covariance is
    (`output_map`).
    """
    here, velocity_n = solution.position[samples], solution.velocity_n[samples]
    C_ec, C_en = ecef.axes(here[:, 0], here[:, 1]), ecef.axes(truth.latitude, truth.longitude)
    # Displacements are in the axes of the first place, and these errors are in those of the estimate.
    off = -ecef.displacement(here, truth.position)
    faster = velocity_n - ecef.resolve_elsewhere(truth.velocity_n, truth.position, here)
    true_attitude = Rotation.from_matrix(C_ec.transpose(0, 2, 1) @ C_en) * Rotation.from_quat(
        truth.q_nb, scalar_first=True
    )
    psi = attitude_error(solution.q_nb[samples], true_attitude.as_quat(scalar_first=True))
    in_e = np.stack((off, faster, psi), axis=1) @ C_ec.transpose(0, 2, 1)
    return np.asarray((output_map(here, velocity_n) @ in_e.reshape(-1, 9, 1))[..., 0])


def block_matrices(variance: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return symmetric matrices (n, 3, 3) from diagonals and elements (0, 1), (0, 2), (1, 2), (n, 3) each."""
    P = np.empty((variance.shape[0], 3, 3))
    for i in range(3):
        P[:, i, i] = variance[:, i]
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        P[:, i, j] = P[:, j, i] = covariance[:, k]
    return P


def euler_sigma(euler: FloatArray, variance: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return σ of roll, pitch and heading (n, 3) [rad] from the covariance of φ.

    Parameters
    ----------
    euler : (n, 3) array
        Estimated roll, pitch, heading [rad].
    variance, covariance : (n, 3) arrays
        Diagonal and off-diagonal elements of the covariance of φ, as in `block_matrices`.
    """
    P00, P11, P22 = np.ascontiguousarray(variance.T)
    P01, P02, P12 = np.ascontiguousarray(covariance.T)
    cy, sy, sec, tan = _trigonometry(euler)
    # J P Jᵀ of `rotation.euler_jacobian`, written out for speed, because every slider needs it. Roll and
    # heading errors follow from the tilt along the heading, pitch errors from the tilt across it.
    cross = 2 * sy * cy * P01
    along = cy * cy * P00 + sy * sy * P11 + cross
    across = sy * sy * P00 + cy * cy * P11 - cross
    sigma = np.empty(euler.shape, order="F")
    sigma[:, 0] = sec * sec * along
    sigma[:, 1] = across
    sigma[:, 2] = P22 + tan * (tan * along + 2 * (cy * P02 + sy * P12))
    # Roundoff may make a zero variance slightly negative.
    return np.sqrt(np.maximum(sigma, 0, out=sigma), out=sigma)


def _trigonometry(euler: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return cosine and sine of the heading, and secant and tangent of the pitch."""
    pitch, yaw = np.ascontiguousarray(euler[:, 1:].T)
    tan, cos_yaw, sin_yaw = np.tan(pitch), np.cos(yaw), np.sin(yaw)
    return cos_yaw, sin_yaw, np.sqrt(1 + tan * tan), tan


def output_map(position: FloatArray, velocity_n: FloatArray) -> FloatArray:
    """Return T (m, 9, 9), which takes errors in e to the output errors of a filter, to first order.

    Parameters
    ----------
    position : (m, 3) array
        Latitude, longitude [rad], height [m].
    velocity_n : (m, 3) array
        Velocity north, east, down [m/s].
    """
    latitude, longitude, height = position.T
    C_ne = np.swapaxes(ecef.axes(latitude, longitude), 1, 2)
    sine = np.sin(latitude)
    meridian, transverse = earth.radii(sine)
    tangent = sine / np.maximum(np.cos(latitude), SMALLEST)
    turn = np.zeros((latitude.size, 3, 3))  # Θ
    turn[:, 0, 1] = 1 / (transverse + height)
    turn[:, 1, 0] = -1 / (meridian + height)
    turn[:, 2, 1] = -tangent / (transverse + height)
    turn = turn @ C_ne
    T = np.zeros((latitude.size, 9, 9))
    T[:, POS, POS] = T[:, VEL, VEL] = T[:, ATT, ATT] = C_ne
    T[:, VEL, POS] = np.cross(velocity_n[:, None, :], np.swapaxes(turn, 1, 2)).swapaxes(1, 2)
    T[:, ATT, POS] = turn
    return T


def choose_path_samples(time: FloatArray, period: float) -> NDArray[np.int64]:
    """Return the samples of the path.

    Errors jump at the fixes. So the number of samples from one to the next has no factor in common with that
    from fix to fix: the path then has as many samples soon after a fix as soon before one.

    Parameters
    ----------
    time : (n + 1,) array
        Times of the IMU samples [s].
    period
        Time between the fixes [s].
    """
    step = float(time[-1] - time[0]) / max(time.size - 1, 1)
    from_fix = max(1, round(period / step)) if step else 1
    apart = max(1, int(APART / step + 0.5)) if step else 1
    while math.gcd(apart, from_fix) > 1:
        apart -= 1
    return np.arange(0, time.size, apart)


def outage_ends(
    time: FloatArray, outages: Sequence[tuple[float, float]], epoch: float = 0.0
) -> NDArray[np.int64]:
    """Return the last sample before the end of each GPS outage that is in the flight.

    Parameters
    ----------
    time : (n + 1,) array
        Times of the IMU samples [s].
    outages
        Start and end of each outage [s].
    epoch
        Time 0 in the clock of the outages [s].
    """
    half = 0.5 * float(time[-1] - time[0]) / max(time.size - 1, 1)
    ends = [end - epoch for start, end in outages if start - epoch < time[-1] and end - epoch > time[0]]
    return np.maximum(np.searchsorted(time, np.array(ends, dtype=np.float64) - half) - 1, 0)


def compute_errors(
    position: FloatArray, velocity_n: FloatArray, q_nb: FloatArray, truth: Truth
) -> FloatArray:
    """Return errors (m, 9) east, north, up [m], [m/s], and of roll, pitch, heading [°].

    Parameters
    ----------
    position, velocity_n, q_nb : (m, 3), (m, 3), (m, 4) arrays
        As of `Solution`.
    truth
        Truth at the same times.
    """
    return np.concatenate(
        (
            east_north_up(position_error(position, truth)),
            east_north_up(velocity_n - truth.velocity_n),
            np.degrees(wrap(euler_from_quaternion(q_nb) - truth.euler)),
        ),
        axis=1,
    )
