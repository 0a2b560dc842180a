"""Reference of the aids: how the filter in filterpy sees measurements other than fixes.

Written with whole matrices, independently of the compiled `aids`, to be read and to be compared with.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 6 and
16.2.
"""

from __future__ import annotations

import importlib

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.aid_table import FURTHER
from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.motion.frames.rotation import skew, wrap
from lab.navigation import strapdown
from lab.navigation.aids import AIRSPEED, FORWARD, HEADING, HEIGHT, LEAST_LEVEL, MAGNETIC, NORTHWARD, Aids
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL
from lab.navigation.filters.heading_observability import CHANCE, LEVEL, UNKNOWN
from lab.navigation.filters.vertical_bias import MOST
from lab.navigation.kernels import own_room


def predict_aid(
    state: FloatArray, aids: Aids, a: int, age: float, dt: float, names: tuple[str, ...]
) -> tuple[float, FloatArray]:
    """Return navigator minus measurement a of the aids, and its row of H (n,)."""
    row, value = np.zeros(blocks.count(names)), aids.value[a]
    v, before = _three(state, strapdown.VELOCITY), _three(state, strapdown.PREVIOUS_VELOCITY)
    velocity = v - age / dt * (v - before)
    rate = _three(state, strapdown.PREVIOUS_DTHETA) * state[strapdown.PER_STEP]
    C_nb = Rotation.from_quat(state[strapdown.Q_NB : strapdown.Q_NB + 4], scalar_first=True).as_matrix()
    C_nb = C_nb @ Rotation.from_rotvec(-age * rate).as_matrix()
    kind = int(aids.kind[a])
    if kind == HEIGHT:
        row[POS][2], row[VEL][2] = -1.0, age
        _write(row, names, blocks.BAROMETER_BIAS, 1.0)
        there = state[strapdown.HEIGHT] + age * velocity[2]
        return float(there + state[strapdown.BAROMETER_BIAS] - value), row
    if kind in (HEADING, MAGNETIC):
        axis = C_nb @ (aids.field[a] if kind == MAGNETIC else np.array([1.0, 0.0, 0.0]))
        level = np.array([-axis[1], axis[0], 0.0]) / (axis[0] ** 2 + axis[1] ** 2)
        row[ATT] = level @ skew(axis)  # δc = −φ × c = c × φ
        _write(row, names, blocks.HEADING_BIAS, 1.0)
        azimuth = np.arctan2(axis[1], axis[0]) + state[strapdown.HEADING_BIAS]
        return float(wrap(azimuth - value)), row
    if kind == AIRSPEED:
        through_air = velocity - np.append(state[strapdown.WIND : strapdown.WIND + 2], 0.0)
        speed, scale = float(np.linalg.norm(through_air)), float(1 + state[strapdown.AIRSPEED_SCALE])
        row[VEL] = scale * through_air / speed
        _write(row, names, blocks.WIND, -row[VEL][:2])
        _write(row, names, blocks.AIRSPEED_SCALE, speed)
        return scale * speed - value, row
    if kind > AIRSPEED:
        return _predict_further(kind - AIRSPEED - 1, state, C_nb, velocity, age, value, names)
    if kind >= NORTHWARD:
        row[VEL][kind - NORTHWARD] = 1.0
        return float(velocity[kind - NORTHWARD] - value), row
    along = kind - FORWARD
    speed = float((C_nb.T @ velocity + np.cross(rate, aids.place))[along])
    row[VEL] = C_nb[:, along]
    row[ATT] = -C_nb[:, along] @ skew(velocity)
    row[GYRO_BIAS] = skew(aids.place)[along] / (1 + _three(state, strapdown.GYRO_SCALE))
    if kind == FORWARD:
        row *= 1 + state[strapdown.ODOMETER_SCALE]
        _write(row, names, blocks.ODOMETER_SCALE, speed)
        speed *= 1 + state[strapdown.ODOMETER_SCALE]
    return speed - value, row


