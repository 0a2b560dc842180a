"""A drive through a town with a phone on the dashboard, whose motion is known: turns, hills, two stops."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from lab.motion.recordings.recording import Recording
from lab.motion.truth.trajectory import Trajectory

RATE = 100.0
"""Rate of the IMU [Hz]."""
DURATION = 100.0
"""Length of the drive [s]."""
LATITUDE, LONGITUDE = 48.2, 11.6
"""Where it begins [°]."""
SPEED = ((0, 0), (8, 0), (16, 14), (30, 14), (34, 7), (40, 7), (48, 16), (70, 16), (76, 6), (84, 6), (92, 18))
COURSE = (
    (0, 40), (20, 40), (26, 100), (34, 100), (40, 190), (52, 190), (60, 140), (75, 140), (83, 50), (95, 50)
)  # fmt: skip
GRADE = ((0, 0), (25, 0), (30, 3), (45, 3), (55, -2), (80, -2), (90, 0))
"""Speed [m/s], course [°] and grade [°] at times [s]; between them they change steadily."""


class Drive(NamedTuple):
    """What an IMU in forward, right, down and a receiver at 1 Hz measure.

    Attributes
    ----------
    time, rate, force : arrays
        Of the IMU [s], [rad/s], [m/s²].
    at, position, velocity : arrays
        Of the fixes [s], [°, °, m], north and east [m/s].
    """

    time: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    at: np.ndarray
    position: np.ndarray
    velocity: np.ndarray

    @property
    def speed(self) -> np.ndarray:
        """Speed of the fixes [m/s]."""
        return np.hypot(*self.velocity.T)

    @property
    def course(self) -> np.ndarray:
        """Course of the fixes [°]."""
        return np.degrees(np.arctan2(self.velocity[:, 1], self.velocity[:, 0])) % 360


@cache
def trajectory() -> Trajectory:
    """Return the truth; the nose points along the course, and the body leans and nods a little."""
    dt = 1 / RATE
    t = np.arange(0, DURATION + dt / 2, dt)

    def profile(points):
        return gaussian_filter1d(np.interp(t, *zip(*points, strict=True)), 80, mode="nearest")

    speed, yaw, grade = profile(SPEED), np.radians(profile(COURSE)), np.radians(profile(GRADE))
    along = np.column_stack((np.cos(grade) * np.cos(yaw), np.cos(grade) * np.sin(yaw), -np.sin(grade)))
    velocity = speed[:, None] * along
    way = np.vstack((np.zeros(3), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * dt, axis=0)))
    latitude = np.radians(LATITUDE) + way[:, 0] / 6_373_500  # radii of curvature of WGS-84 there
    longitude = np.radians(LONGITUDE) + way[:, 1] / (6_390_200 * np.cos(np.radians(LATITUDE)))
    roll, pitch = -0.005 * speed * np.gradient(yaw, dt), grade - 0.006 * np.gradient(speed, dt)
    euler = np.column_stack((roll, pitch, yaw))
    return Trajectory.from_recording(
        Recording(t, latitude, longitude, 300 - way[:, 2], velocity, euler), RATE
    )


@cache
def drive(seed: int = 1) -> Drive:
    """Return the measurements: biases of a phone's IMU, σ of 2 m, 3 m in height, and 0.2 m/s."""
    ideal, rng = trajectory().increments(RATE), np.random.default_rng(seed)
    time = ideal.time[1:]
    rate = ideal.dtheta * RATE + np.radians((0.3, -0.2, 0.25)) + rng.normal(0, 2e-3, (time.size, 3))
    force = ideal.dvelocity * RATE + np.array((0.05, -0.04, 0.06)) + rng.normal(0, 0.03, (time.size, 3))
    at = np.arange(1.37, DURATION - 0.5)
    truth = trajectory().at(at)
    north, east, up, v_north, v_east = (rng.normal(size=(at.size, 5)) * (2, 2, 3, 0.2, 0.2)).T
    position = np.column_stack((np.degrees(truth.latitude), np.degrees(truth.longitude), truth.height))
    position += np.column_stack((north / 111_200, east / (111_320 * np.cos(truth.latitude)), up))
    return Drive(
        time, rate, force, at, position, truth.velocity_n[:, :2] + np.column_stack((v_north, v_east))
    )
