"""Speed of the laboratory on one core, in medians, beside what it has to reach.

Other programs on the machine disturb these figures: where one misses, look at its minimum and repeat.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyins.filters
import pyins.inertial_sensor
import pyins.measurements
import pyins.util
import pyins_reference
import pytest
from sized_models import with_states

from lab.analysis.errors import position_error
from lab.base.arrays import FloatArray
from lab.base.parameters.units import si
from lab.experiment.ensembles import seeds as many_seeds
from lab.experiment.ensembles.seed_lanes import SeedLanes
from lab.experiment.ensembles.seeds import at_fast_rate, run_ensemble
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE, start
from lab.experiment.variants import compile_lanes
from lab.missions import fly, mission
from lab.navigation.belief import FAST_RATE, belief
from lab.navigation.filters import unscented
from lab.navigation.filters.error_models import MODELS
from lab.navigation.navigator import Fixes, Imu, navigate
from lab.sensors.cards import card

pytestmark = pytest.mark.benchmark


@pytest.fixture(scope="module", autouse=True)
def one_core() -> Iterator[None]:
    """Keep this process, and those it starts, on one core, where the system lets us."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    yield
    os.sched_setaffinity(0, before)


@pytest.fixture(scope="module", autouse=True)
def heading() -> None:
    """Print the head of the table."""
    print(f"\n\n{'what':<66}{'median':>12}{'minimum':>12}{'bar':>12}\n{'-' * 102}")


def row(what: str, seconds: list[float], bar: float | None = None) -> float:
    """Print one line of the table, and return the median."""
    median = float(np.median(seconds))
    print(f"{what:<66}{_show(median):>12}{_show(min(seconds)):>12}{_show(bar) if bar else '':>12}")
    return median


def _show(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 1 else f"{1e3 * seconds:.2f} ms"


def timed(function: Callable[[], object], repetitions: int) -> list[float]:
    """Return how long each call takes [s]."""
    seconds = []
    for _ in range(repetitions):
        begin = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - begin)
    return seconds


@pytest.fixture(scope="module")
def montreal() -> Result:
    """Return the classic experiment."""
    return Experiment(mission="montreal").run()


@pytest.mark.parametrize("name", ["phi", "psi", "invariant", "nonlinear"])
def test_21_states_beside_15(montreal: Result, name: str) -> None:
    """The two in turns, so that what disturbs one disturbs the other."""
    experiment = montreal.experiment.copy()
    imu = Imu(montreal.ideal.time, montreal.gyro.increments, montreal.accelerometer.increments)
    fixes = Fixes(montreal.fixes.time, montreal.fixes.position, montreal.fixes.velocity_n)
    begin = start(montreal.truth_arrays, experiment.navigator, experiment.seed)
    seconds: dict[int, list[float]] = {15: [], 21: []}
    runs: dict[int, Callable[[], object]] = {}
    for states in seconds:
        experiment.set("navigator.states", states)
        assumed = belief(experiment.sensors, experiment.navigator)
        if name == "nonlinear":
            runs[states] = partial(unscented.navigate, imu, fixes, begin, assumed)
        else:
            model = with_states(MODELS[name], states)
            runs[states] = partial(navigate, imu, fixes, begin, assumed, model=model)
        runs[states]()
    for _ in range(9 if name == "nonlinear" else 51):
        for states, run in runs.items():
            seconds[states] += timed(run, 1)
    few = row(f"montreal, {name}, 15 states", seconds[15])
    many = row(f"montreal, {name}, 21 states", seconds[21], 2 * few)
    assert many <= 2 * few


@pytest.fixture(scope="module")
def navigation(montreal: Result) -> Callable[[], object]:
    """Return the navigation stage alone, all histories stored."""
    imu = Imu(montreal.ideal.time, montreal.gyro.increments, montreal.accelerometer.increments)
    fixes = Fixes(montreal.fixes.time, montreal.fixes.position, montreal.fixes.velocity_n)
    begin = start(montreal.truth_arrays, montreal.experiment.navigator, montreal.experiment.seed)
    return lambda: navigate(imu, fixes, begin, montreal.belief)


def test_one_run(montreal: Result, navigation: Callable[[], object]) -> None:
    samples = montreal.gyro.increments.shape[0]
    assert samples >= 40_000
    timed(navigation, 5)
    median = row(f"montreal, {samples} samples, P at 200 Hz, all histories", timed(navigation, 101), 12e-3)
    assert median <= 12e-3


def test_many_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs abreast beside those one by one, in turns; in the processor's time, as threads share a core."""
    experiment = Experiment(mission="montreal")
    compile_lanes()
    run_ensemble(experiment, 2)
    seconds: dict[int, list[float]] = {100: [], 1000: []}
    for first in (10_000, 20_000):  # seeds that no cache has
        for runs, kept in seconds.items():
            monkeypatch.setattr(many_seeds, "FEW", 101)
            begin = time.process_time()
            run_ensemble(experiment, range(first + runs, first + 2 * runs))
            kept.append((time.process_time() - begin) / runs)
    alone = row("montreal, a run of 100 seeds, one by one", seconds[100])
    abreast = row("the same, of 1,000 seeds, eight abreast", seconds[1000], alone / 3.5)
    print(f"{1 / alone:.0f} and {1 / abreast:.0f} runs per second and core: {alone / abreast:.1f} times")
    assert abreast < alone / 3.5


