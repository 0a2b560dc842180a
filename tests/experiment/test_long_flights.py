"""Long flights: in less memory they give what they gave before, or are refused before they begin."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from dashboards.computing import run
from lab import Experiment
from lab.analysis import consistency, fix_causes, observability
from lab.analysis.verdicts import imu_causes, true_motion
from lab.analysis.verdicts.innovation_evidence import offered
from lab.analysis.verdicts.run_evidence import collect_evidence
from lab.base import histories
from lab.cli import app
from lab.experiment import sensor_stages, stages
from lab.experiment.datasets import flight, tables
from lab.experiment.result import Result
from lab.missions import mission
from lab.motion.kinematics import spline_windows
from lab.motion.truth import trajectory
from lab.motion.truth.trajectory import Trajectory
from lab.navigation import navigator
from lab.navigation.filters import smoother, unscented
from lab.navigation.lever_arm import mean_rates_at_fixes
from lab.navigation.model_choice import chosen_model
from lab.navigation.solution import Fixes, Imu, Solution
from lab.run import memory
from lab.run import run as arrays
from lab.sensors.imu import Measured
from lab.views import thinned
from lab.views.figures import TimeAxis
from lab.views.quantities import COVARIANCE, ERRORS, HEIGHT, SCALE_ERRORS, SENSOR_ERRORS
from lab.views.time_figures import TimeFigures
from lab.views.time_plot import TimePlot

SHORT = 2**12
"""Samples from which on a flight counts as long here: a tenth of that of the tests."""
ROUNDING = 2e-5
"""Largest difference of an error of float32 velocities [m/s] or attitudes [°] due to their 24 bits: each of
two velocities of up to 128 m/s is off by up to 3.8e-6 m/s, and two headings, each made of four elements of a
quaternion that are off by up to 3e-8, by up to 2e-5°."""


@pytest.fixture
def everything_is_long(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Treat a flight of minutes as one of hours."""
    for module in (histories, trajectory, sensor_stages, stages, arrays):
        monkeypatch.setattr(module, "LONG", SHORT)
    for module in (navigator, smoother, unscented, memory):
        monkeypatch.setattr(module, "SINGLE", SHORT)
    monkeypatch.setattr(spline_windows, "WINDOW", SHORT)
    for module in (trajectory, arrays, observability, thinned):
        monkeypatch.setattr(module, "AT_ONCE", 1000)
    for module in (navigator, unscented):
        monkeypatch.setattr(module, "PIECE", 777)
    stages.CACHE.clear()
    yield
    stages.CACHE.clear()


def settings(*, rests: bool = True) -> Experiment:
    experiment = Experiment(mission="montreal", seed=3)
    experiment.set("sensors.gyro.instability", 30)
    experiment.set("navigator.states", 21)
    experiment.set("navigator.gate", 0.99)
    experiment.set("navigator.rest_updates", rests)
    return experiment


@pytest.fixture
def exact() -> Result:
    stages.CACHE.clear()
    return settings().run()


