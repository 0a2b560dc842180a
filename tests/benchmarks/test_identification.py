"""Simulated controls of the identification: how often the intervals hold the truth, and how long it takes."""

from __future__ import annotations

from collections import Counter

import pytest

from lab import Experiment

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


def test_ten_minutes_take_a_minute_at_most() -> None:
    """Of a flight of 205 s a third."""
    assert Experiment(mission="montreal").run().identify().seconds < 60 * 205 / 600
