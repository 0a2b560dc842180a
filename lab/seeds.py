"""Seeds: one experiment run with many seeds, on all cores.

Only the required values at the fixes are kept of each run, so that a thousand runs fit into memory.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed

import numpy as np
from numpy.typing import NDArray

from lab.analysis.budget import believed_sigma
from lab.analysis.consistency import normalised_squares, uncertain
from lab.analysis.errors import error_state
from lab.analysis.evidence import position_nees, whole_seconds
from lab.analysis.path_errors import errors_of, path_of
from lab.analysis.run_evidence import evidence_of, reference_of
from lab.ensemble import QUANTITIES, Ensemble, Progress, RunAtFixes, together
from lab.experiment import Experiment
from lab.missions import LogMission, mission
from lab.navigation.algorithm import Algorithm
from lab.navigation.kalman import MEASUREMENTS
from lab.result import Result
from lab.seed_lanes import LANES, SeedLanes

FloatArray = NDArray[np.float64]

EXPLAINED = 8
"""Number of runs whose suspicious innovations are explained, which takes several times as long as a run. The
other runs add only to the remaining evidence."""
MANY = 100
"""Number of runs from which on they are run eight abreast. Their filter is compiled separately, which takes
as long as some hundred single runs; from then on it is loaded from the disk."""
SHOWN_EVERY = 2.0
"""Time between two partial ensembles [s]: putting 1,000 runs together takes 0.02 s."""


def run_ensemble(
    experiment: Experiment,
    seeds: int | Sequence[int],
    progress: Progress | None = None,
    *,
    workers: int | None = None,
    algorithm: Algorithm | None = None,
    partial: Callable[[Ensemble], None] | None = None,
) -> Ensemble:
    """Run an experiment over seeds, on all cores: the kernels release the interpreter.

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
        Number of threads; by default one for each core.
    algorithm
        The user's navigator; it is called from one thread only.
    partial
        Called every two seconds with the ensemble of the runs that are done so far.

    Raises
    ------
    ValueError
        If there is no seed, or more than one for a log; and as in `Experiment.run`.
    """
    chosen = range(experiment.seed, experiment.seed + seeds) if isinstance(seeds, int) else seeds
    numbers = tuple(int(seed) for seed in chosen)
    if not numbers:
        raise ValueError(f"seeds: {seeds!r} contains no run; accepted is a number from 1, or a list of seeds")
    if len(numbers) > 1 and isinstance(mission(experiment.mission), LogMission):
        raise ValueError(
            f"seeds: {len(numbers)} runs of a sensor log would all be the same, since it has no random "
            "draws; accepted is one"
        )

    def alone(seed: int) -> RunAtFixes:
        mine = experiment.copy()
        mine.set("seed", seed)
        return _keep(mine.run(algorithm=algorithm), explain=seed in numbers[:EXPLAINED])

    def abreast(lanes: SeedLanes, seeds: tuple[int, ...]) -> list[RunAtFixes]:
        return [run or alone(seed) for seed, run in zip(seeds, lanes.run(seeds), strict=True)]

    # The user's code need not be thread-safe.
    workers = 1 if algorithm is not None else workers or os.cpu_count()
    pool = ThreadPoolExecutor(workers, thread_name_prefix="ensemble")
    done = _Done(experiment, numbers, progress, partial)
    try:
        lanes = SeedLanes.of(experiment) if algorithm is None and len(numbers) >= MANY else None
        one_by_one = len(numbers) if lanes is None else EXPLAINED
        running: dict[Future[list[RunAtFixes]], int] = {
            pool.submit(lambda seed: [alone(seed)], seed): index
            for index, seed in enumerate(numbers[:one_by_one])
        }
        if lanes is not None:
            for first in range(one_by_one, len(numbers), LANES):
                running[pool.submit(abreast, lanes, numbers[first : first + LANES])] = first
        for future in as_completed(running):
            for index, run in enumerate(future.result(), start=running.pop(future)):
                done.add(index, run)
    finally:
        pool.shutdown(cancel_futures=True)
    return done.ensemble()


class _Done:
    """The runs that are done, and who is told of them."""

    def __init__(
        self,
        experiment: Experiment,
        seeds: tuple[int, ...],
        progress: Progress | None,
        partial: Callable[[Ensemble], None] | None,
    ) -> None:
        self._experiment, self._seeds = experiment.copy(), seeds
        self._progress, self._partial = progress, partial
        self._runs: dict[int, RunAtFixes] = {}
        self._began = self._shown = time.monotonic()

    def add(self, index: int, run: RunAtFixes) -> None:
        """Add the run of a seed, and tell of it."""
        self._runs[index] = run
        count, wanted, now = len(self._runs), len(self._seeds), time.monotonic()
        if self._progress is not None:
            rate = count / max(now - self._began, 1e-9)
            left = f", {rate:.3g} per second, {(wanted - count) / rate:.0f} s left" if count < wanted else ""
            self._progress(f"{count:,} of {wanted:,} runs{left}", count / wanted)
        if self._partial is not None and 1 < count < wanted and now - self._shown > SHOWN_EVERY:
            self._shown = now
            self._partial(self.ensemble())

    def ensemble(self) -> Ensemble:
        """Return the ensemble of the runs that are done, in the order of their seeds."""
        order = sorted(self._runs)
        seeds = tuple(self._seeds[index] for index in order)
        return together(self._experiment, seeds, [self._runs[index] for index in order])


def _keep(result: Result, *, explain: bool = True) -> RunAtFixes:
    """Return the kept values of a result; unknown values of a log are NaN.

    `explain` is true if suspicious innovations are to be explained.
    """
    solution = result.solution_arrays
    used = solution.fix_sample >= 0
    at = solution.fix_sample[used]

    grid, apart, apart_degrees = _between(result)
    error, sigma, rms = _errors(result, at)
    nees, degrees = _nees(result, at, solution.fix_covariance[used])
    nu = solution.innovation
    measured = np.isfinite(nu).sum(axis=1)
    return RunAtFixes(
        time=result.fixes.time[used],
        nees=nees,
        nis=normalised_squares(np.nan_to_num(nu[used]), solution.innovation_covariance[used]),
        grid=grid,
        between=apart,
        between_degrees=apart_degrees,
        error=error,
        sigma=sigma,
        rms=rms,
        degrees=degrees,
        nis_degrees=int(measured.max()) if measured.any() else MEASUREMENTS,
        evidence=evidence_of(result, result.filtered, explain=explain),
        seconds=result.seconds,
        algorithm=result.algorithm,
    )


def _nees(result: Result, at: NDArray[np.int64], P: FloatArray) -> tuple[FloatArray, int]:
    """Return NEES at samples (m,) with covariances P (m, n, n), and its degrees of freedom."""
    if result.lacks("consistency"):
        return np.full(at.size, np.nan), 0
    true = reference_of(result)
    x = error_state(result.solution_arrays, at, true.truth, true.bias, true.scale, true.further)
    return normalised_squares(x, P), int(uncertain(P).size) if P.size else 0


def _between(result: Result) -> tuple[FloatArray, FloatArray, int]:
    """Return times between the fixes, NEES of the position there, and its degrees of freedom."""
    if result.lacks("consistency"):
        return np.zeros(0), np.zeros(0), 0
    at = np.maximum(whole_seconds(result.time) - 1, 1)
    nees, degrees = position_nees(result.solution_arrays, at, reference_of(result))
    return result.time[at], nees, degrees


def _errors(result: Result, at: NDArray[np.int64]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return errors and their σ (m, 9) at samples (m,), and the rms (9,) of those known along the path."""
    wide = len(QUANTITIES)
    error, sigma = np.full((at.size, wide), np.nan), believed_sigma(result, at)[:, :wide]
    if result.lacks("errors"):
        return error, sigma, np.full(wide, np.nan)
    along = _errors_at(result, path_of(result.time, float(result.experiment.sensors.gps.period)))
    known = np.isfinite(along)
    count = known.sum(axis=0)
    square = np.sum(along**2, axis=0, where=known)
    rms = np.sqrt(np.divide(square, count, out=np.full(wide, np.nan), where=count > 0))
    return _errors_at(result, at), sigma, np.asarray(rms)


def _errors_at(result: Result, at: NDArray[np.int64]) -> FloatArray:
    """Return the errors (m, 9) at samples (m,)."""
    solution = result.solution_arrays
    truth = result.known_truth("errors").taken(at)
    return errors_of(solution.position[at], solution.velocity_n[at], solution.q_nb[at], truth)
