"""Drives of a car with the errors of a sensor card and an antenna away from the IMU, as rows of a stream."""

from __future__ import annotations

import numpy as np
from live_rows import drive, fix_rows, imu_rows
from scipy.spatial.transform import Rotation

from lab.experiment.experiment import Experiment
from lab.motion.frames.displacement import displaced
from lab.motion.truth.trajectory import Trajectory
from lab.sensors.cards import card
from lab.sensors.imu import Environment, ImuDraws, measure
from lab.sensors.suite import SensorSuite
from lab.sensors.temperature import REFERENCE

STANDALONE, RTK = (0.5, 0.8, 0.1), (0.02, 0.03, 0.03)
"""σ of receivers: horizontal, vertical [m], speed [m/s]."""


def loaded(name: str) -> Experiment:
    """Return an experiment with a card."""
    experiment = Experiment()
    card(name).load(experiment)
    return experiment


def carded(
    sensors: SensorSuite,
    seed: int,
    *,
    begin: float = 0.0,
    end: float = 40.0,
    rate: float = 50.0,
    arm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    receiver: tuple[float, float, float] = STANDALONE,
):
    """Return the rows of IMU and receiver on a drive, and the truth of the times of the IMU.

    Parameters
    ----------
    sensors
        The errors of the IMU.
    seed
        Seed of all errors.
    begin, end
        The part of the drive that is recorded [s]; it is at rest until 20 s.
    rate
        Rate of the IMU [Hz].
    arm
        Lever arm of the antenna, forward, right, down [m].
    receiver
        σ of the receiver.
    """
    trajectory, rng = drive(), np.random.default_rng(seed)
    ideal = trajectory.increments(rate)
    rows = slice(*np.searchsorted(ideal.time, [begin, end]))
    dt, shown = 1 / rate, []
    for name, errors, true in (
        ("gyro", sensors.gyro, ideal.dtheta[rows]),
        ("accelerometer", sensors.accelerometer, ideal.dvelocity[rows]),
    ):
        draws = ImuDraws.of(seed, name, len(true), instability=True, flicker=True, walk=True)
        environment = Environment(np.array(REFERENCE), ideal.dvelocity[rows])
        shown.append(measure(true, dt, errors, draws, environment).increments / dt)
    time = ideal.time[1:][rows]
    times = np.arange(time[0] - dt / 2, time[-1], 0.25)
    place, velocity = antenna(trajectory, times, arm)
    sigma = np.array(receiver)
    place = displaced(place, rng.normal(size=place.shape) * sigma[[0, 0, 1]])
    fixes = fix_rows(times, place, velocity + rng.normal(size=velocity.shape) * sigma[2])
    fixes["horizontal_sigma"], fixes["vertical_sigma"], fixes["speed_sigma"] = receiver
    return imu_rows(time, *shown), fixes, trajectory.at(time)


def antenna(trajectory: Trajectory, times: np.ndarray, arm) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities (m, 3) of an antenna."""
    truth, (turn, _) = trajectory.at(times), trajectory.rates(times)
    C_nb = Rotation.from_quat(truth.q_nb, scalar_first=True)
    place = displaced(truth.position, C_nb.apply(arm))
    return place, truth.velocity_n + C_nb.apply(np.cross(turn, arm))
