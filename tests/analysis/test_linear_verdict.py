"""Linear verdict: attitude errors beyond the linear model are named as the cause, or before they are one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.analysis.fix_causes import MotionAtFixes
from lab.analysis.verdicts.evidence import Linearity, linearity
from lab.analysis.verdicts.finding import Finding, Verdict
from lab.analysis.verdicts.finding_table import LINEAR_MODEL
from lab.analysis.verdicts.linear_verdict import judge
from lab.analysis.verdicts.run_means import NEES
from lab.analysis.verdicts.sums import Kept
from lab.analysis.verdicts.trial import apply_changes
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.navigation.belief import belief
from lab.navigation.solution import Solution
from tests.benchmarks.consistency_matrix import MATCHED, setting

GRAVITY = 9.81


def started(heading: float, model: str, seed: int) -> Result:
    """Return a run whose heading is uncertain at the start [°]."""
    experiment = Experiment(mission="los_angeles", seed=seed)
    experiment.update({"trajectory.imu_rate": 20.0, "navigator.model": model})
    experiment.set("navigator.attitude_sigma", [0.5, 0.5, heading])
    return experiment.run()


@pytest.mark.parametrize("seed", range(1001, 1005))
def test_a_start_that_is_too_uncertain_for_the_model_is_never_consistent(seed: int) -> None:
    wide = started(60.0, "phi", seed)
    for verdict in (wide.verdict, wide.innovation_verdict):
        (finding,) = verdict.findings
        assert finding.quantity == LINEAR_MODEL
        assert finding.factor == pytest.approx(np.radians(60.0))
        settings = apply_changes(wide, finding.changes)
        assert settings.navigator.model == "invariant"
    (remark,) = wide.remarks
    assert "invariant or nonlinear" in remark
    cured = wide.repeated(settings)
    assert cured.verdict.consistent
    assert not cured.remarks


def test_up_to_the_limit_the_errors_decide() -> None:
    found = started(20.0, "phi", 1001)
    assert found.verdict.consistent
    assert not found.remarks


def test_causes_with_a_sample_of_their_own_keep_their_names_from_such_a_start() -> None:
    experiment = Experiment(mission="los_angeles", seed=1001)
    experiment.update({"trajectory.imu_rate": 20.0, "navigator.q_scale": 0.1})
    experiment.set("navigator.attitude_sigma", [0.5, 0.5, 60.0])
    many = run_ensemble(experiment, 3)
    assert [finding.quantity for finding in many.verdict.findings] == ["Q", LINEAR_MODEL]
    assert [finding.quantity for finding in many.innovation_verdict.findings] == [LINEAR_MODEL]
    assert "invariant or nonlinear" in many.remark


def test_a_p0_that_is_too_large_is_named_alone() -> None:
    """The heading is known to 2°, as the sample of the start shows; the filter was told 60°."""
    experiment = Experiment(mission="los_angeles", seed=1001).update({"trajectory.imu_rate": 20.0})
    P0 = np.diag(belief(experiment.sensors, experiment.navigator).P0).copy()
    P0[6:9] *= 900.0
    many = run_ensemble(experiment.update({"navigator.p0": P0.tolist()}), 3)
    assert [finding.quantity for finding in many.verdict.findings] == ["P0 attitude"]


def test_the_neglected_acceleration_is_the_mean_of_the_exact_one() -> None:
    """Of a million rotations, in a turn of a vehicle that heads south; the biases have a σ of 0.02 m/s²."""
    sigma, bias, force = np.array((0.02, 0.03, 0.2)), 0.02, np.array((3.0, 8.0, -GRAVITY))
    phi = np.random.default_rng(1).normal(size=(500_000, 3)) * sigma
    phi = np.concatenate((phi, -phi))
    felt = Rotation.from_rotvec(-phi).apply(force) - force + np.cross(phi, force)
    solution = Solution.empty(9, 2)
    solution.fix_sample[:] = 3, -1
    solution.fix_covariance[:] = np.diag((*(1.0,) * 6, *sigma**2, *(1.0,) * 3, *(bias**2,) * 3))
    south = np.tile(Rotation.from_euler("z", np.pi).as_matrix(), (2, 1, 1))
    zero = np.zeros((2, 3))
    motion = MotionAtFixes(zero, zero, zero, np.tile(force, (2, 1)), south)
    experiment = Experiment()
    found = linearity(solution, belief(experiment.sensors, experiment.navigator), motion, np.arange(2))
    assert found.neglected.values[0] == pytest.approx(np.sum(felt.mean(axis=0) ** 2) / bias**2, rel=0.05)
    assert found.start.values[0] == pytest.approx(np.radians(2.0))
    assert found.largest.values[0] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("model", "largest", "neglected", "quantity", "named"),
    [
        ("phi", 2.0, 2.0, NEES, "invariant"),
        ("invariant", 2.0, 2.0, NEES, "nonlinear"),
        ("nonlinear", 60.0, 2.0, NEES, ""),
        ("phi", 2.0, 0.1, NEES, ""),
        ("phi", 2.0, 2.0, "R position", ""),
        ("psi", 43.0, 0.1, NEES, "invariant"),
        ("invariant", 43.0, 0.1, NEES, ""),
    ],
)
def test_errors_without_another_cause_have_this_one_where_attitude_errors_are_large(
    model: str, largest: float, neglected: float, quantity: str, named: str
) -> None:
    experiment = Experiment(mission="los_angeles")
    evidence = experiment.update({"trajectory.imu_rate": 20.0}).run().evidence
    start, most = np.radians((2.0, largest))
    found = Linearity(*(Kept(np.array([value])) for value in (start, most, neglected)))
    object.__setattr__(evidence, "linearity", found)
    experiment.set("navigator.model", model)
    finding = Finding(quantity, "too large", 1.2, "The errors are 1.1 × as large. No.", "Look.", "seen")
    (judged,) = judge(Verdict("", (finding,), "30 runs"), evidence, experiment.navigator).findings
    assert judged.quantity == (LINEAR_MODEL if named else quantity)
    assert [change.value for change in judged.changes] == ([named] if named else [])


@pytest.mark.parametrize(
    ("model", "means", "direction", "named"),
    [
        ("phi", {"invariant": (3.3, 1.5)}, "too large", "invariant"),
        ("psi", {"invariant": (3.3, 3.1), "nonlinear": (3.3, 1.1)}, "too large", "nonlinear"),
        ("invariant", {"nonlinear": (2.0, 1.2)}, "too large", "nonlinear"),
        ("phi", {"invariant": (1.6, 1.5), "nonlinear": (1.6, 1.55)}, "too large", ""),
        ("phi", {}, "too large", ""),
        ("phi", {"invariant": (0.7, 0.6)}, "too small", ""),
        ("nonlinear", {"nonlinear": (3.0, 1.0)}, "too large", ""),
    ],
)
def test_a_model_with_which_the_errors_have_the_size_of_sigma_is_named(
    model: str, means: dict[str, tuple[float, float]], direction: str, named: str
) -> None:
    experiment = Experiment(mission="los_angeles").update({"trajectory.imu_rate": 20.0})
    evidence = experiment.run().evidence
    experiment.set("navigator.model", model)
    finding = Finding(NEES, direction, 1.2, "The errors are 1.1 × as large. No.", "Look.", "seen")
    before = Verdict("", (finding,), "30 runs")
    found = judge(before, evidence, experiment.navigator, repeated=means.get)
    (judged,) = found.findings
    assert judged.quantity == (LINEAR_MODEL if named else NEES)
    assert [change.value for change in judged.changes] == ([named] if named else [])
    assert found.consistent is False
    assert judge(before, evidence.without_truth(), experiment.navigator, repeated=means.get) == before


@pytest.mark.proof
def test_many_runs_beyond_the_linear_model_name_one_that_holds() -> None:
    """A matched filter of poor accelerometers: with phi, some of 300 runs are far off."""
    kind, _, experiment = setting(60)
    assert kind == MATCHED
    (finding,) = run_ensemble(experiment, range(500_001, 500_301)).verdict.findings
    assert finding.quantity == LINEAR_MODEL
    assert "invariant" in finding.advice


def with_r(mission: str, heading: float, factor: float, seed: int) -> Result:
    """Return a run whose filter assumes R of the position to be too small by a factor."""
    experiment = Experiment(mission=mission, seed=seed).update({"trajectory.imu_rate": 20.0})
    R = np.diag(belief(experiment.sensors, experiment.navigator).R) / np.repeat((factor, 1.0), 3)
    experiment.set("navigator.r", R.tolist())
    experiment.set("navigator.attitude_sigma", [0.5, 0.5, heading])
    return experiment.run()


@pytest.mark.parametrize("factor", [4.6, 10.0])
@pytest.mark.parametrize("heading", [21.0, 40.0])
@pytest.mark.parametrize(
    ("mission", "seed"), [("montreal", 1001), ("los_angeles", 1001), ("los_angeles", 1002)]
)
def test_a_start_does_not_hide_an_r_that_is_wrong_with_a_model_that_holds_too(
    mission: str, seed: int, heading: float, factor: float
) -> None:
    wide = with_r(mission, heading, factor, seed)
    (finding,) = wide.innovation_verdict.findings
    assert (finding.quantity, finding.direction) == ("R position", "too small")
    assert finding.factor == pytest.approx(factor, rel=0.1)
    assert any("invariant or nonlinear" in remark for remark in wide.remarks)


@pytest.mark.parametrize("heading", [21.0, 40.0, 60.0, 90.0])
@pytest.mark.parametrize("seed", [1001, 1002, 1003])
def test_a_wide_start_accuses_no_r_that_is_right(seed: int, heading: float) -> None:
    (finding,) = with_r("montreal", heading, 1.0, seed).innovation_verdict.findings
    assert finding.quantity == LINEAR_MODEL


def test_a_start_that_has_an_effect_is_named_beside_the_wrong_r() -> None:
    """The innovations of this flight are less correlated, or smaller, with a model that holds at 40°."""
    named = {
        finding.quantity for finding in with_r("los_angeles", 40.0, 4.6, 2005).innovation_verdict.findings
    }
    assert named == {"R position", LINEAR_MODEL}


@pytest.mark.parametrize(("heading", "seed"), [(45.0, 2013), (90.0, 1001)])
def test_no_run_tells_other_causes_where_no_model_holds(heading: float, seed: int) -> None:
    """The fixes of these flights look correlated with the invariant model; R is wrong."""
    (finding,) = with_r("los_angeles", heading, 4.6, seed).innovation_verdict.findings
    assert finding.quantity == LINEAR_MODEL
