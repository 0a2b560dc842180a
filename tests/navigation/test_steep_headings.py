"""Headings of a nose that points up or down: they say nothing there, and the more the less it does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from place_flights import looping

from lab import Experiment
from lab.experiment.result import Result
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.navigation.aids import azimuth_variance

SEEDS = 12


@pytest.fixture(scope="module")
def loops(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a flight of three loops."""
    path = tmp_path_factory.mktemp("loops") / "loops.csv"
    write_flight_csv(path, looping())
    return path


def fly(mission: Path, seed: int, **navigator: object) -> Result:
    """Fly with a heading sensor and gyros so good that they keep the attitude to 0.3°."""
    made = Experiment(mission=str(mission), seed=seed)
    made.update({"trajectory": {"imu_rate": 50.0}, "navigator": navigator})
    for path, value in (("gyro.noise_density", 0.005), ("gyro.bias_sigma", 0.01), ("heading.fitted", True)):
        made.set(f"sensors.{path}", value)
    return made.run()


def pitch_when_seen(result: Result) -> NDArray[np.float64]:
    """Return the size of the true pitch at each heading [°]."""
    at = np.searchsorted(result.time, result.aids.time)
    return np.abs(np.degrees(result.known_truth("the pitch").euler[at, 1]))


@pytest.mark.proof
@pytest.mark.parametrize("model", ["phi", "nonlinear"])
def test_the_filter_is_consistent_through_the_vertical(loops: Path, model: str) -> None:
    """NEES per state was 440 and 121 where every heading counted; its σ over these seeds is 0.1."""
    found = []
    for seed in range(SEEDS):
        nees = fly(loops, seed, model=model).consistency.nees
        found.append(float(nees.mean()) / nees.attrs["degrees"])
    assert np.mean(found) == pytest.approx(1.0, abs=0.3)


def test_only_headings_near_the_vertical_are_left_out(loops: Path) -> None:
    """A nose 30° or more from the vertical shows its azimuth; within 1°, it shows none."""
    result = fly(loops, 3)
    used, pitch = result.solution_arrays.aid_sample >= 0, pitch_when_seen(result)
    assert used[pitch < 60].all()
    assert not used[pitch > 89].any()
    assert np.isnan(result.solution_arrays.aid_innovation[~used]).all()
    assert not [remark for remark in result.remarks if "heading" in remark]


@pytest.mark.proof
def test_filterpy_leaves_out_the_same(loops: Path) -> None:
    """With the model whose attitude errors are along the axes of the body."""
    a = fly(loops, 3, model="invariant").solution_arrays
    b = fly(loops, 3, model="invariant", engine="filterpy").solution_arrays
    np.testing.assert_array_equal(a.aid_sample, b.aid_sample)
    used = a.aid_sample >= 0
    np.testing.assert_allclose(a.aid_variance[used], b.aid_variance[used], rtol=1e-8)
    np.testing.assert_allclose(a.variance, b.variance, rtol=1e-7)


@pytest.mark.parametrize("pitch", [60.0, 75.0, 82.0])
def test_the_variance_is_that_of_the_products_of_tilts(pitch: float) -> None:
    """Tilts of 0.5°, drawn: what the linear part does not explain of the azimuth of the axis."""
    rng, sigma = np.random.default_rng(2), np.radians(0.5)
    tilt = sigma * rng.normal(size=(400_000, 2))
    level, down = np.cos(np.radians(pitch)), np.sin(np.radians(pitch))
    # The end of the axis moves by the cross product of the tilts with it, to first order.
    azimuth = np.arctan2(down * tilt[:, 0], level + down * tilt[:, 1])
    left = azimuth - down * tilt[:, 0] / level
    assert azimuth_variance((level, 0.0, down), 2 * sigma**2) == pytest.approx(np.var(left), rel=0.12)
