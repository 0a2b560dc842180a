"""Aided filters over many seeds: they tell the truth about their errors, and outages cost less."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from lab import Experiment
from lab.analysis.consistency import normalised_squares
from lab.analysis.errors import error_state
from lab.navigation import blocks
from lab.result import Result

SEEDS = 24
RATE = 50.0
"""Rate of the IMU [Hz]: statistics over seeds say the same as at 200 Hz, in a quarter of the time."""
HEADER = (
    "time_s,latitude_deg,longitude_deg,height_m,velocity_north_m_s,velocity_east_m_s,velocity_down_m_s,"
    "roll_deg,pitch_deg,yaw_deg\n"
)
ARM, LATE = (1.0, 0.5, -0.5), 0.3
"""What the filter assumes of the receiver [m], [s]; the truth is drawn about it."""


def everything(seed: int) -> Experiment:
    """Return a flight with all sensors and states; antenna and latency are drawn as the filter believes."""
    rng = np.random.default_rng(seed)
    made = Experiment(mission="montreal", seed=seed)
    made.set("trajectory.imu_rate", RATE)
    for sensor in ("barometer", "heading", "odometer"):
        made.set(f"sensors.{sensor}.fitted", True)
    made.set("sensors.heading.drift_sigma", 0.5)
    made.set("sensors.gps.correlated_sigma", 2.0)
    made.set("sensors.gps.lever_arm", tuple(np.array(ARM) + 0.5 * rng.normal(size=3)))
    made.set("sensors.gps.latency", LATE + 0.05 * rng.normal())
    made.set("navigator.lever_arm", ARM)
    made.set("navigator.latency", LATE)
    made.set("navigator.latency_sigma", 0.05)
    for what in ("gps_drift", "lever_arm", "latency"):
        made.set(f"navigator.estimate_{what}", True)
    return made


def test_all_states_and_measurements_together_are_consistent() -> None:
    nees, nis, aids = [], [], []
    for seed in range(SEEDS):
        result = everything(seed).run()
        solution = result.solution_arrays
        used = solution.fix_sample >= 0
        x = error_state(
            solution,
            solution.fix_sample[used],
            result.known_truth("errors"),
            result.true_bias,
            further=result.true_further(),
        )
        P = solution.fix_covariance[used]
        parts = [slice(None), slice(0, 3), slice(3, 6), slice(6, 9)]
        parts += [blocks.states_of(result.blocks, name) for name in result.blocks]
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


def ends(mission: Path | str, column: list[int], **settings: Any) -> tuple[float, float]:
    """Return the rms error at the end of an outage of 60 s [m], and the rms of error / σ, over seeds."""
    errors, ratios = [], []
    for seed in range(SEEDS):
        made = Experiment(mission=str(mission), seed=seed)
        made.set("trajectory.imu_rate", RATE)
        made.set("sensors.gps.outages", [(100.0, 160.0)])
        for path, value in settings.items():
            made.set(path.replace("__", "."), value)
        result = made.run()
        at = np.array([np.searchsorted(result.time, 159.9)])
        further = result.true_further()
        x = error_state(
            result.solution_arrays, at, result.known_truth("errors"), result.true_bias, further=further
        )
        errors.append(x[0, column])
        ratios.append(x[0, column] / np.sqrt(result.solution_arrays.variance[at[0], column]))
    return float(np.sqrt(np.mean(np.square(errors)))), float(np.sqrt(np.mean(np.square(ratios))))


def check_gain(name: str, alone: tuple[float, float], aided: tuple[float, float], number: int) -> None:
    """Print the gain; the errors must be as large as σ says, and smaller than without the measurement."""
    print(f"\n{name}: {alone[0]:.3g} m becomes {aided[0]:.3g} m, error / σ {aided[1]:.2f}")
    low, high = np.sqrt(stats.chi2.ppf([1e-4, 1 - 1e-4], number) / number)
    assert low < aided[1] < high
    assert aided[0] < 0.5 * alone[0]


def test_a_barometer_halves_the_vertical_error_of_an_outage() -> None:
    alone, aided = ends("montreal", [2]), ends("montreal", [2], sensors__barometer__fitted=True)
    check_gain("barometer", alone, aided, SEEDS)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a drive at 15 m/s along a winding level road, the car pointing where it goes."""
    t = np.arange(0.0, 200.05, 0.1)
    course = 0.8 * np.sin(2 * np.pi * t / 60) + 0.4 * np.sin(2 * np.pi * t / 17)
    north, east = 15 * np.cos(course), 15 * np.sin(course)
    place = [np.concatenate(([0.0], np.cumsum((v[1:] + v[:-1]) / 2 * 0.1))) for v in (north, east)]
    latitude = 45.5 + np.degrees(place[0] / 6.371e6)
    longitude = -73.6 + np.degrees(place[1] / (6.378e6 * np.cos(np.radians(45.5))))
    path = tmp_path_factory.mktemp("drive") / "drive.csv"
    rows = np.column_stack((t, latitude, longitude, north, east, np.degrees(course)))
    line = "{:.1f},{:.10f},{:.10f},30,{:.6f},{:.6f},0,0,0,{:.6f}\n"
    path.write_text(HEADER + "".join(line.format(*row) for row in rows))
    return path


