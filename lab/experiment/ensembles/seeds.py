"""Seeds: one experiment run with many seeds, on all processors.

The runs are added up in the order of their seeds, as they are done, so that ten thousand take no more memory
than a hundred.
"""

from __future__ import annotations

import operator
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.budget import believed_sigma
from lab.analysis.consistency import normalised_squares, uncertain
from lab.analysis.errors import error_state, errors_of, outage_ends, path_of
from lab.analysis.feedforward import CORRECTED
from lab.analysis.fix_causes import of_fixes
from lab.analysis.verdicts.evidence import position_nees, whole_seconds
from lab.analysis.verdicts.run_evidence import evidence_of, reference_of
from lab.base.arrays import FloatArray
from lab.base.blas_threads import OneBlasThread
from lab.base.parameters.setting_error import SettingError
from lab.base.processors import processors
from lab.base.progress import Progress
from lab.experiment.ensembles.ensemble import JUDGED, QUANTITIES, Collected, Ensemble
from lab.experiment.ensembles.run_at_fixes import ChannelSums, RunAtFixes, horizontal_figures
from lab.experiment.ensembles.seed_lanes import LANES, SeedLanes
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.sensor_stages import SensorStages
from lab.missions import LogMission, MissionError, mission
from lab.navigation.algorithm import Algorithm
from lab.navigation.belief import fast_rate
from lab.navigation.checks import DivergedError
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.run.memory import at_once

EXPLAINED = 8
"""Number of runs whose suspicious innovations are explained, which takes several times as long as a run. The
other runs add only to the remaining evidence."""
FEW, MANY = 100, 1000
"""Numbers of runs from which on they are run eight abreast: if their filter is ready, and if it is not.
Compiling it takes as long as some thousand single runs; `ins-lab warm` does so ahead."""
SHOWN_EVERY = 2.0
"""Time between two partial ensembles [s]."""
ASKED_EVERY = 0.1
"""Longest time between two questions whether the work is cancelled [s]."""
AHEAD = 16
"""Largest number of blocks of runs that are begun, or done, while an earlier one is not: those that are done
wait in memory until they are added."""


class StoppedError(ValueError):
    """Work that was cancelled before any run of it was done."""


@OneBlasThread()
def run_ensemble(
    experiment: Experiment,
    seeds: int | Sequence[int],
    progress: Progress | None = None,
    *,
    workers: int | None = None,
    algorithm: Algorithm | None = None,
    partial: Callable[[Ensemble], None] | None = None,
    fast: bool = False,
) -> Ensemble:
    """Run an experiment over seeds, on all processors: the kernels release the interpreter.

    Parameters
    ----------
    experiment
        Experiment to run; its own seed is the first if a number of runs is given.
    seeds
        Number of runs, or the seed of each; a sensor log has one run.
    progress
        Called with a sentence about the current work and the fraction done, from 0 to 1. An exception that it
        raises ends the work.
    workers
        Number of threads; by default one for each processor. There are fewer if so many runs at once do not
        fit into the memory.
    algorithm
        The user's navigator; it is called from one thread only.
    partial
        Called every two seconds with the ensemble of the runs that are done so far.
    fast
        Whether the filter propagates its covariance less often than at each sample; see `at_fast_rate`.

    Raises
    ------
    ValueError
        If there is no seed, or more than one for a log, or no thread; and as in `Experiment.run`.
        Runs that diverge are left out (`Ensemble.diverged`), unless all do.
    """
    experiment = at_fast_rate(experiment) if fast else experiment
    numbers = seed_numbers(experiment, seeds)
    if len(numbers) > 1 and isinstance(mission(experiment.mission), LogMission):
        raise ValueError(
            f"seeds: {len(numbers)} runs of a sensor log would all be the same, since it has no random "
            "draws; accepted is one"
        )

    # The user's code need not be thread-safe.
    threads = 1 if algorithm is not None else at_once(memory_of(experiment), thread_count(workers))
    pool = ThreadPoolExecutor(threads, thread_name_prefix="ensemble")
    done = _Done(experiment, numbers, progress, partial)
    try:
        lanes = None if algorithm is not None or len(numbers) < FEW else SeedLanes.of(experiment)
        if lanes is not None and len(numbers) < MANY and not lanes.is_compiled:
            lanes = None
        runner = _Runner(experiment, numbers, algorithm, lanes)
        left = deque(_blocks(len(numbers), len(numbers) if lanes is None else 0))
        running: dict[Future[list[RunAtFixes | DivergedError]], int] = {}
        while left or running:
            while left and left[0].start < len(done) + AHEAD * LANES:
                block = left.popleft()
                running[pool.submit(runner.run, block)] = block.start
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                done.add(running.pop(future), future.result())
    finally:
        pool.shutdown(cancel_futures=True)
    return done.ensemble()


