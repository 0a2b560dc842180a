"""Logs of a copter, computed from a motion given in closed form: it leans to gain speed and looks elsewhere.

The rotors push along the copter's own up, the air drags against its velocity: what the accelerometers feel
sideways and ahead is the drag alone, however the speed changes. The nose turns as it likes.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from sensor_logs import EPOCH, Tables

from lab.motion.frames import earth

RATE = 100.0
LATITUDE, LONGITUDE, HEIGHT = 0.8, -1.3, 120.0
DRAG = 0.35
"""Of a small copter, per its velocity [1/s]."""


def copter(
    duration: float = 120.0,
    *,
    late: float = 0.0,
    rest: float = 0.0,
    nose: float = 0.7,
    aside: float = 0.0,
    seed: int = 3,
) -> Tables:
    """Return what a copter logs that pulls forward and lets go, again and again.

    Parameters
    ----------
    duration
        How long [s].
    late
        By how much the fixes' stamps are late [s].
    rest
        How long it stands before [s].
    nose
        Heading at the start, from which the nose swings to either side while the course stays [rad].
    aside
        1 lets the nose keep that angle to the course instead, -1 turns it as far against the course.
    seed
        Of the noise.
    """
    rng = np.random.default_rng(seed)
    fine = np.arange(-1.0, duration + 1.0, 1 / (4 * RATE))
    flying = np.clip((fine - rest) / 2.0, 0, 1) ** 2 * (3 - 2 * np.clip((fine - rest) / 2.0, 0, 1))
    t = fine - rest
    speed = flying * (5.0 + 3.5 * np.sin(2 * np.pi * t / 7.0) + np.sin(2 * np.pi * t / 17.0))
    course = 0.4 * np.sin(2 * np.pi * t / 61.0)
    velocity = np.stack(
        (speed * np.cos(course), speed * np.sin(course), -0.4 * flying * np.sin(2 * np.pi * t / 13.0)),
        axis=-1,
    )
    heading = nose + (aside * course if aside else flying * 0.5 * np.sin(2 * np.pi * t / 23.0))
    moving = CubicSpline(fine, velocity)
    g = float(earth.gravity(np.sin(LATITUDE), HEIGHT))
    force_n = moving(fine, 1) - (0, 0, g)
    down = -(force_n + DRAG * velocity)
    down /= np.linalg.norm(down, axis=1)[:, None]
    ahead = np.stack((np.cos(heading), np.sin(heading), np.zeros_like(heading)), axis=-1)
    ahead -= down * (ahead * down).sum(axis=1)[:, None]
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    attitude = Rotation.from_matrix(np.stack((ahead, np.cross(down, ahead), down), axis=-1))
    rate = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * 4 * RATE
    force = attitude.inv().apply(force_n)
    steps = np.arange(round(RATE), round((duration + 1) * RATE)) * 4
    imu = np.column_stack(
        (
            fine[steps],
            np.stack([rate[steps - k] for k in range(1, 5)]).mean(axis=0),
            np.stack([(force[steps - k] + force[steps - k + 1]) / 2 for k in range(1, 5)]).mean(axis=0),
        )
    )
    imu[:, 1:4] += rng.normal(scale=2e-3, size=(len(imu), 3)) + np.radians((0.2, -0.1, 0.15))
    imu[:, 4:] += rng.normal(scale=0.05, size=(len(imu), 3)) + np.array((0.03, -0.05, 0.04))
    times = np.arange(0.0, duration, 0.2)
    gone = moving.antiderivative()(times) - moving.antiderivative()(0.0)
    meridian, transverse = earth.radii(np.sin(LATITUDE))
    place = np.column_stack(
        (
            np.degrees(LATITUDE + gone[:, 0] / (meridian + HEIGHT)),
            np.degrees(LONGITUDE + gone[:, 1] / ((transverse + HEIGHT) * np.cos(LATITUDE))),
            HEIGHT - gone[:, 2],
        )
    )
    at = np.searchsorted(fine, times - 1e-9)
    euler = attitude[at].as_euler("ZYX", degrees=True)[:, ::-1]
    reference = np.column_stack((times, place, moving(times), euler))
    noise = rng.normal(scale=(3e-6, 4e-6, 0.5, 0.06, 0.06, 0.06), size=(len(times), 6))
    sigma = np.tile((0.4, 0.4, 0.6, 0.06, 0.06, 0.06), (len(times), 1))
    gnss = np.column_stack((times + late, np.column_stack((place, moving(times))) + noise, sigma))
    for table in (imu, gnss, reference):
        table[:, 0] += EPOCH
    return Tables(imu, gnss, reference)
