"""Ensemble: one experiment over many seeds, and the verdict on its filter from all runs.

Only the required values at the fixes are kept of each run; see `lab.seeds`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis import consistency, trial
from lab.analysis.algorithm_verdict import judge
from lab.analysis.evidence import Evidence
from lab.analysis.verdict import Verdict
from lab.datasets.labelled import ANGLES, EAST_NORTH_UP
from lab.experiment import Experiment
from lab.notebook_card import NotebookCard

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
TRIED = 4
"""Number of runs on which advice is tried: their mean has half the random scatter of one run."""
UNITS = ("m",) * 3 + ("m/s",) * 3 + ("°",) * 3
"""Units of position, velocity and attitude errors."""


class RunAtFixes(NamedTuple):
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
class Ensemble(NotebookCard):
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
        Root mean square of the errors over each whole flight, of ten samples a second.
    seconds : (runs,) array
        Computing time of the navigator for each run [s]; close to zero for a cached solution.
    evidence : tuple of Evidence
        Evidence of each run.
    algorithm : str
        Name of the user's own navigator; empty for those of the lab.
    """

    CARD: ClassVar[str] = "ensemble"

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


def together(experiment: Experiment, seeds: tuple[int, ...], runs: list[RunAtFixes]) -> Ensemble:
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
