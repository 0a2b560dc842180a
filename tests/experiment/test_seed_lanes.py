"""Seed lanes: runs eight abreast are those of their seeds alone."""

from __future__ import annotations

import dataclasses
import math
import operator
import time
from collections.abc import Sequence
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from polar_flights import over_the_pole

import lab.experiment.ensembles.seed_lanes as seed_lanes_module
import lab.experiment.ensembles.seeds as seeds_module
from lab.analysis.verdicts.evidence import Evidence
from lab.analysis.verdicts.lane_evidence import Abreast, evidence_abreast
from lab.analysis.verdicts.sums import Kept
from lab.analysis.verdicts.verdict import judge
from lab.base.cache import _freeze
from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.experiment.ensembles import lane_results
from lab.experiment.ensembles.collected import Collected
from lab.experiment.ensembles.ensemble import Ensemble
from lab.experiment.ensembles.run_at_fixes import RunAtFixes, keep_values
from lab.experiment.ensembles.seed_lanes import SeedLanes
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.motion.truth.trajectory import Truth
from lab.navigation.navigator import navigate
from lab.navigation.solution import Fixes, Imu
from lab.sensors.cards import card, cards

SLOW: dict[str, object] = {"mission": "los_angeles", "trajectory.imu_rate": 50.0}
OUTAGE: dict[str, object] = {"sensors.gps.outages": [[30.0, 55.0]]}
MONTREAL: dict[str, object] = {
    "mission": "montreal",
    "trajectory.imu_rate": 20.0,
    "sensors.gyro.instability": 30.0,
    "sensors.gyro.flicker": 5.0,
    "sensors.temperature.profile": "warm_up",
    "sensors.accelerometer.bias_temperature": 0.1,
    "sensors.accelerometer.vibration_density": 100.0,
}
ALIGNED: dict[str, object] = {"navigator.alignment": 30.0, "sensors.gps.period": 0.5}
UNTOLD: dict[str, object] = {"sensors.gps.latency": 0.5, "navigator.latency": 0.0}
"""A latency that the filter does not know of: the evidence then compares the fixes with the earlier truth."""
FAST: dict[str, object] = {"navigator.filter_rate": 10.0}
LATE: dict[str, object] = {"sensors.gps.latency": 0.13, "navigator.gate": 0.9, "navigator.robust": "huber"}


def of(changes: dict[str, object]) -> Experiment:
    """Return an experiment at a low rate with changed settings."""
    return Experiment().update(SLOW | changes)


def alone(experiment: Experiment, seed: int) -> RunAtFixes:
    """Return the run of a seed alone."""
    return keep_values(experiment.copy().update({"seed": seed}).run(), explain=False)


def numbers_in(value: Any) -> list[np.ndarray]:
    """Return all arrays of a kept run, with those of its evidence."""
    if dataclasses.is_dataclass(value):
        return [part for f in dataclasses.fields(value) for part in numbers_in(getattr(value, f.name))]
    if isinstance(value, tuple):
        return [part for item in value for part in numbers_in(item)]
    return [] if value is None or isinstance(value, str) else [np.asarray(value, dtype=np.float64)]


def assert_same(abreast: RunAtFixes, single: RunAtFixes) -> None:
    """Assert that two runs agree within rounding, all evidence included."""
    assert abreast.evidence is not None
    assert isinstance(abreast.evidence.assumed, Kept)
    left, right = (numbers_in(run._replace(seconds=0.0)) for run in (abreast, single))
    assert len(left) == len(right) > 50
    for one, other in zip(left, right, strict=True):
        assert one.shape == other.shape
        largest = np.abs(np.nan_to_num(other)).max(initial=0.0)
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-8 * largest)


def assert_abreast_as_alone(changes: dict[str, object]) -> None:
    """Assert that runs abreast are those of their seeds alone."""
    assert_same_abreast(of(changes))


