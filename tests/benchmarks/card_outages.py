"""Card outages: the horizontal error that a minute without fixes leaves, card by card, early and late.

Run it with ``python -m tests.benchmarks.card_outages [seeds] [words in names]``. Seeds begin with 1001, the
IMU rate is 50 Hz. Three columns: an outage from 30 s on (los_angeles), one from 140 s on (montreal), and that
with fixes of 2 cm and 2 cm/s before. Then follow the medians of each grade.
"""

from __future__ import annotations

import sys

import numpy as np

from lab.experiment.experiment import Experiment
from lab.experiment.stages import CACHE
from lab.sensors.cards import cards
from tests.benchmarks.card_matrix import FIRST

CASES = (
    ("los_angeles", 30.0, {}),
    ("montreal", 140.0, {}),
    ("montreal", 140.0, {"position_variance": 4e-4, "velocity_variance": 4e-4}),
)
"""Mission, start of the outage [s], and the receiver."""


def main(arguments: list[str]) -> None:
    """Print rms errors of each card, and their medians."""
    seeds = int(arguments.pop(0)) if arguments and arguments[0].isdigit() else 8
    grades: dict[str, list[list[float]]] = {}
    for name, card in cards().items():
        if arguments and not any(word in name for word in arguments):
            continue
        row = []
        for mission, start, receiver in CASES:
            squares = []
            for seed in range(FIRST, FIRST + seeds):
                experiment = Experiment(mission=mission, seed=seed)
                experiment.set("trajectory.imu_rate", 50)
                card.load(experiment)
                experiment.sensors.gps.update({**receiver, "outages": [(start, start + 60)]})
                result = experiment.run()
                end = int(np.searchsorted(result.time, start + 60)) - 1
                squares.append(float(np.sum(result.errors.position.values[end][:2] ** 2)))
            row.append(float(np.sqrt(np.mean(squares))))
        CACHE.clear()
        grades.setdefault(card.grade, []).append(row)
        print(f"{card.grade:11} {name:22}" + "".join(f"{error:8.1f} m" for error in row), flush=True)
    for grade, rows in grades.items():
        print(f"{grade:11} median                " + "".join(f"{x:8.1f} m" for x in np.median(rows, axis=0)))


if __name__ == "__main__":
    main(sys.argv[1:])
