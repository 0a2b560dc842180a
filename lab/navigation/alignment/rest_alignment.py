"""Rest alignment: attitude and gyro biases from the sensors of a vehicle at rest before a flight.

The accelerometers show the vertical with the accuracy of their biases. The gyros show their biases and, if
these are small enough, north by the Earth's rate. Both are one update of the initial estimate. So each is as
accurate as the grade of the sensors allows, and the remaining errors have the right correlations, such as a
tilt with the accelerometer bias that caused it.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 5.6
(levelling, gyro-compassing) and 3.4.1 (iterated update); S. F. Schmidt, *Application of state-space methods
to navigation problems*, Advances in Control Systems 3 (1966), for errors that are considered, not estimated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY, si
from lab.motion.frames import earth
from lab.motion.frames.rotation import left_jacobian, skew
from lab.navigation.belief import constant_errors, of_bias_states
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ACCEL_SCALE, ATT, GYRO_BIAS, GYRO_SCALE
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Start
from lab.sensors import imu
from lab.sensors import temperature as thermal
from lab.sensors.draws import unit_draws
from lab.sensors.imu import AccelerometerErrors, GyroErrors
from lab.sensors.imu_errors import OFF_DIAGONAL
from lab.sensors.suite import SensorSuite

ROUNDS = 30
"""Most iterations of the update about its own result. Three are usual; a heading that is uncertain by 80°,
and of which gyros of 100 °/h show a little, needs up to fifteen."""
SETTLED = 0.01
"""The iterations end when each estimate has moved by less than this part of its σ, and the variance of the
heading by less than this part of itself."""
LEAST_FORCE, LEAST_RATE = 1e-6, 5e-9
"""Smallest σ of a mean at rest, 0.1 µg [m/s²] and 0.001 °/h [rad/s]: sensors without noise would give a
singular covariance."""
ESTIMATED = np.r_[6:12]
"""The estimated states: attitude and gyro biases. Accelerometer biases and scale factors are considered
(Schmidt), not estimated."""


class Means(NamedTuple):
    """The mean output of the sensors over a rest, and its covariance.

    Attributes
    ----------
    force, rate : (3,) arrays
        In b [m/s²], [rad/s].
    force_covariance, rate_covariance : (3, 3) arrays
        Covariance of the noise of the mean.
    mixing : (6, m) array
        Change of force and rate by each considered error: for a misalignment, the true quantity along the
        other axis; for the g-sensitivity of a gyro, the force along its own.
    considered : (m,) array
        One σ of each of these errors, in the order of `blocks.CONSIDERED`; without any, m is zero.
    """

    force: FloatArray
    rate: FloatArray
    force_covariance: FloatArray
    rate_covariance: FloatArray
    mixing: FloatArray = np.zeros((6, 0))
    considered: FloatArray = np.zeros(0)


class Aligned(NamedTuple):
    """The start of a navigator after a rest.

    Attributes
    ----------
    start : Start
        Start with the new attitude.
    gyro_bias : (3,) array
        Estimated gyro bias [rad/s].
    P : (21 + m, 21 + m) array
        Covariance of the remaining errors, and of the m errors that the alignment considered: a navigator
        that is level by its accelerometers has the tilt that they are misaligned by.
    kept : (21, 21) array
        Remaining part of an initial error: (I − K H) J, with J from its attitude to that after the rest.
    noise : (21, 6) array
        Errors from the noise of the means, one σ in each column.
    considered : (21, m) array
        Errors from those that the alignment considered, one σ in each column.
    """

    start: Start
    gyro_bias: FloatArray
    P: FloatArray
    kept: FloatArray
    noise: FloatArray
    considered: FloatArray


def align_simulated(
    start: Start,
    true: Start,
    sensors: SensorSuite,
    navigator: NavigatorSettings,
    seed: int,
    real: SensorSuite | None = None,
    single: SensorSuite | None = None,
) -> Aligned:
    """Return the start of a simulated navigator, after its alignment if it has one.

    Parameters
    ----------
    start, true
        Assumed start before the alignment, and true start.
    sensors, navigator
        The errors of the sensors; the filter, with the length of the rest.
    seed
        Seed of the run.
    real
        The errors that the sensors really have; by default, those that the filter assumes.
    single
        As for `belief`.
    """
    P, length = constant_errors(sensors, navigator), float(navigator.alignment)
    if not length:
        return Aligned(start, np.zeros(3), P, np.eye(21), np.zeros((21, 6)), np.zeros((21, 0)))
    induced = induced_variance(of_bias_states(sensors, navigator) if single is None else single)
    P[np.diag_indices(21)] += np.concatenate((np.zeros(9), induced, np.zeros(6)))
    means = simulate_means(sensors if real is None else real, seed, length, true)
    sizes = [np.abs(si(errors, "misalignment")) for errors in (sensors.gyro, sensors.accelerometer)]
    # Without states for it, the g-sensitivity at rest is a part of the bias.
    felt = np.abs(si(sensors.gyro, "g_sensitivity")) * navigator.estimate_g_sensitivity
    return align(start, P, means._replace(considered=np.concatenate((*sizes, felt))))


def usual_covariance(sensors: SensorSuite, navigator: NavigatorSettings) -> FloatArray | None:
    """Return P (21, 21) after the alignment of a level vehicle that points north at 45°; None without one."""
    if not navigator.alignment:
        return None
    level = Start(np.array([np.pi / 4, 0.0, 0.0]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return align_simulated(level, level, sensors, navigator, 0).P


def align(start: Start, P: FloatArray, means: Means) -> Aligned:
    """Return the start after a rest.

    Parameters
    ----------
    start
        Assumed start before the alignment, with a gyro bias of zero.
    P : (21, 21) array
        Covariance of the errors before; those of position and velocity do not change.
    means
        Mean output of the sensors.
    """
    sine, height = float(np.sin(start.position[0])), float(start.position[2])
    gravity = np.array([0.0, 0.0, float(earth.gravity(sine, height))])
    omega_ie = earth.RATE * np.array([np.sqrt(1 - sine * sine), 0.0, -sine])
    before = Rotation.from_quat(start.q_nb, scalar_first=True)
    x, after = np.zeros(21), P
    mixed = means.mixing * means.considered
    for _ in range(ROUNDS):
        turned = Rotation.from_rotvec(x[ATT])
        C_nb = (turned * before).as_matrix()
        z = np.concatenate((C_nb @ means.force + gravity, C_nb @ (means.rate + x[GYRO_BIAS]) - omega_ie))
        H = _sight(C_nb, gravity, omega_ie)
        B = np.concatenate((C_nb @ mixed[:3], C_nb @ mixed[3:]))
        R = _noise_of_means(C_nb, means) + _beyond_first_order(H, B, P, after, omega_ie)
        # Errors relative to the attitude of this round, which is not that of the start.
        J = np.eye(21)
        J[ATT, ATT] = left_jacobian(x[ATT])
        # The error before is that of the start still: seen from the attitude of this round, its mean is −J x.
        relative, first = J @ P @ J.T, -J @ x
        K = np.zeros((21, 6))
        K[ESTIMATED] = np.linalg.solve(H @ relative @ H.T + R + B @ B.T, H @ relative)[:, ESTIMATED].T
        step = first + K @ (z - H @ first)
        x += step
        x[ATT] = (Rotation.from_rotvec(step[ATT]) * turned).as_rotvec()
        kept, noise, considered = np.eye(21) - K @ H, K @ np.linalg.cholesky(R), -K @ B
        earlier, after = after, kept @ relative @ kept.T + noise @ noise.T + considered @ considered.T
        if _has_converged(step, earlier, after):
            break
    q_nb = (Rotation.from_rotvec(x[ATT]) * before).as_quat(scalar_first=True)
    P = _add_considered_errors((after + after.T) / 2, considered, means.considered)
    return Aligned(start._replace(q_nb=q_nb), -x[GYRO_BIAS], P, kept @ J, noise, considered)


def _has_converged(step: FloatArray, earlier: FloatArray, after: FloatArray) -> bool:
    """Return whether a further step of the update would change nothing that counts."""
    variance, change = np.diag(after), np.diag(after - earlier)[ATT.stop - 1]
    small = np.abs(step[ESTIMATED]) <= SETTLED * np.sqrt(variance[ESTIMATED])
    return bool(small.all() and abs(change) <= SETTLED * variance[ATT.stop - 1])


def _noise_of_means(C_nb: FloatArray, means: Means) -> FloatArray:
    """Return the covariance (6, 6) of the noise of the means of specific force and rate in n."""
    R = np.zeros((6, 6))
    R[:3, :3] = C_nb @ means.force_covariance @ C_nb.T + LEAST_FORCE**2 * np.eye(3)
    R[3:, 3:] = C_nb @ means.rate_covariance @ C_nb.T + LEAST_RATE**2 * np.eye(3)
    return R


def _beyond_first_order(
    H: FloatArray, B: FloatArray, P: FloatArray, after: FloatArray, omega_ie: FloatArray
) -> FloatArray:
    """Return the covariance (6, 6) of what a heading error ψ adds to the means beyond the first order.

    The level part of the Earth's rate is seen with cos ψ to the north, and with sin ψ to the east. The tilt
    follows the level error of the accelerometers; the wrong heading turns what is expected of it by ψ / 2.
    The variances are the second moments of 1 − cos ψ, sin ψ − ψ and 2 sin (ψ / 4), for a normal ψ.

    Parameters
    ----------
    H, B : (6, 21), (6, m) arrays
        Effect of states and considered errors on the means.
    P, after : (21, 21) arrays
        Covariance before the alignment, and after it as far as it is known.
    omega_ie : (3,) array
        Rotation of the Earth in n [rad/s].
    """
    heading = float(after[ATT.stop - 1, ATT.stop - 1])
    unmoved = H[:2].copy()
    unmoved[:, ATT] = 0.0
    force = unmoved @ P @ unmoved.T + B[:2] @ B[:2].T
    added = np.zeros((6, 6))
    added[:2, :2] = 2 * (1 - np.exp(-heading / 8)) * (np.trace(force) * np.eye(2) - force)
    once, twice = np.exp(-heading / 2), np.exp(-2 * heading)
    added[3, 3] = omega_ie[0] ** 2 * (1 - 2 * once + (1 + twice) / 2)
    added[4, 4] = omega_ie[0] ** 2 * max((1 - twice) / 2 - 2 * heading * once + heading, 0.0)
    return added


def _add_considered_errors(P: FloatArray, considered: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return the covariance with that of errors whose estimate is zero: its error is minus the truth."""
    across = -considered * sizes
    return np.block([[P, across], [across.T, np.diag(sizes**2)]])


