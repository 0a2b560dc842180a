"""Judged logs: the verdict on filters that are not ours, on logs at hand and on runs of known settings.

``python -m tests.benchmarks.judged_logs real [FOLDER ...]`` prints the verdict, its evidence and what the
log's own flags say for each log that holds a filter. With ``known [SEEDS]`` it counts over seeds: our own
filter navigates matched, or with Q or R wrong by 10; only its innovations and their σ are judged, as of
anyone's csv.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import numpy as np

from lab.analysis.verdicts.foreign_verdict import ForeignVerdict, judge_foreign
from lab.base.files.mission_error import MissionError
from lab.data.log.filter_log import AXES, FilterLog, Lane, Measured, innovations_of
from lab.experiment.experiment import Experiment
from lab.experiment.judged_log import judge
from lab.experiment.result import Result

CASES = {
    "matched": {},
    "Q 10 times too small": {"q_scale": 0.1},
    "Q 10 times too large": {"q_scale": 10.0},
    "R 10 times too small": {"r_scale": 0.1},
    "R 10 times too large": {"r_scale": 10.0},
}
FLIGHTS = (
    ("montreal", 1.0, 1.0),
    ("los_angeles", 1.0, 1.0),
    ("montreal", 0.2, 1.0),
    ("los_angeles", 0.2, 1.0),
    ("montreal", 0.2, 10.0),
    ("los_angeles", 0.2, 10.0),
)
"""Missions, the periods of their fixes [s], and how much noisier than by default the inertial sensors are."""


def innovations_alone(result: Result) -> FilterLog:
    """Return what a csv of the innovations and their σ of a run would hold."""
    arrays = result.solution_arrays
    nu, variance = arrays.innovation, np.diagonal(arrays.innovation_covariance, axis1=1, axis2=2)
    found = []
    for name, own, unit in (("position", slice(0, 3), "m"), ("velocity", slice(3, 6), "m/s")):
        one = innovations_of(
            Measured(name, AXES, unit),
            result.fixes.time,
            nu[:, own],
            name,
            variance=np.asarray(variance[:, own]),
        )
        found += [] if one is None else [one]
    return FilterLog("run", "a filter", (Lane("filter", tuple(found)),), fusing=0.0)


def named(found: ForeignVerdict) -> str:
    """Return what a verdict names: Q, R, something else, or nothing."""
    accused = {one.quantity.split()[0] for one in found.verdict.findings}
    for quantity in ("Q", "R"):
        if quantity in accused:
            return f"{quantity} {found.verdict.findings[0].direction}"
    if accused:
        return ", ".join(sorted(accused))
    if any("Q is too large" in one.sentence for one in found.remarks):
        return "Q too large (remark)"
    if any("R is too large" in one.sentence for one in found.remarks):
        return "R too large (remark)"
    return "overstated σ (remark)" if found.remarks else "nothing"


def known(seeds: int) -> None:
    """Print how often each case is named as what."""
    for mission, period, noise in FLIGHTS:
        for case, values in CASES.items():
            counts = Counter()
            for seed in range(1, seeds + 1):
                experiment = Experiment(mission=mission, seed=seed)
                experiment.sensors.gps.period = period
                for sensor in (experiment.sensors.gyro, experiment.sensors.accelerometer):
                    sensor.noise_density = [noise * one for one in sensor.noise_density]
                for name, value in values.items():
                    setattr(experiment.navigator, name, value)
                counts[named(judge_foreign(innovations_alone(experiment.run())))] += 1
            said = ", ".join(f"{name}: {count}" for name, count in counts.most_common())
            print(f"{mission:12} every {period:g} s, noise {noise:g}  {case:22} {said}", flush=True)


def real(folders: list[str]) -> None:
    """Print a row for each log of the folders that holds a filter."""
    paths = sorted(path for folder in folders for path in Path(folder).rglob("*") if path.is_file())
    judged = accused = 0
    for path in paths:
        try:
            found = judge(path)
        except MissionError:
            continue
        judged += 1
        accused += bool(found.verdict.findings)
        print(f"{path.name}: {found.log.filter}, {found.verdict.basis}")
        print(f"  verdict   {found.verdict.headline}")
        for one in found.verdict.findings:
            print(f"  finding   {one.sentence} [{one.evidence}]")
        for remark in (*found.remarks, *found.comparisons):
            print(f"  remark    {remark.sentence} [{remark.evidence}]")
        print(f"  own flags {found.log.flags}")
    print(f"{judged} logs of {len(paths)} files hold a filter; {accused} have findings")


if __name__ == "__main__":
    if sys.argv[1:2] == ["known"]:
        known(int(sys.argv[2]) if len(sys.argv) > 2 else 50)
    else:
        real(sys.argv[2:] or [str(Path(__file__).parents[2].parent / "shared" / "logs")])
