"""Gains: what they make of the innovations is what the filter did to its navigator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.analysis.gains import choose_epochs, iterate_updates
from lab.experiment.experiment import Experiment
from lab.motion.frames import ecef


@pytest.mark.parametrize("model", ["phi", "invariant"])
@pytest.mark.parametrize("seed", [1001, 1002])
def test_gains_turn_the_attitude_as_far_as_the_filter_did(model: str, seed: int) -> None:
    """Single fixes correct the attitude by 20° and more; attitudes have changed by that and by the gyros."""
    experiment = Experiment(mission="los_angeles", seed=seed)
    experiment.set_texts(("navigator.attitude_sigma=[2,2,60]", f"navigator.model={model}"))
    result = experiment.run()
    solution, epochs = result.solution_arrays, choose_epochs(result)
    truth, ideal = result.true_flight("budget")
    place = np.column_stack((truth.latitude, truth.longitude))[epochs.sample]
    turns = {
        sample: update.turn
        for sample, fix, update in zip(
            epochs.sample.tolist(), epochs.fix, iterate_updates(result, epochs, place), strict=True
        )
        if fix >= 0 and update is not None
    }
    at = np.array(list(turns))
    measured = Rotation.from_rotvec(
        result.gyro.increments[at - 1] - solution.bias[at - 1, :3].astype(float) * ideal.dt
    )
    after, before = (Rotation.from_quat(solution.q_nb[one], scalar_first=True) for one in (at, at - 1))
    turned = (after * (before * measured).inv()).as_rotvec()
    turned = np.einsum("mij,mj->mi", ecef.axes(*solution.position[at, :2].T), turned)
    assert np.degrees(np.linalg.norm(turned, axis=1).max()) > 20
    # What is left is the turn of the local axes in a step.
    np.testing.assert_allclose(np.stack(list(turns.values())), turned, atol=1e-5)
