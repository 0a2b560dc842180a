"""The navigator, fed with the increments of a perfect IMU, returns to the truth; so does python-ins."""

from __future__ import annotations

import numpy as np
import pyins_reference
import pytest
from flown import fly
from motions import NO_FILTER, NO_FIXES

import lab.missions
from lab.analysis.errors import attitude_error, position_error
from lab.flying.flight_plan import read_plan
from lab.motion.frames import earth, rotation
from lab.motion.recordings.recording import Recording
from lab.motion.truth.trajectory import Trajectory, Truth
from lab.navigation.navigator import Fixes, Imu, Solution, Start, navigate


def unaided(imu: Imu, truth: Truth) -> Solution:
    """Navigate without fixes, from the true start."""
    return navigate(imu, NO_FIXES, Start.off(truth, *np.zeros((3, 3))), NO_FILTER)


def distance(solution: Solution, truth: Truth) -> tuple[float, float]:
    """Return the largest errors over the flight: position [m] and attitude [°]."""
    metres = np.abs(position_error(solution.position, truth)).max()
    degrees = np.degrees(np.abs(attitude_error(solution.q_nb, truth.q_nb)).max())
    return float(metres), float(degrees)


@pytest.mark.proof
@pytest.mark.parametrize("name", ["montreal", "los_angeles"])
def test_both_missions_close(name: str) -> None:
    _, truth, imu = fly(name)
    solution = unaided(imu, truth)
    metres, degrees = distance(solution, truth)
    start = (solution.position[0], truth.velocity_n[0], truth.euler[0])
    other = pyins_reference.integrate(*imu[:3], start)
    difference = np.abs(
        position_error(solution.position, truth) - position_error(other.position, truth)
    ).max()
    print(
        f"\n{name}, {truth.time[-1]:.0f} s: navigator − truth {1e3 * metres:.3f} mm, {degrees:.1e}°; "
        f"navigator − python-ins {1e3 * difference:.3f} mm"
    )
    assert metres <= 5e-3
    assert degrees <= 1e-6
    assert difference <= 5e-3
    assert np.abs(solution.velocity_n - truth.velocity_n).max() <= 1e-3


@pytest.mark.proof
@pytest.mark.parametrize("rate", [50.0, 100.0, 400.0, 1000.0])
def test_other_imu_rates_close(rate: float) -> None:
    _, truth, imu = fly("los_angeles", rate)
    metres, degrees = distance(unaided(imu, truth), truth)
    print(f"\n{rate:g} Hz: {1e3 * metres:.3f} mm, {degrees:.1e}°")
    # Second order in the step, down to the roundoff.
    assert metres <= 5e-3 * max(1, (200 / rate) ** 2)
    assert degrees <= 1e-6 * max(1, (200 / rate) ** 2)


PLANNED = {
    "waypoints": {
        "vehicle": "aircraft",
        "waypoints": [
            {"latitude_deg": -33.9, "longitude_deg": 18.6, "height_m": 300, "speed_m_s": 60},
            {"latitude_deg": -33.85, "longitude_deg": 18.6, "height_m": 500, "speed_m_s": 50},
            {"latitude_deg": -33.82, "longitude_deg": 18.7, "height_m": 400, "speed_m_s": 70},
            {"latitude_deg": -33.9, "longitude_deg": 18.72, "height_m": 300, "speed_m_s": 70},
        ],
    },
    "commands": {
        "start": {"latitude_deg": 45, "longitude_deg": 7, "height_m": 300, "forward_m_s": 20},
        "commands": [
            {"type": 1, "yaw": 10, "seconds": 20},
            {"type": 5, "yaw": -120, "forward": 5, "seconds": 40},
            {"type": 3, "pitch": 20, "roll": -30, "forward": 10, "seconds": 40},
            {"type": 1, "seconds": 20},
        ],
    },
}


def test_a_steep_flight_in_the_air_closes() -> None:
    _, truth, imu = fly("pacific")
    metres, degrees = distance(unaided(imu, truth), truth)
    print(f"\npacific, {truth.time[-1]:.0f} s: {1e3 * metres:.4f} mm, {degrees:.1e}°")
    assert metres <= 5e-3
    assert degrees <= 1e-6


@pytest.mark.proof
@pytest.mark.parametrize("kind", PLANNED)
def test_motions_without_a_simulator_close(kind: str) -> None:
    trajectory = Trajectory.from_recording(lab.missions.fly(read_plan(PLANNED[kind])).recording, 200.0)
    ideal = trajectory.increments()
    truth = trajectory.at(ideal.time)
    metres, degrees = distance(unaided(Imu(ideal.time, ideal.dtheta, ideal.dvelocity), truth), truth)
    print(f"\n{kind}, {truth.time[-1]:.0f} s: {1e3 * metres:.4f} mm, {degrees:.1e}°")
    assert metres <= 5e-3
    assert degrees <= 1e-6


