"""Ensemble: one experiment over many seeds, and the verdict on its filter from all runs.

Only the required values at the fixes are kept of each run, so that hundreds of runs fit into memory.
"""

from __future__ import annotations

import operator
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis import consistency, trial
from lab.analysis.algorithm_verdict import judge
from lab.analysis.evidence import Evidence, position_nees, whole_seconds
from lab.analysis.run_evidence import evidence_of, reference_of
from lab.analysis.verdict import Verdict
from lab.datasets.labelled import ANGLES, EAST_NORTH_UP
from lab.experiment import Experiment
from lab.missions import LogMission, mission
from lab.navigation.algorithm import Algorithm
from lab.result import Result

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]

QUANTITIES = (
    *(f"position {axis}" for axis in EAST_NORTH_UP),
    *(f"velocity {axis}" for axis in EAST_NORTH_UP),
    *(f"attitude {angle}" for angle in ANGLES),
)
"""The kept errors, in this order."""
EXPLAINED = 8
"""Number of runs whose suspicious innovations are explained, which takes several times as long as a run. The
other runs add only to the remaining evidence."""
TRIED = 4
"""Number of runs on which advice is tried: their mean has half the random scatter of one run."""
UNITS = ("m",) * 3 + ("m/s",) * 3 + ("°",) * 3
"""Units of position, velocity and attitude errors."""