def assert_same_abreast(experiment: Experiment) -> None:
    """Assert that runs abreast of an experiment are those of its seeds alone."""
    lanes = SeedLanes.of(experiment)
    assert lanes is not None
    seeds = (5, 9, 6)
    found = list(lanes.run(seeds))
    assert sum(run is not None for run in found) >= 2
    for seed, run in zip(seeds, found, strict=True):
        if run is not None:
            assert_same(run, alone(experiment, seed))
    for seed, run in zip(seeds, lanes.measure(seeds), strict=True):
        assert run is not None
        assert run.evidence is None
        single = alone(experiment, seed)
        assert_same(run._replace(evidence=single.evidence), single)


@pytest.mark.proof
@pytest.mark.parametrize(
    "changes",
    [
        OUTAGE,
        MONTREAL,
        ALIGNED,
        UNTOLD,
        UNTOLD | OUTAGE | {"sensors.gps.latency": 0.13},
        {"sensors.gps.correlated_sigma": 5.0},
        FAST | ALIGNED,
        FAST | UNTOLD | OUTAGE | {"sensors.gps.period": 0.7},
    ],
    ids=[
        *("outage", "montreal", "aligned", "late", "late with an outage", "correlated"),
        *("fast and aligned", "fast and late with an outage"),
    ],
)
def test_a_run_abreast_is_that_of_its_seed_alone(changes: dict[str, object]) -> None:
    assert_abreast_as_alone(changes)


@pytest.mark.proof
@pytest.mark.parametrize("rate", [0.0, 10.0])
@pytest.mark.parametrize("name", ["ADIS16470", "HG9900"])
def test_so_it_is_with_the_states_that_cards_bring(name: str, rate: float) -> None:
    """33 and 30 states, each run with an alignment and a belief of its own."""
    experiment = of(OUTAGE)
    card(name).load(experiment)
    experiment.update({"trajectory.imu_rate": 50.0, "navigator.filter_rate": rate})
    assert_same_abreast(experiment)


def test_all_cards_run_abreast() -> None:
    for name in cards():
        experiment = of({})
        card(name).load(experiment)
        assert SeedLanes.of(experiment) is not None, name


def test_a_fast_ensemble_propagates_the_covariance_less_often() -> None:
    """Its figures are those of the rate that it stands for, and not those of the full rate."""
    experiment = of({})
    fast, full = run_ensemble(experiment, 2, fast=True), run_ensemble(experiment, 2)
    same = run_ensemble(seeds_module.at_fast_rate(experiment), 2)
    assert np.array_equal(fast.mean_nees, same.mean_nees)
    assert not np.array_equal(fast.mean_nees, full.mean_nees)
    assert not experiment.navigator.filter_rate


def test_the_verdict_on_runs_abreast_names_the_causes_of_runs_alone() -> None:
    """A latency of 0.5 s, and nothing else: the truth between the stored samples is not straight."""
    lanes = SeedLanes.of(of(UNTOLD))
    assert lanes is not None
    runs = [run for first in (1, 9, 17) for run in lanes.run(range(first, first + 8))]
    (finding,) = judge(reduce(operator.add, [run.evidence for run in runs if run is not None])).findings
    assert finding.quantity == "GPS latency"
    assert finding.factor == pytest.approx(0.5, abs=0.005)


@pytest.mark.benchmark  # each model is compiled
@pytest.mark.parametrize(
    "changes",
    [
        LATE | {"navigator.model": "psi"},
        {"navigator.model": "invariant", "navigator.states": 21, "sensors.gyro.scale_factor_sigma": 0.5},
    ],
    ids=["psi", "invariant 21"],
)
def test_so_it_is_with_other_models(changes: dict[str, object]) -> None:
    assert_abreast_as_alone(changes)


@pytest.mark.parametrize(("changes", "asked"), [({}, False), ({"navigator.r_scale": 0.3}, True)])
def test_a_run_whose_innovations_need_an_explanation_runs_alone(
    changes: dict[str, object], *, asked: bool
) -> None:
    """The evidence of a run alone has likelihoods of hypotheses only if its innovations need them."""
    experiment = of(changes)
    lanes = SeedLanes.of(experiment)
    assert lanes is not None
    (abreast,) = lanes.run((5,), explain=True)
    evidence = keep_values(experiment.copy().update({"seed": 5}).run()).evidence
    assert evidence is not None
    assert bool(evidence.innovations.likelihoods.any()) is asked
    assert (abreast is None) is asked


