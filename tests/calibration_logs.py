"""Logs for calibrations with known errors: rests and turns of an IMU, fields, a drive with an IMU askew.

The motion is in closed form: each turn is about one axis of the device, so that its rates are exact.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from lab import Experiment
from lab.analysis.calibration.rests import Samples
from tests.aided_flights import HEADER
from tests.sensor_logs import Tables, write

GRAVITY = 9.81
EARTH = 7.292115e-5 * np.array([np.cos(0.8), 0.0, -np.sin(0.8)])
FACES = (
    (0, 0, 0),
    (np.pi / 2, 0, 0),
    (np.pi, 0, 0),
    (-np.pi / 2, 0, 0),
    (0, np.pi / 2, 0),
    (0, -np.pi / 2, 0),
)


class Errors(NamedTuple):
    """True errors of an IMU: measured = K true + b."""

    K_a: np.ndarray
    b_a: np.ndarray
    K_g: np.ndarray
    b_g: np.ndarray

    @property
    def terms(self) -> dict[tuple[str, str, str], float]:
        """The errors by group, name and axis, in the units of the terms."""
        found = {}
        for k, one in enumerate("xyz"):
            found["accelerometer", "bias", one] = self.b_a[k]
            found["gyro", "bias", one] = np.degrees(self.b_g[k])
            for group, K in (("accelerometer", self.K_a), ("gyro", self.K_g)):
                found[group, "scale factor", one] = 100 * (K[k, k] - 1)
                for j, other in enumerate("xyz"):
                    if j != k:
                        found[group, "misalignment", one + other] = np.degrees(K[k, j])
        return found


def errors(rng: np.random.Generator, size: float = 1.0) -> Errors:
    """Return errors of a consumer IMU: 1 %, 0.6°, 0.1 m/s², 0.6 °/s, times a size."""
    skew = rng.normal(scale=0.01 * size, size=(3, 3))
    K_a = np.eye(3) + np.triu(skew) + np.triu(skew, 1).T
    K_g = np.eye(3) + rng.normal(scale=0.01 * size, size=(3, 3))
    return Errors(K_a, rng.normal(scale=0.1 * size, size=3), K_g, rng.normal(scale=0.01 * size, size=3))


def bench(
    rng: np.random.Generator,
    made: Errors,
    rests: int = 18,
    *,
    faces: bool = False,
    shake: float = 0.0,
    rate: float = 100.0,
) -> tuple[Samples, Samples]:
    """Return what an IMU measures in rests of 3 s and turns of 2.5 s between them.

    Parameters
    ----------
    rng, made
        Random numbers, and the errors of the IMU.
    rests
        Number of rests, in random attitudes.
    faces
        Whether they are the faces of a box, put down within a degree.
    shake
        σ of a hand that never rests [rad/s]; also in m/s².
    rate
        Rate of the samples [Hz].
    """
    attitudes = [Rotation.random(random_state=rng) for _ in range(rests)]
    if faces:
        askew = Rotation.from_rotvec(rng.normal(scale=0.02, size=(rests, 3)))
        attitudes = [Rotation.from_rotvec(FACES[k % 6]) * askew[k] for k in range(rests)]
    still, moving = round(3.0 * rate), round(2.5 * rate)
    way = np.linspace(0.0, 1.0, moving + 1)
    way -= np.sin(2 * np.pi * way) / (2 * np.pi)
    rates, forces = [], []
    for k, begin in enumerate(attitudes):
        rates.append(np.tile(begin.inv().apply(EARTH), (still, 1)))
        forces.append(np.tile(begin.inv().apply([0.0, 0.0, -GRAVITY]), (still, 1)))
        if k + 1 < rests:
            turn = (begin.inv() * attitudes[k + 1]).as_rotvec()
            there = begin * Rotation.from_rotvec(way[1:, None] * turn)
            rates.append(np.diff(way)[:, None] * turn * rate + there.inv().apply(EARTH))
            forces.append(there.inv().apply([0.0, 0.0, -GRAVITY]))
    rate_true, force_true = np.concatenate(rates), np.concatenate(forces)
    time = np.arange(1, len(rate_true) + 1) / rate
    noise = rng.normal(size=(2, len(time), 3))
    gyro = rate_true @ made.K_g.T + made.b_g + np.hypot(6e-4, shake) * noise[0]
    force = force_true @ made.K_a.T + made.b_a + np.hypot(9e-3, 10 * shake) * noise[1]
    return Samples(time, gyro), Samples(time, force)


def write_bench(path: Path, gyro: Samples, accelerometer: Samples) -> Path:
    """Write samples as a csv with headings that name their units."""
    head = "t_s,gx_rad_s,gy_rad_s,gz_rad_s,fx_m_s2,fy_m_s2,fz_m_s2"
    rows = np.column_stack((gyro.time, gyro.values, accelerometer.values))
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=head, comments="")
    return path


def fields(
    rng: np.random.Generator, K: np.ndarray, hard: np.ndarray, *, level: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and fields [µT] of a magnetometer that turns in all directions; level: about one axis."""
    time = np.arange(1500) / 25
    if level:
        angles = np.column_stack((2 * np.pi * time / 20, 0.02 * np.sin(time), 0.02 * np.cos(time / 3)))
    else:
        tilt = np.pi / 2 * np.sin(2 * np.pi * time / 23)
        angles = np.column_stack((2 * np.pi * time / 7, tilt, 2 * np.pi * time / 31)) + rng.uniform(0, 6, 3)
    there = Rotation.from_euler("zyx", angles)
    return time, there.inv().apply([18.0, -3.0, 50.0]) @ K.T + hard + rng.normal(scale=0.4, size=(1500, 3))


