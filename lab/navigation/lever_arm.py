"""Lever arm: the measurement matrix of a fix if the antenna is away from the IMU.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 2.5.5
and 14.3 (14.106, 14.110, 14.126, 14.127).
"""

from __future__ import annotations

import math

import numpy as np

from lab.base.arrays import FloatArray, running_sums
from lab.motion.frames import earth
from lab.navigation import strapdown
from lab.navigation.kernels.compilation import kernel
from lab.navigation.solution import Imu
from lab.navigation.strapdown import (
    Matrix,
    Vector,
    corrected,
    cross,
    get,
    matrix,
    per_scale,
    plus,
    product,
    rotate,
    rotation,
)

ATT, GYRO_BIAS, GYRO_SCALE = 6, 9, 15
"""Indices at which these error states begin."""
OTHER_AXES = ((1, 2), (0, 2), (0, 1))
"""The other two axes of each axis, in the order of misalignments."""
WINDOW = 0.1
"""Time about a fix over which the gyros are averaged [s], about as long as a receiver averages its velocity.
With a single sample, its noise on the lever arm would make the velocity of the antenna jump. An oscillation
of 2 Hz loses 6 % of its amplitude."""

NO_TURNS = np.array([[0.0, 0.0, 0.0, 1.0]])
"""Placeholder for the rates about the fixes if the antenna is at the IMU."""


def mean_rates_at_fixes(
    imu: Imu, times: FloatArray, arm: FloatArray, step: float | None = None, *, estimated: bool = False
) -> FloatArray:
    """Return the mean measured rate (m, 3) about some times [rad/s], and the averaging time [s].

    The averaging time is `WINDOW`, or two samples if they are longer; at the ends of the flight it is
    shorter.

    Parameters
    ----------
    imu
        The measurements.
    times : (m,) array
        Times of validity of the fixes [s].
    arm : (3,) array
        Lever arm [m]; without one, the rates are not needed, and `NO_TURNS` is returned.
    step
        Usual interval between samples, if `imu` is a part of the measurements only [s].
    estimated
        Whether the filter estimates the lever arm, so that the rates are needed without one too.

    Returns
    -------
    (m, 4) array
        Rates, then averaging times.
    """
    if not arm.any() and not estimated:
        return NO_TURNS
    window = max(WINDOW, 2 * (imu.step if step is None else step))
    middle = np.clip(times, imu.time[0], imu.time[-1])
    ends = np.clip([middle - window / 2, middle + window / 2], imu.time[0], imu.time[-1])
    angles = running_sums(imu.dtheta)
    turned = np.stack([np.diff(np.interp(ends, imu.time, angle), axis=0)[0] for angle in angles.T], axis=-1)
    length = ends[1] - ends[0]
    return np.column_stack((turned / length[:, None], length))


@kernel
def predict_antenna(
    state: FloatArray,
    arm: FloatArray,
    turn: FloatArray,
    age: float,
    noise: FloatArray,
    axes: Matrix,
    z: FloatArray,
    H: FloatArray,
    R: FloatArray,
    scaled: bool,
    arm_at: int,
    misalignment_at: int,
) -> None:
    """Move navigator minus fix from the IMU to the antenna, and write H.

    The antenna is at r + C_nb l and moves with v + C_nb (ω_ib,b × l) − ω_ie,n × C_nb l, with the mean rate
    about the fix. R includes the noise of the gyros over that time.

    Parameters
    ----------
    state
        The navigator, after the sample in which the fix falls.
    arm : (3,) array
        Assumed lever arm in b [m]; l is this plus the estimated error in the state.
    turn : (4,) array
        Mean measured rate about the fix [rad/s], and its averaging time [s]; see `mean_rates_at_fixes`.
    age
        Time from the fix to the end of the sample [s].
    noise : (12,) array
        Densities of the process noise, as in `Belief`.
    axes
        North, east and down of the fix in the navigation frame.
    z : (6,) array
        Navigator minus fix; displacement and velocity of the antenna relative to the IMU are added.
    H : (6, n) array
        Holds [I 0]; receives the elements of velocity, attitude, gyro biases and scale factors.
    R : (6, 6) array
        Covariance of the fix; that of the gyros' noise is added.
    scaled
        Whether the filter has states for the scale factors.
    arm_at
        First state of the error of the lever arm; −1 without it.
    misalignment_at
        First state of the misalignments of the gyros; −1 without them.
    """
    for i in range(3):
        H[i, 3 + i] = -age  # the position refers to the time of the fix
    l_b = plus((arm[0], arm[1], arm[2]), 1.0, get(state, strapdown.LEVER_ARM))
    if arm_at < 0 and l_b[0] == 0 and l_b[1] == 0 and l_b[2] == 0:
        return
    per = per_scale(state, strapdown.GYRO_SCALE)
    rate = corrected(
        state, get(turn, 0), 1.0, strapdown.GYRO_BIAS, strapdown.GYRO_SCALE, strapdown.GYRO_MISALIGNMENT
    )
    at = strapdown.Q_NB
    # Turned back to the attitude at the time of the fix.
    q = product(
        (state[at], state[at + 1], state[at + 2], state[at + 3]),
        rotation((-age * rate[0], -age * rate[1], -age * rate[2])),
    )
    C = matrix(q)
    arm_n = rotate(axes, rotate(C, l_b))
    sine = state[strapdown.SINE]
    omega_ie = earth.RATE * math.sqrt(max(0.0, 1 - sine * sine)), 0.0, -earth.RATE * sine
    # Gyros measure ω_ib, while a receiver moves relative to the Earth: less ω_ie × l.
    velocity = plus(rotate(axes, rotate(C, cross(rate, l_b))), -1.0, cross(omega_ie, arm_n))
    for i in range(3):
        z[i] += arm_n[i]
        z[3 + i] += velocity[i]
    _skew(H, 0, arm_n)
    _skew(H, 3, velocity)
    for j in range(3):
        axis = (1.0 if j == 0 else 0.0), (1.0 if j == 1 else 0.0), (1.0 if j == 2 else 0.0)
        x, y, z_n = rotate(axes, rotate(C, cross(l_b, axis)))
        column = x * per[j], y * per[j], z_n * per[j]
        if arm_at >= 0:
            displaced = rotate(axes, rotate(C, axis))
            moving = plus(rotate(axes, rotate(C, cross(rate, axis))), -1.0, cross(omega_ie, displaced))
            for i in range(3):
                H[i, arm_at + j], H[3 + i, arm_at + j] = displaced[i], moving[i]
        for i in range(3):
            H[3 + i, GYRO_BIAS + j] = column[i]
            if scaled:
                H[3 + i, GYRO_SCALE + j] = column[i] * rate[j]
            if misalignment_at >= 0:
                for k in range(2):
                    H[3 + i, misalignment_at + 2 * j + k] = column[i] * rate[OTHER_AXES[j][k]]
            for k in range(3):
                # Noise in the mean rate moves the antenna, too: its density over the averaging time.
                R[3 + i, 3 + k] += column[i] * column[k] * noise[j] / turn[3]


@kernel
def _skew(H: FloatArray, row: int, v: Vector) -> None:
    """Write the block [v ×] of the attitude."""
    H[row, ATT + 1], H[row, ATT + 2] = -v[2], v[1]
    H[row + 1, ATT], H[row + 1, ATT + 2] = v[2], -v[0]
    H[row + 2, ATT], H[row + 2, ATT + 1] = -v[1], v[0]
