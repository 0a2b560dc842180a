"""Initial heading: of vehicles that go where their nose points and of others, given, and by magnetometers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from copter_logs import LATITUDE, LONGITUDE, copter
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation
from sensor_logs import EPOCH, Tables, tables, write

from lab.data.checks.velocity_matching import match, window_of
from lab.data.log.auxiliary_data import AuxiliaryData, Headings, Magnetometer
from lab.missions import read_sensor_log
from lab.motion.frames import earth
from lab.motion.frames.magnetic_field import magnetic_declination
from lab.motion.frames.rotation import euler_from_quaternion, wrap
from lab.motion.kinematics.running_turns import running_attitudes
from lab.navigation.alignment.initial_heading import Found, Hints, choose_surest_heading
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite


def suite() -> SensorSuite:
    sensors = SensorSuite()
    sensors.gyro.bias_sigma, sensors.gyro.noise_density = (0.3,) * 3, (0.02,) * 3
    sensors.accelerometer.bias_sigma, sensors.accelerometer.noise_density = (5.0,) * 3, (5000.0,) * 3
    sensors.gps.velocity_variance = (0.01,) * 3
    return sensors


def heading_error(log, alignment, start: float = 0.0) -> float:
    """Return the error of the heading at the start of the log [°]."""
    true = np.interp(start, log.reference.time, np.unwrap(log.reference.euler[:, 2]))
    return float(np.degrees(wrap(euler_from_quaternion(alignment.start.q_nb)[2] - true)))


@pytest.mark.proof
@pytest.mark.parametrize("nose", [0.0, 1.6, 3.1, 4.5])
@pytest.mark.parametrize("rest", [0.0, 10.0])
@pytest.mark.parametrize("late", [0.0, 0.3])
def test_a_copter_is_aligned_by_how_its_velocity_changes(tmp_path, nose, rest, late):
    """Its course is no heading: taken for it, the start would be off by the angle between nose and course."""
    flown = copter(60, nose=nose, rest=rest, late=late)
    log = read_sensor_log(write(tmp_path, flown, 'vehicle = "copter"'))
    made = navigate_log(log, suite(), NavigatorSettings())
    sigma = np.degrees(made.alignment.attitude_sigma[2])
    assert sigma < 5.0
    assert abs(heading_error(log, made.alignment)) < 2 * sigma
    assert ("0.3 s late" in made.remarks[-1].replace("0.30", "0.3")) == (late > 0)
    after = np.searchsorted(made.imu.time, log.reference.time[200:-10])
    errors = wrap(euler_from_quaternion(made.solution.q_nb)[after] - log.reference.euler[200:-10])
    assert np.degrees(np.abs(errors)).max() < (5.0 if late else 1.0)


def test_where_nothing_shows_the_heading_it_is_unknown(tmp_path):
    """A copter that flies straight on at one speed: course and speed are known, the heading is not."""
    flown = tables(60, 80)
    log = read_sensor_log(write(tmp_path, flown, 'vehicle = "copter"'))
    log.gnss.velocity_n[:] = (5.0, 3.0, 0.0)
    made = navigate_log(log, suite(), NavigatorSettings())
    assert made.alignment.attitude_sigma[2] == np.pi
    assert "navigator.initial_heading" in made.remarks[-1]


def test_a_given_heading_is_taken_with_its_sigma(tmp_path):
    log = read_sensor_log(write(tmp_path, copter(30, nose=2.0), 'vehicle = "copter"'))
    settings = NavigatorSettings()
    settings.initial_heading, settings.initial_heading_uncertainty = 114.0, 3.0
    made = navigate_log(log, suite(), settings)
    assert euler_from_quaternion(made.alignment.start.q_nb)[2] == pytest.approx(np.radians(114.0))
    assert np.sqrt(made.solution.variance[0, 8]) == pytest.approx(np.radians(3.0), rel=1e-3)
    assert "heading given" in made.remarks[-1]


def test_the_vehicle_of_the_settings_rules(tmp_path):
    log = read_sensor_log(write(tmp_path, copter(40, nose=3.1), 'vehicle = "copter"'))
    settings = NavigatorSettings()
    settings.vehicle = "car"
    assert abs(heading_error(log, navigate_log(log, suite(), settings).alignment)) > 150.0


@pytest.mark.parametrize("nose", [0.4, 2.5, 5.0])
def test_a_magnetometer_shows_the_heading_of_what_stands(tmp_path, nose):
    flown = copter(12, nose=nose, rest=12.0)
    log = read_sensor_log(write(tmp_path, flown, 'vehicle = "copter"'))
    declination, dip = 0.2, 1.1
    north = np.array((np.cos(dip) * np.cos(declination), np.cos(dip) * np.sin(declination), np.sin(dip)))
    attitude = Rotation.from_euler("ZYX", log.reference.euler[:, ::-1])
    field = Magnetometer(log.reference.time, 50.0 * attitude.inv().apply(north), declination)
    log = replace(log, auxiliary=replace(log.auxiliary, magnetometer=field))
    made = navigate_log(log, suite(), NavigatorSettings())
    assert abs(heading_error(log, made.alignment)) < 1.0
    assert np.degrees(made.alignment.attitude_sigma[2]) == pytest.approx(10, abs=1.5)
    assert "magnetometer" in made.remarks[-1]


def test_two_antennas_are_surest(tmp_path):
    log = read_sensor_log(write(tmp_path, copter(30, nose=2.0, rest=5.0), 'vehicle = "copter"'))
    headings = Headings(log.reference.time, log.reference.euler[:, 2], np.full(len(log.reference.time), 0.01))
    log = replace(log, auxiliary=replace(log.auxiliary, headings=headings))
    made = navigate_log(log, suite(), NavigatorSettings())
    assert abs(heading_error(log, made.alignment)) < 1.0
    assert np.degrees(made.alignment.attitude_sigma[2]) < 1.0
    assert "two antennas" in made.remarks[-1]


def test_declination_is_that_of_the_world_magnetic_model():
    """Test values of the model's own report, WMM2025 at 2025.0: 80° N 0° E and 80° S 240° E at height 0."""
    for latitude, longitude, expected in ((80.0, 0.0, 1.28), (0.0, 120.0, -0.16), (-80.0, 240.0, 68.78)):
        found, horizontal = magnetic_declination(np.array((np.radians(latitude), np.radians(longitude), 0.0)))
        assert np.degrees(found) == pytest.approx(expected, abs=0.02)
        assert 5 < horizontal < 45