def road(
    folder: Path,
    seconds: float = 400.0,
    *,
    straight: bool = False,
    slip: float = 0.0,
    sway: float = 0.0,
    seed: int = 0,
) -> Path:
    """Return a drive of a car at 7 to 17 m/s on a winding road, along its nose; or at one speed straight on.

    Parameters
    ----------
    folder
        Where the file is written.
    seconds
        Duration [s].
    straight
        Whether the road is straight, and the speed always the same.
    slip
        Speed to the right in turns, for each of their rate [m]: as of a boat.
    sway, seed
        σ of a speed to the right by chance, alike within a second [m/s], and where its numbers begin.
    """
    t = np.arange(0.0, seconds + 0.05, 0.1)
    course = 0.9 * np.sin(2 * np.pi * t / 70) + 0.5 * np.sin(2 * np.pi * t / 23) + 2 * np.pi * t / 300
    speed = 12 + 5 * np.sin(2 * np.pi * t / 41)
    if straight:
        course, speed = np.zeros(t.size), np.full(t.size, 12.0)
    chance = gaussian_filter1d(np.random.default_rng(seed).normal(size=t.size), 6)
    heading = course - (slip * np.gradient(course, t) + sway * chance / chance.std()) / speed
    north, east = speed * np.cos(course), speed * np.sin(course)
    place = [np.concatenate(([0.0], np.cumsum((v[1:] + v[:-1]) / 2 * 0.1))) for v in (north, east)]
    latitude = 45.5 + np.degrees(place[0] / 6.371e6)
    longitude = -73.6 + np.degrees(place[1] / (6.378e6 * np.cos(np.radians(45.5))))
    shown = (np.degrees(heading) + 180) % 360 - 180
    rows = np.column_stack((t, latitude, longitude, north, east, shown))
    line = "{:.1f},{:.10f},{:.10f},30,{:.6f},{:.6f},0,0,0,{:.6f}\n"
    path = folder / "road.csv"
    path.write_text(HEADER + "".join(line.format(*row) for row in rows))
    return path


def drive(folder: Path, seed: int, pitch: float, yaw: float, **of_road: float | bool) -> Experiment:
    """Return an experiment on the log of a drive whose IMU is mounted askew by pitch and yaw [°]."""
    made = Experiment(mission=str(road(folder, **of_road, seed=99 + seed)), seed=seed)  # type: ignore[arg-type]
    made.set("trajectory.imu_rate", 50.0)
    made.set("sensors.gps.position_variance", 0.25)
    made.set("sensors.gps.velocity_variance", 0.0025)
    result = made.run()
    askew = Rotation.from_euler("zyx", [yaw, pitch, 0.0], degrees=True).inv()
    dt = np.diff(result.time)[:, None]
    rates = [askew.apply(one.increments / dt) for one in (result.gyro, result.accelerometer)]
    fixes, truth = result.fixes, result.truth_arrays
    sigma = np.tile((0.5, 0.5, 0.5, 0.05, 0.05, 0.05), (fixes.time.size, 1))
    place = np.degrees(fixes.position[:, :2]), fixes.position[:, 2:]
    gnss = np.column_stack((fixes.time, *place, fixes.velocity_n, sigma))
    there = truth.time, np.degrees(truth.latitude), np.degrees(truth.longitude), truth.height
    reference = np.column_stack((*there, truth.velocity_n, np.degrees(truth.euler)))[::10]
    tables = Tables(np.column_stack((result.time[1:], *rates)), gnss, reference)
    log = Experiment(mission=str(write(folder / "log", tables, 'vehicle = "car"\n')))
    for triad in ("gyro", "accelerometer"):
        for term in ("noise_density", "bias_sigma", "instability", "flicker", "rate_random_walk"):
            log.set(f"sensors.{triad}.{term}", made.get(f"sensors.{triad}.{term}"))
    return log
