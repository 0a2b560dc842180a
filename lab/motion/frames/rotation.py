"""Rotation: attitude as quaternion, matrix and Euler angles, in the lab's one convention.

`C_nb` takes a vector from the body frame (forward, right, down) to the navigation frame (north, east, down);
`q_nb` is the same rotation as a unit quaternion, scalar first. Euler angles are roll, pitch, yaw: the
aerospace sequence that turns n into b by yaw about z, then pitch about y, then roll about x. Every function
takes a single rotation or an array of them; angles in radians. For anything else (composition, rotation
vectors, means) use `scipy.spatial.transform.Rotation` with ``scalar_first=True``: its rotation is our `C_nb`.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 2.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lab.base.arrays import FloatArray

SMALL_ANGLE = 1e-3
"""Angle below which a Jacobian is computed as a series [rad]; the terms that it omits are below 2e-15."""


def wrap(angle: ArrayLike) -> FloatArray:
    """Return angles, or differences of angles, brought to ±π; values already there keep every bit.

    Parameters
    ----------
    angle : (...) array
        Angles [rad].
    """
    angle = np.asarray(angle, dtype=np.float64)
    return np.asarray(angle - 2 * np.pi * np.round(angle / (2 * np.pi)))


def skew(v: FloatArray) -> FloatArray:
    """Return [v ×] (3, 3), so that [v ×] w = v × w.

    Parameters
    ----------
    v : (3,) array
        A vector.
    """
    return np.cross(v, np.eye(3)).T


def left_jacobian(phi: FloatArray) -> FloatArray:
    """Return J (3, 3) of a rotation vector φ (3,) [rad]: exp(φ + δ) is exp(J δ) exp(φ) to first order in δ.

    Source: J. Sola, J. Deray, D. Atchuthan, *A micro Lie theory for state estimation in robotics*, 2018,
    eq. 145.
    """
    square, turn = float(phi @ phi), skew(phi)
    angle = np.sqrt(square)
    if angle < SMALL_ANGLE:
        first, second = 1 / 2 - square / 24, 1 / 6 - square / 120
    else:
        first, second = (1 - np.cos(angle)) / square, (angle - np.sin(angle)) / (angle * square)
    return np.asarray(np.eye(3) + first * turn + second * turn @ turn)


def C_nb_from_euler(euler: ArrayLike) -> FloatArray:  # noqa: N802
    """Return the matrix (..., 3, 3) taking b to n (Groves 2.22, transposed).

    Parameters
    ----------
    euler : (..., 3) array
        Roll, pitch, yaw [rad].
    """
    euler = np.asarray(euler, dtype=np.float64)
    (sr, sp, sy), (cr, cp, cy) = np.sin(np.moveaxis(euler, -1, 0)), np.cos(np.moveaxis(euler, -1, 0))
    C_nb = np.empty((*euler.shape, 3))
    C_nb[..., 0, 0] = cp * cy
    C_nb[..., 0, 1] = sr * sp * cy - cr * sy
    C_nb[..., 0, 2] = cr * sp * cy + sr * sy
    C_nb[..., 1, 0] = cp * sy
    C_nb[..., 1, 1] = sr * sp * sy + cr * cy
    C_nb[..., 1, 2] = cr * sp * sy - sr * cy
    C_nb[..., 2, 0] = -sp
    C_nb[..., 2, 1] = sr * cp
    C_nb[..., 2, 2] = cr * cp
    return C_nb


def quaternion_from_euler(euler: ArrayLike) -> FloatArray:
    """Return the quaternion `q_nb` (..., 4), scalar first (Groves 2.38).

    Parameters
    ----------
    euler : (..., 3) array
        Roll, pitch, yaw [rad].
    """
    half = 0.5 * np.moveaxis(np.asarray(euler, dtype=np.float64), -1, 0)
    (sr, sp, sy), (cr, cp, cy) = np.sin(half), np.cos(half)
    return np.stack(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ),
        axis=-1,
    )


def euler_from_C_nb(C_nb: ArrayLike) -> FloatArray:  # noqa: N802
    """Return roll, pitch, yaw (..., 3) of the matrix taking b to n (Groves 2.23).

    Parameters
    ----------
    C_nb : (..., 3, 3) array
        Rotation matrices.

    Returns
    -------
    (..., 3) array
        Roll and yaw within ±π, pitch within ±π/2 [rad]. Roll and yaw are undefined at pitch
        ±90° exactly.
    """
    C = np.asarray(C_nb, dtype=np.float64)
    return _euler(C[..., 2, 1], C[..., 2, 2], -C[..., 2, 0], C[..., 1, 0], C[..., 0, 0])


def euler_from_quaternion(q_nb: ArrayLike) -> FloatArray:
    """Return roll, pitch, yaw (..., 3) of a unit quaternion (Groves 2.37).

    Parameters
    ----------
    q_nb : (..., 4) array
        Unit quaternions, scalar first; both signs mean the same attitude.

    Returns
    -------
    (..., 3) array
        Roll and yaw within ±π, pitch within ±π/2 [rad]. Roll and yaw are undefined at pitch
        ±90° exactly.
    """
    w, x, y, z = np.moveaxis(np.asarray(q_nb, dtype=np.float64), -1, 0)
    return _euler(
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
        2 * (w * y - x * z),
        2 * (x * y + w * z),
        1 - 2 * (y * y + z * z),
    )


def _euler(
    C32: FloatArray, C33: FloatArray, sin_pitch: FloatArray, C21: FloatArray, C11: FloatArray
) -> FloatArray:
    """Return roll, pitch, yaw from the five elements of `C_nb` that hold them."""
    # The arctangent keeps pitch exact near ±90°, where the arcsine loses half of the digits. Each angle is
    # contiguous, because the angles are mostly used separately.
    euler = np.moveaxis(np.empty((3, *np.shape(C32))), 0, -1)
    euler[..., 0] = np.arctan2(C32, C33)
    euler[..., 1] = np.arctan2(sin_pitch, np.sqrt(C32 * C32 + C33 * C33))
    euler[..., 2] = np.arctan2(C21, C11)
    return euler


def body_rate(euler: FloatArray, euler_rate: FloatArray) -> FloatArray:
    """Return ω_nb,b (..., 3) of Euler angles that change in time (Groves, ch. 2.3) [rad/s].

    Parameters
    ----------
    euler, euler_rate : (..., 3) arrays
        Roll, pitch, yaw [rad] and their derivatives [rad/s].
    """
    roll, pitch = euler[..., 0], euler[..., 1]
    roll_rate, pitch_rate, yaw_rate = np.moveaxis(euler_rate, -1, 0)
    sr, cr, cp = np.sin(roll), np.cos(roll), np.cos(pitch)
    return np.stack(
        (
            roll_rate - np.sin(pitch) * yaw_rate,
            cr * pitch_rate + sr * cp * yaw_rate,
            cr * cp * yaw_rate - sr * pitch_rate,
        ),
        axis=-1,
    )


def euler_jacobian(euler: ArrayLike) -> FloatArray:
    """Return the matrix (..., 3, 3) that maps the attitude error φ to the errors of roll, pitch and heading.

    φ is defined by Ĉ_nb = (I − [φ×]) C_nb and errors are estimate − truth: a positive φ_D turns the estimated
    heading *down*. The covariance of the Euler angle errors is J P_φ Jᵀ.

    Parameters
    ----------
    euler : (..., 3) array
        Roll, pitch, yaw [rad]; pitch must not be ±90°, where roll and heading errors are unbounded.
    """
    euler = np.asarray(euler, dtype=np.float64)
    pitch, yaw = euler[..., 1], euler[..., 2]
    sy, cy, cp, tp = np.sin(yaw), np.cos(yaw), np.cos(pitch), np.tan(pitch)
    jacobian = np.zeros((*euler.shape, 3))
    # Minus the map from ω in n to rates of Euler angles: (I − [φ×]) C is C turned by −φ.
    jacobian[..., 0, 0] = -cy / cp
    jacobian[..., 0, 1] = -sy / cp
    jacobian[..., 1, 0] = sy
    jacobian[..., 1, 1] = -cy
    jacobian[..., 2, 0] = -cy * tp
    jacobian[..., 2, 1] = -sy * tp
    jacobian[..., 2, 2] = -1.0
    return jacobian
