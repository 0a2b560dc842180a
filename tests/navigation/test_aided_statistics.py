"""Aided filters over many seeds: they tell the truth about their errors, and outages cost less."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from aided_flights import flight, standing, starting, winding_road
from scipy import stats

from lab import Experiment
from lab.analysis.consistency import normalised_squares
from lab.analysis.errors import error_state
from lab.base.arrays import FloatArray
from lab.experiment.result import Result
from lab.navigation.aids import NORTHWARD
from lab.navigation.filters import blocks

pytestmark = pytest.mark.proof

SEEDS = 24
RATE = 50.0
"""Rate of the IMU [Hz]: statistics over seeds say the same as at 200 Hz, in a quarter of the time."""
EVERYTHING = {
    "trajectory.imu_rate": RATE,
    "navigator.states": 21,
    "sensors.gyro.scale_factor_sigma": 0.5,
    "sensors.accelerometer.scale_factor_sigma": 0.5,
    "sensors.barometer.fitted": True,
    "sensors.heading.fitted": True,
    "sensors.heading.drift_sigma": 0.5,
    "sensors.odometer.fitted": True,
    "sensors.airspeed.fitted": True,
    "sensors.gps.correlated_sigma": 2.0,
    "sensors.gyro.instability": 60.0,
    "sensors.gyro.correlation_time": 30.0,
    "sensors.accelerometer.instability": 1.0,
    "sensors.accelerometer.correlation_time": 30.0,
    **{
        f"navigator.estimate_{what}": True
        for what in ("misalignments", "g_sensitivity", "bias_drift", "gps_drift", "lever_arm", "latency")
    },
}
"""All sensors and states, so that the filter is the one that is compared with filterpy."""
QUIET = {
    "trajectory.imu_rate": RATE,
    "sensors.gyro.noise_density": 0.005,
    "sensors.gyro.bias_sigma": 0.01,
    "sensors.accelerometer.bias_sigma": 0.2,
    "navigator.attitude_error": (0.0, 0.0, 0.0),
}
"""Sensors with which the other errors of a navigator that runs free stay almost linear for some minutes."""
KINDS = ("barometer", "heading", "odometer", "airspeed")
RUNNING = 1e4
"""Longer than any flight here [s]."""


def only(*names: str) -> dict[str, Any]:
    """Return settings with all other sensors fitted, of which only those named ever measure.

    The states of a silent sensor touch no others. So all tests use one compiled filter, that of
    `test_aids.py`.
    """
    silent = {f"sensors.{name}.outages": [(0.0, RUNNING)] for name in KINDS if name not in names}
    return {f"sensors.{name}.fitted": True for name in KINDS} | silent


def test_all_states_and_measurements_together_are_consistent() -> None:
    nees, nis, aids = [], [], []
    for seed in range(SEEDS):
        result = flight("montreal", seed, EVERYTHING).run()
        solution = result.solution_arrays
        used = solution.fix_sample >= 0
        x = error_state(
            solution,
            solution.fix_sample[used],
            result.known_truth("errors"),
            result.true_bias,
            result.true_scale,
            result.true_further(),
        )
        P = solution.fix_covariance[used]
        parts = [slice(None), slice(0, 3), slice(3, 6), slice(6, 9)]
        parts += [blocks.find_states(result.blocks, name) for name in result.blocks]
        nees.append([normalised_squares(x[:, a], P[:, a, a]).mean() / P[0, a, a].shape[0] for a in parts])
        nis.append(float(result.innovations["nis"].mean()) / 6)
        aids.append(float(np.mean(solution.aid_innovation**2 / solution.aid_variance)))
    mean, scatter = np.mean(nees, axis=0), np.std(nees, axis=0, ddof=1) / np.sqrt(SEEDS)
    print(f"\nNEES per state {mean.round(2)} ± {scatter.round(2)}")
    print(f"NIS {np.mean(nis):.3f}, of the others {np.mean(aids):.3f}")
    # A filter linearised about its estimate may be off by some percent.
    assert (np.abs(mean - 1) < 4 * scatter + 0.05).all()
    for squares in (nis, aids):
        assert np.mean(squares) == pytest.approx(1, abs=4 * np.std(squares) / np.sqrt(SEEDS) + 0.01)


class Ends(NamedTuple):
    """Errors of position at the end of an outage of 60 s [m], and their σ, over seeds (seeds, 3)."""

    errors: FloatArray
    sigma: FloatArray


def ends(mission: Path | str, settings: dict[str, Any]) -> Ends:
    """Return what an outage leaves, over seeds."""
    errors, sigma = [], []
    for seed in range(SEEDS):
        made = Experiment(mission=str(mission), seed=seed)
        made.set("trajectory.imu_rate", RATE)
        made.set("sensors.gps.outages", [(100.0, 160.0)])
        made.update(settings)
        result = made.run()
        at = np.array([np.searchsorted(result.time, 159.9)])
        further = result.true_further()
        x = error_state(
            result.solution_arrays, at, result.known_truth("errors"), result.true_bias, further=further
        )
        errors.append(x[0, :3])
        sigma.append(np.sqrt(result.solution_arrays.variance[at[0], :3]))
    return Ends(np.array(errors), np.array(sigma))


def check_gain(name: str, alone: Ends, aided: Ends, axes: list[int]) -> None:
    """Print the gain; the errors must be as large as σ says, and smaller than without the measurement."""
    before, after, ratio = (
        float(np.sqrt(np.mean(np.square(values[:, axes]))))
        for values in (alone.errors, aided.errors, aided.errors / aided.sigma)
    )
    number = SEEDS * len(axes)
    print(f"\n{name}: {before:.3g} m becomes {after:.3g} m, error / σ {ratio:.2f}")
    low, high = np.sqrt(stats.chi2.ppf([1e-4, 1 - 1e-4], number) / number)
    assert low < ratio < high
    assert after < 0.5 * before


LEVEL, VERTICAL = [0, 1], [2]
"""Axes of the position, in north, east, down."""


@pytest.fixture(scope="module")
def unaided() -> Ends:
    """Return what an outage leaves of a flight without other sensors."""
    return ends("montreal", {})


def test_a_barometer_halves_the_vertical_error_of_an_outage(unaided: Ends) -> None:
    check_gain("barometer", unaided, ends("montreal", only("barometer")), VERTICAL)


def test_airspeed_shortens_the_level_error_of_an_outage(unaided: Ends) -> None:
    check_gain("airspeed", unaided, ends("montreal", only("airspeed")), LEVEL)


def test_wind_and_scale_are_consistent_beside_a_navigator_that_runs_free() -> None:
    """Its velocity is soon wrong by 10 m/s, over which an airspeed is far from linear: see the airspeeds."""
    free = {"navigator.correction": "feedforward"} | only("airspeed") | QUIET
    nees, aids = [], []
    for seed in range(SEEDS):
        result = flight("montreal", seed, free).run()
        solution = result.solution_arrays
        used = solution.fix_sample[solution.fix_sample >= 0]
        own = np.r_[
            *(blocks.find_states(result.blocks, name) for name in (blocks.WIND, blocks.AIRSPEED_SCALE))
        ]
        x = error_state(
            solution, used, result.known_truth("errors"), result.true_bias, further=result.true_further()
        )[:, own]
        P = solution.fix_covariance[solution.fix_sample >= 0][:, own[:, None], own]
        nees.append(normalised_squares(x, P).mean() / x.shape[1])
        aids.append(float(np.mean(solution.aid_innovation**2 / solution.aid_variance)))
    print(f"\nNEES of wind and scale {np.mean(nees):.2f}, NIS of airspeeds {np.mean(aids):.2f}")
    # The three states of a flight hardly change: they count as one draw.
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], 3 * SEEDS) / (3 * SEEDS)
    assert low < np.mean(nees) < high
    assert np.mean(aids) == pytest.approx(1, abs=0.1)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a drive along a winding road."""
    return winding_road(tmp_path_factory.mktemp("drive"))


