"""The error models beside each other: agreement, consistency, large heading errors; and the gate."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import combinations

import numpy as np
import pytest
from apart import apart
from scipy.stats import chi2

from lab.analysis.consistency import chi_square_interval
from lab.analysis.errors import position_error
from lab.base.arrays import FloatArray
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE, start
from lab.motion.frames.rotation import wrap
from lab.motion.truth.trajectory import Truth
from lab.navigation.filters.error_models import MODELS
from lab.navigation.filters.kalman import gate
from lab.navigation.navigator import Fixes, Imu, Schedule, navigate
from lab.sensors.cards import card

SEEDS = 100
RATE = 50.0
"""IMU rate over many seeds [Hz]: their statistics are taken at the fixes, which are as many at any rate."""


def run(model: str, seed: int = 1, rate: float | None = None, **settings: object) -> Result:
    """Run the experiment on montreal with a model, another IMU rate [Hz], and settings of the navigator."""
    experiment = Experiment(mission="montreal", seed=seed)
    if rate is not None:
        experiment.set("trajectory.imu_rate", rate)
    experiment.set("navigator.model", model)
    for name, value in settings.items():
        experiment.set(f"navigator.{name}", value)
    return experiment.run()


@pytest.mark.proof
@pytest.mark.parametrize("model", ["psi", "invariant", "nonlinear"])
def test_a_matched_filter_tells_the_truth_about_itself(model: str) -> None:
    def one(seed: int) -> tuple[FloatArray, FloatArray]:
        result = run(model, seed, RATE)
        late = result.fixes.time > 20
        return result.consistency.nees.values[late], result.innovations.nis.values[late]

    with ThreadPoolExecutor(2) as pool:
        nees, nis = (np.array(x) for x in zip(*pool.map(one, range(1, SEEDS + 1)), strict=True))
    CACHE.clear()
    parts = []
    for values, degrees in ((nees, 15), (nis, 6)):
        low, high = chi_square_interval(degrees, SEEDS)
        mean = values.mean(axis=0)
        parts.append(float(np.mean((low < mean) & (mean < high))))
    print(
        f"\n{model}, {SEEDS} seeds: NEES {nees.mean():.2f}, inside at {100 * parts[0]:.1f} %; "
        f"NIS {nis.mean():.2f}, inside at {100 * parts[1]:.1f} % of epochs"
    )
    assert min(parts) >= 0.9


@pytest.mark.parametrize("seed", range(1, 6))
def test_psi_agrees_with_phi(seed: int) -> None:
    """The same linear theory in other coordinates: what is left is of the length of the step."""
    phi, psi = run("phi", seed), run("psi", seed)
    worst = apart(phi, psi).max()
    print(f"\nseed {seed}: phi − psi {worst:.1e} σ at most")
    assert 0 < worst <= 1e-3
    np.testing.assert_allclose(psi.solution_arrays.variance, phi.solution_arrays.variance, rtol=1e-3)
    # Attitude and velocity errors are truly other ones: mapped, not copied.
    assert (psi.solution_arrays.variance[4000:] != phi.solution_arrays.variance[4000:]).any()


GOOD_SENSORS: dict[str, float] = {
    "sensors.gyro.noise_density": 0.001,
    "sensors.gyro.bias_sigma": 0.001,
    "sensors.accelerometer.noise_density": 35.0,
    "sensors.accelerometer.bias_sigma": 0.02,
    "navigator.attitude_sigma": 0.01,
    "navigator.position_sigma": 0.1,
    "navigator.velocity_sigma": 0.01,
}


def invariant_minus_phi(seed: int, scale: float) -> float:
    """Return the largest difference in σ, with the errors of good sensors scaled."""
    results = []
    for model in ("phi", "invariant"):
        experiment = Experiment(mission="montreal", seed=seed)
        experiment.set("navigator.model", model)
        for name, value in GOOD_SENSORS.items():
            experiment.set(name, value * scale)
        results.append(experiment.run())
    return float(apart(*results).max())


@pytest.mark.parametrize("seed", range(1, 4))
def test_invariant_agrees_with_phi_while_errors_are_small(seed: int) -> None:
    """What parts them is of second order in the errors, so in units of σ it shrinks with the errors."""
    figures = {scale: invariant_minus_phi(seed, scale) for scale in (10.0, 1.0, 0.1)}
    words = [f"{scale:g} × good: {worst:.4f}" for scale, worst in figures.items()]
    print(f"\nseed {seed}, invariant − phi, largest, in σ: {', '.join(words)}")
    assert figures[10.0] <= 0.1
    assert figures[1.0] < 0.5 * figures[10.0]
    assert figures[0.1] < 0.5 * figures[1.0]


@pytest.mark.proof
@pytest.mark.parametrize("name", ["HG1700", "STIM300"])
def test_all_types_agree_with_a_good_sensor(name: str) -> None:
    """With a gyro fit to align with, all four are one filter; with the default one each errs its own way."""
    worst = 0.0
    for seed in range(1, 4):
        results = []
        for model in ("phi", "psi", "invariant", "nonlinear"):
            experiment = Experiment(mission="montreal", seed=seed)
            experiment.update({"sensors": card(name).settings()})
            experiment.update({"navigator": {"model": model, "attitude_sigma": 0.3}})
            results.append(experiment.run())
        worst = max(worst, *(float(apart(*pair).max()) for pair in combinations(results, 2)))
    print(f"\n{name}: any two of the four types differ by at most {worst:.3f} σ")
    assert worst <= 0.1


@pytest.mark.parametrize(
    "model", ["phi", *(pytest.param(model, marks=pytest.mark.proof) for model in ("psi", "invariant"))]
)
def test_feedforward_keeps_to_the_fixes_where_the_navigator_runs_off(model: str) -> None:
    """An uncorrected navigator is soon hundreds of metres and 2.5° off: the estimate is not."""
    experiment = Experiment(mission="montreal")
    card("HG9900", assumed=False).load(experiment)
    experiment.update({"navigator": {"model": model, "correction": "feedforward", "alignment": 0.0}})
    result = experiment.run()
    errors = np.abs(result.errors.position.values[4000:])
    print(f"\n{model}: position error at most {errors.max():.2g} m")
    assert np.degrees(result.free_run.drift) > 2
    assert errors.max() < 2.0


def test_corrections_that_wait_too_long_are_named() -> None:
    """The model is linear in what waits: NEES shows 30 s without correction, and the verdict its reason."""
    nees, named = [], []
    for period in (3.0, 30.0):
        results = []
        for seed in (1, 2):
            experiment = Experiment(mission="los_angeles", seed=seed)
            experiment.update({"trajectory.imu_rate": RATE, "navigator.correction_period": period})
            results.append(experiment.run())
        nees.append(np.mean([float(result.consistency["nees"].mean()) / 15 for result in results]))
        told = [[finding.quantity for finding in result.verdict.findings] for result in results]
        named.append((told, ["correction_period" in " ".join(result.remarks) for result in results]))
    print(f"\nNEES per state with a correction each 3 s {nees[0]:.2f}, each 30 s {nees[1]:.0f}")
    assert nees[0] < 2
    assert nees[1] > 10
    assert named == [([[], []], [False] * 2), ([["correction period"]] * 2, [True] * 2)]


def heading_errors(model: str, seed: int) -> tuple[FloatArray, FloatArray, float]:
    """Return time, heading error [°] and mean NEES where the heading starts 60° off, as P₀ says."""
    result = run(model, seed, RATE, attitude_error=[0.0, 0.0, 60.0])
    late = (result.fixes.time > 20) & (result.fixes.time < 60)
    error = wrap(result.euler[:, 2] - result.truth_arrays.euler[:, 2])
    return result.time, np.abs(np.degrees(error)), float(result.consistency.nees.values[late].mean())


@pytest.mark.proof
@pytest.mark.parametrize("model", MODELS)
def test_from_a_heading_60_degrees_off(model: str) -> None:
    """Until take-off, at 6 s, the heading cannot be seen."""
    with ThreadPoolExecutor(2) as pool:
        runs = list(pool.map(lambda seed: heading_errors(model, seed), range(1, SEEDS + 1)))
    CACHE.clear()
    time = runs[0][0]
    error, nees = np.array([run[1] for run in runs]), np.array([run[2] for run in runs])
    assert (np.abs(error[:, 0] - 60) < 10).all()
    converged = (error[:, time >= 60] < 3).all(axis=1)
    figures = [f"{t} s: {np.median(error[:, np.searchsorted(time, t)]):.2f}°" for t in (8, 10, 15, 30, 60)]
    print(
        f"\n{model}: {converged.sum()} of {SEEDS} below 3° from 60 s on; median error at "
        f"{', '.join(figures)}; NEES from 20 to 60 s {nees.mean():.1f} (15 expected)"
    )
    if model == "invariant":
        assert converged.sum() >= 95
        assert nees.mean() < 30


def test_the_given_initial_error_adds_to_the_drawn_one() -> None:
    drawn, given = (
        run("phi", 3, **settings)
        for settings in (
            {},
            {"position_error": [10.0, -20.0, 5.0], "velocity_error": 2.0, "attitude_error": [0.0, 0.0, 60.0]},
        )
    )
    one, other, truth = drawn.solution_arrays, given.solution_arrays, drawn.truth_arrays
    moved = position_error(other.position[:1], _first(truth)) - position_error(
        one.position[:1], _first(truth)
    )
    np.testing.assert_allclose(moved[0], [10, -20, 5], atol=1e-4)
    np.testing.assert_allclose(other.velocity_n[0] - one.velocity_n[0], 2.0, atol=1e-12)
    turned = wrap(given.euler[0, 2] - drawn.euler[0, 2])
    assert np.degrees(turned) == pytest.approx(-60, abs=1), "60° down make the heading 60° too small"
    variance = np.diag(given.belief.P0) - np.diag(drawn.belief.P0)
    expected = [100, 400, 25, 4, 4, 4, 0, 0, np.radians(60) ** 2, *np.zeros(6)]
    np.testing.assert_allclose(variance, expected, rtol=1e-12, atol=1e-15)


def _first(truth: Truth) -> Truth:
    return Truth(**{name: getattr(truth, name)[:1] for name in Truth.__dataclass_fields__})


WILD = [20, 21, 60, 111]
"""Numbers of fixes that are put off."""


@pytest.mark.parametrize("model", MODELS)
def test_the_gate_rejects_what_is_wild_and_little_else(model: str) -> None:
    result = run(model)
    imu = Imu(result.ideal.time, result.gyro.increments, result.accelerometer.increments)
    begin = start(result.truth_arrays, result.experiment.navigator, result.experiment.seed)
    position = result.fixes.position.copy()
    position[WILD, 2] += 30.0
    fixes = Fixes(result.fixes.time, position, result.fixes.velocity_n)
    schedule = Schedule(gate=gate(0.999))
    gated, open_to_all = (
        navigate(imu, fixes, begin, result.belief, s, MODELS[model]) for s in (schedule, Schedule())
    )
    assert set(WILD) <= set(np.flatnonzero(gated.fix_rejected))
    assert gated.fix_rejected.sum() <= len(WILD) + 3
    assert (gated.fix_sample[gated.fix_rejected] == -1).all()
    assert np.isfinite(gated.innovation).all()
    assert not open_to_all.fix_rejected.any()
    nu, S = gated.innovation, gated.innovation_covariance
    nis = np.einsum("mi,mi->m", nu, np.linalg.solve(S, nu[..., None])[..., 0])
    np.testing.assert_array_equal(gated.fix_rejected, nis > chi2.ppf(0.999, 6))
    truth = result.truth_arrays
    worst = [np.abs(position_error(x.position, truth)[2000:, 2]).max() for x in (gated, open_to_all)]
    print(
        f"\n{model}: {gated.fix_rejected.sum()} rejected; height error up to {worst[0]:.1f} m, without gate "
        f"{worst[1]:.1f} m"
    )
    assert worst[0] < 0.5 * worst[1]


@pytest.mark.parametrize("model", MODELS)
def test_the_gate_lets_its_part_of_good_fixes_through(model: str) -> None:
    rejected = [run(model, seed, RATE, gate=0.95).solution_arrays.fix_rejected for seed in range(1, 21)]
    CACHE.clear()
    part = float(np.mean(rejected))
    print(f"\n{model}: {100 * part:.1f} % of {np.size(rejected)} good fixes rejected, 5 % expected")
    # Four standard deviations of a mean of 4000 fixes, and what rejecting itself changes.
    assert part == pytest.approx(0.05, abs=0.014)


def test_rejected_fixes_are_told() -> None:
    result = run("phi", gate=0.9)
    count = int(result.solution_arrays.fix_rejected.sum())
    assert count > 5
    assert result.innovations.rejected.values.sum() == count
    assert any(f"rejected {count} of {result.fixes.time.size} GPS fixes" in text for text in result.remarks)
    np.testing.assert_array_equal(np.isnan(result.innovations.nis), result.solution_arrays.fix_rejected)
    assert not run("phi").innovations.rejected.values.any()
