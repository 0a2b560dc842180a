"""Bias verdict: one state for turn-on bias and instability is not called wrong, and a wrong drive is."""

from __future__ import annotations

import operator
from functools import reduce
from pathlib import Path

import numpy as np
import pymap3d
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import Finding
from lab.analysis.verdicts.run_evidence import make_reference
from lab.analysis.verdicts.selection import Explained
from lab.analysis.verdicts.sensor_evidence import sensor_errors, spectrum
from lab.analysis.verdicts.sensor_verdict import _state_finding, judge_sensors
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.missions import Recording, write_flight_csv
from lab.navigation.belief import belief
from lab.navigation.solution import Imu

MATCHED = [
    ("gyro", 30.0, 0.5),
    ("gyro", 30.0, 50.0),
    ("accelerometer", 0.05, 0.5),
    ("accelerometer", 5.0, 5.0),
]
"""Sensor, instability [°/h] or [mg], and correlation time [s]: far below the turn-on bias, and above it."""


def unstable(sensor: str, instability: float, correlation_time: float, seed: int = 1) -> Experiment:
    """Return an experiment whose filter is matched to an instability beside the turn-on bias."""
    experiment = Experiment(mission="los_angeles", seed=seed)
    experiment.set(f"sensors.{sensor}.instability", instability)
    experiment.set(f"sensors.{sensor}.correlation_time", correlation_time)
    return experiment


@pytest.mark.proof
@pytest.mark.parametrize(("sensor", "instability", "correlation_time"), MATCHED)
def test_a_filter_matched_to_an_instability_is_not_accused(
    sensor: str, instability: float, correlation_time: float
) -> None:
    """Neither by one run nor by ten together."""
    ensemble = run_ensemble(unstable(sensor, instability, correlation_time), 10)
    print(f"\n{sensor}, {instability}, {correlation_time} s: {ensemble.verdict}")
    assert ensemble.verdict.consistent
    assert all(verdict.consistent for verdict in ensemble.verdicts)


@pytest.fixture(scope="module", params=[("gyro", 30.0, 5.0), ("accelerometer", 0.5, 0.5)], ids=lambda p: p[0])
def ten(request: pytest.FixtureRequest) -> tuple[str, list[Result]]:
    """Return a sensor and ten runs with a filter that is matched to its instability."""
    sensor = request.param[0]
    return sensor, [unstable(*request.param, seed=seed).run() for seed in range(1, 11)]


def judged(sensor: str, runs: list[Result], factor: float) -> list[Finding]:
    """Return what is said of filters whose bias drive is a number of times the matched one."""
    rows = slice(6, 9) if sensor == "gyro" else slice(9, 12)
    parts = []
    for run in runs:
        noise = run.belief.noise.copy()
        noise[rows] *= factor
        imu = Imu(run.time, run.gyro.increments, run.accelerometer.increments)
        parts.append(sensor_errors(run.belief._replace(noise=noise), imu, make_reference(run)))
    return [entry.finding for entry in judge_sensors(reduce(operator.add, parts))]


@pytest.mark.parametrize("factor", [10.0, 100.0])
def test_a_larger_drive_is_too_large_by_what_it_exceeds_the_matched_one(
    ten: tuple[str, list[Result]], factor: float
) -> None:
    sensor, runs = ten
    (finding,) = judged(sensor, runs, factor)
    assert (finding.quantity, finding.direction) == (f"Q {sensor} bias", "too large")
    assert finding.factor == pytest.approx(factor, rel=1e-6)


def test_a_smaller_drive_is_never_too_large(ten: tuple[str, list[Result]]) -> None:
    """The noise hides this instability of the gyros, so that nothing tells of a drive that is too small."""
    sensor, runs = ten
    assert judged(sensor, runs, 0.3) == []
    found = [(finding.quantity, finding.direction) for finding in judged(sensor, runs, 0.01)]
    assert found == ([] if sensor == "gyro" else [("Q accelerometer bias", "too small")])


def walking(sensor: str, seed: int, times: float) -> Result:
    """Return a run whose filter knows of no walk, with a σ of so many times that of the noise in a flight T.

    The noise N lets a mean over T err by N/√T, and a walk K grows to K √T.
    """
    experiment = Experiment(mission="los_angeles", seed=seed)
    experiment.trajectory.imu_rate = 50.0
    own = getattr(experiment.sensors, sensor)
    experiment.set("navigator.q", belief(experiment.sensors, experiment.navigator).noise.tolist())
    density = float(np.max(own.noise_density)) * (3600 if sensor == "gyro" else 1e-3)  # °/h or mg, and √Hz
    own.rate_random_walk = times * density / 105.0 * 60.0  # K = N / T, per √h
    return experiment.run()


@pytest.mark.parametrize("sensor", ["gyro", "accelerometer"])
def test_a_walk_is_named_even_where_the_noise_hides_it_by_chance(sensor: str) -> None:
    """In some runs, the biases through their noise are hardly likelier with the true drive."""
    by_chance = 0
    rows = slice(0, 3) if sensor == "gyro" else slice(3, 6)
    for seed in range(1001, 1009):
        run = walking(sensor, seed, 10.0)
        errors = run.evidence.sensors
        constant = errors.drift_vector.values[0, rows, :, 0] ** 2
        constant /= errors.drift_matrix.values[0, rows, :, 0, 0]
        others = errors.drift_squares.values[0, rows] + errors.log_determinant.values[0, rows]
        gains = 0.5 * (constant - others).sum(axis=0)
        by_chance += gains[1] < gains[0] + limits.VERDICT.likelihood_ratio
        names = [finding.quantity for finding in run.verdict.findings]
        assert names in ([f"Q {sensor} bias"], [f"{sensor} bias drift"])
    assert by_chance