def test_an_odometer_and_wheels_that_do_not_slip_hold_the_position(drive: Path) -> None:
    wheels = {"sensors__odometer__fitted": True, "navigator__no_slip": True}
    alone = ends(drive, [0, 1])
    aided = ends(drive, [0, 1], navigator__slip_sigma=(0.05, 0.05), **wheels)
    check_gain("odometer and no slip", alone, aided, SEEDS)


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a vehicle that stands still."""
    path = tmp_path_factory.mktemp("rest") / "standing.csv"
    path.write_text(HEADER + "".join(f"{t},45,7,300,0,0,0,1,2,30\n" for t in range(201)))
    return path


def test_zero_velocity_at_rest_is_consistent_and_sharper(standing: Path) -> None:
    alone, aided = at_rest(standing, used=False), at_rest(standing, used=True)
    speed = [np.array([one.solution_arrays.velocity_n[-1] for one in results]) for results in (alone, aided)]
    sigma = np.array([np.sqrt(one.solution_arrays.variance[-1, 3:6]) for one in aided])
    ratio = float(np.sqrt(np.mean((speed[1] / sigma) ** 2)))
    print(f"\nzero velocity: {speed[0].std():.3g} m/s becomes {speed[1].std():.3g}, error / σ {ratio:.2f}")
    assert ratio < 1.3  # the vehicle stands still exactly, better than the 2 cm/s assumed
    assert speed[1].std() < 0.3 * speed[0].std()
    assert all((one.solution_arrays.aid_sample >= 0).all() for one in aided)


def at_rest(standing: Path, *, used: bool) -> list[Result]:
    """Return runs at rest, with zero velocity used as a measurement or not."""
    found = []
    for seed in range(SEEDS):
        made = Experiment(mission=str(standing), seed=seed)
        made.set("trajectory.imu_rate", RATE)
        made.set("navigator.zero_velocity", used)
        found.append(made.run())
    return found


def test_smoothed_errors_are_smaller_and_as_large_as_their_sigma() -> None:
    nees, squares = [], []
    for seed in range(8):
        made = everything(seed)
        result = made.run()
        made.set("navigator.smoother", True)
        smoothed = made.run()
        every = int(10 * RATE)
        at = np.arange(every, result.time.size - every, every)
        truth, bias, further = result.known_truth("errors"), result.true_bias, result.true_further()
        x, better = (
            error_state(one.solution_arrays, at, truth, bias, further=further) for one in (result, smoothed)
        )
        squares.append([np.mean(values[:, :9] ** 2, axis=0) for values in (x, better)])
        nees.append(np.mean(better**2 / smoothed.solution_arrays.variance[at], axis=0))
    before, after = np.mean(squares, axis=0)
    print(f"\nsmoothed: rms / filtered {np.sqrt(after / before).round(2)}, (error/σ)² {np.mean(nees):.2f}")
    assert (after < before).all()
    # Over 8 flights, with some 3 independent epochs and 25 states each.
    assert np.mean(nees) == pytest.approx(1, abs=0.25)
