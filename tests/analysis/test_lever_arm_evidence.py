"""The lever arm that innovations alone show: how well, with the default receiver, and when it is named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from lab.analysis.verdicts import limits
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


@pytest.mark.parametrize(("mission", "told"), [("pacific", False), ("montreal", True), ("los_angeles", True)])
def test_an_arm_forward_and_a_latency_are_told_apart_only_where_the_flight_does(
    mission: str, told: bool
) -> None:
    """By the information of the true motion: what a latency leaves of an arm. The latency is never named."""
    either = 0
    for seed in range(1001, 1007):
        result = flown(mission, seed, (2.0, 0.0, 0.0))
        samples = result.solution_arrays.fix_sample
        truth, ideal = result.truth_arrays, result.ideal
        C_nb = Rotation.from_quat(truth.q_nb[samples], scalar_first=True).as_matrix()
        rate = ideal.dtheta[samples - 1] / ideal.dt
        acceleration = np.gradient(truth.velocity_n, truth.time, axis=0)[samples]
        forward = np.concatenate(
            (C_nb[:, :, 0], (C_nb @ np.cross(rate, (1.0, 0.0, 0.0))[..., None])[..., 0]), 1
        )
        late = -np.concatenate((truth.velocity_n[samples], acceleration), axis=1)
        signature = np.stack((late, forward)).reshape(2, -1) / np.tile(
            np.sqrt(np.diag(result.belief.R)), len(late)
        )
        information = signature @ signature.T
        left = information[1, 1] - information[0, 1] ** 2 / information[0, 0]
        # As a logarithm of the likelihood ratio of 2 m; noise adds to it.
        assert (0.5 * 2.0**2 * left > limits.VERDICT.likelihood_ratio) == told
        (finding,) = result.verdict.findings
        either += finding.quantity == "GPS lever arm or latency"
        assert finding.quantity in ("GPS lever arm", "GPS lever arm or latency")
        (change,) = finding.changes
        assert change.path == "navigator.lever_arm"
        assert np.linalg.norm(np.subtract(change.value, (2.0, 0.0, 0.0))) < 0.5
    assert either == 0 if told else either >= 3


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
