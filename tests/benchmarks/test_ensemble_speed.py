"""Speed of many runs: verdicts, sweeps, outages and memory, each as a ratio within one benchmark.

All in the processor's time, so that what else the machine does disturbs little. Beside each ratio stands that
of the commit before the work on it.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest

from lab.experiment.ensembles import sweeping
from lab.experiment.ensembles.lane_draws import seeds_abreast
from lab.experiment.ensembles.seed_lanes import SeedLanes
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.variants import compile_lanes, compile_verdict
from lab.sensors.cards import card
from lab.sensors.draws import unit_draws

pytestmark = pytest.mark.benchmark

CARDS = ("BMI270", "ADIS16470", "STIM300")
"""A consumer, an industrial and a tactical card."""
BEFORE = {"judged": 3.46, "explained": 13.5, "verdict": 1.56, "outage": 7.8, "sweep": 1.0, "draws": 1.0}
"""The ratios at commit 4057f047."""


@pytest.fixture(scope="module", autouse=True)
def heading() -> None:
    """Print the head of the table."""
    compile_lanes()
    compile_verdict()
    print(f"\n\n{'ratio, in the time of the processor':<66}{'now':>10}{'before':>10}\n{'-' * 86}")


def row(what: str, ratio: float, before: float) -> None:
    """Print one line of the table."""
    print(f"{what:<66}{ratio:>10.2f}{before:>10.2f}")


def spent(work: Callable[[], object]) -> float:
    """Return the processor time of a function [s]."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def montreal(seed: int, **settings: object) -> Experiment:
    """Return the classic experiment with a seed."""
    return Experiment(mission="montreal", seed=seed).update(settings)


def test_draws_abreast_beside_those_of_numpy() -> None:
    """The white noise of a triad for a flight of 200 s: of eight runs together, and of each alone."""
    shape, both = (40_000, 3), list[tuple[float, float]]()
    for first in range(0, 88, 8):
        seeds = range(first, first + 8)
        own = seeds_abreast(seeds)
        abreast = spent(lambda own=own: [unit_draws(seed, "gyro.noise", shape) for seed in own])
        alone = spent(lambda seeds=seeds: [unit_draws(seed, "gyro.noise", shape) for seed in seeds])
        both.append((abreast, alone))
    ours, numpys = (list(times) for times in zip(*both[1:], strict=True))
    row("normal draws of eight runs abreast in the time of NumPy's", _ratio(numpys, ours), BEFORE["draws"])
    assert _ratio(numpys, ours) > 1.5


def test_a_judged_run_beside_others() -> None:
    """With its evidence, of the first runs of an ensemble, against one without."""
    lanes = SeedLanes.of(montreal(1))
    assert lanes is not None
    judged, plain = [], []
    for first in range(100, 148, 8):
        seeds = range(first, first + 8)
        plain.append(spent(lambda seeds=seeds: list(lanes.measure(seeds))))
        judged.append(spent(lambda seeds=seeds: list(lanes.run(seeds))))
    row("a run abreast with its evidence, by one without", _ratio(judged, plain), BEFORE["judged"])
    assert _ratio(judged, plain) < 1.75


@pytest.mark.parametrize(("what", "r_scale", "bar"), [("verdict", 1.0, 2.0), ("explained", 0.3, 3.3)])
def test_a_run_with_its_verdict_beside_the_run(what: str, r_scale: float, bar: float) -> None:
    """A further run, as at each move of a slider; with R too small, its innovations are explained."""
    runs, whole = [], []
    for seed in range(20, 32):
        experiment, found = montreal(seed, **{"navigator.r_scale": r_scale}), list[Result]()
        runs.append(spent(lambda one=experiment, found=found: found.append(one.run())))
        whole.append(runs[-1] + spent(lambda found=found: found[0].verdict))
    told = "a run with its verdict, by the run" + ", innovations explained" * (r_scale != 1)
    row(told, _ratio(whole[2:], runs[2:]), BEFORE[what])
    assert _ratio(whole[2:], runs[2:]) < bar


def test_a_sweep_beside_runs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"navigator.q_scale": [0.3, 1.0, 3.0, 10.0, 30.0]}
    first = montreal(40)
    sweeping.KEPT.clear()
    abreast = spent(lambda: first.sweep(values, 24, workers=1)) / 120
    monkeypatch.setattr(sweeping, "FEW", 10**9)
    alone = spent(lambda: montreal(80).sweep(values, 4, workers=1)) / 20
    row("runs of a sweep of 120 in the time of one alone", alone / abreast, BEFORE["sweep"])
    assert alone > 2 * abreast


def test_outages_beside_ten_lines() -> None:
    """The table of some cards in fast, by the loop that a user would write; for each run."""

    def ten_lines(seeds: range) -> None:
        for name in CARDS:
            for seed in seeds:
                experiment = montreal(seed)
                card(name).load(experiment)
                experiment.set("sensors.gps.outages", [(100.0, 160.0)])
                result = experiment.run()
                end = int(np.searchsorted(result.time, 160.0)) - 1
                float(np.hypot(*result.errors.position.values[end, :2]))

    def table(first: int, seeds: int) -> None:
        montreal(first).outage(60.0, CARDS, seeds, workers=1)

    table(1, 8)
    ten_lines(range(1, 2))
    abreast = spent(lambda: table(200, 100)) / 100
    alone = spent(lambda: ten_lines(range(300, 304))) / 4
    row("runs of a table of outages in the time of one by hand", alone / abreast, BEFORE["outage"])
    assert alone > 7 * abreast


MEMORY = """
import resource, sys
from lab import Experiment
from lab.experiment.ensembles.seeds import run_ensemble
experiment = Experiment(mission="los_angeles").update({"trajectory.imu_rate": 10.0})
run_ensemble(experiment, 100)
run_ensemble(experiment, range(1000, 1000 + int(sys.argv[1])))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.skipif(
    sys.platform != "linux", reason="other systems count memory in other units, or not at all"
)
def test_ten_thousand_seeds_in_the_memory_of_a_hundred() -> None:
    most = []
    for runs in (100, 10_000):
        command = [sys.executable, "-c", MEMORY, str(runs)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        most.append(int(done.stdout.split()[-1]))
    row("largest memory of 10,000 seeds, by that of 100", most[1] / most[0], 1.05)
    assert most[1] < 1.1 * most[0]


def _ratio(some: list[float], others: list[float]) -> float:
    return float(np.median(np.array(some) / np.array(others)))
