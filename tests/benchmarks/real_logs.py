"""Real logs: strict gates, verdicts, advice and identification, judged by withheld fixes.

Run it with ``python -m tests.benchmarks.real_logs FOLDER ...``. A folder holds log files of known formats, or
folders of ``imu.csv``, ``gnss.csv`` and ``meta.json``. For each log it prints:

- for each gate, the rms error relative to the fixes that were withheld in outages of 10 s each minute, over
  that without a gate, and the part of the fixes that the filter did not use;
- the verdict, and the error across the outages with its advice followed, over that before;
- the error with what `identify` recommends, over the best of a grid of 36 factors on R and Q; and the part of
  the epochs whose NIS is in its interval, with the reason that is named for the rest.
"""

from __future__ import annotations

import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import cast

import numpy as np

from lab.analysis.identification.factors import scale_noise
from lab.analysis.identification.identify import LARGEST_PART, SETTLING
from lab.analysis.identification.renavigation import Subject, subject
from lab.analysis.identification.withheld import held_out, outages
from lab.analysis.verdicts import trial
from lab.base.files.mission_error import MissionError
from lab.experiment.experiment import Experiment
from lab.experiment.log_result import LogResult
from lab.missions.catalogue import mission
from lab.missions.flight_import import read_log
from lab.missions.library import add_log
from lab.missions.mission import Mission
from lab.missions.mission_name import suggested_name
from lab.run.experiment_settings import ExperimentSettings
from tests.sensor_logs import described

GATES = (0.99, 0.995, 0.999, 0.9999)
"""Strict gates: the probability that a good fix passes."""
ON_R, ON_Q = (0.03, 0.1, 0.3, 1.0, 3.0, 30.0), (0.1, 1.0, 10.0, 100.0, 1000.0, 10000.0)
"""Factors of the grid."""


def missions(folder: Path, library: Path) -> list[Mission]:
    """Return the logs of a folder as missions of a library."""
    found = []
    for path in sorted(folder.iterdir()):
        name = suggested_name(path.stem)
        try:
            if (path / "meta.json").is_file() and (path / "gnss.csv").is_file():
                found.append(mission(described(library / name, path)))
            elif path.is_file() and path.suffix != ".md":
                found.append(add_log(read_log([path]), name, title=name, folder=library))
        except MissionError as error:
            print(f"{path.name}: {str(error)[:110]}")
    return found


class Errors:
    """The errors of a log across outages, with other settings of its filter."""

    def __init__(self, result: LogResult) -> None:
        self.subject: Subject = subject(result)
        first, last = self.subject.span
        self._masks = outages(self.subject.stamps, first + min(SETTLING, LARGEST_PART * (last - first)), last)
        self._none = np.zeros(self.subject.stamps.size, np.bool_)

    def of(self, experiment: ExperimentSettings) -> float:
        """Return the rms position error relative to withheld fixes [m]; NaN where none is withheld."""
        if not self._masks:
            return float("nan")
        return held_out(self.subject, experiment, self._masks, self._none).position_error


def unused(result: LogResult) -> float:
    """Return the part of the fixes that the filter rejected."""
    return float(np.mean(result.solution_arrays.fix_rejected))


def report(mission: Mission) -> None:
    """Print the figures of a log."""
    began = time.perf_counter()
    result = cast(LogResult, Experiment(mission=str(mission.path)).run())
    errors, plain = Errors(result), result.experiment
    base = errors.of(plain)
    print(f"\n{mission.name}: {result.fixes.time.size} fixes, {base:.2f} m across outages, "
          f"{unused(result):.1%} unused, verdict: {result.verdict.headline}")  # fmt: skip
    for gate in GATES:
        changed = plain.copy().update({"navigator": {"gate": gate}})
        run = cast(LogResult, result.repeated(changed))
        print(
            f"  gate {gate}: {errors.of(changed) / base:.2f} times, {unused(run):.1%} unused, "
            f"finite {bool(np.isfinite(run.solution_arrays.position).all())}, {run.verdict.headline[:90]}"
        )
    changes = tuple(change for finding in result.tried_verdict.findings for change in finding.changes)
    if changes:
        advised = trial.apply_changes(result, changes)
        words = ", ".join(finding.quantity for finding in result.tried_verdict.findings if finding.changes)
        print(f"  advice on {words} followed: {errors.of(advised) / base:.2f} times")
    found = result.identify()
    after = errors.of(plain.copy().update(found.changes)) if found.recommended else base
    grid = []
    for r, q in product(ON_R, ON_Q):
        try:
            grid.append(errors.of(scale_noise(plain, r, q)))
        except ValueError:  # beyond the bounds, or it diverges
            continue
    best = np.nanmin(grid)
    print(
        f"  identify: {after:.2f} m, best of {len(grid)} {best:.2f} m: {after / best:.2f} times; "
        f"NIS inside {found.inside[1]:.0%}, {'recommended' if found.recommended else 'not recommended'}, "
        f"chosen by {found.chosen_by}, {found.spread}"
    )
    print(f"  {time.perf_counter() - began:.0f} s")


def main(arguments: list[str]) -> None:
    """Print the figures of all logs of some folders."""
    with tempfile.TemporaryDirectory() as library:
        for folder in arguments:
            for one in missions(Path(folder), Path(library)):
                try:
                    report(one)
                except ValueError as error:
                    print(f"{one.name}: {str(error)[:150]}")


if __name__ == "__main__":
    main(sys.argv[1:])