def test_a_contradiction_makes_the_heading_uncertain():
    course, compass = Found(0.1, 0.05, "one way", 1.0), Found(1.1, 0.1, "another", 2.0)
    both = choose_surest_heading((compass, course))
    assert (both.heading, both.sigma) == (0.1, pytest.approx(1.0))
    assert "57°" in both.source
    assert choose_surest_heading((course, compass._replace(heading=0.15))) is course
    assert choose_surest_heading(()).sigma == np.pi


def test_the_words_of_autopilots_are_known():
    for word, follows in (("rotary wing", False), ("fixed wing", True), ("rover", True), ("boat", False)):
        assert (
            Hints.of(AuxiliaryData(word), "auto", None, 5.0, np.zeros((1, 3))).vehicle.follows_nose == follows
        )
    assert (
        Hints.of(AuxiliaryData("fixed wing"), "copter", None, 5.0, np.zeros((1, 3))).vehicle.name == "copter"
    )


def test_matching_over_many_seeds_knows_how_well_it_knows():
    """Heading, gyro bias and lag of a copter over 20 seeds: errors as large as their σ say."""
    shown = []
    for seed in range(20):
        flown = copter(25, nose=1.0, late=0.1, seed=seed)
        time = flown.imu[:, 0] - EPOCH
        log = (
            time, flown.imu[1:, 1:4] / 100, flown.imu[1:, 4:] / 100, flown.gnss[:, 0] - EPOCH,
            flown.gnss[:, 4:7], flown.gnss[:, 10:13],
        )  # fmt: skip
        found = match(window_of(log, 2.0), lags=(0.0,))
        true = np.radians(np.interp(2.0, flown.reference[:, 0] - EPOCH, flown.reference[:, 9]))
        shown.append(
            (
                wrap(found.C_nb.as_euler("ZYX")[0] - true) / found.heading_sigma,
                (found.lag + 0.1) / found.lag_sigma,
                (found.gyro_bias[2] - np.radians(0.15)) / found.gyro_bias_sigma[2],
            )
        )
    assert (np.sqrt(np.mean(np.square(shown), axis=0)) < 1.3).all()


def test_turning_is_the_product_of_the_increments():
    increments = np.random.default_rng(1).normal(scale=0.2, size=(37, 3))
    attitude = Rotation.identity()
    for number, increment in enumerate(increments):
        attitude = attitude * Rotation.from_rotvec(increment)
        apart = running_attitudes(increments)[number + 1].inv() * attitude
        assert apart.magnitude() < 1e-12


