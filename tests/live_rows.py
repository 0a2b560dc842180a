"""Rows of a live stream, computed from a drive in closed form and from a vehicle that stands still."""

from __future__ import annotations

from functools import cache

import numpy as np
import pymap3d
from scipy.spatial.transform import Rotation

from lab.data.clock.timed_samples import NO_READINGS, TIMED_FIX, TIMED_IMU, TIMED_READING
from lab.missions import Recording
from lab.motion.frames import earth
from lab.motion.frames.rotation import C_nb_from_euler
from lab.motion.truth.trajectory import Trajectory
from lab.sensors.imu import Environment, ImuDraws, measure
from lab.sensors.suite import SensorSuite
from lab.sensors.temperature import REFERENCE

HOST = 5000.0
"""Time of the host at the first sample [s]."""
RATE = 100.0
FIX_SIGMA = (0.5, 0.8, 0.1)
"""σ of a fix: horizontal, vertical [m], speed [m/s]."""


def ramp(time: np.ndarray, start: float, length: float) -> np.ndarray:
    """Return a smooth step from 0 to 1, which begins at a time and takes some time [s]."""
    x = np.clip((time - start) / length, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x * x)


@cache
def drive(end: float = 90.0) -> Trajectory:
    """Return a drive: at rest until 20 s, again from 50 to 70 s, with turns in between."""
    time = np.arange(0, end + 0.01, 0.05)
    speed = 8.0 * (ramp(time, 20, 5) - ramp(time, 45, 5) + ramp(time, 70, 5))
    course = 0.6 + 1.2 * ramp(time, 28, 6) - 0.9 * ramp(time, 37, 6) + 1.0 * ramp(time, 78, 6)
    velocity = np.column_stack((speed * np.cos(course), speed * np.sin(course), np.zeros(time.size)))
    path = np.cumsum(np.vstack((np.zeros(3), 0.025 * (velocity[1:] + velocity[:-1]))), axis=0)
    lat, lon, _ = pymap3d.enu2geodetic(path[:, 1], path[:, 0], np.zeros(time.size), 45.0, -73.5, 100.0)
    euler = np.column_stack((np.full(time.size, 0.02), np.full(time.size, -0.03), course))
    recording = Recording(
        time=time,
        latitude=np.radians(lat),
        longitude=np.radians(lon),
        height=np.full(time.size, 100.0),
        velocity_n=velocity,
        euler=euler,
    )
    return Trajectory.from_recording(recording, RATE)


