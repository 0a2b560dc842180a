"""Derived motion: specific forces and body rates derived from recorded samples, their noise, and smooth axes.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., eq. 5.53
(velocity over the Earth in n, solved for the specific force).
"""

from __future__ import annotations

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames import earth, ecef, rotation
from lab.motion.recordings.recording import Recording

_WINDOW = 5
"""Samples in a row through which the parabola goes."""
_REST = np.array([3.0, -12.0, 18.0, -12.0, 3.0]) / 35
"""Weights that give the middle of five samples minus the parabola through them by least squares."""
_POLE = np.radians(89.0)
"""Latitude from which on the turning of north is left out [rad]."""


class SmoothAxes:
    """Axes f in which velocity and attitude change smoothly: north, east, down (n), or Earth-fixed ones (e).

    North, east and down turn fast close to a pole and jump across it. Flights close to a pole are resolved in
    Earth-fixed axes, others in north, east, down.

    Parameters
    ----------
    latitude : (n,) array
        Latitudes of the flight [rad].
    """

    def __init__(self, latitude: FloatArray) -> None:
        self.polar = bool(ecef.near_pole(latitude).any())

    def vectors(self, vectors_n: FloatArray, position: FloatArray) -> FloatArray:
        """Return vectors (n, 3) in f, given in n at positions (n, 3)."""
        if not self.polar:
            return vectors_n
        return np.asarray(np.einsum("nij,nj->ni", ecef.axes(*position[:, :2].T), vectors_n))

    def vectors_n(self, vectors: FloatArray, position: FloatArray) -> FloatArray:
        """Return vectors (n, 3) in n at positions (n, 3), given in f."""
        if not self.polar:
            return vectors
        return np.asarray(np.einsum("nji,nj->ni", ecef.axes(*position[:, :2].T), vectors))

    def attitudes(self, euler: FloatArray, position: FloatArray) -> FloatArray:
        """Return quaternions q_fb (n, 4) whose sign does not flip from one to the next.

        Parameters
        ----------
        euler : (n, 3) array
            Roll, pitch, yaw [rad].
        position : (n, 3) array
            Where.
        """
        q_fb = rotation.quaternion_from_euler(euler)
        if self.polar:
            C_en = Rotation.from_matrix(ecef.axes(*position[:, :2].T))
            q_fb = (C_en * Rotation.from_quat(q_fb, scalar_first=True)).as_quat(scalar_first=True)
        turned = np.sum(q_fb[1:] * q_fb[:-1], axis=1) < 0
        q_fb[1:][np.cumsum(turned) % 2 == 1] *= -1
        return np.asarray(q_fb)

    def euler(self, q_fb: FloatArray, position: FloatArray) -> FloatArray:
        """Return roll, pitch, yaw (n, 3) [rad] at positions (n, 3) of unit quaternions q_fb (n, 4)."""
        if not self.polar:
            return rotation.euler_from_quaternion(q_fb)
        C_en = Rotation.from_matrix(ecef.axes(*position[:, :2].T))
        C_nb = C_en.inv() * Rotation.from_quat(q_fb, scalar_first=True)
        return rotation.euler_from_quaternion(C_nb.as_quat(scalar_first=True))


def specific_force(position: FloatArray, velocity_n: FloatArray, acceleration_n: FloatArray) -> FloatArray:
    """Return the specific force, north, east, down (n, 3) [m/s²] (Groves 5.53).

    Its magnitude is what an accelerometer measures; within a degree of a pole the turning of north is left
    out.

    Parameters
    ----------
    position : (n, 3) array
        Latitude, longitude [rad] and height [m].
    velocity_n, acceleration_n : (n, 3) arrays
        Velocity over the Earth and the derivatives of its components [m/s], [m/s²].
    """
    latitude, _, height = position.T
    s, c = np.sin(latitude), np.maximum(np.cos(latitude), np.cos(_POLE))
    meridian, transverse = earth.radii(s)
    east_rate = velocity_n[:, 1] / (transverse + height)
    omega_en_n = np.stack((east_rate, -velocity_n[:, 0] / (meridian + height), -east_rate * s / c), axis=-1)
    omega_ie_n = earth.RATE * np.stack((c, np.zeros_like(c), -s), axis=-1)
    f_n = acceleration_n + np.cross(2 * omega_ie_n + omega_en_n, velocity_n)
    f_n[:, 2] -= earth.gravity(s, height)
    return np.asarray(f_n)


def body_rates(time: FloatArray, euler: FloatArray, stride: int = 1) -> FloatArray:
    """Return the mean ω_nb,b from each sample to the one `stride` later, (n − stride, 3) [rad/s].

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    euler : (n, 3) array
        Roll, pitch, yaw [rad].
    stride
        How many samples later.
    """
    C_nb = Rotation.from_quat(rotation.quaternion_from_euler(euler), scalar_first=True)
    turn = (C_nb[:-stride].inv() * C_nb[stride:]).as_rotvec()
    return np.asarray(turn / (time[stride:] - time[:-stride])[:, None])


def spline_rates(time: FloatArray, values: FloatArray, order: int) -> FloatArray:
    """Return a derivative of the spline through samples, on an even grid of as many times, (n, m).

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    values : (n, m) array
        Samples.
    order
        Which derivative, 1 or 2.
    """
    return np.asarray(
        scipy.interpolate.CubicSpline(time, values)(np.linspace(time[0], time[-1], len(time)), order)
    )


def roughness(values: FloatArray) -> float:
    """Return the rms residual of evenly spaced vectors (n, 3) against the parabola through five in a row.

    It is 1.2 for white noise of σ = 1 on each axis, 2.4 for noise that alternates from sample to sample,
    and near 0 for motion that is slow against the samples.
    """
    if len(values) <= _WINDOW:
        return 0.0
    rest = sum(weight * values[start : len(values) - 4 + start] for start, weight in enumerate(_REST))
    return float(np.sqrt(np.mean(np.sum(np.asarray(rest) ** 2, axis=1))))


def euler_at(recording: Recording, times: FloatArray) -> FloatArray:
    """Return roll, pitch, yaw (n, 3) [rad] of a recording at times within it."""
    q_nb = SmoothAxes(np.zeros(1)).attitudes(recording.euler, np.zeros((len(recording.time), 3)))
    between = scipy.interpolate.CubicSpline(recording.time, q_nb)(times)
    return rotation.euler_from_quaternion(between / np.linalg.norm(between, axis=1, keepdims=True))