@pytest.mark.proof
def test_what_is_said_of_a_flight_does_not_change(exact: Result, request: pytest.FixtureRequest) -> None:
    summary, evidence = exact.summary, exact.evidence
    states, nees = evidence.states, evidence.nees
    assert states is not None
    assert nees is not None
    verdict, coverage, consistency = exact.verdict, exact.coverage, exact.consistency
    request.getfixturevalue("everything_is_long")
    long = settings().run()
    a, b = exact.solution_arrays, long.solution_arrays
    assert b.variance.dtype == b.velocity_n.dtype == b.q_nb.dtype == np.float32
    assert b.position.dtype == np.float64
    np.testing.assert_array_equal(a.fix_sample, b.fix_sample)
    np.testing.assert_array_equal(a.rest, b.rest)
    np.testing.assert_allclose(a.position, b.position, rtol=1e-12)
    np.testing.assert_allclose(a.velocity_n, b.velocity_n, atol=1e-9)
    np.testing.assert_allclose(a.q_nb, b.q_nb, atol=1e-11)
    np.testing.assert_allclose(a.fix_covariance, b.fix_covariance, rtol=1e-9, atol=1e-15)
    # 24 bits: 6 parts in 10⁸.
    np.testing.assert_allclose(a.variance, b.variance, rtol=1e-7)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(a.bias, b.bias, rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(
        long.summary[["rms", "max", "95 %"]], summary[["rms", "max", "95 %"]], rtol=1e-8, atol=ROUNDING
    )
    # Errors of correlated states cancel in part, and so do not their 24 bits.
    np.testing.assert_allclose(
        long.consistency["nees"].values, consistency["nees"].values, rtol=1e-4, equal_nan=True
    )
    assert long.evidence.nees is not None
    assert long.evidence.states is not None
    assert float(long.evidence.nees.total) == pytest.approx(float(nees.total), rel=1e-6)
    np.testing.assert_allclose(long.evidence.states.means.values, states.means.values, rtol=1e-4)
    assert long.verdict == verdict
    # A sample that is at one σ to seven digits may count or not: percents of 41,000 samples.
    np.testing.assert_allclose(
        long.coverage.select_dtypes("number"), coverage.select_dtypes("number"), atol=1e-2
    )


def test_drifting_biases_are_in_memory_once() -> None:
    rng = np.random.default_rng(3)
    gyro, accelerometer = (
        Measured(rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), np.zeros((5, 3)), 0) for _ in range(2)
    )
    two = arrays.in_one(gyro, accelerometer)
    biases = arrays.at_samples(two[0].bias, two[1].bias)
    assert np.shares_memory(biases, two[0].bias)
    assert np.shares_memory(biases, two[1].bias)
    for before, after in zip((gyro, accelerometer), two, strict=True):
        np.testing.assert_array_equal(before.bias, after.bias)
    np.testing.assert_array_equal(biases, arrays.at_samples(gyro.bias, accelerometer.bias))
    part = two[0].taken(slice(2, 4)), two[1].taken(slice(2, 4))
    np.testing.assert_array_equal(arrays.at_samples(part[0].bias, part[1].bias), biases[[3, 3, 4]])
    steady = gyro._replace(bias=np.broadcast_to(np.ones(3), (5, 3)))
    assert arrays.in_one(steady, accelerometer) == (steady, accelerometer)