@pytest.mark.parametrize("judged", [True, False])
def test_a_run_does_not_depend_on_those_beside_it(*, judged: bool) -> None:
    """The same bits, whatever its lane, and whether the other lanes are occupied."""
    lanes = SeedLanes.of(of({}))
    assert lanes is not None
    run = lanes.run if judged else lanes.measure
    together, (single,), (_, second) = (list(run(seeds)) for seeds in ((3, 4, 7), (7,), (1, 7)))
    for other in (single, second):
        assert together[2] is not None
        assert other is not None
        left, right = (numbers_in(run._replace(seconds=0.0)) for run in (together[2], other))
        for one, two in zip(left, right, strict=True):
            assert np.array_equal(one, two, equal_nan=True)


def test_runs_are_judged_abreast_and_those_with_an_own_covariance_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Bit for bit the same beside others, too, where an alignment gives each run a P0 of its own."""
    sizes: list[int] = []

    def counted(runs: Abreast, truth: Truth) -> list[Evidence | None]:
        sizes.append(len(runs.solutions))
        return evidence_abreast(runs, truth)

    monkeypatch.setattr(lane_results, "evidence_abreast", counted)
    lanes, aligned = SeedLanes.of(of({})), SeedLanes.of(of(ALIGNED))
    assert lanes is not None
    assert aligned is not None
    list(lanes.run(range(3, 11)))
    assert sizes == [8]
    beside, (single,) = list(aligned.run((3, 7))), list(aligned.run((7,)))
    assert sizes == [8]
    assert beside[1] is not None
    assert single is not None
    left, right = (numbers_in(run._replace(seconds=0.0)) for run in (beside[1], single))
    for one, two in zip(left, right, strict=True):
        assert np.array_equal(one, two, equal_nan=True)


def test_many_seeds_run_abreast_and_those_that_need_more_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """With outliers, some runs of a block need a run of their own."""
    monkeypatch.setattr(seeds_module, "FEW", 20)
    monkeypatch.setattr(seeds_module, "MANY", 20)
    monkeypatch.setattr(seeds_module, "SHOWN_EVERY", 0.0)
    experiment = of({"sensors.gps.outlier_rate": 0.005})
    told: list[tuple[str, float]] = []
    parts: list[Ensemble] = []
    blocks: list[list[bool]] = []
    run = SeedLanes.run

    def watched(self: SeedLanes, seeds: Sequence[int], *, explain: bool) -> list[RunAtFixes | None]:
        found = list(run(self, seeds, explain=explain))
        blocks.append([one is not None for one in found])
        return found

    monkeypatch.setattr(SeedLanes, "run", watched)
    whole = run_ensemble(
        experiment, range(1, 21), lambda words, done: told.append((words, done)), partial=parts.append
    )
    assert sorted(len(block) for block in blocks) == [4, 8, 8]
    done = [one for block in blocks for one in block]
    assert any(done)
    assert not all(done)
    assert [fraction for _, fraction in told] == [count / 20 for count in range(1, 21)]
    assert [len(part.seeds) for part in parts] == list(range(2, 20))
    assert whole.seeds == tuple(range(1, 21))
    for seed in (9, 14, 20):
        single = alone(experiment, seed)
        np.testing.assert_allclose(whole.mean_nees[seed - 1], single.nees.mean(), rtol=1e-7)
        np.testing.assert_allclose(whole.rms[seed - 1], single.rms, rtol=1e-7)


@pytest.mark.proof
def test_an_ensemble_is_the_same_with_any_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit; its verdict is that of the first runs, its figures those of all."""
    monkeypatch.setattr(seeds_module, "FEW", 20)
    monkeypatch.setattr(seeds_module, "MANY", 20)
    monkeypatch.setattr(seeds_module, "JUDGED", 14)
    experiment = of({"navigator.gate": 0.9})
    one, three = (run_ensemble(experiment, 40, workers=workers) for workers in (1, 3))
    assert one.consistency.identical(three.consistency)
    assert one.errors.identical(three.errors)
    assert one.coverage.equals(three.coverage)
    assert one.whiteness.equals(three.whiteness)
    assert np.array_equal(one.rms, three.rms)
    assert one.verdict == three.verdict
    assert len(one.evidence) == 14
    assert one.verdict.basis.startswith("14 runs")
    assert one.at_fixes.count["nis"].max() > 14
    assert 0.8 < one.at_fixes.count["nis"].mean() / 40 < 0.95


