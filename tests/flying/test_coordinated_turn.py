"""The attitude from velocity, against closed forms and against an IMU that must feel no side force."""

from __future__ import annotations

import numpy as np
import pytest
from flights import circle
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.flying.coordinated_turn import FLYING, ROLLING, STANDSTILL, TAXIING, attitude
from lab.missions import Recording, mission
from lab.motion.frames.rotation import C_nb_from_euler, wrap
from lab.motion.truth.trajectory import Trajectory


def turning(speed: float, rate: float, climb: float = 0.0, step: float = 0.1, seconds: float = 60.0):
    """Return times and velocity of a steady turn at a rate [rad/s], climbing at an angle [rad]."""
    time = np.arange(0.0, seconds, step)
    course = 0.3 + rate * time
    level = speed * np.cos(climb)
    down = np.full_like(time, -speed * np.sin(climb))
    return time, np.column_stack((level * np.cos(course), level * np.sin(course), down))


@pytest.mark.parametrize("rate", [np.radians(3.0), -np.radians(6.0)])
def test_a_steady_circle_has_the_bank_of_the_textbook(rate):
    time, velocity = turning(50.0, rate)
    euler = attitude(time, velocity)
    np.testing.assert_allclose(np.tan(euler[:, 0]), 50.0 * rate / STANDARD_GRAVITY, rtol=1e-3)
    np.testing.assert_allclose(np.tan(euler[5:-5, 0]), 50.0 * rate / STANDARD_GRAVITY, rtol=1e-6)
    np.testing.assert_array_equal(euler[:, 1], 0.0)
    np.testing.assert_allclose(wrap(euler[:, 2] - 0.3 - rate * time), 0.0, atol=1e-12)


def test_a_climbing_turn_needs_the_lift_across_its_path():
    climb, rate = np.radians(12.0), np.radians(5.0)
    time, velocity = turning(60.0, rate, climb)
    euler = attitude(time, velocity)
    np.testing.assert_allclose(euler[:, 1], climb, atol=1e-12)
    # Across the path: g cos γ upwards and v cos γ ψ̇ to the right.
    np.testing.assert_allclose(np.tan(euler[5:-5, 0]), 60.0 * rate / STANDARD_GRAVITY, rtol=1e-6)


def test_a_pull_up_in_a_turn_needs_less_bank():
    time, velocity = turning(80.0, np.radians(4.0))
    gamma = 0.05 * time
    velocity = 80.0 * np.column_stack((velocity[:, :2] / 80.0 * np.cos(gamma)[:, None], -np.sin(gamma)))
    rows = time < 10
    euler = attitude(time[rows], velocity[rows])[3:-3]
    lift_up = STANDARD_GRAVITY * np.cos(gamma[rows]) + 80.0 * 0.05
    expected = 80.0 * np.cos(gamma[rows]) * np.radians(4.0) / lift_up
    np.testing.assert_allclose(np.tan(euler[:, 0]), expected[3:-3], rtol=1e-4)


@pytest.mark.parametrize("latitude", [-72.0, -33.0, 0.0, 45.0, 65.0])
@pytest.mark.parametrize("turn", [270.0, -270.0])
def test_the_imu_of_the_flight_feels_no_side_force(latitude, turn):
    flown = circle(latitude=latitude, turn=turn, samples=200)
    euler = attitude(flown.time, flown.velocity_n)
    flight = Recording(flown.time, flown.latitude, flown.longitude, flown.height, flown.velocity_n, euler)
    _, force = Trajectory.from_recording(flight, 50.0).rates(np.linspace(2.0, 47.0, 200))
    assert np.hypot(force[:, 1], force[:, 2]).mean() > 1.03 * STANDARD_GRAVITY
    # 2 Ω v is 0.007 m/s²; gravity between equator and pole differs from the standard by up to 0.026.
    assert np.abs(force[:, 1]).max() < 0.02


def test_an_aeroplane_of_six_degrees_of_freedom_is_followed():
    flown = mission("montreal").recording
    euler = attitude(flown.time, flown.velocity_n)
    rows = (np.linalg.norm(flown.velocity_n, axis=1) > 30) & (flown.time > flown.time[0] + 30)
    off = np.degrees(wrap(euler - flown.euler))[rows]
    # Its angle of attack and the wind are in pitch and yaw, and nothing of them in the bank.
    assert (np.median(np.abs(off), axis=0) < (0.5, 4.0, 5.0)).all()


