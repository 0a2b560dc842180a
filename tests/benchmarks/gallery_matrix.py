"""Gallery matrix: the signature of each of the ten faults of the gallery, over seeds and missions.

Run it with ``python -m tests.benchmarks.gallery_matrix [seeds]``. A signature is the cause that the verdict
names first, and the answers of four statistics. The last lines say which pairs of faults share a signature.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import NamedTuple

from lab.classroom.gallery.faults import FAULTS
from lab.classroom.gallery.faulty_experiment import FaultyExperiment
from lab.classroom.lessons.catalogue import gallery_lessons
from lab.classroom.lessons.quantities import QUANTITIES
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE

MISSIONS = ("los_angeles", "montreal")
LIMITS: Mapping[str, tuple[float, ...]] = {
    "nis_position": (1.5, 5.0, 1000.0),
    "nis_velocity": (1.5, 5.0, 1000.0),
    "correlation": (0.4,),
    "nees": (2.5, 15.0, 1e6),
}
"""Limits between the answers of each statistic. From 1.5 on, the verdict reports a variance; 0.4 is four σ of
the correlation of 105 innovations; NEES of the matched filter is up to 2.5 in a single flight."""
ANSWERS = ("=", "+", "++", "+++")
"""The answers: as stated, larger, much larger, absurd."""
MATCHED = "no fault"


class Signature(NamedTuple):
    """What a run shows: the first cause of the verdict, and the answer of each statistic."""

    verdict: str
    nis_position: str
    nis_velocity: str
    correlation: str
    nees: str

    @property
    def statistics(self) -> tuple[str, ...]:
        """The four answers without the verdict."""
        return self[1:]


def signature(result: Result) -> Signature:
    """Return the signature of a run."""
    found = result.verdict.findings
    answers = {
        name: ANSWERS[sum(QUANTITIES[name].of(result) > limit for limit in limits)]
        for name, limits in LIMITS.items()
    }
    return Signature(found[0].quantity if found else "-", **answers)


def run(fault: str, mission: str, seed: int) -> Result:
    """Return a run of the gallery."""
    settings = gallery_lessons()[0].settings
    chosen = FaultyExperiment(FAULTS[fault]) if fault in FAULTS else Experiment()
    return chosen.update({**settings, "mission": mission, "seed": seed}).run()


def signatures(
    seeds: range, missions: tuple[str, ...] = MISSIONS
) -> Iterator[tuple[str, Counter[Signature]]]:
    """Yield the signatures of each fault, with the number of runs that show them."""
    for fault in (MATCHED, *FAULTS):
        yield fault, Counter(signature(run(fault, mission, seed)) for mission in missions for seed in seeds)
        CACHE.clear()


def shared(found: Mapping[str, Counter[Signature]], *, verdict: bool) -> list[tuple[str, str]]:
    """Return the pairs of faults of which some run shows the signature of the other.

    Parameters
    ----------
    found
        The signatures of each fault.
    verdict
        Whether the verdict counts, or the four statistics alone.
    """
    sets = {
        name: {one if verdict else one.statistics for one in counts}
        for name, counts in found.items()
        if name in FAULTS
    }
    return [(a, b) for a, b in combinations(sets, 2) if sets[a] & sets[b]]


def main(arguments: list[str]) -> None:
    """Print the matrix."""
    found: dict[str, Counter[Signature]] = {}
    print("fault        runs  verdict first                   NIS p  NIS v  corr.  NEES")
    for name, counts in signatures(range(1, 1 + int(arguments[0] if arguments else 10))):
        found[name] = counts
        for one, number in counts.most_common():
            print(
                f"{name:12} {number:4}  {one.verdict:30}  {one.nis_position:5}  {one.nis_velocity:5}  "
                f"{one.correlation:5}  {one.nees}",
                flush=True,
            )
    print("pairs of faults with a signature in common:", shared(found, verdict=True) or "none")
    print("pairs by the four statistics alone:", shared(found, verdict=False) or "none")


if __name__ == "__main__":
    main(sys.argv[1:])
