"""Live errors: the navigator of a simulated device against the truth that the device flies."""

from __future__ import annotations

import time

import numpy as np
import pytest

import lab.live
from lab import Experiment
from lab.live.live_errors import LiveErrors, errors_of, join_errors, normalised_rms
from lab.live.live_navigator import LiveNavigator
from lab.live.live_state import HistoryCursor, LiveHistory
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.motion.frames.earth import radii
from lab.motion.truth.growing_truth import TrueFlight
from lab.motion.truth.trajectory import Truth


def circling(seconds: float = 10.0) -> Truth:
    """Return a flight over the date line that turns through north."""
    t = np.arange(0.0, seconds + 1e-9, 0.01)
    nothing = np.zeros_like(t)
    longitude = np.pi - 1e-6 + 4e-7 * t
    heading = np.pi - 0.5 + 0.1 * t
    return Truth(
        time=t,
        latitude=0.7 + 1e-7 * t**2,
        longitude=np.where(longitude > np.pi, longitude - 2 * np.pi, longitude),
        height=100 + 5 * np.sin(t),
        velocity_n=np.stack((t, -t, nothing), axis=-1),
        q_nb=np.zeros((t.size, 4)),
        euler=np.stack((nothing, nothing, (heading + np.pi) % (2 * np.pi) - np.pi), axis=-1),
    )


def test_the_truth_is_that_of_the_clock_of_the_host_and_unknown_beyond_the_flight() -> None:
    truth = TrueFlight(circling(), lambda: 1000.0)
    t = np.array([-0.01, 0.0, 2.505, 6.123, 10.0, 10.01])
    found = truth.at(1000.0 + t)
    assert np.isnan(found.position[[0, -1]]).all()
    assert np.isnan(found.euler[[0, -1]]).all()
    inside = t[1:-1]
    heading = np.pi - 0.5 + 0.1 * inside
    assert found.position[1:-1, 0] == pytest.approx(0.7 + 1e-7 * inside**2, abs=1e-11)
    assert np.exp(1j * found.position[1:-1, 1]) == pytest.approx(
        np.exp(1j * (np.pi - 1e-6 + 4e-7 * inside)), abs=1e-13
    )
    assert (np.abs(found.position[1:-1, 1]) <= np.pi).all()
    assert found.position[1:-1, 2] == pytest.approx(100 + 5 * np.sin(inside), abs=1e-4)
    assert found.velocity_n[1:-1] == pytest.approx(np.stack((inside, -inside, 0 * inside), axis=-1))
    assert np.exp(1j * found.euler[1:-1, 2]) == pytest.approx(np.exp(1j * heading), abs=1e-12)


def test_before_the_flight_nothing_is_true() -> None:
    assert np.isnan(TrueFlight(circling(), lambda: float("nan")).at(np.array([5.0])).position).all()


def history(truth: Truth, rows: slice, heading_sigma: float = 0.01) -> LiveHistory:
    """Return a history that is 3 m north, 4 m east, 5 m above, 0.1 m/s and 0.02 rad off."""
    t = truth.time[rows]
    meridian, transverse = radii(np.sin(truth.latitude[rows]))
    position = truth.position[rows].copy()
    position[:, 0] += 3 / (meridian + truth.height[rows])
    position[:, 1] += 4 / ((transverse + truth.height[rows]) * np.cos(truth.latitude[rows]))
    position[:, 2] += 5
    nothing = np.zeros((t.size, 0))
    sigma = np.tile([3.0, 2.0, 5.0, 0.1, 0.2, 0.05, *[0.0] * 9], (t.size, 1))
    return LiveHistory(
        time=50.0 + t,
        phase=np.zeros(t.size, np.int64),
        position=position,
        velocity_n=truth.velocity_n[rows] + 0.1,
        euler=truth.euler[rows] + 0.02,
        euler_sigma=np.tile([0.01, 0.02, heading_sigma], (t.size, 1)),
        bias=nothing,
        sigma=sigma,
        fix_time=np.zeros(0),
        innovation=nothing,
        innovation_covariance=nothing,
        rejected=np.zeros(0, np.bool_),
    )