def test_a_car_follows_the_slope_and_a_boat_stays_level():
    time, velocity = turning(15.0, 0.2, climb=0.08)
    car, boat = attitude(time, velocity, "car"), attitude(time, velocity, "boat")
    np.testing.assert_array_equal(car[:, 0], 0.0)
    np.testing.assert_allclose(car[:, 1], 0.08, atol=1e-12)
    np.testing.assert_array_equal(boat[:, :2], 0.0)
    np.testing.assert_array_equal(car[:, 2], boat[:, 2])


def test_a_copter_leans_so_that_its_thrust_is_the_specific_force():
    time = np.arange(0.0, 60.0, 0.05)
    velocity = np.stack((3 * np.sin(0.7 * time), 2 * np.cos(0.5 * time), 0.5 * np.sin(0.9 * time)), axis=-1)
    waves = (2.1 * np.cos(0.7 * time), -np.sin(0.5 * time), 0.45 * np.cos(0.9 * time) - STANDARD_GRAVITY)
    euler = attitude(time, velocity, "copter")
    force = np.einsum("nji,nj->ni", C_nb_from_euler(euler), np.stack(waves, axis=-1))
    assert np.abs(force[3:-3, :2]).max() < 1e-3
    assert (force[:, 2] < 0).all()
    np.testing.assert_array_equal(attitude(time, velocity, "pedestrian")[:, :2], 0.0)


@pytest.mark.parametrize("drift", [0.0, 1e-3, 5.0])
def test_a_rocket_points_along_its_path_up_over_and_down_without_rolling(drift):
    time = np.arange(0.0, 30.0, 0.02)
    up = np.where(time < 3.0, 0.0, np.where(time < 5.0, 60.0 * (time - 3.0), 120.0 - 9.8 * (time - 5.0)))
    aside = drift * np.clip((time - 3.0) / 2.0, 0.0, 1.0)
    velocity = np.stack((aside * np.sin(0.2 * time), aside * np.cos(0.2 * time), -up), axis=-1)
    C = C_nb_from_euler(attitude(time, velocity, "rocket"))
    speed = np.linalg.norm(velocity, axis=1)
    fast = speed > 20.0
    along = np.einsum("ni,ni->n", C[fast, :, 0], velocity[fast]) / speed[fast]
    assert along.min() > np.cos(np.radians(0.1))
    assert C[0, 2, 0] < -0.99  # upright before it is launched
    turn = Rotation.from_matrix(np.einsum("nji,njk->nik", C[:-1], C[1:])).as_rotvec() / 0.02
    assert np.abs(turn[:, 0]).max() < np.radians(2.0)
    assert np.linalg.norm(turn, axis=1).max() < np.radians(600.0)


def test_a_standstill_keeps_the_heading_and_turns_before_leaving():
    time = np.arange(0.0, 60.0, 0.1)
    speed = np.clip(np.abs(time - 30.0) - 10.0, 0.0, 8.0)
    course = np.where(time < 30.0, np.radians(170.0), np.radians(-100.0))  # 90° to the right, through 180°
    rng = np.random.default_rng(3)
    velocity = np.column_stack((speed * np.cos(course), speed * np.sin(course), 0 * time))
    velocity += np.where(speed == 0, 0.1, 0.0)[:, None] * rng.normal(size=velocity.shape)
    yaw = np.unwrap(attitude(time, velocity, "car")[:, 2])
    np.testing.assert_allclose(yaw[(time > 20.6) & (time < 37.0)], np.radians(170.0), atol=1e-9)
    np.testing.assert_allclose(yaw[time > 41.0], np.radians(260.0), atol=1e-9)
    assert np.abs(np.diff(yaw)).max() < np.radians(7.0)


@pytest.mark.parametrize("vehicle", ["aircraft", "car", "boat", "pedestrian"])
@pytest.mark.parametrize("noise", [0.1, 0.5, 1.0])
def test_the_noise_of_a_standing_receiver_turns_nothing(vehicle, noise):
    rng = np.random.default_rng(8)
    time = np.arange(0.0, 60.0, 0.2)
    euler = attitude(time, noise * rng.normal(size=(time.size, 3)) * (1.0, 1.0, 0.5), vehicle)
    turn = np.abs(np.diff(np.unwrap(euler, axis=0), axis=0)) / 0.2
    assert np.degrees(turn[:, 2]).max() < 120
    assert np.degrees(turn[:, :2]).max() < 150


