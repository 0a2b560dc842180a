"""Verdict: every mismatch is named, on both missions, and a matched filter is not accused."""

from __future__ import annotations

import gzip
import operator
import re
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import reduce
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from lab.analysis import fix_causes
from lab.analysis.verdicts import fix_evidence as module
from lab.analysis.verdicts.evidence import Evidence, Reference, evidence
from lab.analysis.verdicts.fix_evidence import RATIOS, TIMES
from lab.analysis.verdicts.innovation_evidence import offered
from lab.analysis.verdicts.innovation_verdict import Explanation, _order_explanations
from lab.analysis.verdicts.outliers import outliers
from lab.analysis.verdicts.sums import Kept
from lab.analysis.verdicts.verdict import judge
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE, start
from lab.motion.frames import earth
from lab.navigation.filters.schedule import EVERY_FIX
from lab.navigation.navigator import navigate
from lab.navigation.solution import Fixes, Imu, Solution

MISSIONS = ("montreal", "los_angeles")
SEEDS = 10
MATCHED_SEEDS = 100
RATE = 50.0
"""Rate of the IMU of the runs that are judged [Hz]: what is judged are fixes, as many at any rate."""

LATENCY = 0.2
ARM = np.array((2.0, 0.0, 0.0))

Displace = Callable[[Result, np.ndarray, int], tuple[np.ndarray, np.ndarray]]


class Case(NamedTuple):
    """A mismatch, and what the verdict should say of it."""

    quantity: str
    direction: str
    low: float
    high: float
    settings: Mapping[str, object] = MappingProxyType({})
    displace: Displace | None = None


