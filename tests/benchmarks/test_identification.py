"""Simulated controls of the identification: how often the intervals hold the truth, and how long it takes."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from lab import Experiment
from lab.analysis.identification.renavigation import subject
from lab.motion.truth.trajectory import Trajectory
from tests.benchmarks.long_flight import recording
from tests.sensor_logs import RATE, tables, write

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(7200)]

SEEDS = 100
TRUE = {
    "gyro noise density": 0.05,
    "horizontal position variance": 0.5,
    "vertical position variance": 0.5,
    "velocity variance": 0.2,
    "latency": 0.2,
    "lever arm forward": 2.0,
    "lever arm right": 0.0,
    "lever arm down": 0.0,
}


def test_each_interval_holds_the_truth_in_90_of_100_seeds() -> None:
    held: Counter[str] = Counter()
    for seed in range(1, SEEDS + 1):
        made = Experiment(mission="montreal", seed=seed)
        made.sensors.gps.update({"latency": 0.2, "lever_arm": (2.0, 0.0, 0.0)})
        made.navigator.update({"q_scale": 0.1, "r_scale": 10.0, "latency": 0.0, "lever_arm": (0.0, 0.0, 0.0)})
        rows = {row.parameter: row for row in made.run().identify().rows}
        held.update(name for name, true in TRUE.items() if rows[name].low <= true <= rows[name].high)
    assert {name: held[name] for name in TRUE if held[name] < 0.9 * SEEDS} == {}


def test_a_log_of_ten_minutes_takes_ten_seconds_of_a_processor(tmp_path: Path) -> None:
    flight = Trajectory.from_recording(recording(1 / 6), RATE)
    log = write(tmp_path / "ten", tables(5.0, 598.0, flight=flight))
    run = Experiment(mission=str(log)).run()
    began = time.process_time()
    found = run.identify()
    taken = time.process_time() - began
    print(f"identification of a log of ten minutes: {taken:.1f} s of a processor, {found.fixes} fixes")
    assert taken < 10


def test_a_sample_of_39_states_takes_at_most_12_times_one_of_15() -> None:
    """P has 7 times as many elements."""
    many = {"states": 21, "estimate_misalignments": True, "estimate_bias_drift": True}

    def seconds(settings: dict[str, object]) -> float:
        made = Experiment(mission="montreal", seed=1)
        made.navigator.update(settings)
        run = made.run()
        one, none, taken = subject(run), np.zeros(run.fixes.time.size, np.bool_), []
        for _ in range(5):
            began = time.process_time()
            one.navigate(run.experiment, none)
            taken.append(time.process_time() - began)
        return min(taken)

    assert seconds(many) < 12 * seconds({})
