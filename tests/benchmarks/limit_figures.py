"""Limit figures: the NEES of docs/limits.md that no test repeats, each of its parts 1 for a right filter.

``python -m tests.benchmarks.limit_figures [words in names ...]`` prints a row for each case: the mean over
seeds, and for some at several times.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import lab
from lab.analysis.consistency import find_uncertain_states, normalised_squares
from lab.base.arrays import FloatArray
from lab.experiment.result import Result
from lab.motion.recordings.flight_csv import write_flight_csv
from lab.motion.recordings.recording import Recording
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, GYRO_BIAS, VEL
from lab.sensors.cards import cards
from tests.aided_flights import flight, winding_road
from tests.benchmarks.state_statistics import states_at
from tests.place_flights import looping

SEEDS, MANY = 24, 100
WIND, SCALE = slice(blocks.CORE, blocks.CORE + 2), slice(blocks.CORE + 2, blocks.CORE + 3)
"""The states of an airspeed sensor alone."""
AIRSPEED: dict[str, Any] = {"sensors.airspeed.fitted": True, "trajectory.imu_rate": 50.0}
QUICK = AIRSPEED | {"sensors.airspeed.noise": 0.3, "sensors.airspeed.period": 0.1}
EVERYTHING = slice(None)
AFTER = 0.0, 1.0, 5.0
"""Times after the start [s] at which biases are compared."""


def nees(result: Result, states: Sequence[slice], times: Sequence[float] = ()) -> FloatArray:
    """Return NEES for each degree of freedom of parts of the states, at all fixes or some times."""
    solution = result.solution_arrays
    used = np.flatnonzero(solution.fix_sample >= 0)
    if times:
        begin = result.fixes.time[used[0]]
        used = used[np.searchsorted(result.fixes.time[used], begin + np.array(times))]
    x = states_at(result, used)
    P = solution.fix_covariance[used]
    found = []
    for part in states:
        own = P[:, part, part]
        squares = normalised_squares(np.ascontiguousarray(x[:, part]), np.ascontiguousarray(own))
        found.append(squares / max(find_uncertain_states(own).size, 1))
    return np.array(found) if times else np.mean(found, axis=1)


def mean(
    mission: Path | str, settings: dict[str, Any], states: Sequence[slice], seeds: int = SEEDS
) -> FloatArray:
    """Return NEES of parts of the states, the mean of seeds."""
    return np.mean([nees(flight(mission, seed, settings).run(), states) for seed in range(seeds)], axis=0)


def told(parts: Sequence[str], where: str, values: FloatArray | Sequence[float]) -> None:
    """Print a row for each part."""
    for part, value in zip(parts, values, strict=True):
        print(f"NEES of {part}, {where}: {value:.2f}", flush=True)


def airspeed(folder: Path) -> None:
    """Print NEES of wind and scale factor."""
    loops = folder / "loops.csv"
    write_flight_csv(loops, looping())
    for name, mission, settings in (
        ("defaults", "montreal", AIRSPEED),
        ("noise of 0.3 m/s", "montreal", QUICK),
        ("a wind that never changes", "montreal", AIRSPEED | {"sensors.airspeed.wind_drift_sigma": 0.0}),
        ("a wind of 8 m/s", "montreal", QUICK | {"sensors.airspeed.wind_sigma": 8.0}),
        ("loops", loops, AIRSPEED),
        ("loops, a wind of 1 m/s", loops, AIRSPEED | {"sensors.airspeed.wind_sigma": 1.0}),
    ):
        told(("the wind", "the scale factor"), name, mean(mission, settings, (WIND, SCALE), MANY))


def wheels(folder: Path) -> None:
    """Print NEES of a car that turns about a place 1 m ahead of its odometer: its nose leads in turns."""
    road = winding_road(folder, drift=1 / 15)
    settings = {"sensors.odometer.fitted": True, "navigator.no_slip": True, "trajectory.imu_rate": 50.0}
    found = mean(road, settings, (EVERYTHING, ACCEL_BIAS))
    told(("all states", "the accelerometer biases"), "wheels 1 m away", found)


def alignment(_: Path) -> None:
    """Print the lowest and the highest NEES of biases after an alignment, of cards with flicker."""
    early, later = [], []
    for one in cards().values():
        made = lab.Experiment(mission="montreal")
        one.load(made)
        if not np.any(made.sensors.gyro.flicker) or not made.navigator.alignment:
            continue
        made.set("trajectory.imu_rate", 50.0)
        results = []
        for seed in range(SEEDS // 2):
            made.seed = seed
            results.append(made.run())
        early.append(np.mean([nees(one, (GYRO_BIAS,), AFTER)[0] for one in results], axis=0))
        if np.any(made.sensors.accelerometer.flicker):
            later.append(np.mean([nees(one, (ACCEL_BIAS, VEL)) for one in results], axis=0))
    for name, edge in (("lowest", np.min), ("highest", np.max)):
        for after, value in zip(AFTER, edge(early, axis=0), strict=True):
            told(("the gyro biases",), f"{after:g} s after an alignment, {name} of the cards", [value])
        parts = "the accelerometer biases", "the velocity"
        told(parts, f"after an alignment, {name} of the cards", edge(later, axis=0))
    print(f"{len(early)} cards have flicker of the gyros, {len(later)} also of the accelerometers")


def track(seconds: float, leg: float, rate: float) -> Recording:
    """Return racetracks at 60 m/s with legs [s] and turns [°/s], banked; without legs, a circle."""
    step = 0.25
    t = np.arange(0.0, seconds + step / 2, step)
    turning = t % (leg + 180 / rate) >= leg
    omega = np.convolve(np.pad(np.radians(rate) * turning, 12, mode="edge"), np.full(25, 1 / 25), "valid")
    course = np.concatenate(([0.0], np.cumsum((omega[1:] + omega[:-1]) / 2 * step)))
    velocity = 60.0 * np.stack((np.cos(course), np.sin(course), 0 * t), axis=-1)
    way = np.concatenate((np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) / 2 * step, axis=0)))
    latitude = np.radians(45.0) + way[:, 0] / 6.367e6
    longitude = way[:, 1] / (6.389e6 * np.cos(np.radians(45.0)))
    euler = np.stack((np.arctan(60 * omega / 9.81), 0 * t, np.angle(np.exp(1j * course))), axis=-1)
    return Recording(t, latitude, longitude, np.full_like(t, 500.0), velocity, euler)


def hours(folder: Path) -> None:
    """Print NEES of two hours of racetracks and of circles."""
    for name, made, models in (
        ("racetracks", track(7200.0, 140.0, 3.0), ("phi", "invariant", "nonlinear")),
        ("circles", track(7200.0, 0.0, 1.0), ("phi", "invariant")),
    ):
        path = folder / f"{name}.csv"
        write_flight_csv(path, made)
        for model in models:
            settings = {"trajectory.imu_rate": 50.0, "navigator.model": model}
            told(("all states",), f"two hours of {name}, {model}", mean(path, settings, (EVERYTHING,), 3))


CASES = {"airspeed": airspeed, "wheels": wheels, "alignment": alignment, "hours": hours}
"""What is printed, by name."""


def main(words: list[str]) -> None:
    """Print the cases whose name has a word; without words, all."""
    with tempfile.TemporaryDirectory() as folder:
        for name, case in CASES.items():
            if not words or any(word in name for word in words):
                case(Path(folder))


if __name__ == "__main__":
    main(sys.argv[1:])
