"""Card matrix: every card on every mission with the defaults a user gets; what is flagged, and the NEES.

Run it with ``python -m tests.benchmarks.card_matrix [seeds] [--no-assumed] [words in names of cards ...]``. A
run counts as flagged if the verdict finds what no remark of the result names as its reason.
"""

from __future__ import annotations

import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from lab.analysis.consistency import chi_square_interval
from lab.experiment import Experiment
from lab.result import Result
from lab.sensors.cards import card, cards
from lab.stages import CACHE
from tests.benchmarks.faults import MISSIONS

REASONS = {
    "misalignment": ".misalignment",
    "g-sensitivity": ".g_sensitivity",
    "scale factor": ".scale_factor",
    "bandwidth": ".bandwidth",
}
"""Findings that a remark names in advance as what the filter has no state for, and the setting it names."""


def unexplained(result: Result) -> list[str]:
    """Return the quantities of a verdict that no remark of the result names."""
    told = " ".join(result.remarks)
    return [
        finding.quantity
        for finding in result.verdict.findings
        if not any(finding.quantity.endswith(word) and path in told for word, path in REASONS.items())
    ]


def inside(results: list[Result]) -> float:
    """Return the part of the epochs at which the mean NEES of all runs is in its 95 % interval."""
    nees = [result.consistency["nees"] for result in results]
    epochs = min(values.size for values in nees)
    mean = np.mean([values.to_numpy()[:epochs] for values in nees], axis=0)
    low, high = chi_square_interval(float(nees[0].attrs["degrees"]), len(results))
    return float(np.mean((mean >= low) & (mean <= high)))


def run(name: str, mission: str, seed: int, *, assumed: bool) -> tuple[Result, list[str], list[str]]:
    """Return a run of a card, what is flagged, and all that is found."""
    experiment = Experiment(mission=mission, seed=seed)
    card(name, assumed=assumed).load(experiment)
    result = experiment.run()
    return result, unexplained(result), [finding.quantity for finding in result.verdict.findings]


def main(arguments: list[str]) -> None:
    """Print the matrix."""
    words = [word for word in arguments if word != "--no-assumed"]
    assumed = "--no-assumed" not in arguments
    seeds = int(words.pop(0)) if words and words[0].isdigit() else 40
    flagged = runs = good = places = 0
    names = [name for name, found in cards().items() if found.value("gyro", "noise_density") is not None]
    for name in (name for name in names if not words or any(word in name for word in words)):
        for mission in MISSIONS:
            with ThreadPoolExecutor(2) as pool:
                done = list(
                    pool.map(lambda s, n=name, m=mission: run(n, m, s, assumed=assumed), range(1, seeds + 1))
                )
            part = inside([result for result, _, _ in done])
            bad = [quantities for _, quantities, _ in done if quantities]
            found = Counter(quantity for _, _, all_ in done for quantity in all_)
            print(
                f"{name:20} {mission:12} flagged {len(bad):3}/{seeds} "
                f"{dict(Counter(q for quantities in bad for q in quantities).most_common(4))} "
                f"NEES inside {100 * part:3.0f} % all {dict(found.most_common(4))}",
                flush=True,
            )
            runs, flagged = runs + seeds, flagged + len(bad)
            places, good = places + 1, good + (part >= 0.9)
            CACHE.clear()
    print(f"{flagged} of {runs} runs flagged; NEES inside in 90 % of the epochs in {good} of {places} places")


if __name__ == "__main__":
    main(sys.argv[1:])
