"""Parsed once: from the name of a mission to its trajectory a flight csv is parsed once and anchored once."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest

import lab.experiment.sensor_stages
from lab.base.cache import StageCache
from lab.experiment.ensembles.seeds import run_ensemble
from lab.experiment.experiment import Experiment
from lab.missions import mission
from lab.motion.kinematics import anchoring
from lab.motion.recordings import flight_csv

COUNTED = ((flight_csv, "read_columns"), (anchoring, "anchored_offsets"), (anchoring, "anchored_cartesian"))
"""Functions that parse the table of a csv, and that hold an integrated velocity to its positions."""


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count the work of an experiment that finds nothing in the cache."""
    counts: Counter[str] = Counter()

    def counted(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            counts[name] += 1
            return function(*args, **options)

        return call

    for owner, name in COUNTED:
        function = getattr(owner, name)
        for module in [one for key, one in sys.modules.items() if key.split(".")[0] == "lab"]:
            if getattr(module, name, None) is function:
                monkeypatch.setattr(module, name, counted(name, function))
    monkeypatch.setattr(lab.experiment.sensor_stages, "CACHE", StageCache(limit=256 * 2**20))
    return counts


ONCE = {"read_columns": 1, "anchored_offsets": 1}


@pytest.mark.parametrize("kind", ["name", "toml", "csv"])
def test_a_run_parses_its_flight_once_and_anchors_it_once(work: Counter[str], kind: str) -> None:
    found = mission("los_angeles")
    named = {"name": "los_angeles", "toml": str(found.path), "csv": str(found.recording_path)}[kind]
    experiment = Experiment(mission=named)
    result = experiment.run()
    _ = result.truth, result.errors, result.verdict
    assert work == ONCE
    experiment.set("sensors.gyro.noise_density", 0.03)
    experiment.set("seed", 5)
    experiment.run()
    assert work == ONCE


def test_runs_in_parallel_share_one_reading(work: Counter[str]) -> None:
    run_ensemble(Experiment(mission="los_angeles"), 3, workers=3)
    assert work == ONCE


@pytest.mark.parametrize(("path", "value"), [("imu_rate", 100.0), ("attitude_curve", "euler")])
def test_another_curve_through_the_same_flight_is_anchored_but_not_parsed(
    work: Counter[str], path: str, value: object
) -> None:
    experiment = Experiment(mission="los_angeles")
    experiment.run()
    experiment.set(f"trajectory.{path}", value)
    experiment.run()
    assert work == {"read_columns": 1, "anchored_offsets": 2}
