"""Lever arm: how a fix sees the errors of a navigator, the antenna being away from the IMU.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 2.5.5
and 14.3 (14.106, 14.110, 14.126, 14.127).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lab import earth
from lab.navigation import strapdown
from lab.navigation.compilation import kernel
from lab.navigation.strapdown import Matrix, Vector, cross, get, matrix, plus, product, rotate, rotation

FloatArray = NDArray[np.float64]

ATT, GYRO_BIAS, GYRO_SCALE = 6, 9, 15


@kernel
def see_antenna(
    state: FloatArray,
    arm: FloatArray,
    age: float,
    noise: FloatArray,
    axes: Matrix,
    z: FloatArray,
    H: FloatArray,
    R: FloatArray,
) -> None:
    """Move navigator minus fix from the IMU to the antenna, and write how the fix sees the errors.

    The antenna is at r + C_nb l and moves with v + C_nb (ω_ib,b × l) − ω_ie,n × C_nb l, at the attitude and
    the mean rate of the last sample. The noise of the gyros over that sample is in R.

    Parameters
    ----------
    state
        The navigator, after the sample in which the fix falls.
    arm : (3,) array
        Lever arm l in b [m].
    age
        Time from the fix to the end of the sample [s].
    noise : (12,) array
        Densities of the process noise, as of `Belief`.
    axes
        North, east and down of the fix in the navigation frame.
    z : (6,) array
        Navigator minus fix; the antenna's way and velocity against the IMU are added.
    H : (6, n) array
        Holds [I 0]; receives the elements of velocity, attitude, gyro biases and scale factors.
    R : (6, 6) array
        Covariance of the fix; that of the gyros' noise is added.
    """
    for i in range(3):
        H[i, 3 + i] = -age  # the position is that of the time of the fix
    if arm[0] == 0 and arm[1] == 0 and arm[2] == 0:
        return
    per_step = state[strapdown.PER_STEP]
    x, y, z_ = get(state, strapdown.PREVIOUS_DTHETA)
    rate = x * per_step, y * per_step, z_ * per_step
    at = strapdown.Q_NB
    q = product(
        (state[at], state[at + 1], state[at + 2], state[at + 3]),
        rotation((-age * rate[0], -age * rate[1], -age * rate[2])),
    )
    C = matrix(q)
    l_b = arm[0], arm[1], arm[2]
    way = rotate(axes, rotate(C, l_b))
    sine = state[strapdown.SINE]
    omega_ie = earth.RATE * math.sqrt(max(0.0, 1 - sine * sine)), 0.0, -earth.RATE * sine
    velocity = plus(rotate(axes, rotate(C, cross(rate, l_b))), -1.0, cross(omega_ie, way))
    for i in range(3):
        z[i] += way[i]
        z[3 + i] += velocity[i]
    _skew(H, 0, way)
    _skew(H, 3, velocity)
    for j in range(3):
        axis = (1.0 if j == 0 else 0.0), (1.0 if j == 1 else 0.0), (1.0 if j == 2 else 0.0)
        column = rotate(axes, rotate(C, cross(l_b, axis)))
        felt = (rate[j] + state[strapdown.GYRO_BIAS + j]) / (1 + state[strapdown.GYRO_SCALE + j])
        for i in range(3):
            H[3 + i, GYRO_BIAS + j] = column[i]
            if H.shape[1] > GYRO_SCALE:
                H[3 + i, GYRO_SCALE + j] = column[i] * felt
            for k in range(3):
                R[3 + i, 3 + k] += column[i] * column[k] * noise[j] * per_step


@kernel
def _skew(H: FloatArray, row: int, v: Vector) -> None:
    """Write the block [v ×] of the attitude."""
    H[row, ATT + 1], H[row, ATT + 2] = -v[2], v[1]
    H[row + 1, ATT], H[row + 1, ATT + 2] = v[2], -v[0]
    H[row + 2, ATT], H[row + 2, ATT + 1] = -v[1], v[0]
