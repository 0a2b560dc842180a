"""Outage blocks: runs of an experiment that share the begin of an outage, and their errors in it."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.cross_checks import LARGEST_PART, SETTLING
from lab.analysis.errors import position_error
from lab.base.arrays import FloatArray
from lab.experiment.ensembles.seed_lanes import LANES, SeedLanes
from lab.experiment.experiment import Experiment
from lab.experiment.outage_table import OutageErrors
from lab.experiment.sensor_stages import SensorStages
from lab.missions import mission
from lab.motion.truth.trajectory import Truth
from lab.navigation.checks import DivergedError
from lab.navigation.filters.error_models import POS
from lab.navigation.kernels.lanes import LaneSolution
from lab.sensors import gps

SHORTEST = 1.0
"""Shortest outage [s]: its errors are known each second."""
BEGINS = 12
"""Least number of begins, if there are as many runs: with fewer than 96, fewer than eight share one."""
CURVE = 120
"""Largest number of intervals of a drift curve."""
_ROOM = threading.local()  # memory for the sensors of a block, which the next block of a thread uses again
_ROUNDING = 1e-9
"""Of times [s]."""

Samples = NDArray[np.int64]


class Block(NamedTuple):
    """Runs that share a begin.

    Attributes
    ----------
    begin
        Time of the last fix before the outage [s].
    seeds
        Their seeds.
    """

    begin: float
    seeds: tuple[int, ...]


def times_since(seconds: float) -> FloatArray:
    """Return the times since the begin of an outage at which errors are kept: each second, and the end."""
    step = max(1.0, math.ceil(seconds / CURVE))
    return np.append(np.arange(0, seconds - _ROUNDING, step), seconds)


def plan_blocks(experiment: Experiment, seconds: float, seeds: Sequence[int], turn: int = 0) -> list[Block]:
    """Return the runs with their begins, which are spread evenly over the fixes of the flight.

    Parameters
    ----------
    experiment
        The experiment.
    seconds
        Length of the outage [s].
    seeds
        The seeds.
    turn
        Number of the set of runs: the begins of each set are between those of the sets before.

    Raises
    ------
    ValueError
        If the flight is too short.
    """
    duration = SensorStages(experiment, mission(experiment.mission)).kept_flight().trajectory.duration
    fixes = gps.fix_times(experiment.sensors.gps, duration)
    settled = min(SETTLING, LARGEST_PART * duration)
    usable = fixes[(fixes >= settled) & (fixes <= duration - seconds + _ROUNDING)]
    if not usable.size:
        raise ValueError(
            f"seconds: an outage of {seconds:g} s does not fit into the flight, which lasts {duration:.0f} s "
            f"and in which the filter converges first; accepted is at most {int(duration - settled)} s"
        )
    count = -(-len(seeds) // min(max(len(seeds) // BEGINS, 1), LANES))
    wanted = usable[0] + (usable[-1] - usable[0]) * (np.arange(count) + offset_of_turn(turn)) / count
    begins = usable[np.abs(usable[:, None] - wanted).argmin(axis=0)]
    parts = np.array_split(np.array(seeds), count)
    return [Block(float(begin), tuple(part.tolist())) for begin, part in zip(begins, parts, strict=True)]


def offset_of_turn(turn: int) -> float:
    """Return the place of the begins of a set between those of the others: 1/2, 1/4, 3/4, 1/8 and so on."""
    place, weight, number = 0.0, 0.5, turn + 1
    while number:
        place += weight * (number % 2)
        number, weight = number // 2, weight / 2
    return place


def errors_in(
    experiment: Experiment, block: Block, since: FloatArray, lanes: SeedLanes | None = None
) -> OutageErrors:
    """Return the errors of runs that share a begin.

    Parameters
    ----------
    experiment
        The experiment; its seed has no effect, and it has no outages.
    block
        The runs.
    since : (k,) array
        Times since the begin [s]; the last is the end of the outage.
    lanes
        The runs of the experiment abreast; None runs each alone.
    """
    receiver, step = experiment.sensors.gps, 1 / float(experiment.trajectory.imu_rate)
    end = block.begin + float(since[-1])
    outage = block.begin + receiver.period / 2, end + receiver.latency + step / 2
    flight = SensorStages(experiment, mission(experiment.mission)).kept_flight()
    samples = np.searchsorted(flight.ideal.time, block.begin + since - step / 2)
    truth = flight.truth.taken(samples)
    nothing: list[LaneSolution | None] = [None] * len(block.seeds)
    solved = nothing if lanes is None else lanes.during(outage, end, _ROOM).navigate(block.seeds, samples)
    figures = [
        _run_alone(experiment, outage, seed, samples, truth)
        if run is None or not np.isfinite(run.solution.variance).all()
        else _figures(run.solution.position, run.solution.variance, run.solution.covariance, truth)
        for seed, run in zip(block.seeds, solved, strict=True)
    ]
    horizontal, vertical, sigma, covariance = (np.array(part) for part in zip(*figures, strict=True))
    begins = np.full(len(block.seeds), block.begin)
    return OutageErrors(np.array(block.seeds), begins, horizontal, vertical, sigma, covariance)


def _run_alone(
    experiment: Experiment, outage: tuple[float, float], seed: int, samples: Samples, truth: Truth
) -> tuple[FloatArray, ...]:
    """Return the figures of a single run; infinite errors if it diverges."""
    mine = experiment.copy()
    mine.set("seed", seed)
    mine.set("sensors.gps.outages", [outage])
    try:
        solution = mine.run().solution_arrays
    except DivergedError:
        lost = np.full(samples.size, np.inf)
        return lost, lost, np.full(samples.size, np.nan), np.full(3, np.nan)
    return _figures(
        solution.position[samples], solution.variance[samples], solution.covariance[samples], truth
    )


def _figures(
    position: FloatArray, variance: FloatArray, covariance: FloatArray, truth: Truth
) -> tuple[FloatArray, ...]:
    """Return horizontal and vertical errors, horizontal σ (k,), and P of north and east at the end (3,)."""
    north, east, down = position_error(position, truth).T
    own = variance[:, POS].astype(np.float64)
    at_end = np.array([own[-1, 0], own[-1, 1], covariance[-1, 0, 0]])
    return np.hypot(north, east), np.abs(down), np.sqrt(own[:, 0] + own[:, 1]), at_end