@pytest.mark.parametrize("sensor", ["gyro", "accelerometer"])
def test_a_walk_that_noise_always_hides_is_not_named(sensor: str) -> None:
    assert all(walking(sensor, seed, 0.5).verdict.consistent for seed in range(1001, 1009))


@pytest.mark.parametrize(("path", "size"), [("gyro.flicker", 1e-3), ("accelerometer.flicker", 1e-4)])
def test_flicker_that_no_flight_shows_is_nothing_to_name(path: str, size: float) -> None:
    """Fixes hide it for longer than the flight."""
    experiment = Experiment(mission="los_angeles", seed=1001)
    experiment.set("trajectory.imu_rate", 50.0)
    experiment.set(f"sensors.{path}", size)
    assert experiment.run().verdict.consistent


def test_constant_biases_are_not_accused_on_a_slow_walk_of_minutes(tmp_path: Path) -> None:
    """Noise resembles a lag there, by chance, and the windows of the biases are not those of the noise."""
    time, knots = np.arange(450.0), np.arange(0, 460, 15.0)
    bends = np.random.default_rng(4).normal(0, np.radians(25), knots.size)
    course = CubicSpline(knots, np.cumsum(bends))(time)
    velocity = 1.5 * np.column_stack([np.cos(course), np.sin(course), np.zeros_like(time)])
    north, east = cumulative_trapezoid(velocity[:, :2], time, axis=0, initial=0).T
    latitude, longitude, _ = pymap3d.enu2geodetic(east, north, 0 * time, 48, 11, 500)
    lean = np.arctan(1.5 * np.gradient(course) / 9.81)
    euler = np.column_stack([lean, 0 * time, course])
    places = np.radians(latitude), np.radians(longitude), np.full_like(time, 500.0)
    write_flight_csv(tmp_path / "walk.csv", Recording(time, *places, velocity, euler))
    experiment = Experiment(mission=str(tmp_path / "walk.csv"))
    experiment.trajectory.imu_rate = 10.0
    for experiment.seed in range(12):
        assert not [one for one in experiment.run().verdict.findings if "bias" in one.quantity]


@pytest.mark.parametrize("correlation_time", [0.3, 4.0, 1e3, 1e9])
def test_the_growth_of_a_process_is_that_of_drawn_ones(correlation_time: float) -> None:
    """Means over windows of 1 s, less the value at the start, of processes with their stationary variance."""
    rng = np.random.default_rng(5)
    windows, steps, paths = 6, 50, 20_000
    dt = 1 / steps
    decay = np.exp(-dt / correlation_time)
    # Of unit drive: what a process of first order, or a random walk, adds in a step.
    added = np.sqrt(-np.expm1(-2 * dt / correlation_time) * correlation_time / 2)
    # Growth is linear in the start, whose variance is large where the process hardly decays.
    start = rng.normal(0, np.sqrt(correlation_time / 2), paths)
    grown, fallen = np.zeros(paths), 1.0
    means = np.zeros((windows, paths))
    for window in range(windows):
        for _ in range(steps):
            before, fell = grown.copy(), fallen
            grown, fallen = decay * grown + added * rng.standard_normal(paths), decay * fallen
            middle = (fell + fallen) / 2 - 1 if correlation_time < 1e6 else 0.0
            means[window] += ((before + grown) / 2 + middle * start) / steps
    power, basis = spectrum(windows, 1.0, 1 / correlation_time)
    expected = basis * power @ basis.T
    drawn = means @ means.T / paths
    # σ of a covariance of n draws is √((Vᵢⱼ² + Vᵢᵢ Vⱼⱼ) / n).
    sigma = np.sqrt((expected**2 + np.outer(np.diag(expected), np.diag(expected))) / paths)
    assert (np.abs(drawn - expected) < 4.5 * sigma).all()


@pytest.mark.parametrize(
    ("name", "gyros", "accelerometers"),
    [
        ("scale factor", "0.1 %", "0.1 %"),
        ("misalignment", "0.057°", "0.057°"),
        ("bandwidth", "2 ms", "2 ms"),  # two regressors: the lag is their sum
        ("temperature", "0.057 °/s per K", "0.1 mg per K"),
        ("g-sensitivity", "0.56 °/s per g", "1 mg per g"),
        ("bias drift", "3.4 °/s per minute", "6.1 mg per minute"),
    ],
)
def test_the_size_of_a_cause_is_said_in_the_units_of_data_sheets(
    name: str, gyros: str, accelerometers: str
) -> None:
    """Of a thousandth in SI units: 1e-3 rad/s are 0.0573 °/s, 1e-3 m/s² are 0.102 mg."""
    cause = Explained(name, 12.0, np.full((1, 2), 1e-3), np.full((1, 2), 1e-4))
    for sensor, (kind, size) in enumerate((("gyro", gyros), ("accelerometer", accelerometers))):
        assert f" {size}" in _state_finding(cause, kind, sensor).finding.sentence
