"""Smooth axes: axes in which velocity and attitude change smoothly, also close to a pole.

North, east and down turn fast close to a pole and jump across it. Flights close to a pole are resolved in
Earth-fixed axes, others in north, east, down.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames import ecef, rotation


class SmoothAxes:
    """Axes f: north, east, down (n), or the Earth-fixed ones (e) if a flight comes close to a pole.

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