def test_a_walk_with_one_wrong_step_keeps_its_heading_elsewhere():
    time = np.arange(0.0, 120.0, 0.2)
    course = np.radians(40.0) + 0.02 * time
    velocity = 1.4 * np.column_stack((np.cos(course), np.sin(course), 0 * time))
    velocity[300:302, :2] *= -1
    yaw = attitude(time, velocity, "car")[:, 2]
    away = np.abs(time - 60.2) > 2.0
    np.testing.assert_allclose(yaw[away], course[away], atol=1e-9)
    assert np.abs(np.diff(yaw)).max() < np.radians(90.0) * 0.2


def test_a_vehicle_that_never_moves_is_level_and_one_that_starts_late_points_where_it_will_go():
    time = np.arange(0.0, 20.0, 0.5)
    np.testing.assert_array_equal(attitude(time, np.zeros((time.size, 3))), 0.0)
    velocity = np.zeros((time.size, 3))
    velocity[20:, 1] = 5.0
    np.testing.assert_allclose(attitude(time, velocity, "car")[:, 2], np.pi / 2)


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(["aircraft", "car", "boat"]),
    st.floats(1.0, 300.0),
    st.floats(0.0, 30.0),
)
@example(7278, "aircraft", 49.0, 1.0)
@example(652, "aircraft", 206.0, 4.0)
def test_any_smooth_velocity_gives_an_attitude_without_jumps(seed, vehicle, size, offset):
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 40.0, 0.02)
    waves = [
        rng.normal(size=3) * np.cos(rng.uniform(0.05, 0.5) * time + rng.uniform(0, 6))[:, None]
        for _ in range(4)
    ]
    velocity = size / 3 * sum(waves) + offset
    euler = attitude(time, velocity, vehicle)
    assert np.isfinite(euler).all()
    assert np.abs(euler[:, :2]).max() < np.pi / 2
    bank, pitch, yaw = np.abs(np.diff(np.unwrap(euler, axis=0), axis=0)).T
    # The path turns by a step of the velocity over the speed, and the pitch follows it from `slowest` on.
    slowest, full = {"aircraft": (TAXIING, FLYING)}.get(vehicle, (STANDSTILL, ROLLING))
    steepest = 1 / slowest + 1.5 / (full - slowest) * np.pi / 2  # of a smooth step in the middle
    assert np.all(pitch <= steepest * np.linalg.norm(np.diff(velocity, axis=0), axis=1) + 1e-12)
    # While it moves, the heading is the course: through a speed just above a standstill that turns fast, and
    # with it, where the way is nearly vertical, which wing is low.
    fast = np.linalg.norm(velocity[1:, :2], axis=1) > max(5 * STANDSTILL, size / 10)
    assert yaw[fast].max(initial=0.0) < 0.5
    assert bank[fast].max(initial=0.0) < 0.5


def test_weightlessness_does_not_roll_an_aircraft_over():
    time = np.arange(0.0, 20.0, 0.05)
    velocity = np.column_stack(
        (np.full_like(time, 80.0), 0.5 * np.sin(time), 12.0 * np.maximum(time - 10, 0))
    )
    euler = attitude(time, velocity)
    assert np.abs(euler[:, 0]).max() < np.radians(30)
    assert np.linalg.norm(velocity, axis=1).min() > FLYING


def test_a_taxiing_aircraft_does_not_bank():
    time, velocity = turning(4.0, 0.5)
    np.testing.assert_array_equal(attitude(time, velocity)[:, 0], 0.0)


@pytest.mark.parametrize(
    ("time", "velocity", "vehicle", "words"),
    [
        ([0, 1, 2], np.zeros((3, 3)), "tram", "tram.*aircraft, car, boat, copter, rocket, pedestrian"),
        ([0, 1, 1], np.zeros((3, 3)), "car", "does not increase"),
        ([0, 1, 2], np.zeros((4, 3)), "car", "do not go together"),
        ([0], np.zeros((1, 3)), "car", "at least two"),
        ([0, 1], np.full((2, 3), np.nan), "car", "finite"),
    ],
)
def test_what_cannot_be_is_refused(time, velocity, vehicle, words):
    with pytest.raises(ValueError, match=words):
        attitude(np.array(time, dtype=float), velocity, vehicle)
