"""Tuning: how well `identify` finds the noise of a filter, in simulation and on public logs.

``python -m tests.benchmarks.tuning simulated [SEEDS [JUDGED]]`` prints a table of three cards on three
missions, with seeds from 1001 on. Q and R of the filter are each wrong by ten, upwards or downwards by turns.
White noise and constant biases of the card are simulated: the filter's model of flicker is cautious, so that
flicker has no true Q. A line has

- the part of the 95 % intervals that contain the truth, of Q (white noise of gyros and accelerometers) and of
  R (three variances of a fix), and how many there are; where a flight does not show a noise, of those that
  state the most that it may be;
- the part of the seeds in which the NIS with what was found have no χ² distribution, with a chance of 5 %
  (Kolmogorov and Smirnov: the shape, and not the mean only), and the same before;
- the median of the rms position error with what was found, over the least that factors on Q and R reach by
  the truth, for the first seeds, `JUDGED` or as many as are given;
- the mean processor time [s].

``python -m tests.benchmarks.tuning logs FOLDER ...`` prints, of each log in a folder and with its SHA-256,
the error across withheld outages with the data sheet and with what `identify` recommends.
"""

from __future__ import annotations

import hashlib
import sys
import tempfile
import time
from collections import defaultdict
from itertools import chain
from pathlib import Path
from typing import cast

import numpy as np
from scipy import optimize, stats

from lab.analysis.identification.assumptions import FIX, NAMES
from lab.analysis.identification.identification import Identification
from lab.analysis.identification.identify import SETTLING
from lab.analysis.identification.likelihood import squares
from lab.analysis.identification.renavigation import Subject, subject
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.missions.mission_name import suggested_name
from lab.run.experiment_settings import ExperimentSettings
from lab.sensors.cards import card
from tests.benchmarks.real_logs import missions

CARDS = ("BMI088", "ADIS16470", "HG4930")
"""A consumer, an industrial and a tactical IMU."""
MISSIONS = ("montreal", "los_angeles", "pacific")
WRONG = ((10.0, 10.0), (10.0, 0.1), (0.1, 10.0), (0.1, 0.1))
"""Factors on Q and R, by turns."""
SEEDS = 100
"""Seeds of a line."""
FIRST = 1001
"""The first seed."""
APART = 1000
"""Seeds from one line to the next: the fixes of one seed have the same noise in each line."""
IMU_RATE = 50.0
"""Rate of the IMU [Hz]."""
OWN = ("noise_density", "bias_sigma")
"""What a triad has of a card."""
WHITE = NAMES[:2]
"""The parameters of Q with a truth other than zero."""
JUDGED = 20
"""Seeds of a cell for which factors are found by the truth: each takes 40 runs."""


def wrong(name: str, mission: str, seed: int) -> Experiment:
    """Return an experiment whose filter assumes wrong noise."""
    found, source = Experiment(mission=mission, seed=seed), Experiment(mission=mission)
    card(name).load(source)
    for triad in ("gyro", "accelerometer"):
        given = source.sensors.groups()[triad]
        found.sensors.groups()[triad].update({term: given.get(term) for term in OWN})
    found.update({"trajectory": {"imu_rate": IMU_RATE}})
    q, r = WRONG[seed % len(WRONG)]
    found.navigator.update({"q_scale": q, "r_scale": r})
    return found


def covered(found: Identification, q: float, r: float) -> dict[str, list[bool]]:
    """Return whether each interval of Q and R contains the truth; `q` and `r` are the wrong factors."""
    held: dict[str, list[bool]] = {"Q": [], "R": []}
    for row in found.rows:
        if row.parameter in (*WHITE, *NAMES[FIX]) and np.isfinite(row.high):
            kind, factor = ("Q", np.sqrt(q)) if row.parameter in WHITE else ("R", r)
            held[kind].append(bool(row.low <= row.before / factor <= row.high))
    return held


def has_shape(one: Subject, experiment: ExperimentSettings) -> bool:
    """Return whether the NIS of a filter have the χ² distribution, with a chance of 5 % to be wrong."""
    seen, _ = one.navigate(experiment, np.zeros(one.stamps.size, np.bool_))
    nis, degrees = squares(seen)
    counts = (degrees > 0) & (one.stamps > SETTLING)
    return bool(stats.kstest(stats.chi2.cdf(nis[counts], degrees[counts]), "uniform").pvalue > 0.05)


