"""The lever arm that innovations alone show: how well, with the default receiver, and when it is named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lab.experiment.experiment import Experiment
from lab.experiment.result import Result

ARMS = ((2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, -2.0))
"""Lever arms of 2 m [m]."""
SEEDS = range(12)
CHANCE = 1e-3
"""Probability with which the test fails by chance: the seeds are fixed, so it does or does not for ever."""
CERTAIN = 10.0
"""Length of an arm in its σ at which each run names it: 5.7 are needed, and 3 are left for noise."""


def flown(mission: str, seed: int, arm: tuple[float, float, float]) -> Result:
    """Return a run whose filter knows no lever arm."""
    experiment = Experiment(mission=mission, seed=seed)
    experiment.trajectory.imu_rate = 25.0
    experiment.sensors.gps.lever_arm = arm
    experiment.navigator.lever_arm = (0.0, 0.0, 0.0)
    return experiment.run()


def names_an_arm(result: Result) -> bool:
    return any(one.quantity == "GPS lever arm" for one in result.innovation_verdict.findings)


@pytest.mark.proof
@pytest.mark.parametrize("mission", ["los_angeles", "pacific"])
def test_the_arm_is_estimated_with_an_honest_sigma_and_named_beyond_doubt_only(mission: str) -> None:
    squares, sigmas, certain, named = [], np.zeros((3, 3)), 0, np.zeros(3)
    for seed in SEEDS:
        axis = seed % 3
        result = flown(mission, seed, ARMS[axis])
        causes = result.evidence.without_truth().innovations.causes
        information = causes.matrix[1:4, 1:4]
        off = np.linalg.solve(information, causes.vector[1:4]) - ARMS[axis]
        squares.append(off @ information @ off)
        sigma = np.sqrt(np.diag(np.linalg.inv(information)))
        sigmas[axis] += sigma / (len(SEEDS) / 3)
        named[axis] += names_an_arm(result)
        if axis > 0 and 2.0 / sigma[axis] > CERTAIN:  # forward resembles a latency
            certain += 1
            assert names_an_arm(result)
        assert not names_an_arm(flown(mission, seed, (0.0, 0.0, 0.0)))
    print(f"\n{mission}: σ of the arm {sigmas.diagonal().round(2)} m, named {named} of {len(SEEDS) // 3}")
    low, high = stats.chi2.interval(1 - CHANCE, 3 * len(SEEDS))
    assert low < np.sum(squares) < high
    assert (certain > 0) == (mission == "pacific")


def test_errors_of_the_attitude_are_no_errors_of_a_good_receiver() -> None:
    """An antenna 2.2 m away and fixes of 2 cm: a heading that is wrong by 1° for minutes is no fault."""
    named = []
    for seed in range(1, 7):
        experiment = Experiment(mission="montreal", seed=seed)
        experiment.update(
            {
                "trajectory.imu_rate": 50.0,
                "sensors.gps.position_variance": 0.0004,
                "sensors.gps.velocity_variance": 0.0004,
                "sensors.gps.lever_arm": (2.0, -1.0, 0.5),
            }
        )
        named += [one.quantity for one in experiment.run().verdict.findings]
    assert not named
