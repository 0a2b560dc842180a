"""Verdict matrix: over 60 faults, each alone, what the verdict calls first and what else it accuses.

Run it with ``python -m tests.benchmarks.verdict_matrix [seeds] [words in the names of faults ...]``.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from lab.analysis.verdicts.finding import Verdict
from lab.experiment.stages import CACHE
from tests.benchmarks.faults import FAULTS, GRADES, MISSIONS, Fault, experiment

MATCHED = "matched"


@dataclass
class Tally:
    """What was said in the runs of one fault."""

    runs: int = 0
    named: int = 0
    alone: int = 0
    gps_accused: int = 0
    first: Counter[str] = field(default_factory=Counter)
    others: Counter[str] = field(default_factory=Counter)
    unseen: Counter[str] = field(default_factory=Counter)

    def add(self, names: tuple[str, ...], verdict: Verdict, blind: Verdict, place: str) -> None:
        """Count a verdict with the truth, and one by the innovations alone."""
        said = [finding.quantity for finding in verdict.findings]
        self.runs += 1
        right = bool(said) and said[0] in names if names else not said
        self.named += right
        wrong = [quantity for quantity in said if quantity not in names]
        self.alone += not wrong
        self.first[said[0] if said else "-"] += 1
        if not right or wrong:
            self.others[place] += 1
        for quantity in wrong:
            self.others[quantity] += 1
        blindly = blind.findings[0].quantity if blind.findings else "-"
        self.unseen[blindly] += 1
        self.gps_accused += is_gps(blind)


def is_gps(verdict: Verdict) -> bool:
    """Return whether a verdict accuses the GPS, and does not say that it may be the IMU."""
    return any(finding.quantity.startswith(("GPS", "R")) for finding in verdict.findings) and not any(
        "or IMU" in finding.quantity for finding in verdict.findings
    )


def tallies(
    seeds: int, faults: dict[str, Fault], missions: tuple[str, ...], grades: tuple[str, ...]
) -> Iterator[tuple[str, Tally]]:
    """Run each fault on each mission with each grade of sensor, and yield what was said."""
    for name, fault in {MATCHED: None, **faults}.items():
        tally = Tally()
        places = [(m, g, s) for m in missions for g in grades for s in range(1, seeds + 1)]

        def one(place: tuple[str, str, int], fault: Fault | None = fault) -> tuple[Verdict, Verdict]:
            run = experiment(*place)
            result = (run if fault is None else fault.inject(run)).run()
            return result.verdict, result.innovation_verdict

        with ThreadPoolExecutor(2) as pool:
            for place, said in zip(places, pool.map(one, places), strict=True):
                tally.add(fault.names if fault else (), *said, f"{place[0][:2]}/{place[1][:3]}")
        CACHE.clear()
        yield name, tally


def main(arguments: list[str]) -> None:
    """Print the matrix."""
    seeds = int(arguments[0]) if arguments else 10
    words = arguments[1:]
    chosen = {name: f for name, f in FAULTS.items() if not words or any(word in name for word in words)}
    total = Tally()
    accused = imu = 0
    for name, tally in tallies(seeds, chosen, MISSIONS, GRADES):
        print(
            f"{name:32} named {tally.named:3}/{tally.runs:3} alone {tally.alone:3} "
            f"first {dict(tally.first.most_common(3))} wrong {dict(tally.others.most_common(5))} "
            f"| innovations {dict(tally.unseen.most_common(4))}",
            flush=True,
        )
        if name == MATCHED:
            continue
        total.runs += tally.runs
        total.named += tally.named
        total.alone += tally.alone
        if chosen[name].source == "IMU":
            accused += tally.gps_accused
            imu += tally.runs
    print(
        f"{len(chosen)} faults: named first {100 * total.named / max(total.runs, 1):.1f} %, no other accused "
        f"{100 * total.alone / max(total.runs, 1):.1f} %; GPS accused by the innovations of an IMU fault "
        f"{accused} of {imu}"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