def test_an_odometer_and_wheels_that_do_not_slip_hold_the_position(drive: Path) -> None:
    wheels = only("odometer") | {"navigator.no_slip": True, "navigator.slip_sigma": (0.05, 0.05)}
    check_gain("odometer and no slip", ends(drive, {}), ends(drive, wheels), LEVEL)


@pytest.fixture(scope="module")
def parked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a vehicle that stands still."""
    return standing(tmp_path_factory.mktemp("rest"))


def test_zero_velocity_at_rest_is_consistent_and_sharper(parked: Path) -> None:
    alone, aided = at_rest(parked, used=False), at_rest(parked, used=True)
    speed = [np.array([one.solution_arrays.velocity_n[-1] for one in results]) for results in (alone, aided)]
    sigma = np.array([np.sqrt(one.solution_arrays.variance[-1, 3:6]) for one in aided])
    ratio = float(np.sqrt(np.mean((speed[1] / sigma) ** 2)))
    print(f"\nzero velocity: {speed[0].std():.3g} m/s becomes {speed[1].std():.3g}, error / σ {ratio:.2f}")
    assert ratio < 1.3  # the vehicle stands still exactly, better than the 2 cm/s assumed
    assert speed[1].std() < 0.3 * speed[0].std()
    assert all((one.solution_arrays.aid_sample >= 0).all() for one in aided)


def at_rest(parked: Path, *, used: bool) -> list[Result]:
    """Return runs at rest, with zero velocity used as a measurement or not."""
    found = []
    for seed in range(SEEDS):
        made = Experiment(mission=str(parked), seed=seed)
        made.set("trajectory.imu_rate", RATE)
        made.update(only("barometer"))
        made.set("navigator.zero_velocity", used)
        found.append(made.run())
    return found


@pytest.mark.parametrize("acceleration", [0.1, 0.3, 1.0])
def test_a_start_is_no_rest(acceleration: float, tmp_path: Path) -> None:
    """The fixes of a default receiver show its speed at 1.8 m/s; σ of the velocity at rest is 0.01 m/s."""
    path = starting(tmp_path, acceleration)
    settings = only("barometer") | {"navigator.zero_velocity": True}
    squares = []
    for seed in range(8):
        result = flight(path, seed, {"trajectory.imu_rate": RATE} | settings).run()
        solution, at = result.solution_arrays, np.arange(int(62 * RATE), int(75 * RATE), int(RATE))
        truth = result.known_truth("errors"), result.true_bias
        x = error_state(solution, at, *truth, further=result.true_further())[:, 3:5]
        squares.append(np.mean(x**2 / solution.variance[at, 3:5]))
        standing = result.aids.time[result.aids.kind == NORTHWARD]
        assert standing.size > 30
        assert standing.max() <= 61
    print(f"\nstart with {acceleration} m/s²: (error/σ)² {np.mean(squares):.2f}")
    # Two components of eight starts, hardly changing within 13 s.
    low, high = stats.chi2.ppf([1e-4, 1 - 1e-4], 16) / 16
    assert low < np.mean(squares) < high


def test_zero_velocity_holds_the_position_without_fixes(parked: Path) -> None:
    """The vehicle stands still exactly, so σ must be small for it to say more than the inertial sensors."""
    barometer = only("barometer")
    sharp = {"navigator.zero_velocity": True, "navigator.zero_velocity_sigma": 0.002}
    check_gain("zero velocity", ends(parked, barometer), ends(parked, barometer | sharp), LEVEL)


def test_smoothed_errors_are_smaller_and_as_large_as_their_sigma() -> None:
    nees, squares = [], []
    for seed in range(8):
        made = flight("montreal", seed, EVERYTHING)
        result = made.run()
        made.set("navigator.smoother", True)
        smoothed = made.run()
        every = int(10 * RATE)
        at = np.arange(every, result.time.size - every, every)
        truth = result.known_truth("errors"), result.true_bias, result.true_scale, result.true_further()
        x, better = (error_state(one.solution_arrays, at, *truth) for one in (result, smoothed))
        squares.append([np.mean(values[:, :9] ** 2, axis=0) for values in (x, better)])
        nees.append(np.mean(better**2 / smoothed.solution_arrays.variance[at], axis=0))
    before, after = np.mean(squares, axis=0)
    print(f"\nsmoothed: rms / filtered {np.sqrt(after / before).round(2)}, (error/σ)² {np.mean(nees):.2f}")
    assert (after < before).all()
    # Over 8 flights, with some 3 independent epochs and 52 states each.
    assert np.mean(nees) == pytest.approx(1, abs=0.25)
