"""Advice that is followed: whether the error gets smaller where the innovations alone name the fault.

The truth judges: rms position errors and NEES of the run before, and of the run with the advised settings.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

from lab.analysis.verdicts.trial import apply_changes
from lab.experiment.result import Result
from tests.benchmarks.faults import experiment

SEEDS = (11, 12, 13, 14)
RATE = 50.0


def run(seed: int, path: str, value: float) -> Result:
    """Return a run of a tactical sensor with one setting changed."""
    faulty = experiment("los_angeles", "tactical", seed)
    faulty.update({"trajectory.imu_rate": RATE, path: value})
    return faulty.run()


def followed(before: Result) -> Result:
    """Return the run with the settings that the innovations of another advise."""
    (finding,) = before.innovation_verdict.findings
    after = before.repeated(apply_changes(before, finding.changes))
    assert isinstance(after, Result)
    return after


def nees(results: list[Result]) -> float:
    """Return NEES per state of runs."""
    squares = [one.evidence.nees for one in results]
    return float(np.mean([found.mean for found in squares if found is not None]))


def rms(results: list[Result]) -> float:
    """Return the rms position error of runs [m]."""
    return float(np.sqrt(np.mean([np.sum(one.errors["position"].values ** 2, axis=1) for one in results])))


@pytest.mark.proof
@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_r_wrong_as_a_whole_is_mended_as_a_whole(scale):
    """One of position and velocity alone would leave the fixes of the other with the wrong weight."""
    before = [run(seed, "navigator.r_scale", scale) for seed in SEEDS]
    assert {one.innovation_verdict.findings[0].quantity for one in before} == {"R"}
    after = [followed(one) for one in before]
    assert rms(after) < rms(before)
    assert 0.7 < nees(after) < 1.5


def test_scale_factors_that_are_to_be_estimated_get_a_sigma():
    """With 21 states alone, P0 of the scale factors is zero, and they stay so."""
    before = [run(seed, "sensors.gyro.scale_factor", 1.0) for seed in SEEDS]
    assert {one.innovation_verdict.findings[0].quantity for one in before} == {"gyro scale factor"}
    after = [followed(one) for one in before]
    assert rms(after) < 0.8 * rms(before)
    assert 0.7 < nees(after) < 1.5


def test_an_r_too_large_is_mended_beside_a_state_of_the_receiver():
    """The causes cannot be compared there, but innovations that are small tell what to try."""
    before, after = [], []
    for seed in SEEDS:
        faulty = experiment("los_angeles", "tactical", seed)
        faulty.update(
            {
                "trajectory.imu_rate": RATE,
                "sensors.gps.correlated_sigma": 1.0,
                "navigator.estimate_gps_drift": True,
                "navigator.r_scale": 10.0,
            }
        )
        before.append(faulty.run())
        (finding,) = before[-1].innovation_verdict.findings
        (factor,) = re.findall(r"multiply navigator.r_scale by ([0-9.]+)\.", finding.advice)
        faulty.set("navigator.r_scale", 10.0 * float(factor))
        after.append(faulty.run())
    assert rms(after) < rms(before)
    assert 0.7 < nees(after) < 1.5