def correlated(result: Result, samples: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return Gauss-Markov position errors of 3 m and 60 s, N, E, D, and no velocity errors."""
    draws = np.random.default_rng(1000 + seed).normal(0, 3, (samples.size, 3))
    decay = np.exp(-1 / 60)
    draws[1:] *= np.sqrt(1 - decay**2)
    return lfilter([1], [1, -decay], draws, axis=0), np.zeros((samples.size, 3))


def late(result: Result, samples: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return what a fix that tells of `LATENCY` ago misses."""
    truth = result.truth_arrays
    before = samples - round(LATENCY / result.ideal.dt)
    meridian, transverse = earth.radii(np.sin(truth.latitude[samples]))
    north = (truth.latitude[before] - truth.latitude[samples]) * (meridian + truth.height[samples])
    east = (truth.longitude[before] - truth.longitude[samples]) * (transverse + truth.height[samples])
    down = truth.height[samples] - truth.height[before]
    position = np.stack((north, east * np.cos(truth.latitude[samples]), down), axis=-1)
    return position, truth.velocity_n[before] - truth.velocity_n[samples]


def on_an_arm(result: Result, samples: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return by what an antenna at `ARM` is elsewhere and moves otherwise."""
    C_nb = Rotation.from_quat(result.truth_arrays.q_nb[samples], scalar_first=True)
    rate = result.ideal.dtheta[samples - 1] / result.ideal.dt
    return C_nb.apply(ARM), C_nb.apply(np.cross(rate, ARM))


def outlying(result: Result, samples: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return jumps of 20 m north, east and down in one fix of twenty, and no velocity errors."""
    rng = np.random.default_rng(2000 + seed)
    jumps = rng.normal(0, 20, (samples.size, 3))
    chosen = np.isin(np.arange(samples.size), rng.choice(samples.size, samples.size // 20, replace=False))
    return jumps * chosen[:, None], np.zeros((samples.size, 3))


CASES = {
    "R position × 10": Case("R position", "too large", 7.5, 13, {"r": [5.0] * 3 + [0.2] * 3}),
    "R position ÷ 10": Case("R position", "too small", 7.5, 13, {"r": [0.05] * 3 + [0.2] * 3}),
    "R velocity × 10": Case("R velocity", "too large", 7.5, 13, {"r": [0.5] * 3 + [2.0] * 3}),
    "R velocity ÷ 10": Case("R velocity", "too small", 7.5, 13, {"r": [0.5] * 3 + [0.02] * 3}),
    "Q × 10": Case("Q", "too large", 8, 12.5, {"q_scale": 10}),
    "Q ÷ 10": Case("Q", "too small", 8, 12.5, {"q_scale": 0.1}),
    # One run has one start, of 15 states: χ² over its degrees of freedom is 0.27 to 2.4 in 98 % of all runs.
    "P0 × 10": Case("P0", "too large", 4, 40, {"p0_scale": 10}),
    "P0 ÷ 10": Case("P0", "too small", 2.5, 25, {"p0_scale": 0.1}),
    "correlation": Case("GPS correlation", "not modelled", 1, 6, displace=correlated),
    "latency": Case("GPS latency", "not modelled", LATENCY - 0.02, LATENCY + 0.02, displace=late),
    "lever arm": Case("GPS lever arm", "not modelled", 1.5, 2.5, displace=on_an_arm),
    "outliers": Case("GPS outliers", "not modelled", 0.035, 0.055, displace=outlying),
}
MATCHED = Case("", "", 0, 0)


def navigated(mission: str, seed: int, case: Case) -> Result:
    """Run the experiment with a mismatch."""
    experiment = Experiment(mission=mission, seed=seed)
    experiment.set("trajectory.imu_rate", RATE)
    for name, value in case.settings.items():
        experiment.set(f"navigator.{name}", value)
    result = experiment.run()
    if case.displace is None:
        return result
    fixes, truth = result.fixes, result.truth_arrays
    samples = np.round(fixes.time / result.ideal.dt).astype(int)
    metres, velocity = case.displace(result, samples, seed)
    meridian, transverse = earth.radii(np.sin(fixes.position[:, 0]))
    position = fixes.position.copy()
    position[:, 0] += metres[:, 0] / (meridian + position[:, 2])
    position[:, 1] += metres[:, 1] / (transverse + position[:, 2]) / np.cos(position[:, 0])
    position[:, 2] -= metres[:, 2]
    moved = fixes._replace(position=position, velocity_n=fixes.velocity_n + velocity)
    begin = start(truth, experiment.navigator, seed)
    return replace(result, fixes=moved, solution_arrays=renavigated(result, moved, begin))


def renavigated(result: Result, fixes: object, begin: object) -> Solution:
    """Navigate a run again with other fixes."""
    imu = Imu(result.time, result.gyro.increments, result.accelerometer.increments)
    given = Fixes(fixes.time, fixes.position, fixes.velocity_n)
    return navigate(imu, given, begin, result.belief, EVERY_FIX)


def runs(mission: str, case: Case, seeds: int) -> list[Evidence]:
    """Return the evidence of runs with a mismatch."""
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda seed: navigated(mission, seed, case).evidence, range(1, seeds + 1)))
    CACHE.clear()
    return found


@pytest.fixture(
    scope="module", params=[(m, c) for m in MISSIONS for c in CASES], ids=lambda p: f"{p[0]}, {p[1]}"
)
def mismatched(request: pytest.FixtureRequest) -> tuple[str, Case, list[Evidence]]:
    """Return a mismatch and the evidence of `SEEDS` runs with it."""
    mission, name = request.param
    return name, CASES[name], runs(mission, CASES[name], SEEDS)


@pytest.fixture(scope="module", params=MISSIONS)
def matched(request: pytest.FixtureRequest) -> tuple[str, list[Evidence]]:
    """Return the evidence of many runs of a matched filter."""
    return request.param, runs(request.param, MATCHED, MATCHED_SEEDS)


@pytest.mark.proof
def test_each_single_run_names_its_mismatch_and_nothing_else(mismatched):
    name, case, found = mismatched
    for one in found:
        verdict = judge(one)
        assert [(f.quantity, f.direction) for f in verdict.findings] == [(case.quantity, case.direction)]
        (finding,) = verdict.findings
        assert case.low < finding.factor < case.high
        assert verdict.headline == finding.sentence
        assert finding.advice
        assert finding.evidence
    print(f"\n{name}: {judge(found[0]).headline}")


def test_many_runs_together_name_it_too_and_better(mismatched):
    _, case, found = mismatched
    verdict = judge(reduce(operator.add, found))
    assert [(f.quantity, f.direction) for f in verdict.findings] == [(case.quantity, case.direction)]
    if case.displace is None:
        # 150 degrees of freedom at the least: 8 % per σ.
        assert verdict.findings[0].factor == pytest.approx(10, rel=0.4)
    assert f"{SEEDS} runs" in verdict.basis


@pytest.mark.proof
def test_a_matched_filter_is_consistent(matched):
    """At most one false alarm in 100 runs, by errors and by innovations alone, and none over all together."""
    mission, found = matched
    alarms = [
        sum(not judge(one).consistent for one in group)
        for group in (found, [one.without_truth() for one in found])
    ]
    print(f"\n{mission}, {MATCHED_SEEDS} matched runs: {alarms[0]} false alarms; {alarms[1]} by innovations")
    assert max(alarms) <= MATCHED_SEEDS // 50
    together = reduce(operator.add, found)
    assert judge(together).headline.startswith("Consistent")
    assert judge(together.without_truth()).consistent


SEEN = {
    "R position × 10": ("R position", 0.95),
    "R position ÷ 10": ("R position", 0.95),
    "R velocity × 10": ("R velocity", 0.95),
    "R velocity ÷ 10": ("R velocity", 0.95),
    "correlation": ("GPS correlation", 0.5),
    "latency": ("GPS latency", 0.5),
    "outliers": ("GPS outliers", 0.95),
}
"""What innovations alone can name in one run, and in which part of the runs at the least."""


@pytest.mark.proof
def test_what_innovations_alone_tell(mismatched):
    """Too large Q and P0 hardly show there, too small ones as low gain; a lever arm not always."""
    name, _, found = mismatched
    verdicts = [judge(one.without_truth()) for one in found]
    named = [verdict.findings[0].quantity if verdict.findings else "" for verdict in verdicts]
    together = judge(reduce(operator.add, found).without_truth())
    print(f"\n{name}: {dict(Counter(named))}; all: {together.headline}")
    if name in SEEN:
        quantity, part = SEEN[name]
        assert np.mean([one == quantity for one in named]) >= part
        assert together.findings[0].quantity == quantity
    elif "÷" in name:
        assert together.findings[0].quantity == "gain"
    elif name == "lever arm":
        assert together.findings[0].quantity == "GPS lever arm"
        assert together.findings[0].factor == pytest.approx(2, abs=1)
    else:
        # Where they show, the gain is too large, or S is larger than the innovations.
        seen = [(one.quantity, one.direction) for one in together.findings]
        assert seen in ([], [("gain", "too large")], [("NIS", "too small")])
        assert all("Q" in one.sentence for one in together.findings)
    assert "innovations only" in together.basis


# The statistics behind it


def test_the_response_of_the_innovations_is_that_of_the_filter_itself():
    """Navigate with fixes that are all late, or off by a lever arm, by a little, and take the difference."""
    result = Experiment(mission="montreal", seed=2).run()
    solution = result.solution_arrays
    imu = Imu(result.time, result.gyro.increments, result.accelerometer.increments)
    seen, samples = offered(solution, result.fixes, imu)
    motion = fix_causes.motion_at_fixes(solution, samples, imu)
    causes = fix_causes.error_per_cause(motion)
    gains = fix_causes.gains(solution, seen)
    response = fix_causes.response(gains, solution, result.belief, seen, samples, imu.time, motion, causes)
    begin = start(result.truth_arrays, result.experiment.navigator, 2)
    meridian, transverse = earth.radii(np.sin(result.fixes.position[:, 0]))
    for cause, size in ((0, 0.01), (1, 0.1), (3, 0.1)):
        off = size * causes[..., cause]
        position = result.fixes.position.copy()
        position[:, 0] += off[:, 0] / (meridian + position[:, 2])
        position[:, 1] += off[:, 1] / (transverse + position[:, 2]) / np.cos(position[:, 0])
        position[:, 2] -= off[:, 2]
        moved = result.fixes._replace(position=position, velocity_n=result.fixes.velocity_n + off[:, 3:])
        change = (renavigated(result, moved, begin).innovation - solution.innovation) / size
        left = np.sqrt(np.mean((change - response[..., cause]) ** 2))
        assert left < 0.1 * np.sqrt(np.mean(change**2))


def test_coloured_likelihoods_are_those_of_scipy():
    """For every correlation time and variance ratio, values and causes made white against a plain normal."""
    rng = np.random.default_rng(4)
    # With a gap of three minutes, after which hardly anything is left of the correlated part.
    times = np.cumsum(np.append(rng.uniform(0.5, 2, 39), 180.0))
    values, causes = rng.normal(0, 1, (40, 3)), rng.normal(0, 1, (40, 3, 4))
    fit, log_determinant = module.coloured(times, causes, values)
    x = rng.normal(0, 1, 4)
    for at in np.ndindex(len(TIMES), len(RATIOS)):
        V = np.eye(40) + RATIOS[at[1]] * np.exp(-np.abs(times[:, None] - times) / TIMES[at[0]])
        rest = values - causes @ x
        expected = sum(stats.multivariate_normal(np.zeros(40), V).logpdf(column) for column in rest.T)
        square = fit.squares[at] - 2 * fit.vector[at] @ x + x @ fit.matrix[at] @ x
        found = -0.5 * (square + log_determinant[at] + 120 * np.log(2 * np.pi))
        assert found == pytest.approx(expected, rel=1e-9)


@pytest.fixture(scope="module")
def one() -> Evidence:
    """Return the evidence of one matched run."""
    return Experiment(mission="montreal", seed=1).run().evidence


@pytest.mark.parametrize(
    ("mean", "direction", "words"), [(4.0, "too large", "2 times"), (0.25, "too small", "0.5 times")]
)
def test_what_no_cause_explains_is_still_said(one, mean, direction, words):
    wrong = replace(one.states, means=Kept(mean * np.ones_like(one.states.means.values)))
    finding = judge(replace(one, states=wrong)).findings[0]
    assert (finding.quantity, finding.direction) == ("NEES", direction)
    assert finding.factor == pytest.approx(4)
    assert words in finding.sentence


def test_the_weightiest_finding_comes_first_and_the_others_are_counted():
    experiment = Experiment(seed=1)
    experiment.set("navigator.r", [0.05] * 3 + [0.2] * 3)
    experiment.set("navigator.p0_scale", 0.1)
    verdict = experiment.run().verdict
    assert [finding.quantity for finding in verdict.findings] == ["R position", "P0"]
    assert verdict.headline.endswith("too small. (1 more)")
    assert not verdict.consistent
    assert str(verdict) == verdict.headline


def test_outliers_neither_hide_a_wrong_r_nor_survive_the_gate_that_is_advised():
    experiment = Experiment(seed=1)
    experiment.set("sensors.gps.outlier_rate", 0.05)
    plain = experiment.run().verdict
    assert [finding.quantity for finding in plain.findings] == ["GPS outliers"]
    assert "of 205 fixes" in plain.headline
    assert "navigator.gate to 0.999" in plain.findings[0].advice
    gated = experiment.copy()
    gated.set("navigator.gate", 0.999)
    for verdict in (gated.run().verdict, gated.run().innovation_verdict):
        # The gate did without them; a verdict of more than 2 % of unused fixes says so.
        assert [(f.quantity, f.direction) for f in verdict.findings] == [("GPS outliers", "rejected")]
    experiment.set("navigator.r", [0.05] * 3 + [0.2] * 3)
    both = {finding.quantity: finding for finding in experiment.run().verdict.findings}
    assert set(both) == {"GPS outliers", "R position"}
    assert both["R position"].factor == pytest.approx(10, rel=0.4)


def test_a_bad_constellation_makes_r_too_small_and_no_outliers():
    experiment = Experiment(seed=1)
    experiment.set("sensors.gps.quality_steps", [[30, 60]])
    result = experiment.run()
    for verdict in (result.verdict, result.innovation_verdict):
        assert verdict.findings
        assert all(finding.quantity.startswith("R ") for finding in verdict.findings)


@pytest.mark.parametrize("rate", [0.01, 0.05, 0.1])
def test_outliers_are_found_among_gaussian_errors_of_any_size_and_drift(rate):
    """Known jumps on white noise of three sizes with a slow drift; all are found, nothing else is."""
    rng = np.random.default_rng(6)
    for size in (0.3, 1.0, 4.0):
        errors = size * rng.normal(0, 1, (2000, 6)) + 5 * np.sin(np.arange(2000) / 100)[:, None]
        chosen = rng.random(2000) < rate
        errors[chosen, 0] += 20 * max(size, 1.0) * rng.choice((-1, 1), chosen.sum())
        found = outliers(errors)
        assert not (found & ~chosen).any()
        assert (found & chosen).sum() > 0.97 * chosen.sum()


@pytest.mark.parametrize("duration", [3.0, 6.0, 9.0])
def test_a_matched_filter_is_not_accused_on_a_flight_of_seconds(tmp_path, duration):
    """There are then hardly more windows than causes, which together explain any errors."""
    with gzip.open(Path(__file__).parents[2] / "missions/montreal.csv.gz", "rt") as whole:
        heading, *rows = whole.read().splitlines()
    flight = tmp_path / "cut.csv"
    cut = [row for row in rows if 100 <= float(row.split(",")[0]) <= 100 + duration]
    flight.write_text("\n".join((heading, *cut)))
    experiment = Experiment(mission=str(flight))
    experiment.trajectory.imu_rate = RATE
    accused = []
    for experiment.seed in range(15):
        verdict = experiment.run().verdict
        accused += [] if verdict.consistent else [verdict.headline]
    assert len(accused) <= stats.binom.ppf(0.999, 15, 0.03), accused


@pytest.mark.parametrize("outages", [[[0, 1e6]], [[1.5, 1e6]], [[2.5, 1e6]]], ids=["none", "one", "two"])
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_flights_with_hardly_a_fix_are_judged_by_what_there_is(outages):
    experiment = Experiment(mission="los_angeles", seed=1)
    experiment.set("sensors.gps.outages", outages)
    result = experiment.run()
    expected = None if outages[0][0] == 0 else True
    for verdict in (result.verdict, result.innovation_verdict):
        assert verdict.consistent is expected
        assert ("no fix" in verdict.headline) == (expected is None)


def test_states_without_an_error_are_not_accused():
    """The σ of scale factors that no sensor has: the mean square of their errors is zero."""
    experiment = Experiment(mission="los_angeles", seed=1)
    experiment.navigator.states = 21
    experiment.navigator.p0 = [*[1.0] * 3, *[0.09] * 3, *[1e-4] * 3, *[3e-6] * 3, *[4e-4] * 3, *[1e-8] * 6]
    verdict = experiment.run().tried_verdict
    assert not any("scale" in one.quantity for one in verdict.findings)


def test_a_scale_factor_that_is_no_state_is_named():
    experiment = Experiment(seed=1)
    experiment.set("sensors.gyro.scale_factor", 5)
    finding = experiment.run().verdict.findings[0]
    assert (finding.quantity, finding.direction) == ("gyro scale factor", "not modelled")
    assert finding.factor == pytest.approx(0.05, rel=0.1)
    assert "navigator.states" in finding.advice


def test_evidence_of_a_run_is_the_same_from_plain_arrays():
    result = Experiment(seed=1).run()
    found = evidence(
        result.solution_arrays,
        result.belief,
        Fixes(result.fixes.time, result.fixes.position, result.fixes.velocity_n),
        Imu(result.time, result.gyro.increments, result.accelerometer.increments),
        Reference(result.truth_arrays, result.true_bias, result.ideal.dtheta, result.ideal.dvelocity),
    )
    assert judge(found) == result.verdict


def test_numbers_of_a_diverged_filter_are_written_as_people_write_them():
    experiment = Experiment(mission="los_angeles")
    experiment.trajectory.imu_rate = RATE
    experiment.navigator.q_scale, experiment.navigator.r_scale = 1e-4, 1e-2
    verdict = experiment.run().verdict
    assert not verdict.consistent
    texts = [" ".join((one.sentence, one.advice, one.evidence)) for one in verdict.findings]
    assert any(re.search(r"by \d{4,}\.", text) for text in texts)  # the numbers are that large
    assert not any(re.search(r"\de[+-]\d", text) for text in texts), texts


@pytest.mark.parametrize(("size", "first"), [(0.2, "R"), (0.02, "GPS correlation")])
def test_an_r_too_large_by_decades_is_not_preferred_to_correlated_fixes(size: float, first: str) -> None:
    """Few fixes with correlated errors have small innovations; a smaller R would follow these errors."""
    explained = [Explanation("GPS correlation", "GPS", 100.0, 1.0), Explanation("R", "GPS", 97.0, size)]
    assert _order_explanations(explained)[0].name == first
