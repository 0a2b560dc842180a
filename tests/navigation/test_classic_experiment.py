"""The classic experiment on both missions: errors, and what the filter says of them, over many seeds."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import pytest

from lab.analysis.consistency import chi_square_interval
from lab.base.arrays import FloatArray
from lab.experiment.experiment import Experiment
from lab.experiment.stages import CACHE

MISSIONS = ("montreal", "los_angeles")
SEEDS = 100
RATE = 50.0
"""Rate of the IMU [Hz] where what comes with the fixes is judged: NEES, NIS, innovations."""
SHOWN = 20
"""Seeds of which the errors, and the innovations, are looked at one by one."""


class Runs(NamedTuple):
    """What is kept of all seeds of one mission.

    Attributes
    ----------
    rms, largest : (runs, 3) arrays
        Position errors east, north, up after the first 10 s [m].
    autocorrelation : (runs, lags, 3) array
        Of the position innovations, lags from 1 on.
    band : float
        Half-width of its 95 % band.
    nees, nis : (runs, fixes) arrays
        Consistency after the first 20 s.
    """

    rms: FloatArray
    largest: FloatArray
    autocorrelation: FloatArray
    band: float
    nees: FloatArray
    nis: FloatArray


def fly(mission: str, runs: int, rate: float | None = None, **settings: float) -> Runs:
    """Run the experiment for many seeds, at an IMU rate [Hz], with settings of the navigator."""

    def one(seed: int) -> tuple[FloatArray | float, ...]:
        experiment = Experiment(mission=mission, seed=seed)
        if rate is not None:
            experiment.set("trajectory.imu_rate", rate)
        for name, value in settings.items():
            experiment.set(f"navigator.{name}", value)
        result = experiment.run()
        error = result.errors.position.values[result.time > 10]
        correlation = result.autocorrelation
        late = result.fixes.time > 20
        nees, nis = result.consistency.nees.values[late], result.innovations.nis.values[late]
        rms = np.sqrt(np.mean(error**2, axis=0))
        return rms, np.abs(error).max(axis=0), correlation.position.values[1:], correlation.band, nees, nis

    with ThreadPoolExecutor(2) as pool:
        columns = [np.array(column) for column in zip(*pool.map(one, range(1, runs + 1)), strict=True)]
    CACHE.clear()
    return Runs(columns[0], columns[1], columns[2], float(columns[3][0]), columns[4], columns[5])


@pytest.fixture(scope="module", params=MISSIONS)
def matched(request: pytest.FixtureRequest) -> tuple[str, Runs]:
    """Return a mission's name and its runs with the filter matched to the sensors."""
    return request.param, fly(request.param, SEEDS, RATE)


def inside(values: FloatArray, degrees: int) -> float:
    """Return the part of the epochs at which the mean over the runs lies in its 95 % χ² interval."""
    low, high = chi_square_interval(degrees, values.shape[0])
    mean = values.mean(axis=0)
    return float(np.mean((low < mean) & (mean < high)))


def consistent(name: str, runs: Runs) -> tuple[float, float]:
    """Return, and print, at which part of the epochs NEES and NIS are inside their intervals."""
    nees, nis = inside(runs.nees, 15), inside(runs.nis, 6)
    print(
        f"\n{name}, {SEEDS} seeds: NEES {runs.nees.mean():.2f} on average, inside at {100 * nees:.1f} %; "
        f"NIS {runs.nis.mean():.2f}, inside at {100 * nis:.1f} % of epochs"
    )
    return nees, nis


@pytest.mark.proof
@pytest.mark.parametrize("mission", MISSIONS)
def test_position_errors_stay_small(mission: str) -> None:
    """At the full rate of the IMU."""
    runs = fly(mission, SHOWN)
    rms, largest = runs.rms, runs.largest
    print(
        f"\n{mission}, {SHOWN} seeds, position error east, north, up: "
        f"rms up to {rms.max(axis=0).round(3)} m, never above {largest.max(axis=0).round(2)} m"
    )
    assert rms.max() <= 0.6
    assert largest.max() <= 3.0
    assert rms.min() > 0.05, "the receiver's errors are not without effect"


def test_position_innovations_are_white(matched: tuple[str, Runs]) -> None:
    name, runs = matched
    within = np.abs(runs.autocorrelation[:SHOWN]) < runs.band
    print(f"\n{name}, {SHOWN} seeds: {100 * within.mean():.1f} % of lags 1-30 inside ±{runs.band:.3f}")
    assert within.shape[1] == 30
    assert within.mean() >= 0.9


def test_the_filter_tells_the_truth_about_itself(matched: tuple[str, Runs]) -> None:
    name, runs = matched
    nees, nis = consistent(name, runs)
    assert nees >= 0.9
    assert nis >= 0.9


@pytest.mark.proof
@pytest.mark.parametrize("settings", [{"q_scale": 100.0}, {"r_scale": 0.01}], ids=["Q × 100", "R ÷ 100"])
@pytest.mark.parametrize("mission", MISSIONS)
def test_wrong_noise_shows_in_nees_and_nis(mission: str, settings: dict[str, float]) -> None:
    nees, nis = consistent(f"{mission}, {settings}", fly(mission, SEEDS, RATE, **settings))
    assert nees < 0.5
    assert nis < 0.9


@pytest.mark.proof
@pytest.mark.parametrize("settings", [{"q_scale": 0.01}, {"r_scale": 100.0}], ids=["Q ÷ 100", "R × 100"])
@pytest.mark.parametrize("mission", MISSIONS)
def test_too_little_gain_colours_the_innovations(mission: str, settings: dict[str, float]) -> None:
    runs = fly(mission, SHOWN, RATE, **settings)
    within = np.abs(runs.autocorrelation) < runs.band
    first = runs.autocorrelation[:, 0].mean()
    print(f"\n{mission}, {settings}: {100 * within.mean():.1f} % of lags inside, lag 1 is {first:.2f}")
    assert within.mean() < 0.9
    assert first > 0.1
