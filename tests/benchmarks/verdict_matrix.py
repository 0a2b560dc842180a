"""Verdict matrix: over 60 faults, each alone, what the verdict calls first and what else it accuses.

Run it with ``python -m tests.benchmarks.verdict_matrix [seeds] [words ...]``. Seeds are their number, from 1
on, or the first and the last one: ``1001-1003``. The names of missions and of grades of sensors among the
words choose these; the other words choose the faults whose names have one of them. For each fault, the runs
follow in which another cause is named first, or as well, with what was said.
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
    missed: list[str] = field(default_factory=list)
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
            self.missed.append(f"{place}: {', '.join(said) or 'consistent'}")
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
    seeds: range, faults: dict[str, Fault], missions: tuple[str, ...], grades: tuple[str, ...]
) -> Iterator[tuple[str, Tally]]:
    """Run each fault on each mission with each grade of sensor, and yield what was said."""
    for name, fault in {MATCHED: None, **faults}.items():
        tally = Tally()
        places = [(m, g, s) for m in missions for g in grades for s in seeds]

        def one(place: tuple[str, str, int], fault: Fault | None = fault) -> tuple[Verdict, Verdict]:
            run = experiment(*place)
            result = (run if fault is None else fault.inject(run)).run()
            return result.verdict, result.innovation_verdict

        with ThreadPoolExecutor(2) as pool:
            for place, said in zip(places, pool.map(one, places), strict=True):
                tally.add(fault.names if fault else (), *said, " ".join(map(str, place)))
        CACHE.clear()
        yield name, tally


def main(arguments: list[str]) -> None:
    """Print the matrix."""
    first, _, last = (arguments[0] if arguments else "10").rpartition("-")
    seeds = range(int(first or 1), int(last) + 1)
    missions, grades = (tuple(w for w in arguments[1:] if w in known) for known in (MISSIONS, GRADES))
    words = [word for word in arguments[1:] if word not in (*missions, *grades)]
    chosen = {name: f for name, f in FAULTS.items() if not words or any(word in name for word in words)}
    total = Tally()
    accused = imu = 0
    for name, tally in tallies(seeds, chosen, missions or MISSIONS, grades or GRADES):
        print(
            f"{name:32} named {tally.named:3}/{tally.runs:3} alone {tally.alone:3} "
            f"first {dict(tally.first.most_common(3))} wrong {dict(tally.others.most_common(5))} "
            f"| innovations {dict(tally.unseen.most_common(4))}",
            *tally.missed,
            sep="\n    ",
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
