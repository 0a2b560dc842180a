"""Log matrix: sensor logs with one fault each, and what the verdict on their innovations names first.

Run it with ``python -m tests.benchmarks.log_matrix [seeds] [words in the names of faults ...]``. The flights
are those of `tests.sensor_logs` on three missions; a log that is refused counts by what the refusal says.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from lab.analysis.verdicts.verdict import Verdict
from lab.base.files.mission_error import MissionError
from lab.live.live_verdict import judge_stream
from lab.missions import mission, read_sensor_log
from lab.motion.truth.trajectory import Trajectory
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite
from tests.sensor_logs import Tables, tables, write

MISSIONS = {"montreal": (20.0, 120.0), "los_angeles": (5.0, 100.0), "pacific": (5.0, 105.0)}
"""The flights, and the part of each that the log has [s]."""
FIRST_SEED = 1001

Damage = Callable[[Tables, np.random.Generator], Tables]


class LogFault(NamedTuple):
    """A fault of a log.

    Attributes
    ----------
    said
        Words of which the first finding, or the refusal, has at least one.
    damage
        Returns the log with the fault.
    """

    said: tuple[str, ...]
    damage: Damage

    def is_named(self, text: str) -> bool:
        """Return whether a sentence names this fault."""
        return any(word in text for word in self.said)


def columns(matrix_g: np.ndarray, matrix_f: np.ndarray) -> Damage:
    """Return what changes the axes and signs of gyros and accelerometers."""

    def damage(log: Tables, _rng: np.random.Generator) -> Tables:
        imu = log.imu.copy()
        imu[:, 1:4], imu[:, 4:] = imu[:, 1:4] @ matrix_g.T, imu[:, 4:] @ matrix_f.T
        return log._replace(imu=imu)

    return damage


def clock(rate: float, agrees: int = 0) -> Damage:
    """Return what lets the clock of the IMU run fast; it agrees at a sample, by default the first."""

    def damage(log: Tables, _rng: np.random.Generator) -> Tables:
        imu = log.imu.copy()
        imu[:, 0] = imu[agrees, 0] + (imu[:, 0] - imu[agrees, 0]) * (1 + rate)
        return log._replace(imu=imu)

    return damage


def clipped(sensor: int, axis: int, part: float) -> Damage:
    """Return what ends the range of an axis at a part of its largest value."""

    def damage(log: Tables, _rng: np.random.Generator) -> Tables:
        imu, own = log.imu.copy(), 1 + 3 * sensor + axis
        limit = part * np.abs(imu[:, own]).max()
        imu[:, own] = np.clip(imu[:, own], -limit, limit)
        return log._replace(imu=imu)

    return damage


def lost(part: float, longest: int = 1) -> Damage:
    """Return what loses a part of the samples, some in a row."""

    def damage(log: Tables, rng: np.random.Generator) -> Tables:
        starts = rng.random(len(log.imu)) < part / (0.5 + longest / 2)
        gone = np.zeros(len(log.imu), bool)
        for at in np.flatnonzero(starts):
            gone[at : at + rng.integers(1, longest + 1)] = True
        gone[[0, -1]] = False
        return log._replace(imu=log.imu[~gone])

    return damage


def late(seconds: float) -> Damage:
    """Return what stamps the fixes late."""

    def damage(log: Tables, _rng: np.random.Generator) -> Tables:
        gnss = log.gnss.copy()
        gnss[:, 0] += seconds
        return log._replace(gnss=gnss)

    return damage


def signs(*values: float) -> np.ndarray:
    """Return a matrix of signs."""
    return np.diag(np.array(values, float))


SAME = np.eye(3)
SWAPPED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
NOSE = "the nose goes up about the axis called {} ("
"""A refusal of wrong axes: the pitch rate of banked turns is about right."""
FAULTS = {
    "none": LogFault(("Consistent",), lambda log, _: log),
    "forward accelerometer reversed": LogFault(
        ("forward accelerometer", "along minus forward"), columns(SAME, signs(-1, 1, 1))
    ),
    "right accelerometer reversed": LogFault(
        ("right accelerometer", "along forward, minus right"), columns(SAME, signs(1, -1, 1))
    ),
    "forward gyro reversed": LogFault(
        ("The forward gyro has", "gyros about minus forward, right, down"), columns(signs(-1, 1, 1), SAME)
    ),
    "right gyro reversed": LogFault(
        ("The right gyro has", "gyros about forward, minus right, down", NOSE.format("minus right")),
        columns(signs(1, -1, 1), SAME),
    ),
    "down gyro reversed": LogFault(
        ("The down gyro has", "the gyro called down has", "gyros about forward, right, minus down"),
        columns(signs(1, 1, -1), SAME),
    ),
    "gyros x and y reversed": LogFault(
        (
            "The forward and the right gyro have",
            "gyros about minus forward, minus right, down",
            NOSE.format("minus right"),
        ),
        columns(signs(-1, -1, 1), SAME),
    ),
    "gyros x and y exchanged": LogFault(
        (
            "The forward and the right gyro are exchanged.",
            "gyros about right, forward, down",
            NOSE.format("forward"),
        ),
        columns(SWAPPED, SAME),
    ),
    "left-handed": LogFault(("left-handed",), columns(signs(1, -1, 1), signs(1, -1, 1))),
    "exchanged left-handed": LogFault(("left-handed", NOSE.format("forward")), columns(SWAPPED, SWAPPED)),
    "clock 1 % fast": LogFault(("clock",), clock(0.01)),
    "clock 0.5 % slow": LogFault(("clock",), clock(-0.005)),
    "clock 0.3 % fast": LogFault(("clock",), clock(0.003)),
    "gyro range": LogFault(("range",), clipped(0, 2, 0.5)),
    "accelerometer range": LogFault(("range",), clipped(1, 0, 0.5)),
    "third lost": LogFault(("lost", "losses"), lost(1 / 3)),
    "third lost in runs": LogFault(("lost", "losses"), lost(1 / 3, 20)),
    "latency 0.3 s": LogFault(("late",), late(0.3)),
}


@cache
def flight(name: str) -> Trajectory:
    """Return a flight at the rate of the logs."""
    return Trajectory.from_recording(mission(name).recording, 100.0)


def verdict(log: Tables, toml: str | None = None) -> Verdict | MissionError:
    """Return the verdict on a log, or why it is refused."""
    with TemporaryDirectory() as folder:
        try:
            read = read_sensor_log(str(write(Path(folder) / "log", log, toml)))
        except MissionError as error:
            return error
    return judge_stream(read, SensorSuite(), NavigatorSettings())


def main(arguments: list[str]) -> None:
    """Print what is said about each fault."""
    seeds, words = int(arguments[0]) if arguments else 2, arguments[1:]
    for name, fault in FAULTS.items():
        if words and not any(word in name for word in words):
            continue
        said: Counter[str] = Counter()
        runs = right = 0
        for place, span in MISSIONS.items():
            for seed in range(FIRST_SEED, FIRST_SEED + seeds):
                rng = np.random.default_rng(seed)
                found = verdict(fault.damage(tables(*span, seed=seed, flight=flight(place)), rng))
                text = str(found.findings[0].sentence if getattr(found, "findings", ()) else found)
                runs += 1
                right += fault.is_named(text)
                said[text if len(arguments) else text[:80]] += 1
        print(
            f"{name:32} named {right}/{runs}",
            *(f"\n    {n} × {text}" for text, n in said.most_common()),
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
