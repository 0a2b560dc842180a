"""The square of a tilt that lasts looks like a vertical accelerometer bias: σ of this bias allows for it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.analysis.verdicts.run_means import NEES, Figure
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.experiment.experiment import Experiment
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.motion.recordings.recording import Recording
from lab.navigation.filters.vertical_bias import raise_vertical_bias

SEEDS = range(1001, 1013)


@pytest.fixture(scope="module")
def parked(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the path of a vehicle that stands for a quarter of an hour."""
    t = np.arange(0.0, 900.5, 0.5)
    still = np.zeros_like(t)
    euler = np.tile((0.01, 0.02, 0.6), (t.size, 1))
    path = tmp_path_factory.mktemp("parked") / "parked.csv"
    place = still + np.radians(45.0), still + 0.1, still + 300.0
    write_flight_csv(path, Recording(t, *place, np.zeros((t.size, 3)), euler))
    return str(path)


@pytest.mark.proof
@pytest.mark.parametrize("model", ["phi", "psi", "invariant", "nonlinear"])
def test_errors_after_a_quarter_of_an_hour_at_rest_have_the_size_of_sigma(parked: str, model: str) -> None:
    means = []
    for seed in SEEDS:
        experiment = Experiment(mission=parked, seed=seed)
        experiment.trajectory.imu_rate = 20.0
        experiment.navigator.model = model
        found = experiment.run().evidence.means
        means.append(found.means.values[0, found.figures.index(Figure(NEES))])
    assert 0.8 < np.mean(means) < 1.3


def test_the_bound_is_the_second_moment_of_the_neglected_specific_force() -> None:
    rng = np.random.default_rng(1)
    C_nb = Rotation.from_rotvec((0.3, -0.2, 1.0)).as_matrix()
    own, down = C_nb[2], C_nb[2]  # an attitude error in b
    root = rng.normal(size=(15, 15)) * np.repeat((1.0, 0.1, 1e-3, 1e-5, 1e-8), 3)[:, None]
    P = root @ root.T
    before = P.copy()
    raise_vertical_bias(P, tuple(own), tuple(down))
    turns = Rotation.from_rotvec(rng.multivariate_normal(np.zeros(3), before[6:9, 6:9], 200_000))
    neglected = STANDARD_GRAVITY * (1 - np.cos(np.arccos(np.clip(turns.apply(down) @ down, -1, 1))))
    assert down @ P[12:15, 12:15] @ down == pytest.approx(np.mean(neglected**2), rel=0.02)
    added = np.zeros((15, 15))
    added[12:15, 12:15] = np.outer(down, down)
    np.testing.assert_allclose(P - before, added * (P - before)[12:15, 12:15].trace(), atol=1e-20)


def test_a_bias_that_is_known_worse_than_that_keeps_its_variance() -> None:
    P = np.diag(np.repeat((1.0, 0.1, 1e-4, 1e-5, 1e-2), 3) ** 2)
    before = P.copy()
    raise_vertical_bias(P, (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    np.testing.assert_array_equal(P, before)