def test_the_memory_of_many_runs_is_that_of_few() -> None:
    """What an ensemble keeps of the runs that are not judged: 200 bytes each."""
    run = alone(of({}), 1)._replace(evidence=None)
    sizes = []
    for runs in (100, 1000):
        collected = Collected()
        for seed in range(runs):
            collected.add(seed, run)
        sizes.append(_freeze(collected.ensemble(of({}))))
    assert sizes[1] - sizes[0] < 900 * 250


def test_the_samples_that_are_asked_for_change_nothing() -> None:
    """A fix updates at its own sample, whether or not anything is stored there."""
    lanes = SeedLanes.of(of({}))
    assert lanes is not None
    few, many = np.array([501, 1507]), np.arange(0, 1508)
    for some, every in zip(lanes.navigate((4, 2), few), lanes.navigate((4, 2), many), strict=True):
        assert some is not None
        assert every is not None
        np.testing.assert_array_equal(some.solution.position, every.solution.position[few])
        np.testing.assert_array_equal(some.solution.variance, every.solution.variance[few])


SATURATED: dict[str, object] = {"sensors.gyro.range": 1.0, "sensors.accelerometer.range": 1.01}
QUANTISED: dict[str, object] = {
    "sensors.gyro.quantisation": 0.05,
    "sensors.gyro.misalignment": (0.5, -0.3, 0.2, 0.1, 0.4, -0.2),
    "sensors.gyro.scale_factor_sigma": 1.0,
    "sensors.accelerometer.bias": (3.0, -2.0, 1.0),
}


DRIFTING: dict[str, object] = ALIGNED | {
    "sensors.gyro.flicker": 5.0,
    "sensors.gyro.g_sensitivity": 0.01,
    "sensors.gyro.bandwidth": 15.0,
    "sensors.gyro.scale_factor_sigma": 1.0,
    "sensors.gyro.rate_random_walk": 20.0,
    "sensors.gyro.range": 20.0,
    "sensors.accelerometer.instability": 0.1,
    "sensors.accelerometer.bias_temperature": 0.1,
    "sensors.accelerometer.scale_temperature": 0.01,
    "sensors.temperature.profile": "warm_up",
}
SHAKEN: dict[str, object] = {
    "sensors.accelerometer.vibration_density": 100.0,
    "sensors.gyro.g_sensitivity": 0.01,
}
"""Errors of both triads that are not simulated abreast."""


@pytest.mark.parametrize(
    "changes",
    [SATURATED, QUANTISED, ALIGNED, DRIFTING, ALIGNED | SHAKEN],
    ids=["saturated", "quantised", "aligned", "drifting", "aligned and shaken"],
)
def test_sensors_abreast_measure_what_those_of_a_run_alone_do(changes: dict[str, object]) -> None:
    experiment = of(changes)
    lanes = SeedLanes.of(experiment)
    assert lanes is not None
    for seed, one in zip((4, 2), lanes._sense((4, 2), lanes._sensor_room()), strict=True):
        result = experiment.copy().update({"seed": seed}).run()
        for abreast, single in ((one.gyro, result.gyro), (one.accelerometer, result.accelerometer)):
            largest = float(np.abs(single.increments).max())
            # Rounding moves a value to the next step of the quantisation only where it is half way.
            apart = np.abs(abreast.increments - single.increments) > 1e-12 * largest
            assert apart.mean() < 1e-4
            np.testing.assert_allclose(abreast.bias, single.bias, rtol=1e-9, atol=1e-15)
            np.testing.assert_allclose(abreast.scale, single.scale, rtol=1e-12)
            assert abreast.saturated == single.saturated
        if changes is SATURATED:
            assert one.gyro.saturated > 0


