"""Flights for other sensors: a winding road, a vehicle that stands still; errors drawn as believed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from lab import Experiment

HEADER = (
    "time_s,latitude_deg,longitude_deg,height_m,velocity_north_m_s,velocity_east_m_s,velocity_down_m_s,"
    "roll_deg,pitch_deg,yaw_deg\n"
)
ARM, LATE = (1.0, 0.5, -0.5), 0.3
"""What the filter assumes of the receiver [m], [s]; the truth is drawn about it."""
ARM_SIGMA, LATE_SIGMA = 0.5, 0.05
"""σ of both [m], [s]."""
MISALIGNMENT = 0.2
"""σ of each misalignment [°], and its size: the sign is drawn, since a filter takes the size as σ."""
G_SENSITIVITY = 0.01
"""As for the misalignments [°/s/g]."""


def winding_road(
    folder: Path, seconds: float = 200.0, *, drift: float = 0.0, current: float = 0.0, banks: bool = False
) -> Path:
    """Return a drive at 15 m/s along a winding level road, the car pointing where it goes.

    Parameters
    ----------
    folder
        Where the file is written.
    seconds
        Duration [s].
    drift
        By how much the nose points into a turn, for each of its rate [s]: as that of a ship.
    current
        Speed to the north of what carries it [m/s].
    banks
        Whether it banks into its turns, as an aeroplane does.
    """
    t = np.arange(0.0, seconds + 0.05, 0.1)
    course = 0.8 * np.sin(2 * np.pi * t / 60) + 0.4 * np.sin(2 * np.pi * t / 17)
    turning = np.gradient(course, t)
    heading, roll = course + drift * turning, np.arctan(15 * turning / 9.81) * banks
    north, east = 15 * np.cos(course) + current, 15 * np.sin(course)
    place = [np.concatenate(([0.0], np.cumsum((v[1:] + v[:-1]) / 2 * 0.1))) for v in (north, east)]
    latitude = 45.5 + np.degrees(place[0] / 6.371e6)
    longitude = -73.6 + np.degrees(place[1] / (6.378e6 * np.cos(np.radians(45.5))))
    path = folder / "drive.csv"
    rows = np.column_stack((t, latitude, longitude, north, east, np.degrees(roll), np.degrees(heading)))
    line = "{:.1f},{:.10f},{:.10f},30,{:.6f},{:.6f},0,{:.6f},0,{:.6f}\n"
    path.write_text(HEADER + "".join(line.format(*row) for row in rows))
    return path


def standing(folder: Path) -> Path:
    """Return a vehicle that stands still."""
    path = folder / "standing.csv"
    path.write_text(HEADER + "".join(f"{t},45,7,300,0,0,0,1,2,30\n" for t in range(201)))
    return path


def starting(folder: Path, acceleration: float) -> Path:
    """Return a vehicle that stands for 60 s and starts to the north with an acceleration, up to 10 m/s."""
    t = np.arange(0.0, 120.05, 0.1)
    speed = np.clip(acceleration * (t - 60), 0, 10)
    place = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * 0.1)))
    path = folder / f"start{acceleration}.csv"
    rows = zip(t, 45 + np.degrees(place / 6.371e6), speed, strict=True)
    path.write_text(HEADER + "".join(f"{a:.1f},{b:.10f},7,300,{v:.6f},0,0,1,2,0\n" for a, b, v in rows))
    return path


def flight(mission: Path | str, seed: int, settings: dict[str, Any]) -> Experiment:
    """Return an experiment with settings; errors that a filter estimates are drawn as it believes them."""
    made = Experiment(mission=str(mission), seed=seed)
    for path, value in settings.items():
        made.set(path, value)
    rng = np.random.default_rng(seed)
    if made.navigator.estimate_lever_arm:
        made.set("sensors.gps.lever_arm", tuple(np.array(ARM) + ARM_SIGMA * rng.normal(size=3)))
        made.set("navigator.lever_arm", ARM)
        made.set("navigator.lever_arm_sigma", (ARM_SIGMA,) * 3)
    if made.navigator.estimate_latency:
        made.set("sensors.gps.latency", LATE + LATE_SIGMA * rng.normal())
        made.set("navigator.latency", LATE)
        made.set("navigator.latency_sigma", LATE_SIGMA)
    if made.navigator.estimate_misalignments:
        for triad in ("gyro", "accelerometer"):
            made.set(f"sensors.{triad}.misalignment", tuple(MISALIGNMENT * rng.choice((-1.0, 1.0), 6)))
    if made.navigator.estimate_g_sensitivity:
        made.set("sensors.gyro.g_sensitivity", tuple(G_SENSITIVITY * rng.choice((-1.0, 1.0), 3)))
    return made