def _predict_further(
    k: int,
    state: FloatArray,
    C_nb: FloatArray,
    velocity: FloatArray,
    age: float,
    value: float,
    names: tuple[str, ...],
) -> tuple[float, FloatArray]:
    """Return navigator minus a reading of further sensor k of the aid table, and its row of H (n,)."""
    aid, own, row = FURTHER[k], state[strapdown.AID_ERRORS + k], np.zeros(blocks.count(names))
    see = importlib.import_module(aid.belief).see_by_matrices
    seen, row[: blocks.CORE] = see(state, C_nb, velocity, age)
    if aid.is_scale:
        row *= 1 + own
    _write(row, names, aid.state, seen if aid.is_scale else 1.0)
    return float((1 + own) * seen if aid.is_scale else seen + own) - value, row


def as_biases(state: FloatArray, H: FloatArray, names: tuple[str, ...]) -> None:
    """Write the columns of H (m, n) of all states that act as gyro biases do, from those of the biases."""
    if blocks.GYRO_DRIFT in names:
        H[:, blocks.find_states(names, blocks.GYRO_DRIFT)] = H[:, GYRO_BIAS]
    if blocks.GYRO_G in names:
        force = _three(state, strapdown.PREVIOUS_DVELOCITY) * state[strapdown.PER_STEP]
        felt = (1 + _three(state, strapdown.GYRO_SCALE)) * force
        H[:, blocks.find_states(names, blocks.GYRO_G)] = H[:, GYRO_BIAS] * felt
    own = blocks.user_states(names)
    size = own.stop - own.start
    effects = state[own_room.EFFECTS : own_room.EFFECTS + own_room.WIDTH * size].reshape(size, own_room.WIDTH)
    # They are taken off behind the scale factors, the biases before them.
    H[:, own] = H[:, GYRO_BIAS] * (1 + _three(state, strapdown.GYRO_SCALE)) @ effects.T[:3]


def vertical_directions(state: FloatArray, P: FloatArray, *, in_body: bool) -> FloatArray:
    """Return the directions (2, n) of heading and vertical gyro bias among the states.

    Parameters
    ----------
    state
        The navigator.
    P : (n, n) array
        Covariance: a gyro bias that is certain has no part in the vertical one.
    in_body
        Whether the attitude error is resolved in b.
    """
    C_nb = Rotation.from_quat(state[strapdown.Q_NB : strapdown.Q_NB + 4], scalar_first=True).as_matrix()
    D = np.zeros((2, P.shape[0]))
    D[0, ATT] = C_nb[2] if in_body else (0.0, 0.0, 1.0)
    down = np.where(np.diag(P)[GYRO_BIAS] > 0, C_nb[2], 0.0)
    D[1, GYRO_BIAS] = down / (np.linalg.norm(down) or 1.0)
    return D


def shows_heading(P: FloatArray, H: FloatArray, S: FloatArray, D: FloatArray) -> bool:
    """Return whether a measurement shows heading or vertical gyro bias more than by chance.

    Parameters
    ----------
    P : (n, n) array
        Covariance before the update.
    H : (r, n) array
        Measurement matrix, for the filter's own errors.
    S : (r,) array
        Variances of the innovation.
    D : (2, n) array
        From `vertical_directions`.
    """
    variance = np.diag(D @ P @ D.T)
    turned = np.zeros((9, 9))
    for block in (POS, VEL, ATT):
        turned[block, block] = skew(D[0, ATT])
    of_heading = (P @ D[0])[:9]
    others = P[:9, :9] - np.outer(of_heading, of_heading) / variance[0]
    chance = np.minimum(np.diag(H[:, :9] @ turned @ others @ turned.T @ H[:, :9].T), S)
    response = H @ P @ D.T
    own_variance = np.diag(H @ P @ H.T) - response[:, 0] ** 2 / variance[0]
    counts = (H @ D.T != 0) | (chance > LEVEL * own_variance)[:, None]
    limit = CHANCE**2 * variance[0] * chance[:, None] * variance
    return bool(variance[0] > UNKNOWN or (counts & (response**2 > limit)).any())


