"""Compiling apart: which filters another process compiles, and that it compiles the right one."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from lab import Experiment
from lab.base.compiling.compiled_cache import CachedKernel
from lab.experiment import variants
from lab.experiment.stages import compile_apart
from lab.navigation import model_choice
from lab.navigation.filters import smoother, unscented
from lab.navigation.kernels.driver import driver
from lab.navigation.model_choice import chosen_model


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Mapping[str, Any]]:
    """Return the settings that another process is given."""
    found: list[Mapping[str, Any]] = []

    def run(command: list[str], *, input: str, **_: Any) -> None:
        assert command[1] == "-c"
        found.append(json.loads(input))

    monkeypatch.setattr(subprocess, "run", run)
    return found


def test_a_filter_that_is_not_on_the_disk_is_compiled_with_the_same_settings(
    asked: list[Mapping[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = Experiment(mission="los_angeles")
    experiment.update({"navigator": {"states": 21, "smoother": True}, "trajectory": {"imu_rate": 100}})
    monkeypatch.setattr(model_choice.compiled_cache, "is_missing", lambda _kernel: True)
    compile_apart(experiment.navigator, experiment.sensors, 100.0)
    (settings,) = asked
    runs: list[Experiment] = []

    def run(made: Experiment) -> None:
        runs.append(made)

    monkeypatch.setattr(Experiment, "run", run)
    assert variants.compile_variant(settings)
    (made,) = runs
    assert made.navigator.to_dict() == experiment.navigator.to_dict()
    assert made.sensors.to_dict() == experiment.sensors.to_dict()
    assert made.trajectory.imu_rate == 100


@pytest.mark.parametrize(("filter_rate", "smoother_on"), [(0.0, False), (10.0, False), (0.0, True)])
def test_each_part_of_a_filter_is_looked_for(
    filter_rate: float, smoother_on: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = Experiment()
    experiment.update({"navigator": {"filter_rate": filter_rate, "smoother": smoother_on}})
    model, looked = chosen_model(experiment.navigator, experiment.sensors), list[object]()
    monkeypatch.setattr(model_choice.compiled_cache, "is_missing", looked.append)
    assert not model_choice.is_missing(experiment.navigator, experiment.sensors, 100.0)
    parts = [driver(model, summed=filter_rate > 0)]
    assert looked == ([*parts, smoother.backward_pass(model, aided=False)] if smoother_on else parts)


def test_the_nonlinear_filter_is_looked_for_too(monkeypatch: pytest.MonkeyPatch) -> None:
    experiment, looked = Experiment(), list[object]()
    experiment.set("navigator.model", "nonlinear")
    monkeypatch.setattr(model_choice.compiled_cache, "is_missing", looked.append)
    model_choice.is_missing(experiment.navigator, experiment.sensors, 100.0)
    assert looked == [unscented.driver(aided=False)]


def test_a_filter_that_is_on_the_disk_is_not_compiled_again(
    asked: list[Mapping[str, Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = Experiment()
    experiment.set("trajectory.imu_rate", 50)
    experiment.run()  # compiled now at the latest
    (kernel,) = [driver(chosen_model(experiment.navigator, experiment.sensors), summed=False)]
    assert isinstance(kernel, CachedKernel)
    other = CachedKernel(kernel.py_func, targetoptions=kernel.targetoptions)  # as in a new process
    assert not model_choice.compiled_cache.is_missing(other)
    compile_apart(experiment.navigator, experiment.sensors, 50.0)
    assert asked == []
    files = other._files()
    assert files is not None
    monkeypatch.setattr(files, "_index_path", str(Path(files._index_path).with_name("none.nbi")))
    assert model_choice.compiled_cache.is_missing(other)