@pytest.mark.parametrize(
    "changes",
    [
        {"navigator.correction": "feedforward"},
        {"navigator.correction_period": 5.0},
        {"navigator.smoother": True},
        {"navigator.model": "nonlinear"},
        {"navigator.mechanization": "wander azimuth"},
        {"navigator.engine": "filterpy"},
        {"sensors.gps.lever_arm": (1.0, 0.0, 0.0)},
        {"sensors.barometer.fitted": True},
        {"navigator.estimate_bias_drift": True},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_what_lanes_do_not_cover_runs_alone(changes: dict[str, object]) -> None:
    assert SeedLanes.of(of(changes)) is None


def test_a_run_that_turns_too_far_within_a_sample_runs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """What counts is what its gyros show, not what their range admits."""
    lanes = SeedLanes.of(of({"sensors.gyro.range": 2000.0}))
    assert lanes is not None
    assert all(run is not None for run in lanes.measure((1, 2)))
    largest = [float(np.abs(one.gyro.increments).max()) for one in lanes._sense((1, 2), lanes._sensor_room())]
    monkeypatch.setattr(seed_lanes_module, "LARGEST_TURN", math.sqrt(3) * sum(largest) / 2)
    assert [run is not None for run in lanes.measure((1, 2))] == [one < max(largest) for one in largest]


def test_a_flight_over_a_pole_runs_alone(tmp_path: Path) -> None:
    write_flight_csv(tmp_path / "polar.csv", over_the_pole(40.0, duration=60.0))
    assert SeedLanes.of(Experiment(mission=str(tmp_path / "polar.csv"))) is None


@pytest.mark.benchmark
def test_a_run_abreast_takes_a_part_of_the_time_of_a_run_alone() -> None:
    """In the processor's time: the loop over the samples, and the whole run with its evidence."""
    experiment = Experiment(mission="los_angeles")
    lanes = SeedLanes.of(experiment)
    assert lanes is not None
    result = experiment.run()
    list(lanes.run(range(8)))
    imu = Imu(result.time, result.gyro.increments, result.accelerometer.increments)
    fixes = Fixes(result.fix_validity, result.fixes.position, result.fixes.velocity_n)
    room = lanes._sensor_room()
    sensed = lanes._sense(range(8), room)
    one: list[float] = []
    eight: list[float] = []
    single: list[float] = []
    block: list[float] = []
    for turn in range(5):
        began = time.thread_time()
        navigate(imu, fixes, result.aligned.start, result.belief, lanes._schedule, lanes._model)
        one.append(time.thread_time() - began)
        began = time.thread_time()
        lanes._navigate(sensed, range(8), room.increments)
        eight.append((time.thread_time() - began) / 8)
        began = time.thread_time()
        alone(experiment, 100 + turn)
        single.append(time.thread_time() - began)
        began = time.thread_time()
        list(lanes.run(range(200 + 8 * turn, 208 + 8 * turn)))
        block.append((time.thread_time() - began) / 8)
    figures = [1000 * min(seconds) for seconds in (one, eight, single, block)]
    print("\n{:.2f} ms alone, {:.2f} abreast; whole runs {:.1f} ms alone, {:.1f} abreast".format(*figures))
    assert figures[1] < 0.6 * figures[0]
    assert figures[3] < 0.8 * figures[2]


def test_runs_with_errors_of_their_own_are_not_run_abreast() -> None:
    """Their fault, or their own errors, are no part of the settings that runs abreast share."""
    assert SeedLanes.of(FaultyExperiment(next(iter(FAULTS.values()))).update(SLOW)) is None
