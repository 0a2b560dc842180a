"""Seeds: one experiment run with many seeds, on all processors, or on a cluster.

The runs are added up in the order of their seeds, as they are done, so that ten thousand take no more memory
than a hundred. Threads and clusters add the same blocks of runs (`lab.experiment.ensembles.collected`).
"""

from __future__ import annotations

import operator
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from lab.base.blas_threads import OneBlasThread
from lab.base.parameters.setting_error import SettingError
from lab.base.processors import processors
from lab.base.progress import Progress, StoppedError
from lab.experiment.ensembles.collected import Collected
from lab.experiment.ensembles.ensemble import JUDGED, Ensemble
from lab.experiment.ensembles.run_at_fixes import RunAtFixes, keep_values
from lab.experiment.ensembles.seed_lanes import LANES, SeedLanes
from lab.experiment.experiment import Experiment
from lab.experiment.sensor_stages import SensorStages
from lab.missions import LogMission, MissionError, mission
from lab.navigation.algorithm import Algorithm
from lab.navigation.belief import fast_rate
from lab.navigation.checks import DivergedError
from lab.run.memory import at_once

if TYPE_CHECKING:
    from distributed import Client

    from lab.experiment.ensembles.parcel import Unpacked

EXPLAINED = 8
"""Number of runs whose suspicious innovations are explained, which takes several times as long as a run. The
other runs add only to the remaining evidence."""
FEW, MANY = 100, 300
"""Numbers of runs from which on they are run eight abreast: if their filter is ready, and if it is not.
Compiling it takes as long as some hundred single runs; `ins-lab warm` does so ahead."""
SHOWN_EVERY = 2.0
"""Time between two partial ensembles [s]."""
ASKED_EVERY = 0.1
"""Longest time between two questions whether the work is cancelled [s]."""
AHEAD = 16
"""Largest number of groups of runs abreast that are begun, or done, while an earlier one is not: those that
are done wait in memory until they are added."""
SMALL_BLOCK, BLOCK, LARGE_BLOCK = 8, 64, 256
"""Numbers of runs whose sums a cluster returns: of a small ensemble, so that all workers have some; usually,
which takes a worker 0.2 s abreast and some seconds one by one; and at most."""
SMALL, LARGE = 256, 4096
"""Numbers of runs up to which blocks are small, and from which on they grow: thousands of blocks take time of
their own."""


