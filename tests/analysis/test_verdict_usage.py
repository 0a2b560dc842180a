"""Verdict on smoothed runs and unused fixes: P0 is judged by the start, rejected fixes are judged too."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment


def quantities(verdict: object) -> list[str]:
    """Return what a verdict finds."""
    return [finding.quantity for finding in verdict.findings]


@pytest.mark.proof
@pytest.mark.parametrize("mission", ["montreal", "los_angeles"])
def test_a_matched_smoothed_run_is_consistent(mission):
    """The smoother moves the first sample far inside P0, which says nothing of P0."""
    judged = []
    for seed in range(1, 11):
        experiment = Experiment(mission=mission, seed=seed)
        experiment.set("trajectory.imu_rate", 50.0)
        experiment.set("navigator.smoother", True)
        judged.append(experiment.run().verdict)
    assert sum(not verdict.consistent for verdict in judged) == 0


@pytest.mark.proof
@pytest.mark.parametrize(("scale", "direction"), [(0.05, "too small"), (20, "too large")])
def test_a_wrong_p0_is_seen_through_the_smoother(scale, direction):
    experiment = Experiment(seed=2)
    experiment.set("navigator.smoother", True)
    experiment.set("navigator.p0_scale", scale)
    (finding,) = experiment.run().verdict.findings
    assert (finding.quantity, finding.direction) == ("P0", direction)


def test_nees_of_a_smoothed_run_is_that_of_its_smoothed_states():
    experiment = Experiment(seed=1)
    experiment.set("navigator.smoother", True)
    smoothed = experiment.run()
    experiment.set("navigator.smoother", False)
    plain = experiment.run()
    assert smoothed.evidence.nees.total != plain.evidence.nees.total
    assert np.array_equal(smoothed.evidence.start.total, plain.evidence.start.total)
    assert smoothed.innovation_verdict == plain.innovation_verdict


def test_a_gate_that_rejects_good_fixes_is_never_consistent():
    """A filter that is too sure of its start rejects nearly all good fixes."""
    experiment = Experiment(seed=1)
    experiment.set("navigator.gate", 0.9)
    experiment.set("navigator.p0", [1e-6] * 15)
    result = experiment.run()
    assert result.solution_arrays.fix_rejected.sum() > 20
    # The filter recovers, so that with the truth at hand its start explains all of it.
    assert quantities(result.verdict)[0].startswith("P0") or "gate" in quantities(result.verdict)
    found = quantities(result.innovation_verdict)
    assert "gate" in found or found[0] == "gain" or found[0].startswith("P0")
    assert result.verdict.consistent is False
    assert result.innovation_verdict.consistent is False


@pytest.mark.proof
@pytest.mark.parametrize("filtered", [True, False])
def test_small_innovations_of_a_receiver_that_filters_are_no_r_too_large(filtered):
    """Its errors of 1 m hardly change from fix to fix; white errors of 0.1 m are an R too large indeed."""
    experiment = Experiment(mission="los_angeles", seed=3)
    experiment.set("trajectory.imu_rate", 20.0)
    experiment.set("sensors.gps.period", 0.2)
    experiment.set("sensors.gps.position_variance", 0.01)
    experiment.set("sensors.gps.correlated_sigma", 1.0 if filtered else 0.0)
    experiment.set("navigator.r", [1.0] * 3 + [0.2] * 3)
    (finding,) = experiment.run().innovation_verdict.findings
    assert finding.quantity == ("GPS correlation" if filtered else "R position")
    assert finding.advice.startswith("Do not lower R:") == filtered
    if filtered:
        numbers = {int(one) for one in re.findall(r"(?:in|by|about) (\d+)", finding.advice)}
        (number,) = numbers
        experiment.set("sensors.gps.period", 0.2 * number)
        assert experiment.run().evidence.nees.mean.mean() < 1.5


def test_where_causes_cannot_be_compared_the_receiver_is_not_accused():
    """Misaligned sensors show in turns; a filter with a state of the receiver compares no explanations."""
    experiment = Experiment(mission="los_angeles", seed=100)
    experiment.set("trajectory.imu_rate", 50.0)
    experiment.set("sensors.gps.period", 0.5)
    experiment.set("sensors.gyro.noise_density", 0.005)
    experiment.set("sensors.gyro.misalignment", [1.0] * 6)
    experiment.set("sensors.accelerometer.misalignment", [1.0] * 6)
    experiment.set("navigator.estimate_gps_drift", True)
    result = experiment.run()
    findings = result.innovation_verdict.findings
    assert findings
    assert not [one.quantity for one in findings if one.quantity.startswith("R ")]
    assert {one.quantity for one in result.verdict.findings} == {
        "gyro misalignment",
        "accelerometer misalignment",
    }


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        ("navigator.aiding_scale", 1.0, None),
        ("navigator.q_scale", 0.03, "Q"),
        ("navigator.p0_scale", 0.05, "P0"),
        ("sensors.gyro.misalignment", [1.0] * 6, "gyro misalignment"),
    ],
)
def test_a_filter_that_estimates_errors_of_the_receiver_is_judged_by_its_own_errors(path, value, named):
    """Its innovations may be right while its errors are ten times as large as it says."""
    for seed in (1, 2):
        experiment = Experiment(mission="los_angeles", seed=seed)
        experiment.set("trajectory.imu_rate", 50.0)
        experiment.set("sensors.gps.correlated_sigma", 2.0)
        experiment.set("navigator.estimate_gps_drift", True)
        experiment.set(path, value)
        verdict = experiment.run().verdict
        assert [one.quantity for one in verdict.findings] == ([named] if named else [])
        assert verdict.basis == "1 run, errors and innovations"


@pytest.mark.proof
@pytest.mark.parametrize("gate", [0.95, 0.99, 0.999])
def test_what_a_gate_rejects_by_chance_is_no_finding(gate):
    for seed in range(1, 6):
        experiment = Experiment(seed=seed)
        experiment.set("navigator.gate", gate)
        result = experiment.run()
        assert result.verdict.consistent, result.verdict
        assert result.innovation_verdict.consistent, result.innovation_verdict


def test_where_no_fix_was_offered_there_is_no_verdict():
    experiment = Experiment(seed=1)
    experiment.set("sensors.gps.outages", [[0, 1e6]])
    result = experiment.run()
    for verdict in (result.verdict, result.innovation_verdict):
        assert verdict.consistent is None
        assert verdict.headline.startswith("No verdict")


@pytest.mark.parametrize(
    ("sensors", "judged"),
    [
        pytest.param({}, "errors only", id="alone"),
        # Its advice compiles the invariant filter with a heading, which no other test needs.
        pytest.param(
            {"sensors.heading.fitted": True}, "errors and innovations", id="heading", marks=pytest.mark.proof
        ),
    ],
)
def test_where_no_fix_was_used_wrong_errors_are_named_without_fixes(sensors, judged):
    """With 10° of initial error, the linear model does not hold; a run and an ensemble say the same."""
    experiment = Experiment(mission="los_angeles", seed=2).update(
        {
            "trajectory.imu_rate": 50,
            "sensors.gps.outages": [[0, 1e6]],
            "navigator.attitude_sigma": 10.0,
            **sensors,
        }
    )
    ensemble = run_ensemble(experiment, (2, 3))
    for verdict, runs in ((experiment.run().verdict, "1 run"), (ensemble.verdict, "2 runs")):
        (finding,) = verdict.findings
        assert (finding.quantity, finding.direction) == ("NEES", "too large")
        assert finding.sentence.startswith("The errors of the position, taken together, are ")
        assert "fix" not in f"{finding.sentence} {finding.advice} {finding.evidence}"
        assert verdict.basis == f"{runs}, no fix used, {judged}"
    assert ensemble.innovation_verdict.headline == "No verdict: no fix was used."
    assert ensemble.coverage["within ±1σ [%]"].isna().all()


def test_an_ensemble_without_fixes_whose_errors_are_right_has_no_verdict_as_a_run_has_none():
    experiment = Experiment(mission="los_angeles", seed=3).update(
        {"trajectory.imu_rate": 50, "sensors.gps.outages": [[0, 1e6]], "sensors.heading.fitted": True}
    )
    for verdict in (experiment.run().verdict, run_ensemble(experiment, 3).verdict):
        assert verdict.consistent is None
        assert verdict.headline == "No verdict: no fix was used."


@pytest.mark.parametrize(
    ("path", "value", "rate"), [("navigator.robust", "huber", 0.04), ("navigator.gate", 0.999, 0.06)]
)
def test_outliers_are_named_beside_a_state_of_the_receiver(path, value, rate):
    """Here the causes of the innovations are not compared, and no other sentence says what is wrong."""
    for seed in (1, 2):
        experiment = Experiment(mission="los_angeles", seed=seed)
        experiment.set("trajectory.imu_rate", 50.0)
        experiment.set("sensors.gps.correlated_sigma", 0.5)
        experiment.set("sensors.gps.period", 0.5)
        experiment.set("sensors.gps.outlier_rate", rate)
        experiment.set("sensors.gps.outlier_size", 50.0)
        experiment.set("navigator.estimate_gps_drift", True)
        experiment.set(path, value)
        result = experiment.run()
        for verdict in (result.verdict, result.innovation_verdict):
            assert [one.quantity for one in verdict.findings] == ["GPS outliers"]