def vertical_bias_noise(state: FloatArray, P: FloatArray, D: FloatArray) -> FloatArray:
    """Return the process noise (n, n) that raises the variance of the vertical accelerometer bias.

    The square of the tilt adds to this bias (`vertical_bias`).

    Parameters
    ----------
    state
        The navigator.
    P : (n, n) array
        Covariance after an update.
    D : (2, n) array
        From `vertical_directions`.
    """
    across = np.eye(3) - np.outer(D[0, ATT], D[0, ATT])
    Sigma = across @ P[ATT, ATT] @ across
    C_nb = Rotation.from_quat(state[strapdown.Q_NB : strapdown.Q_NB + 4], scalar_first=True).as_matrix()
    down = np.zeros(P.shape[0])
    down[ACCEL_BIAS] = C_nb[2]
    before = down @ P @ down
    least = min(STANDARD_GRAVITY**2 / 4 * (np.trace(Sigma) ** 2 + 2 * np.trace(Sigma @ Sigma)), MOST)
    return np.outer(down, down) * (max(least - before, 0.0) if before > 0 else 0.0)


def bent_speed(state: FloatArray, P: FloatArray, *, in_body: bool) -> float:
    """Return how much larger a speed forward appears on average, because the attitude is uncertain [m/s].

    Parameters
    ----------
    state
        The navigator.
    P : (3, 3) array
        Covariance of the attitude [rad²].
    in_body
        Whether it is resolved in b.
    """
    C_nb = Rotation.from_quat(state[strapdown.Q_NB : strapdown.Q_NB + 4], scalar_first=True).as_matrix()
    forward = np.array([1.0, 0.0, 0.0]) if in_body else C_nb[:, 0]
    speed = C_nb[:, 0] @ _three(state, strapdown.VELOCITY)
    return float(speed * (np.trace(P) - forward @ P @ forward) / 2)


def azimuth_variance(state: FloatArray, aids: Aids, a: int, P: FloatArray, *, in_body: bool) -> float:
    """Return the variance of an azimuth from the products of tilts [rad²], infinite if it is too steep.

    Parameters
    ----------
    state
        The navigator.
    aids, a
        The measurements, and the number of this one, an azimuth.
    P : (3, 3) array
        Covariance of the attitude [rad²].
    in_body
        Whether it is resolved in b.
    """
    C_nb = Rotation.from_quat(state[strapdown.Q_NB : strapdown.Q_NB + 4], scalar_first=True).as_matrix()
    axis = C_nb @ (aids.field[a] if aids.kind[a] == MAGNETIC else np.array([1.0, 0.0, 0.0]))
    tilts = (C_nb @ P @ C_nb.T if in_body else P)[:2, :2]
    moved, level = axis[2] ** 2 * np.trace(tilts) / 2, axis[0] ** 2 + axis[1] ** 2
    if aids.kind[a] == HEADING and level <= LEAST_LEVEL**2 * moved:
        return np.inf
    return float((moved / level) ** 2)


def bent_airspeed(state: FloatArray, P: FloatArray) -> float:
    """Return how much larger an airspeed appears on average, because the wind is uncertain [m/s].

    Parameters
    ----------
    state
        The navigator.
    P : (2, 2) array
        Covariance of the wind to the north and to the east [m²/s²].
    """
    through_air = _three(state, strapdown.VELOCITY) - np.append(
        state[strapdown.WIND : strapdown.WIND + 2], 0.0
    )
    level = through_air[:2]
    across = np.array([-level[1], level[0]]) / np.linalg.norm(level)
    return float(across @ P @ across / (2 * np.linalg.norm(through_air)))


def _write(row: FloatArray, names: tuple[str, ...], name: str, value: float | FloatArray) -> None:
    """Write the elements of a row for the states of a block, if the filter has it."""
    if name in names:
        row[blocks.find_states(names, name)] = value


def _three(state: FloatArray, at: int) -> FloatArray:
    return state[at : at + 3]