def weaving(latitude: float, longitude: float) -> Recording:
    """Return an aerobatic flight of a minute, north-east, in closed form: banks, climbs and turns."""
    t = np.arange(0, 60.02, 0.02)
    lat = latitude + 1.2e-4 * np.sin(0.05 * t)
    lon = longitude + 1.0e-5 * t / np.cos(latitude) + 2e-5 * (1 - np.cos(0.1 * t))
    height = 400 + 3 * t + 20 * np.sin(0.1 * t)
    meridian, transverse = earth.radii(np.sin(lat))
    north = 6e-6 * np.cos(0.05 * t) * (meridian + height)
    east = (1e-5 / np.cos(latitude) + 2e-6 * np.sin(0.1 * t)) * (transverse + height) * np.cos(lat)
    velocity_n = np.stack((north, east, -3 - 2 * np.cos(0.1 * t)), axis=-1)
    euler = np.stack((0.8 * np.sin(0.5 * t), 0.3 * np.sin(0.7 * t), rotation.wrap(0.2 * t)), axis=-1)
    return Recording(t, lat, rotation.wrap(lon), height, velocity_n, euler)


PLACES = {
    "north": (0.8, -1.3),
    "south": (-0.6, 2.6),
    "across the date line": (0.4, np.pi - 3e-4),
    "across the equator": (-5e-5, 0.0),
    "across Greenwich": (0.9, -3e-4),
    "high latitude": (np.radians(88.0), 1.0),
}


@pytest.mark.parametrize("place", PLACES)
def test_flights_anywhere_close(place: str) -> None:
    trajectory = Trajectory.from_recording(weaving(*PLACES[place]), 200)
    ideal = trajectory.increments()
    truth = trajectory.at(ideal.time)
    solution = unaided(Imu(ideal.time, ideal.dtheta, ideal.dvelocity), truth)
    metres, degrees = distance(solution, truth)
    print(f"\n{place}: {1e3 * metres:.3f} mm, {degrees:.1e}°")
    assert metres <= 5e-3
    assert degrees <= 1e-6
    assert np.abs(solution.position[:, 1]).max() <= np.pi
    if place == "across the date line":
        assert solution.position[:, 1].min() < -3 < 3 < solution.position[:, 1].max()


def test_fixes_across_the_date_line_are_no_event() -> None:
    trajectory = Trajectory.from_recording(weaving(*PLACES["across the date line"]), 200)
    ideal = trajectory.increments()
    times = np.arange(1.0, 60.0)
    true = trajectory.at(times)
    fixes = Fixes(times, np.stack((true.latitude, true.longitude, true.height), axis=-1), true.velocity_n)
    start = Start.off(trajectory.at([0.0]), *np.zeros((3, 3)))
    belief = NO_FILTER._replace(P0=np.eye(15))
    solution = navigate(Imu(ideal.time, ideal.dtheta, ideal.dvelocity), fixes, start, belief)
    assert (np.sign(true.longitude[[0, -1]]) == [1, -1]).all()
    np.testing.assert_allclose(solution.innovation, 0, atol=1e-3)


def test_irregular_imu_times_close() -> None:
    """Samples of 3 to 7 ms, in no order: sums of the increments of a 1 kHz IMU."""
    trajectory = Trajectory.from_recording(weaving(*PLACES["north"]), 1000)
    fine = trajectory.increments()
    ends = np.cumsum(np.random.default_rng(1).integers(3, 8, fine.time.size // 3))
    ends = np.concatenate(([0], ends[ends < fine.time.size]))
    dtheta, dvelocity = (
        np.add.reduceat(x, ends[:-1])[: ends.size - 1]
        for x in (fine.dtheta[: ends[-1]], fine.dvelocity[: ends[-1]])
    )
    time = fine.time[ends]
    truth = trajectory.at(time)
    metres, degrees = distance(unaided(Imu(time, dtheta, dvelocity), truth), truth)
    print(f"\nirregular: {1e3 * metres:.3f} mm, {degrees:.1e}°")
    # Coning and sculling are compensated as if neighbouring samples were equally long.
    assert metres <= 5e-3
    assert degrees <= 5e-5


def test_order_of_convergence_is_two_or_more() -> None:
    """Halving the step divides the errors of position, velocity and attitude by four, at least."""
    trajectory = Trajectory.from_recording(weaving(*PLACES["north"]), 800)
    errors = []
    for rate in (12.5, 25.0, 50.0, 100.0):
        ideal = trajectory.increments(rate)
        truth = trajectory.at(ideal.time)
        solution = unaided(Imu(ideal.time, ideal.dtheta, ideal.dvelocity), truth)
        metres, degrees = distance(solution, truth)
        errors.append((metres, degrees, np.abs(solution.velocity_n - truth.velocity_n).max()))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    print(f"\norders of position, attitude, velocity, step by step:\n{orders.round(2)}")
    assert orders.min() >= 2
