"""Card matrix: every card on every mission as it is loaded; what the verdict finds, NEES, and outages.

Run it with ``python -m tests.benchmarks.card_matrix [seeds] [50Hz] [--no-assumed] [words in names]``.
Seeds begin with 1001; 20 are usual. Each run counts as flagged if its verdict finds anything at all, whatever
the remarks of the result say. The IMU rate is that of the laboratory unless one is given, with its unit.
"""

from __future__ import annotations

import sys
from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.consistency import find_uncertain_states, normalised_squares
from lab.analysis.errors import error_state
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE
from lab.sensors.cards import card, cards
from tests.benchmarks.faults import MISSIONS

FIRST = 1001
"""The first seed."""
OUTAGE = (100.0, 160.0)
"""An outage of a minute [s], in runs of its own."""
NEES = (0.8, 1.3)
"""Bounds of NEES per state of a card over all missions."""
RATIO = (0.8, 1.2)
"""Bounds of error over σ of position at the end of an outage, rms of a card over missions and axes."""


class Run(NamedTuple):
    """What counts of a run: NEES per state, rms of the position [m], computing time [s], what is found."""

    nees: float
    position: float
    seconds: float
    found: list[str]


def errors_at(result: Result, samples: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the errors of all states at some samples."""
    solution = result.solution_arrays
    return error_state(
        solution,
        samples,
        result.known_truth("errors"),
        result.true_bias,
        result.true_scale if solution.scale.size else None,
        result.true_further() if solution.further.size else None,
    )


def measured(experiment: Experiment) -> Run:
    """Return what counts of a run."""
    result = experiment.run()
    solution = result.solution_arrays
    used = solution.fix_sample >= 0
    x, P = errors_at(result, solution.fix_sample[used]), solution.fix_covariance[used]
    return Run(
        float(normalised_squares(x, P).mean()) / find_uncertain_states(P).size,
        float(np.sqrt(np.mean(np.sum(x[:, :3] ** 2, axis=1)))),
        result.seconds,
        [finding.quantity for finding in result.verdict.findings],
    )


def ends(experiment: Experiment) -> NDArray[np.float64]:
    """Return error over σ of the position, north, east, down, at the end of an outage; none if too short."""
    outage = experiment.copy()
    outage.set("sensors.gps.outages", [OUTAGE])
    result = outage.run()
    if result.time[-1] < OUTAGE[1]:
        return np.zeros((0, 3))
    at = np.searchsorted(result.time, [OUTAGE[1]]) - 1
    return np.asarray(errors_at(result, at)[:, :3] / np.sqrt(result.solution_arrays.variance[at, :3]))


def judged(value: float, bounds: tuple[float, float]) -> str:
    """Return a value as text, marked if it is out of bounds."""
    return f"{value:.2f}" + ("" if bounds[0] <= value <= bounds[1] else "!")


def main(arguments: list[str]) -> None:
    """Print the matrix."""
    words = [word for word in arguments if word != "--no-assumed"]
    seeds = int(words.pop(0)) if words and words[0].isdigit() else 20
    rates = [word.removesuffix("Hz") for word in words if word.removesuffix("Hz").isdigit()]
    words = [word for word in words if not word.removesuffix("Hz").isdigit()]
    flagged, runs, seconds, means = 0, 0, dict[str, list[float]](), list[float]()
    for name, entry in cards().items():
        if words and not any(word in name for word in words):
            continue
        squares, ratios, line, found = list[float](), list[NDArray[np.float64]](), list[str](), Counter[str]()
        for mission in MISSIONS:
            done = []
            for seed in range(FIRST, FIRST + seeds):
                experiment = Experiment(mission=mission, seed=seed)
                if rates:
                    experiment.set("trajectory.imu_rate", float(rates[0]))
                card(name, assumed="--no-assumed" not in arguments).load(experiment)
                done.append(measured(experiment))
                ratios.append(ends(experiment))
            CACHE.clear()
            squares += [one.nees for one in done]
            line.append(
                f"{mission[:4]} {np.mean([one.nees for one in done]):.2f} "
                f"{np.mean([one.position for one in done]):.2f} m"
            )
            found.update(quantity for one in done for quantity in one.found)
            flagged += sum(bool(one.found) for one in done)
            runs += seeds
            seconds.setdefault(entry.grade, []).append(min(one.seconds for one in done))
        means.append(float(np.mean(squares)))
        axes = np.sqrt(np.mean(np.square(np.concatenate(ratios)), axis=0))
        print(
            f"{name:20} NEES/n {judged(means[-1], NEES):6} ({', '.join(line)}); outage error/σ "
            f"{' '.join(judged(ratio, RATIO) for ratio in axes)}; found {dict(found.most_common(4))}",
            flush=True,
        )
    times = ", ".join(f"{grade} {1e3 * np.median(values):.0f} ms" for grade, values in seconds.items())
    print(f"{flagged} of {runs} runs flagged; mean NEES/n of the cards {np.mean(means):.3f}; a run: {times}")


if __name__ == "__main__":
    main(sys.argv[1:])
