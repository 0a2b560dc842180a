"""Evidence: its sums of squares of hand-made errors, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis.errors import error_state
from lab.analysis.verdicts import hypotheses, imu_causes, innovation_evidence
from lab.analysis.verdicts.evidence import BLOCKS, Reference, state_means, usage
from lab.analysis.verdicts.run_evidence import collect_evidence
from lab.analysis.verdicts.run_means import BETWEEN, NEES, QUARTERS, Figure
from lab.analysis.verdicts.sums import pseudoinverse
from lab.analysis.verdicts.verdict import judge
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.motion.truth.trajectory import Truth
from lab.navigation.belief import belief
from lab.navigation.solution import Solution

STEP = 0.5


def flown(duration: float, fixes: int) -> tuple[Solution, Reference]:
    """Return a solution without errors, of σ 2 in all states, and the truth of a vehicle at rest."""
    n = round(duration / STEP) + 1
    solution = Solution.empty(n, fixes)
    solution.position[:] = 0.7, 0.1, 500.0
    solution.q_nb[:] = 1.0, 0.0, 0.0, 0.0
    solution.variance[:], solution.fix_covariance[:] = 4.0, 4.0 * np.eye(15)
    for rest in (solution.velocity_n, solution.bias, solution.covariance):
        rest[:] = 0.0
    latitude, longitude, height = solution.position.T.copy()
    zero = np.zeros((n, 3))
    truth = Truth(100 + STEP * np.arange(n), latitude, longitude, height, zero, solution.q_nb.copy(), zero)
    return solution, Reference(truth, np.zeros((n, 6)), zero[1:], zero[1:])


@pytest.mark.parametrize(("duration", "epochs"), [(240.0, 3), (150.0, 2.5), (30.0, 1)])
def test_nees_counts_the_fixes_used_once_a_minute(duration: float, epochs: float) -> None:
    """And not more often than there are fixes."""
    solution, reference = flown(duration, 4)
    solution.fix_sample[:] = 7, 9, -1, 20
    solution.velocity_n[7], solution.velocity_n[20] = (2.0, 4.0, 0.0), (0.0, 0.0, 2.0)
    solution.velocity_n[8] = 1e3  # no fix here
    used = np.array([0, 1, 3])
    means = state_means(solution, used, used, reference)
    found = means.together(means.figures.index(Figure(NEES, "velocity")))
    assert found.total == pytest.approx(epochs * (5 + 0 + 1) / 3)
    assert found.number == 3 * epochs
    assert means.together(0).number == 15 * epochs
    assert state_means(solution, used[:0], used, reference).together(0).number == 0


def test_between_fixes_the_position_is_judged_each_second_and_just_before_each_fix() -> None:
    solution, reference = flown(240.0, 0)
    fixes = np.array([0, 2, 32, 64])  # after 0, 1, 16 and 32 s
    solution.covariance[:, 0] = 0.0, 2.0, 0.0  # of north and down
    # 6 m too deep half a second before the fixes, far off where nobody looks.
    solution.position[1::2, 2] += 1e3
    solution.position[[1, 31, 63], 2] = 494.0
    unused = np.array([], dtype=np.int64)
    found = state_means(solution, unused, fixes, reference)
    at = found.figures.index(Figure(BETWEEN))
    # The inverse of [[4, 2], [2, 4]] has 1/3 on its diagonal; 239 whole seconds, and three samples beside.
    assert found.together(at).mean == pytest.approx(36 / 3 / 3 * 3 / (239 + 3))
    assert found.together(at).number == 4 * 3
    # All three are in the first quarter, with 59 whole seconds.
    quarters = found.means.values[0, at + 1 : at + 5]
    assert quarters * [59 + 3, 60, 60, 60] == pytest.approx([36 / 3 / 3 * 3, 0, 0, 0])
    assert np.isnan(found.means.values[0, found.figures.index(Figure(NEES))])
    still, short = flown(0.5, 0)
    assert not np.isfinite(state_means(still, unused, fixes[:0], short).means.values).any()


def test_groups_of_states_and_quarters_have_their_own_mean_nees() -> None:
    """A σ of 2 in all states; errors of the velocity in one quarter, of an accelerometer bias in another."""
    solution, reference = flown(240.0, 8)
    solution.fix_sample[:] = 40, 80, 160, 200, 280, 320, 400, 470  # two in each quarter of 120 samples
    solution.velocity_n[80] = 2.0, 4.0, 0.0
    solution.bias[400, 5] = 6.0
    found = state_means(solution, np.arange(8), np.zeros(0, dtype=np.int64), reference)
    means = dict(zip(found.figures, found.means.values[0], strict=True))
    assert means[Figure(NEES)] == pytest.approx((5 + 9) / 15 / 8)
    assert [means[Figure(NEES, "", name)] for name in QUARTERS] == pytest.approx(
        [5 / 15 / 2, 0, 0, 9 / 15 / 2]
    )
    assert means[Figure(NEES, "velocity")] == pytest.approx(5 / 3 / 8)
    assert means[Figure(NEES, "accelerometer bias")] == pytest.approx(9 / 3 / 8)
    assert means[Figure(NEES, "position")] == 0
    assert np.isnan([means[Figure(NEES, name)] for name in ("gyro scale", "further states")]).all()
    number = dict(zip(found.figures, found.independent.values[0], strict=True))
    assert number[Figure(NEES)] == 15 * 4
    assert number[Figure(NEES, "", "last")] == 15
    assert number[Figure(NEES, "velocity")] == 3 * 4
    assert number[Figure(NEES, "gyro bias")] == 3


def test_usage_counts_what_the_gate_should_reject() -> None:
    solution, _ = flown(10.0, 5)
    solution.fix_sample[:] = 3, -1, 5, -1, -1
    solution.fix_rejected[[1, 3]] = True
    found = usage(solution, 0.9)
    assert (found.offered, found.used, found.rejected) == (4, 2, 2)
    assert found.expected == pytest.approx(0.4)
    assert usage(solution, 0.0).expected == 0


def test_the_start_is_judged_by_p0_in_whole_and_by_blocks() -> None:
    experiment = Experiment(mission="montreal", seed=3)
    result = experiment.run()
    first = np.zeros(1, dtype=np.int64)
    x = error_state(result.solution_arrays, first, result.known_truth("errors"), result.true_bias)[0]
    P0 = belief(experiment.sensors, experiment.navigator).P0
    found = result.evidence.start
    assert result.evidence.runs == 1
    for at, block in enumerate((slice(None), *BLOCKS.values())):
        expected = x[block] @ np.linalg.solve(P0[block, block], x[block])
        assert found.total[at] == pytest.approx(expected, rel=1e-9)
        assert found.number[at] == x[block].size


def test_a_record_that_is_computed_in_parts_says_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    experiment = Experiment(mission="los_angeles")
    experiment.update({"trajectory.imu_rate": 50, "navigator.r_scale": 0.1})
    result = experiment.run()
    whole = collect_evidence(result, result.filtered).innovations
    assert whole.likelihoods.any()  # suspicious, so the response to all causes is sought
    solution = result.solution_arrays
    count = int(np.sum((solution.fix_sample >= 0) | solution.fix_rejected))
    monkeypatch.setattr(innovation_evidence, "LONGEST", count)
    monkeypatch.setattr(innovation_evidence, "steps", lambda *_: pytest.fail("all at once"))
    monkeypatch.setattr(imu_causes, "AT_ONCE", 7)
    parts = collect_evidence(result, result.filtered).innovations
    np.testing.assert_allclose(parts.causes.matrix, whole.causes.matrix, rtol=1e-9)
    np.testing.assert_allclose(parts.causes.vector, whole.causes.vector, rtol=1e-9)
    np.testing.assert_allclose(parts.likelihoods, whole.likelihoods, rtol=1e-9)


WILD = {
    "trajectory.imu_rate": 50,
    "navigator.q_scale": 1e6,
    "navigator.p0_scale": 1e6,
    "navigator.r_scale": 1e-6,
    "navigator.attitude_sigma": 170.0,
}
"""Bounds of the settings: P0 is so much larger than R that rounding spoils recomputed covariances."""


@pytest.mark.proof
def test_the_truth_and_the_innovations_judge_a_start_beyond_the_bounds_of_float64() -> None:
    """Which likelihoods rounding takes, depends on the processor; they are -inf, and the rest is judged."""
    for seed in range(1, 5):
        result = Experiment(mission="los_angeles", seed=seed).update(WILD).run()
        assert not np.isnan(result.evidence.innovations.likelihoods).any()
        by_truth = {finding.quantity: finding.direction for finding in result.verdict.findings}
        assert by_truth["R position"] == "too small"
        assert by_truth["Q"] == "too large"


def test_causes_that_rounding_hides_are_withheld(monkeypatch: pytest.MonkeyPatch) -> None:
    def hidden(*_given: object) -> hypotheses.Outcome:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(hypotheses, "likelihoods", hidden)
    result = Experiment(mission="los_angeles", seed=1).update(WILD).run()
    found = result.evidence.innovations
    assert not found.likelihoods.any()
    assert not found.causes.matrix.any()
    # The verdict of the run names such a start before anything else.
    (start,) = result.innovation_verdict.findings
    assert start.quantity == "linear model"
    (finding,) = judge(result.evidence.without_truth()).findings
    assert finding.quantity == "NIS"
    assert "rounding" in finding.sentence


def test_a_run_whose_causes_are_withheld_does_not_stop_an_ensemble() -> None:
    ensemble = run_ensemble(Experiment(mission="los_angeles").update(WILD), (2, 3))
    assert len(ensemble.evidence) == 2
    assert ensemble.verdict.consistent is False
    assert ensemble.innovation_verdict.consistent is False


def of_two_hypotheses(added: float) -> hypotheses.Outcome:
    """Return the likelihoods under Q and ten times Q, of a Q that adds a variance to each of the states."""
    n, fixes = 15, 2
    noise = np.zeros((fixes, 5, n, n))
    noise[:, 0] = added * np.eye(n)
    step = imu_causes.Steps(np.tile(np.eye(n), (fixes, 1, 1)), noise, np.zeros((fixes, n, 0)))
    tried = (hypotheses.HYPOTHESES[0], hypotheses.Hypothesis("Q", 10.0, q=(10.0,) * 4))
    return hypotheses.likelihoods(
        np.ones((fixes, 6)),
        np.zeros((fixes, n)),
        [step],
        np.tile(np.eye(6, n), (fixes, 1, 1)),
        np.tile(np.eye(6), (fixes, 1, 1)),
        np.eye(n),
        np.arange(fixes + 1.0),
        np.zeros(fixes, dtype=np.bool_),
        tried,
    )


def test_a_hypothesis_without_a_covariance_has_no_likelihood() -> None:
    """A negative variance stands for what rounding leaves of a difference of large ones."""
    assert np.isfinite(of_two_hypotheses(0.3).likelihoods).all()
    assert list(of_two_hypotheses(-0.25).likelihoods) == [0.0, -np.inf]
    with pytest.raises(np.linalg.LinAlgError):
        of_two_hypotheses(-3.0)


def test_pseudoinverses_of_symmetric_matrices_are_those_of_numpy():
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(40, 6, 4))
    singular = rows @ np.swapaxes(rows, 1, 2)  # of rank 4
    whole = singular + np.eye(6)
    nothing = np.zeros((1, 6, 6))
    for matrices in (singular, whole, whole - 3 * np.eye(6), nothing):
        ours, numpys = pseudoinverse(matrices, 1e-9), np.linalg.pinv(matrices, rcond=1e-9, hermitian=True)
        np.testing.assert_allclose(ours, numpys, atol=1e-9 * np.abs(numpys).max())