def simulate_means(sensors: SensorSuite, seed: int, length: float, start: Start) -> Means:
    """Return the mean output of simulated sensors over a rest in a true attitude.

    It includes their constant biases at the temperature of the start and under gravity, scale factors,
    misalignments and the noise of a mean. The sizes of the considered errors that a filter assumes are zero.
    The instability of the flight is not included.

    Parameters
    ----------
    sensors
        The errors of the sensors.
    seed
        Seed of the run.
    length
        Length of the rest [s].
    start
        The true position and attitude.
    """
    into_b = Rotation.from_quat(start.q_nb, scalar_first=True).inv()
    sine = float(np.sin(start.position[0]))
    force = into_b.apply([0.0, 0.0, -float(earth.gravity(sine, start.position[2]))])
    rate = into_b.apply(earth.RATE * np.array([np.sqrt(1 - sine * sine), 0.0, -sine]))
    environment = imu.Environment(_temperature(sensors), force[None])

    def shown(name: str, errors: GyroErrors | AccelerometerErrors, at_rest: FloatArray) -> FloatArray:
        draws = imu.ImuDraws.of(seed, name, 0, instability=False)
        noise = np.sqrt(_noise(errors, length)) * unit_draws(seed, f"{name} alignment", (3,))
        return imu.mean_at_rest(errors, draws, at_rest, environment) + noise

    return Means(
        shown("accelerometer", sensors.accelerometer, force),
        shown("gyro", sensors.gyro, rate),
        np.diag(_noise(sensors.accelerometer, length)),
        np.diag(_noise(sensors.gyro, length)),
        _considered_jacobian(force, rate),
        np.zeros(sum(blocks.block(name).size for name in blocks.CONSIDERED)),
    )