def test_the_place_of_the_test_is_where_the_model_knows_it():
    found, _ = magnetic_declination(np.array((LATITUDE, LONGITUDE, 120.0)))
    assert -15 < np.degrees(found) < -9


def aeroplane(heading: float, rest: float, backwards: float, aside: float = np.pi) -> Tables:
    """Return what a level aeroplane logs that is pushed at 1.3 m/s after a rest, stands, and takes off.

    Parameters
    ----------
    heading
        Its heading [rad].
    rest, backwards
        How long it stands before, and how long it is pushed [s].
    aside
        The course of the push, relative to the heading [rad].
    """
    rng = np.random.default_rng(1)
    knots = rest + np.array((-1.0, 0.0, 1.0, backwards, backwards + 1, backwards + 4, backwards + 14))
    end = knots[-1] + 5.0
    pushed = np.array((0.0, 0.0, 1.3, 1.3, 0.0, 0.0, 0.0))
    own = np.array((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 25.0))
    knots, pushed, own = np.append(knots, end + 2), np.append(pushed, 0.0), np.append(own, 25.0)
    directions = np.array([[np.cos(angle), np.sin(angle), 0.0] for angle in (heading + aside, heading)])
    moving = PchipInterpolator(knots, pushed[:, None] * directions[0] + own[:, None] * directions[1])
    time = np.arange(0.0, end, 0.01)
    force_n = moving(time, 1) - (0, 0, float(earth.gravity(np.sin(LATITUDE), 120.0)))
    attitude = Rotation.from_euler("z", heading)
    imu = np.column_stack((time, np.zeros((len(time), 3)), attitude.inv().apply(force_n)))
    imu[:, 1:4] += rng.normal(scale=2e-3, size=(len(time), 3)) + np.radians((0.2, -0.1, 0.15))
    imu[:, 4:] += rng.normal(scale=0.05, size=(len(time), 3))
    at = np.arange(0.0, end, 0.2)
    gone = moving.antiderivative()(at) - moving.antiderivative()(0.0)
    meridian, transverse = earth.radii(np.sin(LATITUDE))
    place = np.column_stack(
        (
            np.degrees(LATITUDE + gone[:, 0] / (meridian + 120.0)),
            np.degrees(LONGITUDE + gone[:, 1] / ((transverse + 120.0) * np.cos(LATITUDE))),
            np.full(len(at), 120.0),
        )
    )
    euler = np.tile((0.0, 0.0, np.degrees(heading)), (len(at), 1))
    sigma = np.tile((0.4, 0.4, 0.6, 0.06, 0.06, 0.06), (len(at), 1))
    noise = rng.normal(scale=(3e-6, 4e-6, 0.5, 0.06, 0.06, 0.06), size=(len(at), 6))
    gnss = np.column_stack((at, np.column_stack((place, moving(at))) + noise, sigma))
    reference = np.column_stack((at, place, moving(at), euler))
    for table in (imu, gnss, reference):
        table[:, 0] += EPOCH
    return Tables(imu, gnss, reference)


@pytest.mark.parametrize("vehicle", ["aeroplane", "car"])
@pytest.mark.parametrize(
    ("rest", "aside", "source"),
    [(10.0, np.pi, "backwards"), (0.0, np.pi, "backwards"), (10.0, 1.6, "course")],
)
def test_what_is_pushed_back_or_carried_before_it_moves_has_the_heading_of_its_motion(
    tmp_path, vehicle, rest, aside, source
):
    flown = aeroplane(1.0, rest, 12.0, aside)
    log = read_sensor_log(write(tmp_path, flown, f'vehicle = "{vehicle}"'))
    made = navigate_log(log, suite(), NavigatorSettings())
    sigma = float(np.degrees(made.alignment.attitude_sigma[2]))
    assert sigma < 20.0
    assert abs(heading_error(log, made.alignment)) < 2 * sigma
    assert source in made.alignment.heading.source


def test_a_slow_motion_forward_has_the_heading_of_its_course(tmp_path):
    flown = aeroplane(1.0, 10.0, 12.0, 0.0)
    log = read_sensor_log(write(tmp_path, flown, 'vehicle = "aeroplane"'))
    found = navigate_log(log, suite(), NavigatorSettings()).alignment.heading
    assert found.time < 13.0
    assert found.source.startswith("from the course at 1")
    assert "backwards" not in found.source