def test_errors_are_estimate_minus_truth_in_metres_and_radians() -> None:
    truth = circling()
    found = errors_of(history(truth, slice(0, 900, 7)), TrueFlight(truth, lambda: 50.0))
    assert found.position == pytest.approx(np.tile([3, 4, -5.0], (len(found.time), 1)), abs=1e-3)
    assert found.velocity == pytest.approx(np.full((len(found.time), 3), 0.1), abs=1e-9)
    assert found.attitude == pytest.approx(np.full((len(found.time), 3), 0.02), abs=1e-9)
    rms = normalised_rms(found)
    assert rms["position"] == pytest.approx(np.sqrt((1 + 4 + 1) / 3), rel=1e-3)
    assert rms["velocity"] == pytest.approx(np.sqrt((1 + 0.25 + 4) / 3), rel=1e-6)
    assert rms["attitude"] == pytest.approx(np.sqrt((4 + 1 + 4) / 3), rel=1e-6)
    both = join_errors([LiveErrors(*(column[:5] for column in found)), LiveErrors(*(c[5:] for c in found))])
    assert both.position == pytest.approx(found.position)


def test_a_heading_that_nothing_shows_has_no_error() -> None:
    truth = circling()
    found = errors_of(history(truth, slice(0, 50), np.pi), TrueFlight(truth, lambda: 50.0))
    assert np.isnan(found.attitude[:, 2]).all()
    assert np.isfinite(found.attitude[:, :2]).all()
    assert np.isfinite(normalised_rms(found)["attitude"])


def test_what_is_unknown_stays_unknown() -> None:
    truth = circling()
    told = history(truth, slice(0, 20))
    told.position[:] = np.nan
    told.velocity_n[:] = np.nan
    found = errors_of(told, TrueFlight(truth, lambda: 50.0))
    assert np.isnan(found.position_sigma).all()
    assert np.isnan(normalised_rms(found)["position"])


@pytest.mark.proof
def test_the_errors_of_many_flights_are_as_large_as_their_sigma() -> None:
    """Ten seeds of a flight with an antenna 2 m ahead, of which the filter knows."""
    arm = {"lever_arm": (2.0, 0.0, 0.0)}
    normed: dict[str, list[float]] = {"position": [], "velocity": [], "attitude": []}
    for seed in range(1, 11):
        flight = SimulatedFlight.of("montreal", 100.0, seed=seed, settings={"sensors": {"gps": arm}})
        experiment = Experiment(mission="montreal")
        experiment.navigator.update(arm)
        navigator = LiveNavigator(experiment.sensors, experiment.navigator)
        imu, fix = flight.timed()
        for first in range(0, len(imu), 1000):
            last = min(first + 1000, len(imu)) - 1
            begin, end = imu["time"][first], imu["time"][last]
            navigator.feed(
                imu[first : last + 1], fix[(fix["time"] > begin - 0.01) & (fix["time"] <= end - 0.01)]
            )
        navigator.finish()
        _, told = navigator.since(HistoryCursor())
        assert flight.result.truth_arrays is not None
        found = errors_of(told, TrueFlight(flight.result.truth_arrays, lambda: 0.0))
        for name, value in normalised_rms(found).items():
            normed[name].append(value**2)
    for name, values in normed.items():
        mean, spread = np.mean(values), np.std(values, ddof=1) / np.sqrt(len(values))
        assert abs(mean - 1) < 4 * spread + 0.1, (name, values)


def test_a_source_knows_its_truth_only_if_it_simulates() -> None:
    with lab.live.open("simulated:rest?hz=50&rest=20&over=tcp:0") as source:
        truth = source.truth
        assert truth is not None
        deadline = time.monotonic() + 30
        while source.end.imu < 5 and time.monotonic() < deadline:
            source.wait(source.end, 0.5)
        now = np.array([time.monotonic()])
        assert truth.at(now).position[0] == pytest.approx([np.radians(45), np.radians(7.5), 200.0])
    assert lab.live.open("udp:5555").truth is None
