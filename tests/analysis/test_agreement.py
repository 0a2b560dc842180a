"""Agreement: runs of a matched filter agree as often as the limits say, and small mismatches show."""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.agreement import FigureWording, agreements, judge_agreement
from lab.analysis.verdicts.finding_table import FINDINGS
from lab.analysis.verdicts.run_means import BETWEEN, NEES, NIS, QUARTERS, Figure, RunMeans, Series, run_means
from lab.analysis.verdicts.sums import Kept, Squares
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment

TOLD = FigureWording(FINDINGS["unexplained"])
RUNS = 30


def drawn(rng: np.random.Generator, runs: int, slow: float = 0.0) -> RunMeans:
    """Return the means of runs of a matched filter: ten fast states, and five that keep their errors.

    In each quarter the fast ones take 20 independent values. The slow ones keep a part of their variance over
    the flight.
    """
    fast = rng.chisquare(200, (runs, 4)) / 20
    kept, fresh = rng.normal(size=(runs, 1, 5)), rng.normal(size=(runs, 4, 5))
    lasting = np.sum((np.sqrt(slow) * kept + np.sqrt(1 - slow) * fresh) ** 2, axis=2)
    quarters = (fast + lasting) / 15
    nis = rng.chisquare(300, (runs, 4)) / 300
    columns = [
        (Figure(NEES), quarters.mean(axis=1), 15.0),
        *((Figure(NEES, "", name), quarters[:, at], 15.0) for at, name in enumerate(QUARTERS)),
        (Figure(NEES, "velocity"), fast.mean(axis=1) / 10, 10.0),
        (Figure(NEES, "gyro bias"), lasting.mean(axis=1) / 5, 5.0),
        (Figure(NIS), nis.mean(axis=1), 1200.0),
        *((Figure(NIS, "", name), nis[:, at], 300.0) for at, name in enumerate(QUARTERS)),
    ]
    figures, values, numbers = zip(*columns, strict=True)
    return RunMeans(
        tuple(figures), Kept(np.stack(values, axis=1)), Kept(np.tile(np.array(numbers), (runs, 1)))
    )


def scaled(means: RunMeans, factor: float, *figures: Figure) -> RunMeans:
    """Return means of which some figures, or all, are larger by a factor."""
    own = [not figures or figure in figures for figure in means.figures]
    return RunMeans(means.figures, Kept(means.means.values * np.where(own, factor, 1.0)), means.independent)


@pytest.mark.proof
@pytest.mark.parametrize("runs", [10, RUNS, 100])
@pytest.mark.parametrize("slow", [0.0, 0.9])
def test_matched_runs_disagree_in_any_figure_as_seldom_as_the_family_says(runs: int, slow: float) -> None:
    """Of 1,000 ensembles: 1 % with σ 0.3 %; ten skewed draws are allowed half as many again."""
    rng = np.random.default_rng(runs)
    off = sum(not all(one.holds for one in agreements(drawn(rng, runs, slow))) for _ in range(1000))
    print(f"\n{runs} runs, slow {slow}: {off} of 1,000 disagree")
    assert off / 1000 < 1.5 * limits.VERDICT.family_chance + 0.009
    assert off


