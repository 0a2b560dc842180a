"""Variants: all combinations are listed, and a run of one that was compiled ahead compiles nothing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from lab import Experiment, cards
from lab.experiment.variants import compile_variant, variants
from lab.navigation.belief import chosen_blocks
from lab.navigation.settings import NavigatorSettings

AHEAD = """
from numba.core import event
from lab import Experiment
from lab.experiment.variants import compile_variant

compile_variant({})
compiled = []

class Compilations(event.Listener):
    def on_start(self, what):
        compiled.append(what.data["dispatcher"].py_func.__qualname__)

    def on_end(self, what):
        pass

event.register("numba:compile", Compilations())
others = {
    "trajectory.imu_rate": 100.0,
    "sensors.gps.outages": [(30.0, 60.0)],
    "sensors.gps.lever_arm": (1.0, 0.5, -1.0),
    "sensors.gps.latency": 0.1,
    "navigator.correction": "feedforward",
    "navigator.gate": 0.999,
    "navigator.alignment": 20.0,
}
for name, value in others.items():
    experiment = Experiment()
    experiment.update({name: value})
    experiment.run()
print(compiled)
"""


def test_every_combination_is_a_variant_and_the_default_is_the_first() -> None:
    found = variants()
    assert Experiment().update(found[0]).navigator.to_dict() == Experiment().navigator.to_dict()
    asked = {tuple(sorted(assignments.items())) for assignments in found}
    assert len(asked) == len(found)
    for name in ("model", "states", "mechanization"):
        values = {assignments[f"navigator.{name}"] for assignments in found}
        assert values == set(NavigatorSettings.param[name].objects)


def test_the_filter_of_every_card_is_a_variant() -> None:
    """Whoever chooses a sensor waits for no compiler."""
    known = {chosen_blocks(Experiment().update(one).navigator, None) for one in variants()}
    for name, found in cards().items():
        experiment = Experiment()
        found.load(experiment)
        assert chosen_blocks(experiment.navigator, None) in known, name


def test_a_combination_that_is_refused_is_no_variant() -> None:
    nonlinear = {"navigator.model": "nonlinear", "navigator.smoother": True}
    assert nonlinear.items() <= max(variants(), key=lambda found: nonlinear.items() <= found.items()).items()
    assert not compile_variant(nonlinear)


@pytest.mark.proof
def test_a_run_compiles_nothing_after_its_variant_is_compiled_ahead() -> None:
    """Other rates, receivers, corrections and alignments have the same code."""
    run = subprocess.run(
        [sys.executable, "-c", AHEAD], cwd=Path(__file__).parents[2], capture_output=True, check=True
    )
    assert run.stdout.decode().splitlines()[-1] == "[]", run.stdout.decode()