def induced_variance(sensors: SensorSuite) -> FloatArray:
    """Return the squared biases (6,) from temperature and gravity at rest, in SI units."""
    environment = imu.Environment(_temperature(sensors), np.full((1, 3), STANDARD_GRAVITY))
    added = np.zeros((2, 3))
    for row, errors in enumerate((sensors.gyro, sensors.accelerometer)):
        added[row] = imu.induced_bias(errors, environment, 1.0)
    return added.ravel() ** 2


def _temperature(sensors: SensorSuite) -> FloatArray:
    """Return the temperature (1,) of the rest; with a compensation, its reference temperature."""
    if sensors.temperature.compensation:
        return np.array([thermal.REFERENCE])
    return thermal.temperature(sensors.temperature, np.zeros(1), np.zeros(1))


def _noise(errors: GyroErrors | AccelerometerErrors, length: float) -> FloatArray:
    """Return the variance (3,) of a mean over some time."""
    return np.asarray(si(errors, "noise_density") ** 2 / length)


def _considered_jacobian(force: FloatArray, rate: FloatArray) -> FloatArray:
    """Return the change (6, 15) of force and rate by each of the errors `blocks.CONSIDERED`."""
    pairs = 2 * len(OFF_DIAGONAL)
    mixing = np.zeros((6, pairs + 3))
    mixing[3:, pairs:] = np.diag(force)
    for k, pair in enumerate(OFF_DIAGONAL):
        row, column = ("xyz".index(axis) for axis in pair)
        mixing[3 + row, k] = rate[column]
        mixing[row, len(OFF_DIAGONAL) + k] = force[column]
    return mixing


def _sight(C_nb: FloatArray, gravity: FloatArray, omega_ie: FloatArray) -> FloatArray:
    """Return H (6, 21) of specific force plus gravity, and of rate minus the Earth's rate, in n."""
    H = np.zeros((6, 21))
    # (I − [φ×]) (−g) + g = φ × g = −[g×] φ, and (I − [φ×]) ω − ω = −φ × ω = [ω×] φ.
    H[:3, ATT], H[3:, ATT] = -skew(gravity), skew(omega_ie)
    H[:3, ACCEL_BIAS], H[3:, GYRO_BIAS] = -C_nb, -C_nb
    # Minus C times the force in b, which is −Cᵀ g; rates have no second minus.
    H[:3, ACCEL_SCALE], H[3:, GYRO_SCALE] = C_nb * (C_nb.T @ gravity), -C_nb * (C_nb.T @ omega_ie)
    return H
