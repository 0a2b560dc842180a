"""Trial: advice is run before it is given, and not given where it makes something worse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.analysis.identification.renavigation import subject
from lab.analysis.verdicts import trial
from lab.analysis.verdicts.finding import Change, Finding, Verdict
from lab.analysis.verdicts.trial import Figures
from lab.experiment.ensembles.ensemble import TRIED
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.navigation.checks import divergence_error

OUTAGES = np.array([3.0, 4.0, 5.0, 4.0, 3.5, 4.5])
BEFORE = Figures(nis=1.5, correlation=0.1, outages=OUTAGES, fixes=400)


@pytest.mark.parametrize(
    ("after", "word"),
    [
        (BEFORE._replace(nis=2.0), "NIS"),
        (BEFORE._replace(nis=0.3), "NIS"),
        (BEFORE._replace(correlation=0.3), "correlation"),
        (BEFORE._replace(outages=1.5 * OUTAGES), "outages"),
    ],
)
def test_each_figure_can_veto(after, word):
    assert word in trial.describe_worsened(BEFORE, after)


def test_what_is_as_good_or_better_is_not_vetoed():
    assert not trial.describe_worsened(BEFORE, BEFORE)
    assert not trial.describe_worsened(BEFORE, Figures(1.0, 0.02, 0.7 * OUTAGES, 400))
    short = BEFORE._replace(outages=np.zeros(0))
    assert not trial.describe_worsened(short, short)


def test_what_chance_does_to_a_right_filter_is_not_vetoed():
    """200 fixes: NIS of a right filter varies by 4 %, its correlations by 7 %."""
    right = Figures(nis=1.0, correlation=0.05, outages=OUTAGES, fixes=200)
    assert not trial.describe_worsened(right, right._replace(nis=0.94, correlation=0.15))
    assert "NIS" in trial.describe_worsened(right, right._replace(nis=0.8))
    assert "correlation" in trial.describe_worsened(right, right._replace(correlation=0.25))


@pytest.mark.parametrize(
    ("factors", "is_worse"),
    [
        ([1.4], False),
        ([3.0], True),
        ([1.4, 0.9, 1.5], False),
        ([1.3] * 12, True),
        ([1.3, 0.6, 2.5, 1.1, 0.7, 1.4], False),
        ([1.01] * 1000, False),
    ],
)
def test_a_few_outages_show_a_gross_loss_only(factors, is_worse):
    before = BEFORE._replace(outages=np.full(len(factors), 5.0))
    assert bool(trial.describe_worsened(before, before._replace(outages=5.0 * np.array(factors)))) == is_worse


def test_an_outage_without_its_only_fix_is_not_compared():
    """Fixes 7 s apart: another latency moves them in and out of the outages."""
    known = BEFORE._replace(outages=np.array([4.0, np.nan, 5.0]))
    assert not trial.describe_worsened(known, BEFORE._replace(outages=np.array([np.nan, 4.0, 5.5, 3.0])))
    assert not trial.describe_worsened(known, BEFORE._replace(outages=np.array([np.nan, 40.0, np.nan])))
    assert trial.describe_worsened(known, BEFORE._replace(outages=np.array([40.0, np.nan, 50.0])))
    experiment = Experiment(mission="montreal", seed=1)
    experiment.update({"sensors": {"gps": {"period": 7.0, "latency": 3.0}}, "navigator": {"latency": 0.0}})
    late = experiment.run()
    right = experiment.copy().update({"navigator": {"latency": 3.0}}).run()
    before, after = (trial.figures(run).outages for run in (late, right))
    assert (np.isnan(before) != np.isnan(after)).any()
    assert "outages" not in trial.describe_worsened(trial.figures(late), trial.figures(right))


@pytest.mark.proof
@pytest.mark.parametrize("mission", ["montreal", "los_angeles"])
def test_a_latency_that_is_true_is_advised_whatever_the_seed(mission):
    """The flights have three outages and one, whose errors come from what was wrong before them, too."""
    for seed in range(1, 11):
        experiment = Experiment(mission=mission, seed=seed)
        experiment.update({"trajectory": {"imu_rate": 50}})
        experiment.update({"sensors": {"gps": {"latency": 0.05}}, "navigator": {"latency": 0.0}})
        advice = [finding.advice for finding in experiment.run().tried_verdict.findings]
        assert not [text for text in advice if text.startswith("No advice")], seed


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("change", [{"q_scale": 0.1}, {"r_scale": 10.0}])
def test_advice_on_one_wrong_matrix_is_given(seed, change):
    experiment = Experiment(seed=seed)
    experiment.update({"navigator": change})
    verdict = experiment.run().tried_verdict
    assert all(finding.changes for finding in verdict.findings)  # none was withheld
    assert "Tried" in verdict.findings[-1].advice


def test_changes_are_applied_to_what_the_filter_assumed():
    result = Experiment(seed=1).update({"navigator": {"q_scale": 0.1}}).run()
    changes = (
        Change("navigator.r", 4.0, times=True, rows=(3, 6)),
        Change("navigator.q_scale", 9.8, times=True),
        Change("navigator.latency", 0.2),
    )
    changed = trial.apply_changes(result, changes)
    assert np.allclose(changed.navigator.r, np.diag(result.belief.R) * [1, 1, 1, 4, 4, 4])
    assert changed.navigator.q_scale == 0.98  # 0.1 × 9.8 has other last digits in binary
    assert changed.navigator.latency == 0.2
    assert result.experiment.navigator.latency is None


def test_a_change_of_r_is_that_of_the_filter_whatever_its_factors():
    made = Experiment(mission="los_angeles", seed=1)
    made.update({"navigator": {"r_scale": 2.0, "r_factors": [10.0, 5.0, 3.0]}})
    result = made.run()
    changed = trial.apply_changes(result, (Change("navigator.r", 0.25, times=True, rows=(0, 3)),)).run()
    ratio = np.diag(changed.belief.R) / np.diag(result.belief.R)
    assert np.allclose(ratio, [0.25, 0.25, 0.25, 1.0, 1.0, 1.0])


def test_advice_that_is_right_is_given_with_what_it_brings():
    experiment = Experiment(seed=1)
    experiment.set("sensors.gps.latency", 0.3)
    experiment.set("navigator.latency", 0.0)
    result = experiment.run()
    (finding,) = result.tried_verdict.findings
    assert finding.advice.startswith("Set navigator.latency to 0.30.")
    assert "Tried: NIS per degree of freedom" in finding.advice
    followed = trial.apply_changes(result, finding.changes)
    assert followed.run().verdict.consistent


def test_advice_that_makes_the_prediction_worse_is_not_given(monkeypatch):
    """The same advice on the same run, refused where it would raise the errors across outages."""
    experiment = Experiment(seed=1)
    experiment.set("navigator.r", [0.05] * 3 + [0.2] * 3)
    result = experiment.run()
    wrong = Change("navigator.r", 1e-3, times=True, rows=(0, 3))
    verdict = result.verdict
    (finding,) = verdict.findings
    spoilt = replace(verdict, findings=(replace(finding, changes=(wrong,)),))
    monkeypatch.setitem(result.__dict__, "verdict", spoilt)
    (refused,) = trial.try_advice(result.verdict, [result]).findings
    assert refused.counsel.startswith("No advice: the change that such a finding suggests was tried")
    assert not refused.changes


def test_advice_that_changes_nothing_is_not_given(monkeypatch):
    """A P0 that is 10 % larger changes no figure; said of two findings, this is said once."""
    result = Experiment(mission="los_angeles", seed=1).run()
    idle = Finding(
        "P0", "too small", 1.1, "P0 is.", "Raise P0.", "", (Change("navigator.p0_scale", 1.1, True),)
    )
    monkeypatch.setattr(trial, "judge", lambda _evidence: Verdict("", (idle, twin), "1 run"))
    twin = replace(idle, quantity="P0 velocity")
    first, second = trial.try_advice(Verdict("", (idle, twin), "1 run"), [result]).findings
    assert first.counsel.startswith("No advice: what such a finding suggests was tried")
    assert second.counsel == ""
    assert not first.changes
    assert not second.changes


def test_a_figure_that_gets_better_is_a_gain():
    assert not trial.has_improved(BEFORE, BEFORE)
    assert trial.has_improved(BEFORE, BEFORE._replace(nis=1.1))
    assert trial.has_improved(BEFORE, BEFORE._replace(correlation=0.02))
    assert trial.has_improved(BEFORE, BEFORE._replace(outages=0.8 * OUTAGES))
    assert not trial.has_improved(BEFORE, BEFORE._replace(outages=0.999 * OUTAGES))


def test_a_start_that_is_told_rightly_is_a_gain_though_no_figure_shows_it():
    """P0 matters to NEES before the first fixes: the truth shows it, and the advice is given."""
    experiment = Experiment(mission="los_angeles", seed=1)
    experiment.set("navigator.p0_scale", 1e-3)
    verdict = experiment.run().tried_verdict
    (finding,) = verdict.findings
    assert finding.quantity.startswith("P0")
    assert finding.counsel.startswith("Try:")


def test_errors_across_outages_are_those_of_the_coasted_solution():
    """Against the truth at the same times, to which the fixes add their own noise of 0.7 m a component."""
    experiment = Experiment(seed=3)
    result = experiment.run()
    found = np.sqrt(np.mean(trial.held_out(result) ** 2))
    experiment.set("sensors.gps.outages", [[50, 60], [110, 120], [170, 180]])
    coasted = experiment.run()
    at = np.searchsorted(coasted.time, [56, 57, 58, 59, 60, 116, 117, 118, 119, 120, 176, 177, 178, 179, 180])
    errors = coasted.errors.position.values[at]
    expected = np.sqrt(np.mean(np.sum(errors**2, axis=1)) + 1.5)
    assert found == pytest.approx(expected, rel=0.35)


def test_a_flight_that_diverges_without_its_fixes_still_has_its_advice_tried(monkeypatch):
    """Its error across outages is infinite: any finite one is better, and it is worse than any."""
    before = trial.Figures(1.0, 0.0, np.full(2, np.inf), 600.0)
    finite = before._replace(outages=np.array([3.0, 2.0]))
    assert trial.describe_worsened(before, finite) == ""
    assert "without bound" in trial.describe_worsened(finite, before)
    result = Experiment(mission="los_angeles").run()

    def repeated(_experiment):
        raise divergence_error("the numbers are not usable")

    monkeypatch.setitem(result.__dict__, "repeated", repeated)
    assert (trial.held_out(result) == np.inf).all()
    assert trial.figures(result).held_out == np.inf


def test_a_flight_without_room_for_outages_is_judged_without_them():
    experiment = Experiment(mission="los_angeles", seed=1)
    experiment.set("sensors.gps.outages", [[40, 1e6]])
    result = experiment.run()
    assert np.isnan(trial.held_out(result)).all()
    assert np.isnan(trial.figures(result).held_out)


def test_what_one_fault_hides_of_another_is_tried_together() -> None:
    """With R four times too large, the latency alone would make NIS still smaller."""
    experiment = Experiment(mission="los_angeles")
    experiment.update({"sensors": {"gps": {"latency": 0.2}}, "navigator": {"latency": 0.0, "r_scale": 4.0}})
    result = experiment.run()
    verdict = result.tried_verdict
    assert len(verdict.findings) > 1
    effects = ["Tried, all advice together: NIS" in finding.advice for finding in verdict.findings]
    assert effects == [False] * (len(effects) - 1) + [True]  # once is enough
    before = trial.figures(result)
    after = trial.figures(trial.apply_changes(result, verdict.changes).run())
    assert abs(np.log(after.nis)) < abs(np.log(before.nis)) / 2
    latency = next(finding for finding in verdict.findings if finding.quantity == "GPS latency")
    assert trial.describe_worsened(before, trial.figures(trial.apply_changes(result, latency.changes).run()))


@pytest.mark.proof
def test_advice_on_many_runs_is_tried_on_the_first_of_them() -> None:
    experiment = Experiment(mission="los_angeles", seed=3)
    experiment.update({"navigator": {"r_scale": 10.0}})
    many = run_ensemble(experiment, 6)
    findings = many.tried_verdict.findings
    changes = tuple(change for finding in findings for change in finding.changes)
    assert {change.rows for change in changes} == {(0, 3), (3, 6)}
    runs = [experiment.copy().update({"seed": seed}).run() for seed in range(3, 3 + TRIED)]
    before = np.mean([trial.figures(run).nis for run in runs])
    after = np.mean([trial.figures(trial.apply_changes(run, changes).run()).nis for run in runs])
    assert f"NIS per degree of freedom {before:.2f}, then {after:.2f}" in findings[-1].advice
    assert abs(np.log(after)) < abs(np.log(before)) / 4


def test_a_matched_filter_over_many_runs_has_nothing_to_try() -> None:
    many = run_ensemble(Experiment(mission="los_angeles", seed=3), 3)
    assert many.tried_verdict is many.verdict


def test_fixes_are_predicted_with_the_drift_that_the_filter_estimates():
    """As the innovations of withheld fixes, which contain it: the position alone is off by the drift."""
    made = Experiment(mission="montreal", seed=3)
    made.update({"trajectory.imu_rate": 50.0, "sensors.gps.correlated_sigma": 3.0})
    made.set("navigator.estimate_gps_drift", True)
    result = made.run()
    found = trial.held_out(result)
    starts = result.time[0] + trial.EVERY * np.arange(1, found.size + 1) - trial.OUTAGE
    since = result.fixes.time[:, None] - starts
    withheld = ((since > -1e-6) & (since < trial.OUTAGE + 1e-6)).any(axis=1)
    _, seen = subject(result).navigate(made, withheld)
    squares = np.sum(seen.innovation[:, :3] ** 2, axis=1)
    for column, error in zip(since.T, found, strict=True):
        late = (column > trial.OUTAGE / 2) & (column <= trial.OUTAGE)
        assert np.sqrt(squares[late].mean()) == pytest.approx(error, rel=0.02)