class _Run(NamedTuple):
    """The kept values of one run: at the m fixes, and for the whole run."""

    time: FloatArray
    nees: FloatArray
    nis: FloatArray
    grid: FloatArray
    between: FloatArray
    between_degrees: int
    error: FloatArray
    sigma: FloatArray
    rms: FloatArray
    degrees: int
    nis_degrees: int
    evidence: Evidence
    seconds: float
    algorithm: str


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble:
    """Runs of one experiment with different seeds.

    Attributes
    ----------
    experiment : Experiment
        The experiment.
    seeds : tuple of int
        The seeds, one for each run.
    time : (m,) array
        Times of the fixes that all runs have [s].
    nees, nis : (runs, m) arrays
        NEES and NIS at each fix; NaN if a run did not use the fix.
    grid : (k,) array
        Times just before each whole second, so that outages show [s]; empty for a sensor log.
    between : (runs, k) array
        NEES of the position at these times.
    between_degrees : int
        Its degrees of freedom.
    degrees : int
        Degrees of freedom of NEES; 0 for a sensor log, whose NEES is unknown.
    nis_degrees : int
        Degrees of freedom of NIS.
    error, sigma : (runs, m, 9) arrays
        Errors and their σ after each fix, in the order of `QUANTITIES` and in `UNITS`.
    rms : (runs, 9) array
        Root mean square of the errors over each whole flight.
    seconds : (runs,) array
        Computing time of the navigator for each run [s]; close to zero for a cached solution.
    evidence : tuple of Evidence
        Evidence of each run.
    algorithm : str
        Name of the user's own navigator; empty for those of the lab.
    """

    experiment: Experiment
    seeds: tuple[int, ...]
    time: FloatArray
    nees: FloatArray
    nis: FloatArray
    grid: FloatArray
    between: FloatArray
    between_degrees: int
    degrees: int
    nis_degrees: int
    error: FloatArray
    sigma: FloatArray
    rms: FloatArray
    seconds: FloatArray
    evidence: tuple[Evidence, ...]
    algorithm: str

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict on the filter from all runs together."""
        return judge(reduce(operator.add, self.evidence))

    @cached_property
    def tried_verdict(self) -> Verdict:
        """The verdict, with its advice tried on the first runs; advice that makes things worse is not given.

        This takes several times as many runs as `TRIED`; `verdict` is the same without trials.
        """
        return self.with_advice_tried()

    def with_advice_tried(self, progress: Progress | None = None) -> Verdict:
        """Return the verdict, with its advice tried on the first runs; `progress` as in `run_ensemble`."""
        if not trial.can_be_tried(self.verdict, self.algorithm):
            return self.verdict
        first = [self.experiment.copy().update({"seed": seed}) for seed in self.seeds[:TRIED]]
        return trial.tried(self.verdict, [experiment.run() for experiment in first], progress)

    @cached_property
    def innovation_verdict(self) -> Verdict:
        """The verdict from the innovations alone."""
        return judge(reduce(operator.add, self.evidence).without_truth())

    @cached_property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Verdict on each run alone."""
        return tuple(judge(one) for one in self.evidence)

    @cached_property
    def consistency(self) -> xr.Dataset:
        """NEES and NIS averaged over the runs, with their 95 % intervals (5.4.2-9).

        NEES of all states and NIS at each fix; NEES of the position also between the fixes.
        """
        import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

        variables = {}
        for name, clock, values, degrees in (
            ("anees", "time_gps", self.nees, self.degrees),
            ("anis", "time_gps", self.nis, self.nis_degrees),
            ("anees_between", "time_between", self.between, self.between_degrees),
        ):
            mean, low, high = _averages(values, degrees)
            label = f"{name.upper()}, {degrees} degrees of freedom"
            for suffix, series in (("", mean), ("_low", low), ("_high", high)):
                variables[name + suffix] = (clock, series, {"units": "", "long_name": label})
        coords = {
            name: (name, time, {"units": "s", "long_name": "time"})
            for name, time in (("time_gps", self.time), ("time_between", self.grid))
        }
        return xr.Dataset(variables, coords=coords)

    def inside(self, after: float = 0.0) -> tuple[float, float]:
        """Return the fractions of the epochs with average NEES and NIS in their 95 % intervals.

        Parameters
        ----------
        after
            Epochs up to this time are omitted [s].
        """
        late = self.time > after
        parts = []
        for values, degrees in ((self.nees, self.degrees), (self.nis, self.nis_degrees)):
            mean, low, high = (series[late] for series in _averages(values, degrees))
            known = ~np.isnan(mean)
            parts.append(float(np.mean((low < mean) & (mean < high), where=known)) if known.any() else np.nan)
        return parts[0], parts[1]

    @cached_property
    def whiteness(self) -> pd.DataFrame:
        """Table of the innovations of all runs in their σ: mean, variance, and whether they are white.

        The columns are those of `lab.analysis.consistency.whiteness_table`. Components that the receiver of a
        log does not measure have no row.
        """
        seen = reduce(operator.add, self.evidence).innovations
        # The evidence is in north, east, down, with position first.
        order, sign = [1, 0, 2, 4, 3, 5], np.array([1, 1, -1] * 2)
        number = seen.squares.number[order]
        power = np.maximum(seen.squares.total, 1e-300)
        table = consistency.whiteness_table(
            sign * seen.sums[order] / np.maximum(number, 1),
            seen.squares.total[order] / np.maximum(number, 1),
            np.concatenate((np.ones((1, 6)), (seen.lagged / power)[:, order])),
            float(number.max() / len(self.seeds)),
            len(self.seeds),
        )
        return table[number > 0].reset_index(drop=True) if number.any() else table

    @cached_property
    def coverage(self) -> pd.DataFrame:
        """Table of the errors after the fixes: rms, mean in σ, and fractions within ±1σ and ±3σ.

        `mean ±` is the 95 % interval of the mean over independent runs; each run counts once.
        """
        import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

        known = ~np.isnan(self.error[..., 0])
        errors, sigma = self.error[known], self.sigma[known]
        table = {
            "quantity": QUANTITIES,
            "unit": UNITS,
            "rms": np.sqrt(np.mean(self.rms**2, axis=0)),
            "mean [σ]": np.mean(errors / sigma, axis=0) if errors.size else np.full(len(QUANTITIES), np.nan),
            "mean ±": consistency.whiteness_band(len(self.seeds)),
            "within ±1σ [%]": 100 * consistency.coverage(errors, sigma, 1),
            "within ±3σ [%]": 100 * consistency.coverage(errors, sigma, 3),
        }
        return pd.DataFrame(table)

    def __repr__(self) -> str:
        table = self.coverage.to_string(index=False, float_format=lambda value: f"{value:.4g}")
        return f"Ensemble of {self.experiment.mission}, {len(self.seeds)} seeds: {self.verdict}\n{table}"


