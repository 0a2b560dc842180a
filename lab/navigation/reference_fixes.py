"""Reference fixes: what the navigator of `lab.navigation.reference` predicts of a fix, in whole matrices."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames import earth
from lab.motion.frames.rotation import skew, wrap
from lab.navigation import strapdown
from lab.navigation.filters import blocks
from lab.navigation.filters.blocks import LEVER_ARM
from lab.navigation.filters.error_models import ATT, GYRO_BIAS, GYRO_SCALE, POS, VEL
from lab.navigation.reference_aids import as_biases
from lab.navigation.solution import Belief, Fixes
from lab.sensors.imu_errors import OFF_DIAGONAL


def part_of(state: FloatArray, at: int, count: int = 3) -> FloatArray:
    """Return some numbers of the state of the navigator, as a view."""
    return state[at : at + count]


def predict_antenna(
    state: FloatArray, belief: Belief, turn: FloatArray, age: float, names: tuple[str, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return H of a fix (6, n), the antenna relative to the IMU (6,), and an addition to R (6, 6).

    The antenna has a displacement and a velocity; the addition to R is the noise of the gyros on the lever
    arm.
    """
    arm, n = belief.lever_arm + part_of(state, strapdown.LEVER_ARM), blocks.count(names)
    measured, length = turn[:3], turn[3]
    scale, bias = part_of(state, strapdown.GYRO_SCALE), gyro_bias(state)
    rate = alignment(state, strapdown.GYRO_SCALE, strapdown.GYRO_MISALIGNMENT) @ (measured - bias)
    C_nb = Rotation.from_quat(part_of(state, strapdown.Q_NB, 4), scalar_first=True).as_matrix()
    C_nb = C_nb @ Rotation.from_rotvec(-age * rate).as_matrix()
    latitude = np.arcsin(state[strapdown.SINE])
    omega_ie = earth.RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    arm_n = C_nb @ arm
    velocity = C_nb @ np.cross(rate, arm) - np.cross(omega_ie, arm_n)
    H = np.eye(6, n)
    H[POS, VEL] = -age * np.eye(3)
    H[POS, ATT], H[VEL, ATT] = skew(arm_n), skew(velocity)
    H[VEL, GYRO_BIAS] = C_nb @ skew(arm) / (1 + scale)
    if blocks.GYRO_SCALE in names:
        H[VEL, GYRO_SCALE] = H[VEL, GYRO_BIAS] * rate
    if blocks.GYRO_MISALIGNMENT in names:
        first = blocks.first_state(names, blocks.GYRO_MISALIGNMENT)
        for k, pair in enumerate(OFF_DIAGONAL):
            row, column = ("xyz".index(axis) for axis in pair)
            H[VEL, first + k] = H[VEL, GYRO_BIAS][:, row] * rate[column]
    as_biases(state, H, names)
    own = blocks.user_states(names)
    seen = np.concatenate((arm_n, velocity)) + H[:, own] @ user_values(state, names)
    if blocks.GYRO_G in names:
        seen = seen + H[:, blocks.find_states(names, blocks.GYRO_G)] @ part_of(state, strapdown.GYRO_G)
    if LEVER_ARM in names:
        H[POS, blocks.find_states(names, LEVER_ARM)] = C_nb
        H[VEL, blocks.find_states(names, LEVER_ARM)] = C_nb @ skew(rate) - skew(omega_ie) @ C_nb
    gyro_noise = np.zeros((6, 6))
    gyro_noise[VEL, VEL] = H[VEL, GYRO_BIAS] * belief.noise[:3] @ H[VEL, GYRO_BIAS].T / length
    return H, seen, gyro_noise


def gyro_bias(state: FloatArray) -> FloatArray:
    """Return both parts of the gyro biases (3,)."""
    return part_of(state, strapdown.GYRO_BIAS) + part_of(state, strapdown.GYRO_DRIFT)


def user_values(state: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """Return the estimates (k,) of the states that a user declared."""
    own = blocks.user_states(names)
    return state[list(blocks.find_places(names))[own.start - GYRO_BIAS.start :]]


def alignment(state: FloatArray, scale: int, off: int) -> FloatArray:
    """Return the matrix (3, 3) that takes scale factors and misalignments off a vector.

    Misalignments M to third order, as in the strapdown: (I + M)⁻¹ ≈ I − M + M².
    """
    factors, M = 1 + part_of(state, scale), np.zeros((3, 3))
    for pair, part in zip(OFF_DIAGONAL, part_of(state, off, 6), strict=True):
        row, column = ("xyz".index(axis) for axis in pair)
        M[row, column] = part / factors[row]
    return np.asarray((np.eye(3) - M + M @ M) / factors)


def predict_receiver_errors(state: FloatArray, H: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """Return what the estimated errors of the receiver add to navigator minus fix (6,), and write H."""
    added = np.zeros(6)
    if blocks.LATENCY in names:
        v, before = part_of(state, strapdown.VELOCITY), part_of(state, strapdown.PREVIOUS_VELOCITY)
        motion = np.concatenate((v, (v - before) * state[strapdown.PER_STEP]))
        added -= state[strapdown.LATENCY] * motion
        H[:, blocks.find_states(names, blocks.LATENCY)] = -motion[:, None]
    if blocks.GPS_DRIFT in names:
        added[POS] += part_of(state, strapdown.GPS_DRIFT)
        H[POS, blocks.find_states(names, blocks.GPS_DRIFT)] = np.eye(3)
    return added


def metres_per_radian(state: FloatArray) -> tuple[float, float]:
    """Return R_M + h and (R_N + h) cos L [m]: metres per radian of latitude and longitude."""
    return 1 / state[strapdown.MERIDIAN], state[strapdown.COSINE] / state[strapdown.TRANSVERSE]


def navigator_minus_fix(state: FloatArray, fixes: Fixes, m: int, age: float, dt: float) -> FloatArray:
    """Return navigator minus fix (6,), the navigator interpolated to the time of the fix."""
    v, before = part_of(state, strapdown.VELOCITY), part_of(state, strapdown.PREVIOUS_VELOCITY)
    latitude, longitude, height = part_of(state, strapdown.LATITUDE)
    per_latitude, per_longitude = metres_per_radian(state)
    position = np.array(
        [
            (latitude - fixes.position[m, 0]) * per_latitude,
            float(wrap(longitude - fixes.position[m, 1])) * per_longitude,
            fixes.position[m, 2] - height,
        ]
    )
    position -= age * (v + before) / 2
    velocity = v - (age / dt) * (v - before) - fixes.velocity_n[m]
    return np.concatenate((position, velocity))
