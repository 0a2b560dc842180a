"""Rest alignment: what the sensors of a vehicle at rest before a flight show of attitude and gyro biases.

The accelerometers show the vertical as far as their own biases let them; the gyros show their biases, and
north by the Earth's rate if their biases are small enough. Both are one update of the initial estimate, so
that each comes out as well as the grade of the sensors allows, and the errors that are left are correlated
as they are in truth: a tilt with the accelerometer bias that caused it.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 5.6
(levelling, gyro-compassing) and 3.4.1 (iterated update); S. F. Schmidt, *Application of state-space methods
to navigation problems*, Advances in Control Systems 3 (1966), for errors that are considered, not estimated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab import earth
from lab.navigation.belief import constant_errors
from lab.navigation.error_models import ACCEL_BIAS, ACCEL_SCALE, ATT, GYRO_BIAS, GYRO_SCALE
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Start
from lab.rotation import skew
from lab.sensors import imu
from lab.sensors import temperature as thermal
from lab.sensors.draws import unit_draws
from lab.sensors.imu import AccelerometerErrors, GyroErrors
from lab.sensors.suite import SensorSuite
from lab.units import si

FloatArray = NDArray[np.float64]

ROUNDS = 8
"""Times the update is made anew about its own result; from a heading 20° off, gyros of 0.01 °/h take six."""
LEAST_FORCE, LEAST_RATE = 1e-6, 5e-9
"""σ below which no mean at rest is believed, of 0.1 µg [m/s²] and 0.001 °/h [rad/s]: sensors without noise
would leave a covariance of lower rank."""
ESTIMATED = np.r_[6:12]
"""The states that are estimated: attitude and gyro biases. Biases of the accelerometers and scale factors
are considered."""


class Means(NamedTuple):
    """What the sensors put out on the average of a rest, and how well that is known.

    Attributes
    ----------
    force, rate : (3,) arrays
        In b [m/s²], [rad/s].
    force_covariance, rate_covariance : (3, 3) arrays
        Of what no state stands for: the noise of the mean, and misalignments.
    """

    force: FloatArray
    rate: FloatArray
    force_covariance: FloatArray
    rate_covariance: FloatArray


class Aligned(NamedTuple):
    """The start of a navigator after a rest.

    Attributes
    ----------
    start : Start
        With the attitude that was found.
    gyro_bias : (3,) array
        Gyro bias that was found [rad/s].
    P : (21, 21) array
        Covariance of the errors that are left.
    kept : (21, 21) array
        What is left of an initial error: I − K H.
    noise : (21, 6) array
        Errors that the noise of the means brought, one σ in each column.
    """

    start: Start
    gyro_bias: FloatArray
    P: FloatArray
    kept: FloatArray
    noise: FloatArray


def begin(
    start: Start, true: Start, sensors: SensorSuite, navigator: NavigatorSettings, seed: int
) -> Aligned:
    """Return the start of a simulated navigator: after its alignment, or as it is without one.

    Parameters
    ----------
    start, true
        What is believed before, and where the vehicle is.
    sensors, navigator
        The errors of the sensors; the filter, which says how long the rest is.
    seed
        Seed of the run.
    """
    P, length = constant_errors(sensors, navigator), float(navigator.alignment)
    if not length:
        return Aligned(start, np.zeros(3), P, np.eye(21), np.zeros((21, 6)))
    P[np.diag_indices(21)] += np.concatenate((np.zeros(9), induced_variance(sensors), np.zeros(6)))
    return align(start, P, means_of(sensors, seed, length, true))


def usual(sensors: SensorSuite, navigator: NavigatorSettings) -> FloatArray | None:
    """Return P (21, 21) after the alignment of a level vehicle that points north at 45°; None without one."""
    if not navigator.alignment:
        return None
    level = Start(np.array([np.pi / 4, 0.0, 0.0]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return begin(level, level, sensors, navigator, 0).P


def align(start: Start, P: FloatArray, means: Means) -> Aligned:
    """Return the start after a rest.

    Parameters
    ----------
    start
        What is believed before, the gyro bias taken for zero.
    P : (21, 21) array
        Covariance of the errors before; those of position and velocity stay.
    means
        What the sensors put out.
    """
    sine, height = float(np.sin(start.position[0])), float(start.position[2])
    gravity = np.array([0.0, 0.0, float(earth.gravity(sine, height))])
    omega_ie = earth.RATE * np.array([np.sqrt(1 - sine * sine), 0.0, -sine])
    before = Rotation.from_quat(start.q_nb, scalar_first=True)
    x, after = np.zeros(21), P
    for _ in range(ROUNDS):
        attitude = Rotation.from_rotvec(x[ATT]) * before
        C_nb = attitude.as_matrix()
        z = np.concatenate((C_nb @ means.force + gravity, C_nb @ (means.rate + x[GYRO_BIAS]) - omega_ie))
        H = _sight(C_nb, gravity, omega_ie, means.force)
        R = np.zeros((6, 6))
        R[:3, :3] = C_nb @ means.force_covariance @ C_nb.T + LEAST_FORCE**2 * np.eye(3)
        R[3:, 3:] = C_nb @ means.rate_covariance @ C_nb.T + LEAST_RATE**2 * np.eye(3)
        # Beyond first order a heading error ψ takes 1 − cos ψ off the level part of the Earth's rate.
        R[3, 3] += 0.75 * (omega_ie[0] * after[ATT.stop - 1, ATT.stop - 1]) ** 2
        K = np.zeros((21, 6))
        K[ESTIMATED] = np.linalg.solve(H @ P @ H.T + R, H @ P)[:, ESTIMATED].T
        x = K @ (z + H @ x)
        kept, noise = np.eye(21) - K @ H, K @ np.linalg.cholesky(R)
        after = kept @ P @ kept.T + noise @ noise.T
    q_nb = (Rotation.from_rotvec(x[ATT]) * before).as_quat(scalar_first=True)
    return Aligned(start._replace(q_nb=q_nb), -x[GYRO_BIAS], (after + after.T) / 2, kept, noise)


def means_of(sensors: SensorSuite, seed: int, length: float, start: Start) -> Means:
    """Return what simulated sensors put out on the average of a rest in a true attitude.

    Their constant biases at the temperature of the start and under gravity, scale factors, misalignments and
    the noise of a mean. What varies, the instability of the flight, is not there before it.

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
        _unmodelled(sensors.accelerometer, force, length),
        _unmodelled(sensors.gyro, rate, length),
    )