def test_the_probability_of_each_figure_is_right_to_both_sides() -> None:
    """Means of χ² with eight degrees of freedom: each tail holds 1 % where 2 % are asked for."""
    rng, sides = np.random.default_rng(1), np.zeros(2)
    figures = tuple(Figure(NEES, str(at)) for at in range(50))
    for _ in range(100):
        values = rng.chisquare(8, (RUNS, 50)) / 8
        for one in agreements(RunMeans(figures, Kept(values), Kept(np.ones_like(values)))):
            sides[int(one.mean > 1)] += one.chance < 0.02
    # 5,000 draws: 50 on each side, with a σ of 7.
    assert (np.abs(sides - 50) < 29).all()


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_mismatch_below_all_other_limits_is_told(factor: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        found = [entry.finding for entry in judge_agreement(scaled(drawn(rng, RUNS), factor), TOLD)]
        assert [finding.quantity for finding in found] == [NEES, NIS]
        for finding in found:
            assert finding.direction == ("too large" if factor > 1 else "too small")
            assert finding.factor == pytest.approx(max(factor, 1 / factor), rel=0.1)
            assert ", taken together, are " in finding.sentence


def test_what_is_off_in_one_quarter_or_one_group_is_named_by_it() -> None:
    matched = drawn(np.random.default_rng(4), RUNS)
    last, bias = Figure(NEES, "", "last"), Figure(NEES, "gyro bias")
    (quarter,) = judge_agreement(scaled(matched, 1.4, last), TOLD)
    assert quarter.finding.sentence.startswith(
        "The errors of the states in the last quarter of the flight are 1."
    )
    (group,) = judge_agreement(scaled(matched, 1.4, bias), TOLD)
    assert group.finding.sentence.startswith("The errors of the gyro bias are 1.")


@pytest.mark.parametrize("factor", [0.01, 0.3, 3.0, 100.0])
def test_nothing_that_is_far_off_is_hidden_by_a_few_large_draws(factor: float) -> None:
    """The correction for skewness moves to the other side; it must not reach it."""
    values = np.ones(RUNS) + 0.02 * np.arange(RUNS)
    values[3] = 4.0
    values *= factor / values.mean()
    (found,) = agreements(RunMeans((Figure(NEES),), Kept(values[:, None]), Kept(np.ones((RUNS, 1)))))
    assert not found.holds
    assert found.low <= found.mean <= found.high


def test_equal_runs_have_no_scatter_to_judge_by() -> None:
    one = drawn(np.random.default_rng(5), 1)
    assert agreements(one) == []
    assert agreements(one + one) == []
    assert not judge_agreement(one + one, TOLD)


def test_a_single_run_is_judged_by_the_independent_values_it_has() -> None:
    """Four are beyond doubt among as many as a quarter has, 1.5 among none; three biases may be four."""
    matched = drawn(np.random.default_rng(6), 1)
    matched = scaled(RunMeans(matched.figures, Kept(np.ones((1, 12))), matched.independent), 1.0)
    assert not judge_agreement(matched, TOLD)
    for figure, factor, is_named in (
        (Figure(NEES, "", "first"), 4.0, True),
        (Figure(NEES, "", "first"), 1.6, False),
        (Figure(NEES, "gyro bias"), 4.0, False),
        (Figure(NIS, "", "last"), 1.6, True),
        (Figure(NIS), 1.4, False),
    ):
        found = judge_agreement(scaled(matched, factor, figure), TOLD)
        assert bool(found) == is_named, figure
        if is_named:
            assert found[0].finding.factor == pytest.approx(factor)


def test_means_are_weighted_by_what_is_measured_and_of_their_quarter() -> None:
    """Fixes at 1 s, 2 s and 7 s of a flight of 8 s, the second one of a position only."""
    series = Series(
        Figure(NIS), np.array([1.0, 2.0, 7.0]), np.array([6.0, 9.0, 12.0]), np.array([6.0, 3.0, 6.0]), 0.0
    )
    found = run_means([series], (0.0, 8.0))
    assert found.figures == (Figure(NIS), *(Figure(NIS, "", name) for name in QUARTERS))
    np.testing.assert_allclose(found.means.values, [[27 / 15, 1.0, 3.0, np.nan, 2.0]])
    np.testing.assert_allclose(found.independent.values, [[15.0, 6.0, 3.0, 0.0, 6.0]])
    both = found + found
    assert both.runs == 2
    assert both.together(0) == Squares(np.array(2 * 27.0), np.array(2 * 15.0))
    assert both.together(3).number == 0
    beside = found.beside(run_means([series._replace(figure=Figure(BETWEEN))], (0.0, 8.0)))
    assert len(beside.figures) == beside.means.values.shape[1] == 10


@pytest.mark.proof
@pytest.mark.parametrize("r_scale", [0.8, 1.25])
def test_an_r_that_is_a_little_off_is_not_consistent_over_many_runs(r_scale: float) -> None:
    """Too little to be named as the cause; each run alone may be by chance."""
    settings = {"trajectory.imu_rate": 20.0, "navigator.r_scale": r_scale}
    many = run_ensemble(Experiment(mission="los_angeles", seed=1001).update(settings), RUNS)
    table = many.agreement.set_index("figure")
    assert table.loc["NIS", "chance"] < table.loc["NIS", "limit"]
    assert table.loc["NIS", "mean"] == pytest.approx(many.mean_nis.mean() / 6, rel=1e-6)
    assert table.loc["NEES", "mean"] == pytest.approx(many.mean_nees.mean() / 15, rel=1e-6)
    for verdict in (many.verdict, many.innovation_verdict):
        assert not verdict.consistent
        assert NIS in {finding.quantity for finding in verdict.findings}
    assert sum(bool(verdict.consistent) for verdict in many.verdicts) > RUNS // 2


def test_matched_runs_are_consistent() -> None:
    settings = {"trajectory.imu_rate": 20.0}
    many = run_ensemble(Experiment(mission="los_angeles", seed=1001).update(settings), RUNS)
    assert many.verdict.consistent
    assert many.innovation_verdict.consistent
