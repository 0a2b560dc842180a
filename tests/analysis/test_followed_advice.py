"""Advice that is followed: whether the error gets smaller where the innovations alone name the fault.

The truth judges: rms position errors and NEES of the run before, and of the run with the advised settings.
"""

from __future__ import annotations

import numpy as np
import pytest

from lab import Experiment
from lab.analysis.trial import advised
from lab.result import Result

SEEDS = (11, 12, 13, 14)
RATE = 50.0


def run(seed: int, **navigator: float) -> Result:
    """Return a run with some settings of the navigator."""
    experiment = Experiment(mission="los_angeles", seed=seed)
    experiment.set("trajectory.imu_rate", RATE)
    for name, value in navigator.items():
        experiment.set(f"navigator.{name}", value)
    return experiment.run()


def rms(results: list[Result]) -> float:
    """Return the rms position error of runs [m]."""
    return float(np.sqrt(np.mean([np.sum(one.errors["position"].values ** 2, axis=1) for one in results])))


@pytest.mark.parametrize("scale", [0.1, 10.0])
def test_r_wrong_as_a_whole_is_mended_as_a_whole(scale):
    """One of position and velocity alone would leave the fixes of the other with the wrong weight."""
    before = [run(seed, r_scale=scale) for seed in SEEDS]
    after = []
    for one in before:
        (finding,) = one.innovation_verdict.findings
        assert finding.quantity == "R"
        assert finding.factor == pytest.approx(10, rel=0.5)
        again = one.repeated(advised(one, finding.changes))
        assert isinstance(again, Result)
        after.append(again)
    assert rms(after) < rms(before)
    nees = np.mean([float(one.evidence.nees.mean) for one in after])
    assert 0.7 < nees < 1.5