def counted(done: int, wanted: int, began: float) -> str:
    """Return how many runs are done, and if some are not, their rate and the time left.

    Parameters
    ----------
    done, wanted
        Numbers of runs.
    began
        When the first began, in the clock of `time.monotonic`.
    """
    rate = done / max(time.monotonic() - began, 1e-9)
    left = f", {rate:.3g} per second, {(wanted - done) / rate:.0f} s left" if done < wanted else ""
    return f"{done:,} of {wanted:,} runs{left}"


def at_fast_rate(experiment: Experiment) -> Experiment:
    """Return a copy whose filter propagates its covariance at `fast_rate`."""
    fast = experiment.copy()
    fast.navigator.filter_rate = fast_rate(fast.sensors, fast.navigator)
    return fast


def thread_count(workers: int | None) -> int:
    """Return the number of threads that a user asks for; None stands for one for each processor.

    Raises
    ------
    ValueError
        If it is no whole number from 1.
    """
    if workers is None:
        return processors()
    try:
        count = operator.index(workers)
    except TypeError:
        count = 0  # a fraction, or no number
    if count < 1:
        raise ValueError(f"workers: {workers!r} is no number of threads; accepted is a whole number from 1")
    return count


def memory_of(experiment: Experiment) -> int:
    """Return the memory that a run needs [bytes]; none if it is refused, or is that of a log."""
    try:
        found = mission(experiment.mission)
        if isinstance(found, LogMission):
            return 0
        stages = SensorStages(experiment, found)
        return stages.memory(stages.samples())
    except (SettingError, MissionError):
        return 0


def seed_numbers(experiment: Experiment, seeds: int | Sequence[int]) -> tuple[int, ...]:
    """Return the seeds of some runs.

    Parameters
    ----------
    experiment
        The experiment; its own seed is the first if a number of runs is given.
    seeds
        Number of runs, or the seed of each.

    Raises
    ------
    ValueError
        If there is none, or one is no whole number.
    """
    accepted = "accepted is a number from 1, or a list of seeds"
    first = experiment.seed
    try:
        given = seeds if isinstance(seeds, Iterable) else range(first, first + operator.index(seeds))
        numbers = tuple(operator.index(seed) for seed in given)
    except TypeError as error:
        raise ValueError(f"seeds: {seeds!r} contains what is no whole number; {accepted}") from error
    if not numbers:
        raise ValueError(f"seeds: {seeds!r} contains no run; {accepted}")
    return numbers


def _blocks(count: int, one_by_one: int) -> list[range]:
    """Return the places of the runs that are computed together: single ones first, then blocks."""
    judged = max(min(count, JUDGED), one_by_one)
    starts = [*range(one_by_one), *range(one_by_one, judged, LANES), *range(judged, count, LANES)]
    return [range(first, last) for first, last in zip(starts, [*starts[1:], count], strict=True)]


class _Runner(NamedTuple):
    """What runs the seeds at some places: alone, or abreast in lanes."""

    experiment: Experiment
    seeds: tuple[int, ...]
    algorithm: Algorithm | None
    lanes: SeedLanes | None

    def run(self, block: range) -> list[RunAtFixes | DivergedError]:
        """Run the seeds of a block; a run that diverges gives the error."""
        if self.lanes is None:
            return [self._alone(place) for place in block]
        seeds = [self.seeds[place] for place in block]
        abreast = (
            self.lanes.run(seeds, explain=block.start < EXPLAINED)
            if block.start < JUDGED
            else self.lanes.measure(seeds)
        )
        return [run or self._alone(place) for place, run in zip(block, abreast, strict=True)]

    def _alone(self, place: int) -> RunAtFixes | DivergedError:
        mine = self.experiment.copy()
        mine.set("seed", self.seeds[place])
        try:
            result = mine.run(algorithm=self.algorithm)
        except DivergedError as error:
            return error.with_traceback(None)
        return _keep(result, explain=place < EXPLAINED, judged=place < JUDGED)


class _Done:
    """The runs that are done, and who is told of them."""

    def __init__(
        self,
        experiment: Experiment,
        seeds: tuple[int, ...],
        progress: Progress | None,
        partial: Callable[[Ensemble], None] | None,
    ) -> None:
        self._seeds, self._progress, self._partial = seeds, progress, partial
        self._collected = Collected(experiment)
        self._waiting: dict[int, RunAtFixes | DivergedError] = {}
        self._began = self._shown = time.monotonic()

    def __len__(self) -> int:
        """Return the number of the runs that are added."""
        return len(self._collected)

    def add(self, first: int, runs: Sequence[RunAtFixes | DivergedError]) -> None:
        """Add runs, of which the `first` place is given, once all before them are added; tell of each."""
        self._waiting |= dict(enumerate(runs, start=first))
        while (place := len(self)) in self._waiting:
            seed, run = self._seeds[place], self._waiting.pop(place)
            if isinstance(run, DivergedError):
                self._collected.leave_out(seed, str(run))
            else:
                self._collected.add(seed, run)
            self._report()

    def _report(self) -> None:
        count, wanted, now = len(self), len(self._seeds), time.monotonic()
        if self._progress is not None:
            self._progress(counted(count, wanted, self._began), count / wanted)
        some = 1 < count < wanted and not self._collected.is_empty
        if self._partial is not None and some and now - self._shown > SHOWN_EVERY:
            self._shown = now
            self._partial(self.ensemble())

    def ensemble(self) -> Ensemble:
        """Return the ensemble of the runs that are added."""
        return self._collected.ensemble()