@OneBlasThread()
def run_ensemble(
    experiment: Experiment,
    seeds: int | Sequence[int],
    progress: Progress | None = None,
    *,
    workers: int | None = None,
    algorithm: Algorithm | None = None,
    partial: Callable[[Ensemble], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    fast: bool = False,
    client: Client | None = None,
) -> Ensemble:
    """Run an experiment over seeds, on all processors: the kernels release the interpreter.

    The sums are the same to the bit with any number of threads or workers, on processors of one family;
    others round differently.

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
    cancelled
        Asked ten times a second; once it says so, no further run begins, and the ensemble is that of the runs
        that have begun.
    fast
        Whether the filter propagates its covariance less often than at each sample; see `at_fast_rate`.
    client
        A client of a Dask cluster, whose workers run the seeds in place of this computer's threads. If the
        cluster is lost on the way, `Ensemble.ended` says so, and the ensemble has the runs that were done.

    Raises
    ------
    StoppedError
        If it is cancelled before a run has begun.
    ValueError
        If there is no seed, or more than one for a log, or no thread; if the cluster cannot do this work, or
        was lost before the first runs were done; and as in `Experiment.run`. Runs that diverge are left out
        (`Ensemble.diverged`), unless all do.
    """
    experiment = at_fast_rate(experiment) if fast else experiment
    numbers = seed_numbers(experiment, seeds)
    if len(numbers) > 1 and isinstance(mission(experiment.mission), LogMission):
        raise ValueError(
            f"seeds: {len(numbers)} runs of a sensor log would all be the same, since it has no random "
            "draws; accepted is one"
        )

    done = _Done(experiment, numbers, progress, partial)
    lanes = None if algorithm is not None or len(numbers) < FEW else SeedLanes.of(experiment)
    if lanes is not None and len(numbers) < MANY and not lanes.is_compiled:
        lanes = None
    if client is not None:
        _run_on_cluster(
            client, workers, experiment, algorithm, done, abreast=lanes is not None, cancelled=cancelled
        )
    else:
        # The user's code need not be thread-safe.
        threads = 1 if algorithm is not None else at_once(estimate_memory(experiment), thread_count(workers))
        _run_on_threads(threads, _Runner(experiment, algorithm, lanes), done, cancelled)
    if not len(done) and not done.ended:
        raise StoppedError(f"stopped before the first of {len(numbers):,} runs was done")
    return done.ensemble()


def _run_on_threads(threads: int, runner: _Runner, done: _Done, cancelled: Callable[[], bool] | None) -> None:
    is_cancelled, patience = cancelled or (lambda: False), None if cancelled is None else ASKED_EVERY
    pool = ThreadPoolExecutor(threads, thread_name_prefix="ensemble")
    left = deque(part for block in done.blocks for part in runner.parts(block))
    running: dict[Future[list[RunAtFixes | DivergedError]], range] = {}
    try:
        while (left or running) and not is_cancelled():
            while left and left[0].start < len(done) + AHEAD * LANES:
                part = left.popleft()
                running[pool.submit(runner.run, part, done.seeds[part.start : part.stop])] = part
            for future in wait(running, patience, FIRST_COMPLETED).done:
                done.add(running.pop(future), future.result())
    finally:
        pool.shutdown(cancel_futures=True)
    for future, part in running.items():  # of cancelled work: what was begun is done by now
        if not future.cancelled():
            done.add(part, future.result())


def _run_on_cluster(
    client: Client,
    workers: int | None,
    experiment: Experiment,
    algorithm: Algorithm | None,
    done: _Done,
    *,
    abreast: bool,
    cancelled: Callable[[], bool] | None,
) -> None:
    from lab.experiment.ensembles import cluster  # noqa: PLC0415 - imports Dask, which need not be installed

    cluster.check_client(client, workers)
    pieces = [(block, done.seeds[block.start : block.stop], abreast) for block in done.blocks]
    first = range(LANES if abreast else 1)
    is_log = isinstance(mission(experiment.mission), LogMission)
    done.ended = cluster.run_pieces(
        client,
        cluster.Parcel.of([experiment.copy().update({"seed": 0})], algorithm),  # one parcel for all seeds
        run_block,
        pieces,
        done.join,
        tell=done.tell,
        warming=None if is_log else (first, tuple(first), abreast),
        cancelled=cancelled,
    )
    done.join_what_waits()


def run_block(given: Unpacked, block: range, seeds: Sequence[int], abreast: bool) -> Collected:
    """Return the sums of a block of runs, on a worker of a cluster.

    Parameters
    ----------
    given
        The experiment, and the user's navigator.
    block
        Places of the runs in the ensemble: the first ones are judged.
    seeds
        Their seeds.
    abreast
        Whether they are run in lanes.
    """
    experiment = given.experiments[0]
    runner = _Runner(experiment, given.algorithm(), given.kept(SeedLanes.of, experiment) if abreast else None)
    found = Collected()
    for part in runner.parts(block):
        own = seeds[part.start - block.start : part.stop - block.start]
        for seed, run in zip(own, runner.run(part, own), strict=True):
            _collect(found, seed, run)
    return found


def _collect(collected: Collected, seed: int, run: RunAtFixes | DivergedError) -> None:
    if isinstance(run, DivergedError):
        collected.leave_out(seed, str(run))
    else:
        collected.add(seed, run)


def format_progress(done: int, wanted: int, began: float) -> str:
    """Return how many runs are done, and if some are not, their rate and the time left.

    Parameters
    ----------
    done, wanted
        Numbers of runs.
    began
        When the first began, in the clock of `time.monotonic`.
    """
    # The clock of some systems has not moved yet when the first runs are done.
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


def estimate_memory(experiment: Experiment) -> int:
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
    SettingError
        If the setting does not accept one.
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
    for end in (min(numbers), max(numbers)):
        experiment.copy().set("seed", end)
    return numbers


def blocks(count: int) -> list[range]:
    """Return the places of some runs in blocks, which depend on nothing but their number."""
    whole = LARGE // BLOCK  # as many blocks as usual, in whole groups of lanes
    size = SMALL_BLOCK if count <= SMALL else BLOCK
    if count > LARGE:
        size = min(-(-count // (whole * LANES)) * LANES, LARGE_BLOCK)
    return [range(first, min(first + size, count)) for first in range(0, count, size)]


class _Runner(NamedTuple):
    """What runs the seeds at some places: alone, or abreast in lanes."""

    experiment: Experiment
    algorithm: Algorithm | None
    lanes: SeedLanes | None

    def parts(self, block: range) -> list[range]:
        """Return the places of a block that are computed together; judged runs are apart from others."""
        if self.lanes is None:
            return [range(place, place + 1) for place in block]
        judged = min(max(block.start, JUDGED), block.stop)
        starts = [*range(block.start, judged, LANES), *range(judged, block.stop, LANES)]
        return [range(first, last) for first, last in zip(starts, [*starts[1:], block.stop], strict=True)]

    def run(self, part: range, seeds: Sequence[int]) -> list[RunAtFixes | DivergedError]:
        """Run the seeds of some places; a run that diverges gives the error."""
        if self.lanes is None:
            return [self._run_alone(place, seed) for place, seed in zip(part, seeds, strict=True)]
        abreast = (
            self.lanes.run(seeds, explain=part.start < EXPLAINED)
            if part.start < JUDGED
            else self.lanes.measure(seeds)
        )
        return [
            run or self._run_alone(place, seed) for place, seed, run in zip(part, seeds, abreast, strict=True)
        ]

    def _run_alone(self, place: int, seed: int) -> RunAtFixes | DivergedError:
        mine = self.experiment.copy()
        mine.set("seed", seed)
        try:
            result = mine.run(algorithm=self.algorithm)
        except DivergedError as error:
            return error.with_traceback(None)
        return keep_values(result, explain=place < EXPLAINED, judged=place < JUDGED)


class _Done:
    """The runs that are done, and who is told of them.

    Attributes
    ----------
    seeds : tuple of int
        The seed of each run.
    blocks : list of range
        The places of the runs in blocks.
    ended : str
        Why there are no further runs; see `Ensemble`.
    """

    def __init__(
        self,
        experiment: Experiment,
        seeds: tuple[int, ...],
        progress: Progress | None,
        partial: Callable[[Ensemble], None] | None,
    ) -> None:
        self.seeds, self.blocks, self.ended = seeds, blocks(len(seeds)), ""
        self._experiment, self._progress, self._partial = experiment.copy(), progress, partial
        self._collected, self._block = Collected(), Collected()
        self._waiting: dict[int, RunAtFixes | DivergedError] = {}
        self._joined, self._waiting_blocks = 0, dict[int, Collected]()
        self._began = self._shown = time.monotonic()

    def __len__(self) -> int:
        """Return the number of the runs that are added."""
        return len(self._collected) + len(self._block)

    def add(self, part: range, runs: Sequence[RunAtFixes | DivergedError]) -> None:
        """Add the runs of some places, once all before them are added; tell of each."""
        self._waiting |= dict(zip(part, runs, strict=True))
        while (place := len(self)) in self._waiting:
            _collect(self._block, self.seeds[place], self._waiting.pop(place))
            if len(self) == self.blocks[self._joined].stop:
                self._collected.join(self._block)
                self._block, self._joined = Collected(), self._joined + 1
            self._report()

    def join(self, index: int, block: Collected) -> None:
        """Add the sums of a block, once all before it are added; tell of it."""
        self._waiting_blocks[index] = block
        while self._joined in self._waiting_blocks:
            self._collected.join(self._waiting_blocks.pop(self._joined))
            self._joined += 1
            self._report()

    def join_what_waits(self) -> None:
        """Add the sums of blocks before which one is missing, for good."""
        for index in sorted(self._waiting_blocks):
            self._collected.join(self._waiting_blocks.pop(index))

    def tell(self, step: str) -> None:
        """Tell of a step before the first run, and count the time from then on."""
        self._began = time.monotonic()
        if self._progress is not None:
            self._progress(step, 0.0)

    def _report(self) -> None:
        count, wanted, now = len(self), len(self.seeds), time.monotonic()
        if self._progress is not None:
            self._progress(format_progress(count, wanted, self._began), count / wanted)
        some = 1 < count < wanted and (self._collected.has_evidence or self._block.has_evidence)
        if self._partial is not None and some and now - self._shown > SHOWN_EVERY:
            self._shown = now
            self._partial(replace(self.ensemble(), whole=False))

    def ensemble(self) -> Ensemble:
        """Return the ensemble of the runs that are added.

        Raises
        ------
        ValueError
            If the cluster was lost before there is evidence for a verdict.
        """
        whole = self._collected.copy()
        whole.join(self._block)
        if self.ended and not whole.has_evidence:
            raise ValueError(f"{self.ended} No verdict is possible without the first runs.")
        return whole.ensemble(self._experiment, self.ended)
