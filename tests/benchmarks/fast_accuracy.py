"""Fast accuracy: what a covariance at the fast rate changes for each card, on the same seeds.

`python -m tests.benchmarks.fast_accuracy 100` prints for each card the 95 % of the horizontal error at the
end of an outage of 60 s and the mean NEES over its degrees of freedom, each with the covariance at every
sample, and what the fast rate changes. Words after the number of seeds choose cards by name.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lab.experiment.ensembles.seed_lanes import LANES, SeedLanes
from lab.experiment.ensembles.seeds import at_fast_rate
from lab.experiment.experiment import Experiment
from lab.sensors.cards import card, cards

OUTAGE = (100.0, 160.0)
"""The outage on the flight of montreal [s]."""
OF_ERROR, OF_NEES = 0.02, 0.02
"""Largest change of the 95 %, as a part of it, and of NEES, for each degree of freedom."""


class Change(NamedTuple):
    """Figures at the full and at the fast rate: 95 % [m], NEES for each degree of freedom, and ms a run."""

    most: tuple[float, float]
    nees: tuple[float, float]
    milliseconds: tuple[float, float]

    @property
    def is_small(self) -> bool:
        """Whether the fast rate changes no more than it may."""
        full, fast = self.most
        return abs(fast / full - 1) <= OF_ERROR and abs(self.nees[1] - self.nees[0]) <= OF_NEES


def change_of(name: str, seeds: Sequence[int], imu_rate: float = 200.0) -> Change:
    """Return what the fast rate changes for a card."""
    experiment = Experiment(mission="montreal")
    card(name).load(experiment)
    experiment.update({"trajectory.imu_rate": imu_rate, "sensors.gps.outages": [OUTAGE]})
    figures = [_figures(one, seeds) for one in (experiment, at_fast_rate(experiment))]
    return Change(*zip(*figures, strict=True))


def _figures(experiment: Experiment, seeds: Sequence[int]) -> tuple[float, float, float]:
    lanes = SeedLanes.of(experiment)
    assert lanes is not None
    list(lanes.measure(seeds[:1]))
    began = time.process_time()
    blocks = [seeds[first : first + LANES] for first in range(0, len(seeds), LANES)]
    runs = [run for block in blocks for run in lanes.measure(block) if run is not None]
    passed = time.process_time() - began
    assert len(runs) == len(seeds)
    errors = [float(np.hypot(*run.at_outage_ends[0, :2])) for run in runs]
    nees = float(np.mean([run.nees.mean() / run.degrees for run in runs]))
    return float(np.quantile(errors, 0.95)), nees, 1e3 * passed / len(runs)


def main() -> None:
    """Print the table."""
    count, *names = sys.argv[1:] or ["40"]
    print(f"{'card':<22}{'95 % [m]':>12}{'fast':>10}{'NEES/n':>10}{'fast':>10}{'ms':>8}{'fast':>8}")
    found = {name: change_of(name, range(1, int(count) + 1)) for name in names or cards()}
    for name, one in found.items():
        full, fast = one.most
        print(
            f"{name:<22}{full:>12.4g}{100 * (fast / full - 1):>+9.2f}%{one.nees[0]:>10.3f}"
            f"{one.nees[1] - one.nees[0]:>+10.4f}{one.milliseconds[0]:>8.1f}{one.milliseconds[1]:>8.1f}"
            f"{'' if one.is_small else '  too much'}"
        )
    most = max(abs(one.most[1] / one.most[0] - 1) for one in found.values())
    nees = max(abs(one.nees[1] - one.nees[0]) for one in found.values())
    print(f"largest change: {100 * most:.2f} % of the 95 %, {nees:.4f} of NEES")


if __name__ == "__main__":
    main()