BEFORE = {"the first 100": 2.25, "1,000 seeds": 0.83}
"""Processor time of a run of an ensemble at commit 8cd95b72, in that of the navigation of a single run."""


def test_ratios_of_ensembles(navigation: Callable[[], object]) -> None:
    """Ratios to the navigation of a single run, which other work on the machine changes as it does these."""
    experiment = Experiment(mission="montreal")
    compile_lanes()
    for one in (experiment, at_fast_rate(experiment)):
        run_ensemble(one, range(500, 600))
    found: dict[str, list[float]] = {}
    for first in (30_000, 40_000):
        alone = np.median([_on_the_processor(navigation) for _ in range(25)])
        for fast in (False, True):
            for what, runs in (("the first 100", 100), ("1,000 seeds", 1000)):
                work = partial(run_ensemble, experiment, range(first, first + runs), fast=fast)
                name = f"a run of {what}{', fast' * fast}"
                found.setdefault(name, []).append(_on_the_processor(work) / runs / float(alone))
    for name, ratios in found.items():
        before = next(ratio for what, ratio in BEFORE.items() if what in name)
        print(f"{name:<66}{np.median(ratios):>12.2f}{min(ratios):>12.2f}{'before':>12}{before:>8.2f}")
        assert min(ratios) < 1.1 * before


@pytest.mark.parametrize("name", ["BMI270", "ADIS16470", "HG9900"])
def test_cards_abreast(name: str) -> None:
    """A consumer, an industrial and a navigation-grade card: runs alone beside those abreast, also fast."""
    experiment = Experiment(mission="montreal")
    card(name).load(experiment)
    seconds: list[float] = []
    for rate in (0.0, FAST_RATE):
        experiment.set("navigator.filter_rate", rate)
        lanes = SeedLanes.of(experiment)
        assert lanes is not None
        list(lanes.measure(range(8)))
        own = [experiment.copy().update({"seed": seed}) for seed in range(100, 104)]
        own[0].run()
        alone = [_on_the_processor(one.run) for one in own[1:]]
        blocks = [partial(lanes.measure, range(first, first + 8)) for first in (200, 208, 216)]
        abreast = [_on_the_processor(block) / 8 for block in blocks]
        seconds += [float(np.median(alone)), float(np.median(abreast))]
    print(f"{name}: {1e3 * seconds[0]:.0f} ms alone, {1e3 * seconds[1]:.1f} abreast", end="")
    print(f"; fast {1e3 * seconds[2]:.0f} and {1e3 * seconds[3]:.1f} ms")
    assert seconds[3] < seconds[1] < 0.8 * seconds[0]


def _on_the_processor(work: Callable[[], object]) -> float:
    """Return the processor time of a function [s]."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def pyins_filter(result: Result) -> Callable[[], FloatArray]:
    """Return python-ins' filter on the data of a run, matched like ours, at its default step."""
    truth, sensors, navigator = result.truth_arrays, result.experiment.sensors, result.experiment.navigator
    begin = start(truth, navigator, result.experiment.seed)
    lla = np.column_stack((np.degrees(result.fixes.position[:, :2]), result.fixes.position[:, 2]))
    position = pd.DataFrame(lla, result.fixes.time, pyins.util.LLA_COLS)
    velocity = pd.DataFrame(result.fixes.velocity_n, result.fixes.time, pyins.util.VEL_COLS)
    euler = np.degrees(result.euler[0])
    pva = np.concatenate((np.degrees(begin.position[:2]), begin.position[2:], begin.velocity_n, euler))
    models = [
        pyins.inertial_sensor.EstimationModel(si(errors, "bias_sigma"), si(errors, "noise_density"))
        for errors in (sensors.gyro, sensors.accelerometer)
    ]
    increments = pyins_reference.increments(
        result.ideal.time, result.gyro.increments, result.accelerometer.increments
    )

    def run() -> FloatArray:
        found = pyins.filters.run_feedback_filter(
            pd.Series(pva, pyins.util.TRAJECTORY_COLS, name=result.ideal.time[0]),
            *(navigator.position_sigma[0], navigator.velocity_sigma[0]),
            *(navigator.attitude_sigma[0], navigator.attitude_sigma[2]),
            increments,
            *models,
            [
                pyins.measurements.Position(position, np.sqrt(sensors.gps.position_variance[0])),
                pyins.measurements.NedVelocity(velocity, np.sqrt(sensors.gps.velocity_variance[0])),
            ],
        )
        path = np.array(found.trajectory[pyins.util.LLA_COLS])
        return np.column_stack((np.radians(path[:, :2]), path[:, 2]))

    return run


