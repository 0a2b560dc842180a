"""State advice: settings that give the filter states for an error are tried, and change no truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.analysis.verdicts.advice_table import ADVICE
from lab.analysis.verdicts.state_advice import advise_simulated
from lab.analysis.verdicts.trial import apply_changes
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from tests.aided_flights import winding_road
from tests.simulated_logs import log_of

SEEDS = range(1, 9)
SIGMA, TIME = 1.5, 200.0
"""A slow error of a receiver [m], [s]."""
PRECISE = {
    "sensors.gyro.noise_density": 0.002,
    "sensors.gyro.bias_sigma": 0.01,
    "sensors.accelerometer.noise_density": 30.0,
    "sensors.accelerometer.bias_sigma": 1.0,
    "sensors.gps.velocity_variance": 0.01,
}
"""An IMU and velocities that show the drift of the positions."""
CONTRARY = ("R", "R position", "NIS", "GPS correlation", "GPS or IMU")


def run(settings: dict, seed: int = 1, mission: str = "montreal") -> Result:
    """Return a run at 50 Hz."""
    made = Experiment(mission=mission, seed=seed)
    made.set("trajectory.imu_rate", 50.0)
    for path, value in settings.items():
        made.set(path, value)
    return made.run()


def followed(before: Result) -> Result:
    """Return the run with all advice on it that was tried."""
    changes = tuple(change for finding in before.tried_verdict.findings for change in finding.changes)
    assert changes
    after = before.repeated(apply_changes(before, changes))
    assert isinstance(after, Result)
    return after


def nees(results: list[Result]) -> float:
    """Return NEES over its degrees of freedom, of all fixes of all runs."""
    parts = [one.consistency["nees"] for one in results]
    return float(np.mean([part.mean() / part.attrs["degrees"] for part in parts]))


def rms(results: list[Result]) -> float:
    """Return the rms position error of runs [m]."""
    return float(
        np.sqrt(np.mean([np.mean(np.sum(one.errors["position"].values ** 2, 1)) for one in results]))
    )


def same_sensors(one: Result, other: Result) -> bool:
    """Return whether two runs have the same measurements, bit for bit."""
    pairs = (
        (one.gyro.increments, other.gyro.increments),
        (one.accelerometer.increments, other.accelerometer.increments),
        (one.fixes.position, other.fixes.position),
        (one.fixes.velocity_n, other.fixes.velocity_n),
        (one.fixes.time, other.fixes.time),
    )
    return all(np.array_equal(a, b) for a, b in pairs)


@pytest.fixture(scope="module")
def drifting() -> list[Result]:
    """Return runs whose receiver drifts, which their filter does not know."""
    settings = {"sensors.gps.correlated_sigma": SIGMA, "sensors.gps.correlation_time": TIME}
    return [run(settings, seed) for seed in SEEDS]


@pytest.mark.proof
def test_the_drift_of_a_receiver_is_estimated_and_the_circle_ends(drifting):
    after = []
    for one in drifting:
        (finding,) = one.tried_verdict.findings
        assert finding.quantity == "GPS correlation"
        assert [change.path for change in finding.changes] == ["navigator.estimate_gps_drift"]
        assert "Tried: NIS per degree of freedom" in finding.counsel
        assert "R" not in finding.advice.split(" Tried")[0].split()
        after.append(followed(one))
        for verdict in (after[-1].verdict, after[-1].innovation_verdict):
            assert not [found for found in verdict.findings if found.quantity in CONTRARY]
    before = nees(drifting)
    print(f"\nNEES {before:.2f}, then {nees(after):.2f}; {rms(drifting):.2f} m, then {rms(after):.2f} m")
    assert before > 4
    assert 0.75 < nees(after) < 1.25
    assert rms(after) <= rms(drifting)


def test_following_advice_changes_no_truth(drifting):
    assert same_sensors(drifting[0], followed(drifting[0]))


def test_an_ensemble_offers_the_drift_too():
    made = Experiment(mission="los_angeles")
    made.update({"trajectory.imu_rate": 50.0, "sensors.gps.correlated_sigma": SIGMA})
    found = {one.quantity: one for one in run_ensemble(made, 3).verdict.findings}
    assert found["GPS correlation"].changes[0].path == "navigator.estimate_gps_drift"


@pytest.mark.proof
@pytest.mark.parametrize("mission", ["montreal", "los_angeles"])
def test_a_white_receiver_never_hears_of_drift(mission):
    for seed in range(1, 13):
        flown = run({}, seed, mission)
        for verdict in (flown.verdict, flown.innovation_verdict):
            assert not [one for one in verdict.findings if one.quantity == "GPS correlation"], seed


def test_an_error_that_the_settings_hide_keeps_its_words(drifting):
    """Settings with a size of zero give the states a σ of zero: they estimate nothing."""
    found = drifting[0].verdict
    silent = tuple(
        replace(one, advice=ADVICE["estimate the slow error"].text, changes=()) for one in found.findings
    )
    hidden = drifting[0].experiment.copy().update({"sensors.gps.correlated_sigma": 0.0})
    (finding,) = advise_simulated(replace(found, findings=silent), hidden, None).findings
    assert (finding.advice, finding.changes) == (ADVICE["estimate the slow error"].text, ())


@pytest.mark.proof
@pytest.mark.parametrize("kind", ["gyro", "accelerometer"])
def test_misalignments_are_estimated(kind):
    quiet = {"sensors.gyro.noise_density": 0.01, "sensors.gyro.bias_sigma": 0.02}
    before = run({**quiet, f"sensors.{kind}.misalignment": 1.0})
    (finding,) = before.tried_verdict.findings
    assert finding.quantity == f"{kind} misalignment"
    assert [change.path for change in finding.changes] == ["navigator.estimate_misalignments"]
    after = followed(before)
    assert same_sensors(before, after)
    assert nees([after]) < 0.05 * nees([before])
    assert rms([after]) < 0.5 * rms([before])
    assert after.innovation_verdict.consistent


@pytest.mark.proof
def test_g_sensitivity_is_estimated():
    quiet = {"sensors.gyro.noise_density": 0.01, "sensors.gyro.bias_sigma": 0.02}
    before = run({**quiet, "sensors.gyro.g_sensitivity": 0.05})
    after = followed(before)
    assert after.experiment.navigator.estimate_g_sensitivity
    assert after.verdict.consistent


def test_scale_factors_get_their_sigma_in_the_filter_and_not_in_the_sensors():
    """With sensors.gyro.scale_factor_sigma, the gyros would have other scale factors."""
    errors = {"sensors.gyro.scale_factor": 2.0, "sensors.accelerometer.scale_factor": 2.0}
    before = run({**errors, "navigator.p0_scale": 2.0})
    paths = {change.path for one in before.tried_verdict.findings for change in one.changes}
    assert paths == {"navigator.states", "navigator.p0"}
    after = followed(before)
    assert same_sensors(before, after)
    P0 = after.belief.P0
    assert np.allclose(P0[:15, :15], before.belief.P0)
    assert np.allclose(np.sqrt(np.diag(P0)[15:]), 0.02, rtol=0.1)
    assert after.verdict.consistent


@pytest.mark.proof
@pytest.mark.parametrize(
    "states",
    ["estimate_misalignments", "estimate_g_sensitivity", "estimate_bias_drift", "estimate_gps_drift"],
)
def test_a_filter_with_further_states_gets_a_verdict_on_suspicious_innovations(states):
    sizes = {"sensors.gyro.misalignment": 0.2, "sensors.gyro.g_sensitivity": 0.01}
    flown = run({**sizes, f"navigator.{states}": True, "navigator.r_scale": 0.1})
    assert flown.verdict.findings
    assert flown.innovation_verdict.findings


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_drift_of_the_receiver_of_a_log_is_estimated_with_its_size(seed, tmp_path):
    """Over four correlation times, σ is known to a factor of 1.5."""
    drift = {"sensors.gps.correlated_sigma": SIGMA, "sensors.gps.correlation_time": TIME}
    driven = run({**PRECISE, **drift}, seed, str(winding_road(tmp_path, 800.0)))
    before = log_of(driven, tmp_path / "log", 'vehicle = "car"\n').run()
    (finding,) = before.tried_verdict.findings
    assert finding.quantity == "GPS correlation"
    changes = {change.path: change.value for change in finding.changes}
    assert changes.pop("navigator.estimate_gps_drift") is True
    size, time = changes["sensors.gps.correlated_sigma"], changes["sensors.gps.correlation_time"]
    print(f"\n{size:.2f} m over {time:.0f} s")
    assert SIGMA / 2 < size < 2 * SIGMA
    assert SIGMA**2 / TIME / 2 < size**2 / time < 2 * SIGMA**2 / TIME
    after = followed(before)
    assert after.verdict.consistent
    assert rms([after]) < rms([before])


@pytest.mark.proof
def test_who_raised_r_for_a_slow_error_gets_out_of_the_circle(tmp_path):
    """R is too large, then the fixes are correlated, and then nothing is wrong."""
    drift = {"sensors.gps.correlated_sigma": SIGMA, "sensors.gps.correlation_time": TIME}
    driven = run({**PRECISE, **drift}, 1, str(winding_road(tmp_path, 400.0)))
    made = log_of(driven, tmp_path / "log", 'vehicle = "car"\n')
    made.set("navigator.r_factors", [100.0, 100.0, 1.0])
    result, named = made.run(), []
    while result.verdict.findings:
        assert len(named) < 3
        named.append((result.verdict.findings[0].quantity, result.verdict.findings[0].direction))
        result = followed(result)
    assert named == [("R position", "too large"), ("GPS correlation", "not modelled")]
    assert result.experiment.navigator.estimate_gps_drift


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_log_of_a_white_receiver_never_hears_of_drift(seed, tmp_path: Path):
    driven = run(PRECISE, seed, str(winding_road(tmp_path, 400.0)))
    found = log_of(driven, tmp_path / "log", 'vehicle = "car"\n').run().verdict
    assert not [one for one in found.findings if one.quantity == "GPS correlation"]


@pytest.mark.proof
@pytest.mark.parametrize("size", [1.0, 2.0])
def test_misalignments_of_a_log_are_estimated_with_their_size(size, tmp_path):
    """Of 2°, noise explains the innovations better to first order, and is not in the samples."""
    quiet = {"sensors.gyro.noise_density": 0.01, "sensors.gyro.bias_sigma": 0.02}
    flown = run({**quiet, "sensors.gyro.misalignment": size})
    before = log_of(flown, tmp_path / "log").run()
    (finding,) = before.tried_verdict.findings
    assert finding.quantity == "gyro misalignment"
    changes = {change.path: change.value for change in finding.changes}
    assert changes["navigator.estimate_misalignments"] is True
    assert changes["sensors.gyro.misalignment"] == pytest.approx(size, rel=0.3)
    assert followed(before).verdict.consistent