def _keep(result: Result, *, explain: bool = True, judged: bool = True) -> RunAtFixes:
    """Return the kept values of a result; unknown values of a log are NaN.

    `judged` is true if the evidence is wanted, and `explain` if suspicious innovations are to be explained.
    """
    solution = result.solution_arrays
    used = np.flatnonzero(solution.fix_sample >= 0)
    at = solution.fix_sample[used]

    grid, apart, apart_degrees = _between(result)
    error, sigma = _errors(result, at)
    rms, largest, most, at_outage_ends = _sizes(result)
    nees, degrees = _nees(result, at, of_fixes(solution.fix_covariance, used))
    nu = solution.innovation
    measured = np.isfinite(nu).sum(axis=1)
    found = evidence_of(result, result.filtered, explain=explain) if judged else None
    S = solution.innovation_covariance[used]
    return RunAtFixes(
        time=result.fixes.time[used],
        nees=nees,
        nis=normalised_squares(np.nan_to_num(nu[used]), S),
        grid=grid,
        between=apart,
        between_degrees=apart_degrees,
        error=error,
        sigma=sigma,
        rms=rms,
        largest=largest,
        most=most,
        at_outage_ends=at_outage_ends,
        degrees=degrees,
        nis_degrees=int(measured.max()) if measured.any() else MEASUREMENTS,
        innovations=ChannelSums.of_used(nu[used], S) if found is None else ChannelSums.of(found.innovations),
        span=(float(result.time[0]), float(result.time[-1])),
        evidence=found,
        free=result.free_run if judged else CORRECTED,
        seconds=result.seconds,
        algorithm=result.algorithm,
    )


def _nees(result: Result, at: NDArray[np.int64], P: FloatArray) -> tuple[FloatArray, int]:
    """Return NEES at samples (m,) with covariances P (m, n, n), and its degrees of freedom."""
    if result.missing_reason("consistency"):
        return np.full(at.size, np.nan), 0
    true = reference_of(result)
    x = error_state(result.solution_arrays, at, true.truth, true.bias, true.scale, true.further)
    return normalised_squares(x, P), int(uncertain(P).size) if P.size else 0


def _between(result: Result) -> tuple[FloatArray, FloatArray, int]:
    """Return times between the fixes, NEES of the position there, and its degrees of freedom."""
    if result.missing_reason("consistency"):
        return np.zeros(0), np.zeros(0), 0
    at = np.maximum(whole_seconds(result.time) - 1, 1)
    nees, degrees = position_nees(result.solution_arrays, at, reference_of(result))
    return result.time[at], nees, degrees


def _errors(result: Result, at: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """Return errors and their σ (m, 9) at samples (m,)."""
    wide = len(QUANTITIES)
    sigma = believed_sigma(result, at)[:, :wide]
    return np.full((at.size, wide), np.nan) if result.missing_reason("errors") else _errors_at(
        result, at
    ), sigma


def _sizes(result: Result) -> tuple[FloatArray, FloatArray, float, float]:
    """Return rms and largest size (9,) of the errors known along the path, and figures of the horizontal one.

    These are `most` and `at_outage_ends` of `RunAtFixes`.
    """
    wide = len(QUANTITIES)
    if result.missing_reason("errors"):
        return np.full(wide, np.nan), np.full(wide, np.nan), np.nan, np.nan
    gps, time = result.experiment.sensors.gps, result.time
    along = _errors_at(result, path_of(time, float(gps.period)))
    ends = outage_ends(time, gps.outages, result.epoch)
    known = np.isfinite(along)
    count = known.sum(axis=0)
    square = np.sum(along**2, axis=0, where=known)
    rms = np.sqrt(np.divide(square, count, out=np.full(wide, np.nan), where=count > 0))
    largest = np.max(np.abs(along), axis=0, where=known, initial=0.0)
    figures = horizontal_figures(np.hypot(*along[:, :2].T), np.hypot(*_errors_at(result, ends)[:, :2].T))
    return np.asarray(rms), np.where(count > 0, largest, np.nan), *figures


def _errors_at(result: Result, at: NDArray[np.int64]) -> FloatArray:
    """Return the errors (m, 9) at samples (m,)."""
    solution = result.solution_arrays
    truth = result.known_truth("errors").taken(at)
    return errors_of(solution.position[at], solution.velocity_n[at], solution.q_nb[at], truth)
