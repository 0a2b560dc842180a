"""Seed lanes: runs eight abreast are those of their seeds alone."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from lab.analysis.sums import Kept
from lab.ensemble import RunAtFixes
from lab.experiment import Experiment
from lab.seed_lanes import SeedLanes
from lab.seeds import _keep

SLOW: dict[str, object] = {"mission": "los_angeles", "trajectory.imu_rate": 50.0}
OUTAGE: dict[str, object] = {"sensors.gps.outages": [[30.0, 55.0]]}
LATE: dict[str, object] = {"sensors.gps.latency": 0.13, "navigator.gate": 0.9, "navigator.robust": "huber"}


def of(changes: dict[str, object]) -> Experiment:
    """Return an experiment at a low rate with changed settings."""
    return Experiment().update(SLOW | changes)


def alone(experiment: Experiment, seed: int) -> RunAtFixes:
    """Return the run of a seed alone."""
    return _keep(experiment.copy().update({"seed": seed}).run(), explain=False)


def numbers_in(value: Any) -> list[np.ndarray]:
    """Return all arrays of a kept run, with those of its evidence."""
    if dataclasses.is_dataclass(value):
        return [part for f in dataclasses.fields(value) for part in numbers_in(getattr(value, f.name))]
    if isinstance(value, tuple):
        return [part for item in value for part in numbers_in(item)]
    return [] if value is None or isinstance(value, str) else [np.asarray(value, dtype=np.float64)]


def assert_same(abreast: RunAtFixes, single: RunAtFixes) -> None:
    """Assert that two runs agree within rounding, all evidence included."""
    assert isinstance(abreast.evidence.told, Kept)
    left, right = (numbers_in(run._replace(seconds=0.0)) for run in (abreast, single))
    assert len(left) == len(right) > 50
    for one, other in zip(left, right, strict=True):
        assert one.shape == other.shape
        largest = np.nanmax(np.abs(other), initial=0.0)
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-8 * largest)


@pytest.mark.parametrize(
    "changes",
    [
        OUTAGE,
        LATE | {"navigator.model": "psi"},
        {"navigator.model": "invariant", "navigator.states": 21, "sensors.gyro.scale_factor_sigma": 0.5},
    ],
    ids=["phi", "psi", "invariant 21"],
)
def test_a_run_abreast_is_that_of_its_seed_alone(changes: dict[str, object]) -> None:
    experiment = of(changes)
    lanes = SeedLanes.of(experiment)
    assert lanes is not None
    seeds = (5, 9, 6)
    found = list(lanes.run(seeds))
    assert sum(run is not None for run in found) >= 2
    for seed, run in zip(seeds, found, strict=True):
        if run is not None:
            assert_same(run, alone(experiment, seed))