def run_ensemble(
    experiment: Experiment,
    seeds: int | Sequence[int],
    progress: Progress | None = None,
    *,
    workers: int | None = None,
    algorithm: Algorithm | None = None,
) -> Ensemble:
    """Run an experiment over seeds, on all cores: the kernels release the interpreter.

    Parameters
    ----------
    experiment
        Experiment to run; its own seed is the first if a number of runs is given.
    seeds
        Number of runs, or the seed of each; a sensor log has one run.
    progress
        Called with a sentence about the current work and the fraction done, from 0 to 1.
    workers
        Number of threads; by default one for each core.
    algorithm
        The user's navigator; it is called from one thread only.

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
    count = 0
    lock = threading.Lock()

    def one(seed: int) -> _Run:
        nonlocal count
        mine = experiment.copy()
        mine.set("seed", seed)
        kept = _keep(mine.run(algorithm=algorithm), explain=seed in numbers[:EXPLAINED])
        with lock:
            count += 1
            if progress is not None:
                progress(f"{count} of {len(numbers)} runs", count / len(numbers))
        return kept

    # The user's code need not be thread-safe.
    workers = 1 if algorithm is not None else workers or os.cpu_count()
    pool = ThreadPoolExecutor(workers, thread_name_prefix="ensemble")
    try:
        runs = list(pool.map(one, numbers))
    finally:
        pool.shutdown(cancel_futures=True)
    return _together(experiment.copy(), numbers, runs)


def _keep(result: Result, *, explain: bool = True) -> _Run:
    """Return the kept values of a result; unknown values of a log are NaN.

    `explain` is true if suspicious innovations are to be explained.
    """
    solution = result.solution_arrays
    used = solution.fix_sample >= 0
    at = solution.fix_sample[used]

    grid, apart, apart_degrees = _between(result)
    error, sigma, rms = _errors(result, at)
    unknown = bool(result.lacks("consistency"))
    return _Run(
        time=result.fixes.time[used],
        nees=np.full(at.size, np.nan) if unknown else result.consistency["nees"].values[used],
        nis=result.innovations["nis"].values[used],
        grid=grid,
        between=apart,
        between_degrees=apart_degrees,
        error=error,
        sigma=sigma,
        rms=rms,
        degrees=0 if unknown else int(result.consistency["nees"].attrs["degrees"]),
        nis_degrees=int(result.innovations["nis"].attrs["degrees"]),
        evidence=evidence_of(result, result.filtered, explain=explain),
        seconds=result.seconds,
        algorithm=result.algorithm,
    )


def _between(result: Result) -> tuple[FloatArray, FloatArray, int]:
    """Return times between the fixes, NEES of the position there, and its degrees of freedom."""
    if result.lacks("consistency"):
        return np.zeros(0), np.zeros(0), 0
    at = np.maximum(whole_seconds(result.time) - 1, 1)
    nees, degrees = position_nees(result.solution_arrays, at, reference_of(result))
    return result.time[at], nees, degrees


def _errors(result: Result, at: NDArray[np.int64]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return errors and their σ (m, 9) at samples (m,), and the root mean square (9,) of all known errors."""
    wide = len(QUANTITIES)
    error, sigma = np.full((at.size, wide), np.nan), np.full((at.size, wide), np.nan)
    total, count, first = np.zeros(wide), np.zeros(wide, dtype=np.int64), 0
    for part in result.parts():
        here = (first <= at) & (at < first + part.time.size)
        sigma[here] = _nine(part.sigma)[at[here] - first]
        if not result.lacks("errors"):
            there = _nine(part.errors)
            known = np.isfinite(there)
            total += np.sum(there**2, axis=0, where=known)
            count += known.sum(axis=0)
            error[here] = there[at[here] - first]
        first += part.time.size
    rms = np.sqrt(np.divide(total, count, out=np.full(wide, np.nan), where=count > 0))
    return error, sigma, np.asarray(rms)


def _nine(group: xr.Dataset) -> FloatArray:
    """Return position, velocity and attitude of a dataset in one array (n, 9)."""
    return np.concatenate([group[name].values for name in ("position", "velocity", "attitude")], axis=1)


def _together(experiment: Experiment, seeds: tuple[int, ...], runs: list[_Run]) -> Ensemble:
    """Align runs at the fixes; a run that did not use a fix has NaN there."""
    time = np.unique(np.concatenate([run.time for run in runs]))
    places = [np.searchsorted(time, run.time) for run in runs]

    def beside(name: str, *shape: int) -> FloatArray:
        out = np.full((len(runs), time.size, *shape), np.nan)
        for row, place, run in zip(out, places, runs, strict=True):
            row[place] = getattr(run, name)
        return out

    return Ensemble(
        experiment=experiment,
        seeds=seeds,
        time=time,
        nees=beside("nees"),
        nis=beside("nis"),
        grid=runs[0].grid,
        between=np.stack([run.between for run in runs]),
        between_degrees=runs[0].between_degrees,
        degrees=runs[0].degrees,
        nis_degrees=runs[0].nis_degrees,
        error=beside("error", len(QUANTITIES)),
        sigma=beside("sigma", len(QUANTITIES)),
        rms=np.stack([run.rms for run in runs]),
        seconds=np.array([run.seconds for run in runs]),
        evidence=tuple(run.evidence for run in runs),
        algorithm=runs[0].algorithm,
    )


def _averages(values: FloatArray, degrees: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the mean over the runs at each epoch, and the ends of its 95 % interval."""
    counts = np.sum(~np.isnan(values), axis=0)
    total = np.nansum(values, axis=0)
    mean = np.divide(total, counts, out=np.full(counts.shape, np.nan), where=counts > 0)
    limits = {
        int(count): consistency.chi_square_interval(degrees, int(count)) if count else (np.nan, np.nan)
        for count in np.unique(counts)
    }
    low, high = np.array([limits[int(count)] for count in counts]).reshape(-1, 2).T
    return mean, low, high