def error(experiment: Experiment) -> float:
    """Return the rms position error after the start [m]."""
    run = cast(Result, experiment.run())
    apart = run.errors.position[run.time > SETTLING]
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def oracle(experiment: Experiment) -> float:
    """Return the least error that factors on Q and R reach, found by the truth [m]."""

    def of(logarithms: np.ndarray) -> float:
        changed = experiment.copy()
        changed.navigator.update(dict(zip(("q_scale", "r_scale"), np.exp(logarithms).tolist(), strict=True)))
        return error(changed)

    return float(optimize.minimize(of, np.zeros(2), method="Nelder-Mead", options={"maxfev": 40}).fun)


def cell(name: str, mission: str, seeds: int, judged: int) -> dict[str, list[bool]]:
    """Print the line of a card on a mission, and return which intervals contain the truth."""
    first = FIRST + APART * (CARDS.index(name) * len(MISSIONS) + MISSIONS.index(mission))
    held: dict[str, list[bool]] = defaultdict(list)
    shapes, ratios, taken = [], [], 0.0
    for seed in range(first, first + seeds):
        experiment = wrong(name, mission, seed)
        run = cast(Result, experiment.run())
        began = time.process_time()
        found = run.identify()
        taken += time.process_time() - began
        for kind, flags in covered(found, *WRONG[seed % len(WRONG)]).items():
            held[kind] += flags
        tuned = experiment.copy().update(found.settings() if found.recommended else {})
        one = subject(run)
        shapes.append([has_shape(one, experiment), has_shape(one, tuned)])
        if seed < first + judged:
            ratios.append(error(tuned) / oracle(experiment))
    parts = [f"{kind} {part(held[kind])}" for kind in ("Q", "R")]
    before, after = 100 - 100 * np.mean(shapes, axis=0)
    print(
        f"{name:10} {mission:12} {'  '.join(parts)}  not χ²: {before:3.0f} % before, {after:3.0f} % after  "
        f"{np.median(ratios):.3f} times the oracle  {taken / seeds:.1f} s",
        flush=True,
    )
    return held


def part(flags: list[bool]) -> str:
    """Return the part of intervals that contain the truth, in words."""
    return f"{100 * np.mean(flags):5.1f} % of {len(flags)}" if flags else "not shown"


def simulated(seeds: int, judged: int = JUDGED) -> None:
    """Print the table of simulated flights."""
    every: list[bool] = []
    for name in CARDS:
        for mission in MISSIONS:
            every += chain(*cell(name, mission, seeds, judged).values())
    print(f"all together: {part(every)}, {seeds} seeds a line")


def logs(folders: list[str]) -> None:
    """Print the table of logs."""
    ratios = []
    with tempfile.TemporaryDirectory() as library:
        for folder in map(Path, folders):
            for one in missions(folder, Path(library)):
                try:
                    run = Experiment(mission=str(one.path)).run()
                    began = time.process_time()
                    found = run.identify()
                except ValueError as refused:
                    print(f"{one.name}: {str(refused)[:90]}")
                    continue
                after = found.after if found.recommended else found.before
                ratios.append(after.position_error / found.before.position_error)
                name = Path(one.name).name
                print(
                    f"{name:20} {digest(folder, name)}  {run.time[-1] - run.time[0]:5.0f} s, "
                    f"{found.before.position_error:.2f} m, then {after.position_error:.2f} m: "
                    f"{ratios[-1]:.2f} times; in σ {found.before.in_sigma:.2f}, then {after.in_sigma:.2f}; "
                    f"{time.process_time() - began:.1f} s",
                    flush=True,
                )
    print(f"median {np.nanmedian(ratios):.2f} times, largest {np.nanmax(ratios):.2f}")


def digest(folder: Path, name: str) -> str:
    """Return the first digits of the SHA-256 of a log: of its file, or of the imu.csv in its folder."""
    (path,) = [path for path in folder.iterdir() if suggested_name(path.stem) == name]
    return hashlib.sha256((path / "imu.csv" if path.is_dir() else path).read_bytes()).hexdigest()[:12]


if __name__ == "__main__":
    if sys.argv[1] == "simulated":
        simulated(*(map(int, sys.argv[2:]) if len(sys.argv) > 2 else (SEEDS,)))
    else:
        logs(sys.argv[2:])