@pytest.mark.filterwarnings("ignore")
def test_against_python_ins(montreal: Result, navigation: Callable[[], object]) -> None:
    """The same data, the same model; that it does the same job is seen from its errors."""
    found: list[FloatArray] = []
    run = pyins_filter(montreal)
    run_short = timed(lambda: found.append(run()), 1)
    theirs = row("the same by python-ins run_feedback_filter, P at 10 Hz", run_short)
    ours = float(np.median(timed(navigation, 101)))
    print(f"{'times faster':<66}{theirs / ours:>12.0f}{'':>12}{1000:>12}")
    late = montreal.time > 10
    apart = position_error(found[0], montreal.truth_arrays)[late]
    own = position_error(montreal.solution_arrays.position, montreal.truth_arrays)[late]
    rms = [float(np.sqrt(np.mean(error**2))) for error in (apart, own)]
    assert rms[0] == pytest.approx(rms[1], rel=0.1)
    assert theirs / ours >= 1000


def test_a_change_of_r_recomputes_navigation_and_analysis_only() -> None:
    experiment = Experiment(mission="montreal")
    experiment.run()
    scales = iter(np.geomspace(0.5, 2, 40))
    before = dict(CACHE.computed)
    analysed: list[float] = []

    def change() -> None:
        experiment.set("navigator.r_scale", float(next(scales)))
        result = experiment.run()
        analysed.extend(
            timed(lambda: (result.errors, result.sigma, result.innovations, result.autocorrelation), 1)
        )

    seconds = timed(change, 40)
    row("a change of R, from settings to errors, σ and innovations", seconds)
    row("of that, the analysis", analysed)
    computed = {stage: count - before.get(stage, 0) for stage, count in CACHE.computed.items()}
    assert {stage for stage, count in computed.items() if count} == {"navigation"}
    assert computed["navigation"] == 40


def fresh(code: str, **environment: str) -> str:
    """Run code in a fresh interpreter and return what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_first_run_in_a_fresh_process() -> None:
    code = "from lab import Experiment; Experiment().run().summary"
    fresh(code)
    median = row("first run in a fresh process, imports included", timed(lambda: fresh(code), 5), 2.0)
    assert median <= 2.0


COLD = """
import json, time
from lab import Experiment
begin = time.perf_counter()
seen = []
Experiment().run(lambda stage, done: seen.append((stage, done, time.perf_counter() - begin)))
print(json.dumps(seen))
"""


def test_cold_compilation_is_told(tmp_path: Path) -> None:
    """Nobody waits for the compiler without being told so, and nobody is told so without waiting."""
    cold = json.loads(fresh(COLD, NUMBA_CACHE_DIR=str(tmp_path)))
    times = {stage: seconds for stage, _, seconds in cold}
    told = next(stage for stage in times if "compiled" in stage)
    row("cold compilation of the navigator (once per machine)", [times["Done"] - times[told]])
    row("until it is told", [times[told]])
    fractions = [fraction for _, fraction, _ in cold]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1
    warm = json.loads(fresh(COLD, NUMBA_CACHE_DIR=str(tmp_path)))
    assert not [stage for stage, _, _ in warm if "compiled" in stage]
    row("the whole run with a warm cache", [warm[-1][2]])


def test_flying_montreal() -> None:
    pytest.importorskip("jsbsim")
    plan = mission("montreal").plan
    median = row("montreal flown in JSBSim, 205 s at 1 ms", timed(lambda: fly(plan), 3), 10.0)
    assert median <= 10.0


def test_import() -> None:
    bare = float(np.median(timed(lambda: fresh("pass"), 5)))
    fresh("import lab")
    seconds = [one - bare for one in timed(lambda: fresh("import lab"), 5)]
    assert row("import lab, beyond a bare interpreter", seconds, 1.5) <= 1.5


COMMAND = "import sys; from dashboards.command_line import main; sys.argv = ['ins-lab', {}]; main()"
ANSWERS = {
    "ins-lab --help": (COMMAND.format("'--help'"), 0.25),
    "ins-lab run montreal": (COMMAND.format("'run', 'montreal'"), 1.5),
    "from lab import Experiment": ("from lab import Experiment", 1.0),
    "the same, and a first run": ("from lab import Experiment; Experiment().run()", 2.0),
}


@pytest.mark.skipif(os.name == "nt", reason="Windows tells no time of other processes")
@pytest.mark.parametrize("what", ANSWERS)
def test_time_on_the_processor_until_an_answer(what: str) -> None:
    code, bar = ANSWERS[what]
    seconds = []
    for _ in range(6):
        before = os.times()
        fresh(code, OPENBLAS_NUM_THREADS="1")
        after = os.times()
        seconds.append(after.children_user + after.children_system - sum(before[2:4]))
    assert row(f"{what}, on the processor", seconds[1:], bar) <= bar  # the first may have to compile
