"""A constant turn over the rotating Earth in closed form: its motion, and what an IMU feels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pymap3d
from scipy.spatial.transform import Rotation

from lab.motion.frames import earth
from lab.motion.recordings.recording import Frame

EARTH = np.array([0.0, 0.0, earth.RATE])


class Turning(NamedTuple):
    """A circle in the plane that touches the ellipsoid at height, with a constant bank.

    Attributes
    ----------
    latitude, longitude, height : float
        Centre [rad], [m].
    radius, speed, bank : float
        Radius [m], speed [m/s], bank [rad].
    """

    latitude: float = 0.8
    longitude: float = 0.13
    height: float = 900.0
    radius: float = 600.0
    speed: float = 60.0
    bank: float = 0.55

    @property
    def turn(self) -> float:
        """Rate of the turn to the right [rad/s]."""
        return self.speed / self.radius

    def _plane(self) -> np.ndarray:
        """Return the axes north, east, down of the centre, as columns in e."""
        lat, lon = self.latitude, self.longitude
        north = (-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat))
        east = (-np.sin(lon), np.cos(lon), 0.0)
        down = (-np.cos(lat) * np.cos(lon), -np.cos(lat) * np.sin(lon), -np.sin(lat))
        return np.column_stack((north, east, down))

    def in_e(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, Rotation]:
        """Return position, velocity and acceleration in e, and C_eb, at times (n,)."""
        plane, w = self._plane(), self.turn
        angle = w * t
        out = np.stack((np.cos(angle), np.sin(angle), 0 * t), axis=-1)
        along = np.stack((-np.sin(angle), np.cos(angle), 0 * t), axis=-1)
        centre = np.array(pymap3d.geodetic2ecef(self.latitude, self.longitude, self.height, deg=False))
        C_pb = Rotation.from_euler("ZYX", np.stack((angle + np.pi / 2, 0 * t, 0 * t + self.bank), axis=-1))
        return (
            centre + self.radius * out @ plane.T,
            self.speed * along @ plane.T,
            -self.speed * w * out @ plane.T,
            Rotation.from_matrix(plane) * C_pb,
        )

    def frames(self, t: np.ndarray) -> list[Frame]:
        """Return the frames at times (n,)."""
        r_e, v_e, _, C_eb = self.in_e(t)
        lat, lon, height = map(np.atleast_1d, pymap3d.ecef2geodetic(*r_e.T, deg=False))
        found = []
        for k, time in enumerate(t):
            C_en = self._replace(latitude=lat[k], longitude=lon[k])._plane()
            yaw, pitch, roll = (Rotation.from_matrix(C_en.T) * C_eb[k]).as_euler("ZYX")
            place = np.array([lat[k], lon[k], height[k]])
            found.append(Frame(float(time), place, C_en.T @ v_e[k], np.array([roll, pitch, yaw])))
        return found

    def felt(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ω_ib,b [rad/s] and f_b [m/s²] (n, 3) at times (n,)."""
        r_e, v_e, a_e, C_eb = self.in_e(t)
        lat, lon, height = map(np.atleast_1d, pymap3d.ecef2geodetic(*r_e.T, deg=False))
        down = np.stack((-np.cos(lat) * np.cos(lon), -np.cos(lat) * np.sin(lon), -np.sin(lat)), axis=-1)
        gravity = earth.gravity(np.sin(lat), height)[:, None] * down
        f_e = a_e + 2 * np.cross(EARTH, v_e) - gravity
        turning = self._plane() @ (0.0, 0.0, self.turn)
        return C_eb.apply(EARTH + turning, inverse=True), C_eb.apply(f_e, inverse=True)