def imu_rows(time: np.ndarray, rate: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return rows of an IMU; times from 0 [s]."""
    rows = np.zeros(time.size, TIMED_IMU)
    rows["time"] = rows["arrival"] = time + HOST
    rows["rate"], rows["force"] = rate, force
    rows["magnetic"] = rows["temperature"] = rows["pressure"] = np.nan
    return rows


def fix_rows(time: np.ndarray, position: np.ndarray, velocity: np.ndarray, late: float = 0.0) -> np.ndarray:
    """Return rows of a receiver; times of validity from 0 [s], and how much later they arrive [s]."""
    rows = np.zeros(time.size, TIMED_FIX)
    rows["time"], rows["arrival"] = time + HOST, time + HOST + late
    rows["latitude"], rows["longitude"], rows["height"] = position.T
    rows["velocity_n"] = velocity
    rows["horizontal_sigma"], rows["vertical_sigma"], rows["speed_sigma"] = FIX_SIGMA
    rows["fix_type"], rows["satellites"] = 3, 9
    return rows


def driven(
    seed: int = 1,
    late: float = 0.0,
    lever_arm=(0.0, 0.0, 0.0),
    period: float = 0.25,
    trajectory: Trajectory | None = None,
):
    """Return the rows of IMU and receiver on a drive, with a little noise and bias, and the trajectory."""
    trajectory, rng = trajectory or drive(), np.random.default_rng(seed)
    ideal = trajectory.increments(RATE)
    n = len(ideal.dtheta)
    rate = ideal.dtheta * RATE + np.radians((0.1, -0.2, 0.15)) + rng.normal(scale=1e-3, size=(n, 3))
    force = ideal.dvelocity * RATE + (0.02, -0.01, 0.03) + rng.normal(scale=0.02, size=(n, 3))
    times = np.arange(0.1, ideal.time[-1] - 0.3, period)
    truth = trajectory.at(times)
    C = Rotation.from_quat(truth.q_nb, scalar_first=True)
    turn, _ = trajectory.rates(times)
    sigma = np.array(FIX_SIGMA)
    arm = C.apply(lever_arm) + rng.normal(size=(times.size, 3)) * sigma[[0, 0, 1]]
    velocity = truth.velocity_n + C.apply(np.cross(turn, lever_arm))
    velocity = velocity + rng.normal(scale=sigma[2], size=velocity.shape)
    north, east, down = arm.T
    place = np.stack((truth.latitude, truth.longitude, truth.height), axis=-1)
    place += np.stack((north / 6.37e6, east / (6.39e6 * np.cos(truth.latitude)), -down), axis=-1)
    return imu_rows(ideal.time[1:], rate, force), fix_rows(times, place, velocity, late), trajectory


def standing(
    sensors: SensorSuite, euler: tuple[float, float, float], latitude: float, seconds: float, seed: int,
    rate: float = 100.0,
) -> np.ndarray:  # fmt: skip
    """Return the rows of simulated sensors at rest, with the errors of a suite.

    Parameters
    ----------
    sensors
        The errors.
    euler
        Roll, pitch, heading [rad].
    latitude
        Latitude, at height 0 [rad].
    seconds, rate
        Length [s] and rate [Hz].
    seed
        Seed of the errors.
    """
    n, dt = round(seconds * rate), 1 / rate
    C_bn = C_nb_from_euler(np.array(euler)).T
    turning = C_bn @ (earth.RATE * np.array([np.cos(latitude), 0, -np.sin(latitude)]))
    force = C_bn @ (0, 0, -float(earth.gravity(np.sin(latitude), 0.0)))
    shown = []
    for name, errors, true in (
        ("gyro", sensors.gyro, turning),
        ("accelerometer", sensors.accelerometer, force),
    ):
        draws = ImuDraws.of(seed, name, n, instability=True, flicker=True, walk=True)
        environment = Environment(np.array(REFERENCE), force * dt)
        shown.append(measure(np.tile(true * dt, (n, 1)), dt, errors, draws, environment).increments / dt)
    return imu_rows(np.arange(1, n + 1) * dt, *shown)


def handled(sensors: SensorSuite, latitude: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of simulated sensors that a hand turns, at 50 Hz, and the Euler angles after each row.

    They rest for 15 s, are turned about all axes for 20 s, and rest for 20 s in another attitude.
    """
    rng, dt = np.random.default_rng(seed), 0.02
    time = np.arange(round(55 / dt) + 1) * dt
    euler = np.tile(rng.uniform((-0.3, -0.3, -3), (0.3, 0.3, 3)), (time.size, 1))
    part = np.clip((time - 15) / 20, 0, 1)
    for axis in range(3):
        swing = np.sin(np.pi * part) ** 2 * np.sin(2 * np.pi * part * (2 + axis))
        euler[:, axis] += swing * rng.uniform(0.3, 0.8) + ramp(time, 15, 20) * rng.uniform(-0.5, 0.5)
    C_nb = Rotation.from_euler("ZYX", euler[:, ::-1])
    earth_rate = earth.RATE * np.array([np.cos(latitude), 0, -np.sin(latitude)])
    C_ib = Rotation.from_rotvec(np.outer(time, earth_rate)) * C_nb
    turned = (C_ib[:-1].inv() * C_ib[1:]).as_rotvec()
    halfway = C_nb[:-1] * Rotation.from_rotvec(turned / 2)
    felt = halfway.inv().apply([0, 0, -float(earth.gravity(np.sin(latitude), 0.0))]) * dt
    shown = []
    for name, errors, true in (
        ("gyro", sensors.gyro, turned),
        ("accelerometer", sensors.accelerometer, felt),
    ):
        draws = ImuDraws.of(seed, name, len(true), instability=True, flicker=True, walk=True)
        environment = Environment(np.array(REFERENCE), felt)
        shown.append(measure(true, dt, errors, draws, environment).increments / dt)
    return imu_rows(time[1:], *shown), euler[1:]


def reading_rows(name: str, time: np.ndarray, values: np.ndarray, late: float = 0.0) -> np.ndarray:
    """Return headings [rad] or speeds [m/s] at times from 0 [s], which arrive later by some time [s]."""
    rows = np.zeros(time.size, TIMED_READING)
    rows["time"], rows["arrival"] = time + HOST, time + HOST + late
    rows["heading"] = rows["speed"] = rows["heading_sigma"] = np.nan
    rows[name] = values
    return rows


def feed(navigator, imu: np.ndarray, fixes: np.ndarray, pieces, readings: np.ndarray = NO_READINGS) -> None:
    """Feed rows of the IMU in pieces, each with the fixes and readings that have arrived by its end."""
    start = fix = reading = 0
    for size in pieces:
        if start >= imu.size:
            break
        part = imu[start : start + size]
        due = int(np.searchsorted(fixes["arrival"], part["arrival"][-1], "right"))
        come = int(np.searchsorted(readings["arrival"], part["arrival"][-1], "right"))
        navigator.feed(part, fixes[fix:due], readings[reading:come])
        start, fix, reading = start + size, max(due, fix), max(come, reading)
    navigator.feed(imu[start:], fixes[fix:], readings[reading:])
    navigator.finish()
