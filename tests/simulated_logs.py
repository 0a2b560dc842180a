"""Logs of what the sensors of a simulated run measured, with the true motion as their reference."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from tests.sensor_logs import Tables, write

KNOWN = tuple(
    f"sensors.{triad}.{term}"
    for triad in ("gyro", "accelerometer")
    for term in ("noise_density", "bias_sigma", "instability", "flicker", "rate_random_walk")
)
"""What a filter of the log knows of the sensors."""
EVERY = 10
"""Samples from one row of the reference to the next."""


def log_of(result: Result, folder: Path, toml: str | None = None) -> Experiment:
    """Write a log of a simulated run, and return the experiment on it; its filter knows the white noise."""
    truth, fixes, gps = result.truth_arrays, result.fixes, result.experiment.sensors.gps
    assert truth is not None
    dt = np.diff(result.time)[:, None]
    rates = result.gyro.increments / dt, result.accelerometer.increments / dt
    variances = [np.broadcast_to(one, 3) for one in (gps.position_variance, gps.velocity_variance)]
    sigma = np.tile(np.sqrt(np.concatenate(variances)), (fixes.time.size, 1))
    place = np.degrees(fixes.position[:, :2]), fixes.position[:, 2:]
    rows = slice(None, None, EVERY)
    there = truth.time, np.degrees(truth.latitude), np.degrees(truth.longitude), truth.height
    reference = np.column_stack((*there, truth.velocity_n, np.degrees(truth.euler)))[rows]
    imu = np.column_stack((result.time[1:], *rates))
    gnss = np.column_stack((fixes.time, *place, fixes.velocity_n, sigma))
    made = Experiment(mission=str(write(folder, Tables(imu, gnss, reference), toml)))
    for path in KNOWN:
        made.set(path, result.experiment.get(path))
    return made