def induced_variance(sensors: SensorSuite) -> FloatArray:
    """Return the square of what temperature and gravity add to the biases at rest (6,), in SI units."""
    environment = imu.Environment(_temperature(sensors), np.full((1, 3), earth.STANDARD_GRAVITY))
    added = np.zeros((2, 3))
    for row, errors in enumerate((sensors.gyro, sensors.accelerometer)):
        added[row] = imu.induced_bias(errors, environment, 1.0)
    return added.ravel() ** 2


def _temperature(sensors: SensorSuite) -> FloatArray:
    """Return the temperature (1,) at which the biases are those of the rest; a compensation's reference."""
    if sensors.temperature.compensation:
        return np.array([thermal.REFERENCE])
    return thermal.temperature(sensors.temperature, np.zeros(1), np.zeros(1))


def _noise(errors: GyroErrors | AccelerometerErrors, length: float) -> FloatArray:
    """Return the variance (3,) of a mean over some time."""
    return np.asarray(si(errors, "noise_density") ** 2 / length)


def _unmodelled(errors: GyroErrors | AccelerometerErrors, at_rest: FloatArray, length: float) -> FloatArray:
    """Return the covariance (3, 3) of a mean without biases and scale factors: noise and misalignment."""
    M = imu.misalignment(errors)
    return np.diag(_noise(errors, length)) + np.outer(M @ at_rest, M @ at_rest)


def _sight(C_nb: FloatArray, gravity: FloatArray, omega_ie: FloatArray, force: FloatArray) -> FloatArray:
    """Return how the errors (21,) show in specific force plus gravity and rate less the Earth's, in n."""
    H = np.zeros((6, 21))
    H[:3, ATT], H[3:, ATT] = -skew(gravity), skew(omega_ie)
    H[:3, ACCEL_BIAS], H[3:, GYRO_BIAS] = -C_nb, -C_nb
    # The bias comes off the output of the gyros: their scale factors count for what turns the IMU alone.
    H[:3, ACCEL_SCALE], H[3:, GYRO_SCALE] = -C_nb * force, -C_nb * (C_nb.T @ omega_ie)
    return H
