"""Start of receivers that give positions only: their differences show course, speed and acceleration."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from copter_logs import copter
from phone_drive import RATE, trajectory
from sensor_logs import write

from lab.data.log.auxiliary_data import AuxiliaryData
from lab.data.log.sensor_log import GnssLog, SensorLog
from lab.missions import read_sensor_log
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.navigation.checks import DivergedError
from lab.navigation.log_navigation import navigate_log, start_fixes
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Fixes
from lab.sensors.suite import SensorSuite

ARM = np.zeros(3)
SIGMA = 2.5
"""σ of the positions, north and east [m]."""


def suite():
    sensors = SensorSuite()
    sensors.gyro.bias_sigma, sensors.gyro.noise_density = (0.3,) * 3, (0.02,) * 3
    sensors.accelerometer.bias_sigma, sensors.accelerometer.noise_density = (5.0,) * 3, (5000.0,) * 3
    return sensors


def positions_only(start, rate, seed, vehicle="car"):
    """Return the drive from a time on, with positions at a rate [Hz] and no velocity."""
    ideal, rng = trajectory().increments(RATE), np.random.default_rng(seed)
    kept = ideal.time >= start
    size = int(kept.sum()) - 1
    gyro = np.radians((0.3, -0.2, 0.25)) + rng.normal(0, 2e-3, (size, 3))
    force = np.array((0.05, -0.04, 0.06)) + rng.normal(0, 0.03, (size, 3))
    at = np.arange(start + 0.37, trajectory().duration - 0.5, 1 / rate)
    true = trajectory().at(at)
    sigma = np.tile((SIGMA, SIGMA, 1.5 * SIGMA), (at.size, 1))
    north, east, down = (rng.normal(size=sigma.shape) * sigma).T
    position = np.column_stack((true.latitude, true.longitude, true.height - down))
    position[:, 0] += north / 6.37e6
    position[:, 1] += east / (6.39e6 * np.cos(true.latitude))
    unknown = np.full(sigma.shape, np.nan)
    return SensorLog(
        name="drive",
        epoch=0.0,
        time=ideal.time[kept],
        dtheta=ideal.dtheta[-size:] + gyro / RATE,
        dvelocity=ideal.dvelocity[-size:] + force / RATE,
        gnss=GnssLog(at, position, unknown, sigma, unknown, ARM, 0.0),
        reference=None,
        gaps=np.empty((0, 2)),
        repairs=(),
        auxiliary=AuxiliaryData(vehicle=vehicle),
    )


@pytest.mark.parametrize(("seconds", "used"), [(0.9, 4), (1.2, 2), (2.1, 3)])
def test_the_start_uses_positions_a_second_apart_as_soon_as_there_are_two(seconds: float, used: int) -> None:
    """Differences over 0.3 s would have three times the noise; within one second there are no others."""
    time = np.arange(0, seconds + 0.1, 0.3)
    north = np.column_stack((10.0 * time / 6.37e6, np.zeros((time.size, 2))))
    fixes, sigma = start_fixes(
        Fixes(time, north, np.zeros((time.size, 3))),
        np.full((time.size, 3), np.nan),
        np.tile((4.0, 4.0, 4.0, 1.0, 1.0, 1.0), (time.size, 1)),
    )
    assert fixes.time.size == len(sigma) == used
    if used < time.size:
        assert np.diff(fixes.time).min() > 0.89
        np.testing.assert_allclose(fixes.velocity_n[:, 0], 10.0, rtol=0.01)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("rate", [1, 10])
@pytest.mark.parametrize("start", [0, 20, 45])
def test_positions_show_course_speed_and_acceleration(start, rate, seed):
    """It begins at rest, on a straight road, and in a turn with the brakes on."""
    made = navigate_log(positions_only(start, rate, seed), suite(), NavigatorSettings())
    begin, sigma = made.alignment, made.alignment.attitude_sigma
    true = trajectory().at(made.imu.time)
    errors = np.degrees(
        np.abs(wrap(euler_from_quaternion(made.solution.q_nb) - euler_from_quaternion(true.q_nb)))
    )
    assert np.degrees(sigma[2]) < 30
    assert (errors[0] < 3 * np.degrees(sigma[[0, 1, 2]])).all()
    assert (np.abs(begin.start.velocity_n - true.velocity_n[0]) < 3.5 * begin.velocity_sigma).all()
    assert errors[3000:, 2].max() < 30
    north = (made.solution.position[3000:, 0] - true.latitude[3000:]) * 6.37e6
    assert np.sqrt(np.mean(north**2)) < SIGMA


@pytest.mark.parametrize("vehicle", ["copter", ""])
def test_the_kind_of_vehicle_must_show_its_heading_by_its_course(vehicle):
    made = navigate_log(positions_only(20, 1, 1, vehicle), suite(), NavigatorSettings())
    assert "from the course" not in made.alignment.heading.source


def copter_log(seed: int, sigma: float, duration: float, vehicle: str, folder: Path) -> SensorLog:
    """Return the log of a copter that flies sideways, with positions alone, whose errors have a σ [m]."""
    flown = copter(duration, nose=0.7 * seed, rest=10.0 * (seed % 2), seed=seed)
    log = read_sensor_log(write(folder / str(seed), flown, f'vehicle = "{vehicle}"'))
    gnss = log.gnss
    spread = np.full(gnss.position.shape, sigma)
    metres = np.random.default_rng(seed).normal(size=spread.shape) * spread
    per_radian = np.stack((*metres_per_radian(gnss.position[:, 0], 0.0), np.ones(len(metres))), axis=-1)
    unknown = np.full(spread.shape, np.nan)
    position = gnss.position + metres / per_radian
    return replace(log, gnss=GnssLog(gnss.time, position, unknown, spread, unknown, ARM, 0.0))


@pytest.mark.proof
@pytest.mark.parametrize("sigma", [0.5, 1.5, 3.0])
@pytest.mark.parametrize("vehicle", ["copter", ""])
def test_the_heading_of_a_copter_is_uncertain_where_positions_do_not_show_it(sigma, vehicle, tmp_path):
    """A course taken for its heading is wrong by 40° to 160°.

    After 40 s, the filter may diverge from such a start: see the next test.
    """
    for seed in range(1, 5):
        log = copter_log(seed, sigma, 40, vehicle, tmp_path)
        alignment = navigate_log(log, suite(), NavigatorSettings()).alignment
        true = log.reference.euler[0, 2]
        error = np.abs(wrap(euler_from_quaternion(alignment.start.q_nb)[2] - true))
        assert error < 3 * alignment.attitude_sigma[2]


@pytest.mark.proof
def test_a_solution_that_leaves_the_earth_has_diverged(tmp_path):
    """Fixes of 3 m show nothing of a copter's heading: at some seeds, the filter does not recover from it."""
    for seed in range(5, 13):
        with suppress(DivergedError):  # and no other one
            navigate_log(copter_log(seed, 3.0, 60, "copter", tmp_path), suite(), NavigatorSettings())


def test_the_course_shows_the_gyro_bias_about_the_vertical():
    """Where no ten seconds are straight, the mean rate of the record is a turn, and no σ of a bias."""
    found = [navigate_log(positions_only(45, 10, seed), suite(), NavigatorSettings()) for seed in range(8)]
    errors = np.degrees([made.alignment.gyro_bias[2] for made in found]) - 0.25
    sigmas = np.degrees([made.alignment.gyro_bias_sigma[2] for made in found])
    assert np.sqrt(np.mean((errors / sigmas) ** 2)) < 1.3
    assert sigmas.max() < 1