def smoothed(lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Experiment:
    experiment = settings()
    experiment.set("sensors.gps.lever_arm", lever_arm)
    experiment.set("navigator.smoother", True)
    return experiment


@pytest.mark.proof
def test_a_smoothed_flight_does_not_change(request: pytest.FixtureRequest) -> None:
    stages.CACHE.clear()
    exact = smoothed((3.0, 1.0, -1.0)).run()
    evidence, verdict, filtered = exact.evidence, exact.verdict, exact.filtered.solution
    request.getfixturevalue("everything_is_long")
    long = smoothed((3.0, 1.0, -1.0)).run()
    # Compiling once more takes some 30 s and 200 MB.
    compiled = smoother.backward_pass(
        chosen_model(long.experiment.navigator, long.experiment.sensors), aided=False
    )
    assert len(compiled.signatures) == 1  # type: ignore[attr-defined]
    a, b = exact.solution_arrays, long.solution_arrays
    assert b.variance.dtype == b.velocity_n.dtype == b.q_nb.dtype == np.float32
    assert b.position.dtype == np.float64
    for name in ("fix_sample", "fix_rejected", "fix_recovered", "rest"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_allclose(a.position, b.position, rtol=1e-12)
    np.testing.assert_allclose(a.velocity_n, b.velocity_n, atol=1e-9)
    np.testing.assert_allclose(a.q_nb, b.q_nb, atol=1e-11)
    for name in ("fix_covariance", "fix_H", "fix_R", "innovation", "innovation_covariance"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-8, atol=1e-14, err_msg=name)
    # 24 bits: 6 parts in 10⁸.
    np.testing.assert_allclose(a.variance, b.variance, rtol=1e-7)
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-7, atol=1e-12)
    for name in ("bias", "scale"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=1e-7, atol=1e-12)
    for triad in ("gyro", "accelerometer"):  # the smoother gives up the exact ones on its way
        wanted = getattr(exact, triad).increments.astype(np.float32)
        np.testing.assert_array_equal(getattr(long, triad).increments, wanted)
    # The filter's own solution, as far as the evidence needs it.
    own, motion, gains = long.filtered
    assert motion is not None
    assert gains is not None
    np.testing.assert_allclose(filtered.q_nb, own.q_nb, atol=1e-7)
    fixes = Fixes(exact.fix_validity, exact.fixes.position, exact.fixes.velocity_n)
    imu = Imu(exact.time, exact.gyro.increments, exact.accelerometer.increments)
    seen, samples = offered(filtered, fixes, imu)
    moved = fix_causes.motion_at_fixes(filtered, samples, imu)
    for name, values in moved._asdict().items():
        np.testing.assert_allclose(getattr(motion, name), values, rtol=1e-6, atol=1e-6, err_msg=name)
    K = fix_causes.gains(filtered, seen)
    # The increments have 24 bits: 6 parts in 10⁸, a few times. Gains of metres and of radians differ greatly.
    assert (np.abs(gains - K).max(axis=(0, 2)) <= 1e-6 * np.abs(K).max(axis=(0, 2))).all()
    for name in ("position", "velocity_n", "bias", "scale", "variance", "covariance"):
        np.testing.assert_array_equal(getattr(filtered, name)[:1], getattr(own, name))
    assert evidence.nees is not None
    assert long.evidence.nees is not None
    # Smoothed errors are small, and known to 24 bits of velocity and attitude.
    assert float(long.evidence.nees.total) == pytest.approx(float(evidence.nees.total), rel=1e-5)
    np.testing.assert_allclose(
        long.evidence.innovations.likelihoods, evidence.innovations.likelihoods, rtol=1e-4
    )
    assert long.verdict == verdict


def test_a_flight_of_the_nonlinear_filter_does_not_change(monkeypatch: pytest.MonkeyPatch) -> None:
    def run() -> Solution:
        stages.CACHE.clear()
        experiment = settings()
        experiment.set("trajectory.imu_rate", 50)
        experiment.set("navigator.states", 15)
        experiment.set("navigator.model", "nonlinear")
        return experiment.run().solution_arrays

    exact = run()
    monkeypatch.setattr(unscented, "SINGLE", SHORT)
    monkeypatch.setattr(unscented, "PIECE", 777)
    long = run()
    stages.CACHE.clear()
    assert long.variance.dtype == long.velocity_n.dtype == long.q_nb.dtype == np.float32
    for name, wanted in exact._asdict().items():
        found = getattr(long, name)
        np.testing.assert_array_equal(found, wanted.astype(found.dtype), err_msg=name)


@pytest.mark.proof
def test_a_smoother_takes_little_memory(monkeypatch: pytest.MonkeyPatch, everything_is_long: None) -> None:
    taken = {}
    navigate = smoother.navigate

    def measured(*arguments: Any, **others: Any) -> Solution:
        navigate(*arguments, **others)  # what is compiled or loaded is not counted
        tracemalloc.start()
        try:
            return navigate(*arguments, **others)
        finally:
            taken["smoother"] = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()

    monkeypatch.setattr(smoother, "navigate", measured)
    monkeypatch.setattr(smoother, "GO", 128)  # a tenth of the usual part of the flight
    experiment = smoothed((3.0, 1.0, -1.0))
    result = experiment.run()
    print(f"\nsmoother: {taken['smoother'] / result.time.size:.0f} bytes per sample")
    # With float64, copies of the rates, and a second set of covariances 730.
    assert taken["smoother"] / result.time.size < 500


@pytest.mark.proof
def test_the_filter_of_a_smoothed_flight_is_run_alone(
    monkeypatch: pytest.MonkeyPatch, everything_is_long: None
) -> None:
    result = smoothed().run()
    monkeypatch.setattr(Experiment, "run", lambda *_: pytest.fail("the sensors are simulated again"))
    _ = result.filtered  # loads the code
    tracemalloc.start()
    try:
        own = result.filtered.solution
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert own.q_nb.shape == result.solution_arrays.q_nb.shape
    # The whole solution alone takes 400.
    assert peak / result.time.size < 135


@pytest.mark.proof
def test_what_is_drawn_of_a_flight_does_not_change(exact: Result, request: pytest.FixtureRequest) -> None:
    drawn = [_drawn(exact, plots) for plots in GRIDS]
    places = exact.places(np.array([0, 7000, 41000]))
    request.getfixturevalue("everything_is_long")
    long = settings().run()
    assert len(list(long.parts())) > 10
    for plots, wanted in zip(GRIDS, drawn, strict=True):
        found = _drawn(long, plots)
        for name, values in wanted.items():
            # 24 bits of what is drawn and of what is kept; the edge of a band is a difference of these.
            size = np.nanmax(np.abs(values), initial=1e-12)
            most = 3e-7 * size + (ROUNDING if "velocity" in name or "attitude" in name else 0)
            np.testing.assert_allclose(found[name], values, rtol=3e-7, atol=most, err_msg=name)
    np.testing.assert_allclose(long.places(np.array([0, 7000, 41000])), places, atol=1e-6)
    assert long.drawn_track["time"].values[-1] == long.time[-1]


@pytest.mark.proof
def test_budget_and_observability_do_not_change(request: pytest.FixtureRequest) -> None:
    stages.CACHE.clear()
    exact = settings(rests=False).run()
    budget, seen = exact.budget, exact.observability
    request.getfixturevalue("everything_is_long")
    long = settings(rests=False).run()
    for name in ("total", "believed"):
        np.testing.assert_allclose(long.budget[name], budget[name], rtol=1e-5)
    for name in ("sigma", "free"):
        np.testing.assert_allclose(long.observability[name], seen[name], rtol=1e-6)
    assert list(long.observability.segment.values) == list(seen.segment.values)


GRIDS = (ERRORS, COVARIANCE, SENSOR_ERRORS, SCALE_ERRORS, HEIGHT)


def _drawn(result: Result, plots: tuple[TimePlot, ...]) -> dict[str, np.ndarray]:
    grid = TimeFigures(plots, TimeAxis())
    drawn = {}
    for window in ((0.0, 205.0), (50.0, 120.0), (60.0, 61.0)):
        for clock, columns in grid._thinned(result, window).columns.items():
            drawn |= {f"{clock} {name} {window}": values for name, values in columns.items()}
    return drawn


@pytest.mark.proof
def test_a_plot_of_a_long_flight_holds_no_history(everything_is_long: None) -> None:
    result = settings().run()
    grid = TimeFigures(COVARIANCE, TimeAxis())
    grid._thinned(result, (0.0, 1.0))
    tracemalloc.start()
    try:
        grid._thinned(result, (0.0, 205.0))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # Whole datasets of 21 states at each of the 15 curves take 2500.
    assert peak / result.time.size < 100


STEPS: dict[str, tuple[Callable[[Result], object], int]] = {
    # Bytes per sample: found, and with whole histories at once.
    "summary": (tables.summary, 27),  # 23, 31
    "evidence": (lambda result: collect_evidence(result, result.filtered, explain=False), 175),  # 62, 393
    "true bias": (lambda result: result.true_bias, 60),  # 48, 96
    "manoeuvres": (lambda result: observability.manoeuvres(result.flown), 40),  # 30, 56
    "budget": (lambda result: result.budget, 43),  # 33, 52
}


@pytest.mark.proof
@pytest.mark.parametrize("step", STEPS)
def test_what_is_computed_of_a_long_flight_takes_little(
    step: str, monkeypatch: pytest.MonkeyPatch, everything_is_long: None
) -> None:
    for module, name in ((flight, "AT_ONCE"), (fix_causes, "AT_ONCE"), (true_motion, "AT_ONCE")):
        monkeypatch.setattr(module, name, 1000)
    for module, name in ((imu_causes, "AT_ONCE"), (fix_causes, "FIXES_AT_ONCE"), (consistency, "AT_ONCE")):
        monkeypatch.setattr(module, name, 8)
    experiment = settings(rests=False)
    experiment.set("sensors.gps.outlier_rate", 0.02)  # outliers are searched in all innovations
    experiment.set("navigator.gate", 0.0)
    compute, most = STEPS[step]
    compute(experiment.run())  # loads the code
    result = experiment.run()
    tracemalloc.start()
    try:
        compute(result)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    print(f"\n{step}: {peak / result.time.size:.0f} bytes per sample")
    assert peak / result.time.size < most


def test_a_bare_result_keeps_no_history(everything_is_long: None) -> None:
    result = settings().run()
    bare = result.bare()
    assert not bare.is_long
    assert bare.experiment is result.experiment
    held = [
        *(getattr(bare.truth_arrays, name) for name in ("time", "velocity_n", "q_nb")),
        *(getattr(bare.solution_arrays, name) for name in ("position", "variance", "covariance", "bias")),
        *(bare.gyro.increments, bare.gyro.bias, bare.ideal.dtheta, bare.ideal.time),
    ]
    for array in held:
        assert not any(np.shares_memory(array, whole) for whole in _histories(result))


def _histories(result: Result) -> list[np.ndarray]:
    truth, solution, ideal = result.truth_arrays, result.solution_arrays, result.ideal
    assert truth is not None
    assert ideal is not None
    return [
        *(truth.time, truth.velocity_n, truth.q_nb, ideal.time, ideal.dtheta),
        *(solution.position, solution.variance, solution.covariance, solution.bias),
        *(result.gyro.increments, result.gyro.bias),
    ]


def test_the_sensors_of_a_long_flight_are_not_cached(everything_is_long: None) -> None:
    settings().run()
    assert not {"gyro", "accelerometer"} & set(stages.CACHE.computed)


@pytest.mark.proof
def test_nothing_made_of_a_long_flight_stays(everything_is_long: None) -> None:
    result = settings().run()
    assert result.errors is not result.errors
    assert result.truth_arrays is not None
    assert "euler" not in vars(result.truth_arrays)


@pytest.mark.proof
def test_a_curve_takes_little_while_it_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = mission("montreal").recording
    monkeypatch.setattr(spline_windows, "WINDOW", 2**11)  # a tenth of the flight
    tracemalloc.start()
    try:
        curve = Trajectory.from_recording(recording, 100.0)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # In one window 1600 bytes: nine bands of a matrix of three rows a knot, twice.
    assert peak / curve.time.size < 250
    whole = curve.time[::97]
    monkeypatch.setattr(spline_windows, "WINDOW", 2**20)
    one = Trajectory.from_recording(recording, 100.0)
    for a, b in zip(curve.rates(whole), one.rates(whole), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_what_a_lever_arm_takes_is_counted() -> None:
    samples = 200_000
    imu = Imu(np.arange(samples + 1) / 200, np.zeros((samples, 3)), np.zeros((samples, 3)))
    tracemalloc.start()
    try:
        mean_rates_at_fixes(imu, np.arange(1.0, 900.0), np.array([1.0, 0.0, 0.0]))
        taken = tracemalloc.get_traced_memory()[1] / samples
    finally:
        tracemalloc.stop()
    plain, with_arm = (
        memory.bytes_per_sample(samples, states=15, drifting=0, exact=False, arm=arm) for arm in (False, True)
    )
    assert with_arm - plain == pytest.approx(taken, rel=0.05)


def test_too_long_is_said_before_anything_is_computed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    stages.CACHE.clear()
    monkeypatch.setattr(memory, "ALWAYS", 0)
    monkeypatch.setattr(memory, "available", lambda: 10_000_000)
    experiment = Experiment(mission="montreal")
    with pytest.raises(memory.TooLongError, match=r"GB are available.*up to .* s at this\s+rate, or up to"):
        experiment.run()
    assert "flight" not in stages.CACHE.computed
    assert "GB are available" in run(experiment).problem
    answer = CliRunner().invoke(app, ["run", "montreal"])
    assert answer.exit_code == 2
    assert "GB are available" in answer.stderr


def test_what_the_system_refuses_is_a_message(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(self: Experiment, *_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 34 GiB")

    monkeypatch.setattr(Experiment, "run", refused)
    answer = CliRunner().invoke(app, ["run", "montreal"])
    assert answer.exit_code == 2
    assert "needs more memory than is available" in answer.stderr
