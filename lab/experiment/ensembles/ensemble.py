"""Ensemble: one experiment over many seeds, and the verdict on its filter.

Of the runs only sums are kept, and a few numbers of each; see `lab.experiment.ensembles.seeds`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lab.analysis import consistency, feedforward
from lab.analysis.verdicts import linear_verdict, state_advice, trial
from lab.analysis.verdicts.agreement import agreements
from lab.analysis.verdicts.algorithm_verdict import judge
from lab.analysis.verdicts.evidence import Evidence
from lab.analysis.verdicts.run_means import NEES
from lab.analysis.verdicts.verdict import Verdict
from lab.base.arrays import FloatArray
from lab.base.notebook_card import NotebookCard
from lab.base.progress import Progress
from lab.base.registry import find
from lab.base.result_files import write_netcdf
from lab.experiment.datasets.labelled import ANGLES, EAST_NORTH_UP
from lab.experiment.ensembles.epoch_sums import EpochSums
from lab.experiment.ensembles.error_histogram import ErrorHistogram
from lab.experiment.ensembles.run_at_fixes import ChannelSums
from lab.experiment.experiment import Experiment
from lab.missions import LogMission, mission
from lab.navigation.belief import belief
from lab.navigation.settings import NavigatorSettings
from lab.run.provenance import ENSEMBLE, collect_facts, digest_arrays, netcdf_attributes, seed_ranges

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


QUANTITIES = (
    *(f"position {axis}" for axis in EAST_NORTH_UP),
    *(f"velocity {axis}" for axis in EAST_NORTH_UP),
    *(f"attitude {angle}" for angle in ANGLES),
)
"""The kept errors, in this order."""
TRIED = 4
"""Number of runs on which advice is tried: their mean has half the random scatter of one run."""
OFF_MOST = 3
"""Number of runs that are repeated with another error model, where it may be the cause."""
JUDGED = 100
"""Number of runs whose evidence gives the verdict; it takes twice as long as a run. The verdict names a
variance only if it is wrong by half, which fewer runs show beyond doubt."""
NAMED = 5
"""Most seeds of diverged runs that a sentence names."""
UNITS = ("m",) * 3 + ("m/s",) * 3 + ("°",) * 3
"""Units of position, velocity and attitude errors."""
HORIZONTAL_95 = "95 % quantile of the horizontal position errors"
OUTAGE_END = "error at the ends of the GPS outages, root mean square"
PERCENT = (5.0, 25.0, 50.0, 75.0, 95.0)
"""Percentiles of the errors in their σ: those of a matched filter are −1.64, −0.67, 0, 0.67 and 1.64."""


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble(NotebookCard):
    """Runs of one experiment with different seeds.

    Attributes
    ----------
    experiment : Experiment
        The experiment.
    seeds : tuple of int
        The seeds, one for each run.
    at_fixes : EpochSums
        Sums over the runs at the fixes: ``nees`` and ``nis``; and in the order of `QUANTITIES` and in `UNITS`
        the ``error`` (m, 9), its ``product`` (m, 9, 9) and the filter's ``variance`` (m, 9), the error in its
        σ, ``normalised``, and whether it is ``within 1`` and ``within 3`` σ. A run counts at the fixes that
        it used.
    between : EpochSums
        Sums of the ``nees`` of the position just before each whole second, so that outages show; without
        epochs for a sensor log.
    histogram : ErrorHistogram
        Histogram of the errors in their σ after the fixes.
    innovations : ChannelSums
        Sums of the innovations of all runs.
    degrees : int
        Degrees of freedom of NEES; 0 for a sensor log, whose NEES is unknown.
    nis_degrees : int
        Degrees of freedom of NIS.
    between_degrees : int
        Degrees of freedom of `between`.
    rms, largest : (runs, 9) arrays
        Root mean square and largest size of the errors over each whole flight, of ten samples a second.
    most : (runs,) array
        95 % quantile of the horizontal error of each run [m]; NaN if unknown.
    at_outage_ends : (runs, 2, 9) array
        Root mean square of the errors of each run, and of their σ, over the ends of the GPS outages; NaN if
        unknown, or without an outage.
    mean_nees, mean_nis : (runs,) arrays
        NEES and NIS of each run, averaged over its fixes; NaN if unknown.
    seconds : (runs,) array
        Computing time of the navigator for each run [s]; close to zero for a cached solution.
    evidence : tuple of Evidence
        Evidence of each of the first `JUDGED` runs.
    free : tuple of FreeRun
        How far the navigator of each of them runs free.
    algorithm : str
        Name of the user's own navigator; empty for those of the lab.
    diverged : dict of int to str
        The seeds whose runs diverged, each with the reason: these runs are left out of everything else.
    ended : str
        Why there are fewer runs than asked for: what ended the work of a cluster; empty if nothing did.
    whole : bool
        Whether no more runs will come. Before, no run is repeated for the verdict.
    """

    CARD: ClassVar[str] = "ensemble"

    experiment: Experiment
    seeds: tuple[int, ...]
    at_fixes: EpochSums
    between: EpochSums
    histogram: ErrorHistogram
    innovations: ChannelSums
    degrees: int
    nis_degrees: int
    between_degrees: int
    rms: FloatArray
    largest: FloatArray
    most: FloatArray
    at_outage_ends: NDArray[Any]
    mean_nees: FloatArray
    mean_nis: FloatArray
    seconds: FloatArray
    evidence: tuple[Evidence, ...]
    free: tuple[feedforward.FreeRun, ...]
    algorithm: str
    diverged: dict[int, str] = field(default_factory=dict)
    ended: str = ""
    whole: bool = True

    @property
    def remark(self) -> str:
        """Sentences about runs that are missing or diverged, or are beyond the linear model."""
        beyond = feedforward.remark(self._farthest, self._navigator)
        starts = [float(one.linearity.start.values.max()) for one in self.evidence if one.linearity]
        wide = linear_verdict.remark(max(starts, default=0.0), self._navigator)
        return " ".join(filter(None, (self.ended, self._diverged_runs(), beyond, wide)))

    def _diverged_runs(self) -> str:
        """Return a sentence about the runs that diverged; empty if none did."""
        if not self.diverged:
            return ""
        seeds = sorted(self.diverged)
        more = f" and {len(seeds) - NAMED} more" if len(seeds) > NAMED else ""
        named = ", ".join(map(str, seeds[:NAMED]))
        return (
            f"{len(seeds)} of {len(seeds) + len(self.seeds)} runs diverged, and are left out of all figures: "
            f"seed{'' if len(seeds) == 1 else 's'} {named}{more}."
        )

    @property
    def horizontal_at_outage_ends(self) -> FloatArray:
        """Horizontal position error of each run at the ends of the GPS outages, rms (runs,) [m]."""
        east, north = self.at_outage_ends[:, 0, :2].T.astype(np.float64)
        return np.asarray(np.hypot(east, north))

    @property
    def time(self) -> FloatArray:
        """Times of the fixes that any run used (m,) [s]."""
        return self.at_fixes.time

    @property
    def grid(self) -> FloatArray:
        """Times just before whole seconds, those of `between` (k,) [s]."""
        return self.between.time

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict on the filter from the first `JUDGED` runs together."""
        free, evidence = self._linear_runs()
        return self._of_linear(free, evidence, self._mean_nees_with)

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
        return trial.try_advice(self.verdict, [experiment.run() for experiment in first], progress)

    @cached_property
    def innovation_verdict(self) -> Verdict:
        """The verdict from the innovations alone."""
        free, evidence = self._linear_runs()
        return self._of_linear(free, evidence.without_truth())

    @cached_property
    def verdicts(self) -> tuple[Verdict, ...]:
        """Verdict on each of the first `JUDGED` runs alone."""
        return tuple(self._of_linear(free, one) for free, one in zip(self.free, self.evidence, strict=True))

    def _of_linear(
        self,
        free: feedforward.FreeRun,
        evidence: Evidence,
        repeated: Callable[[str], tuple[float, float] | None] = lambda _model: None,
    ) -> Verdict:
        """Return the verdict from evidence, with attitude errors beyond the linear model as a cause."""
        found = linear_verdict.judge(judge(evidence), evidence, self._navigator, repeated=repeated)
        found = feedforward.judge(free, found, self._navigator, evidence.nees)
        if self.algorithm or not self.degrees:
            return found
        settings = self.experiment
        P0 = None if self._navigator.alignment else belief(settings.sensors, self._navigator).P0
        return state_advice.advise_simulated(found, settings, P0)

    def _mean_nees_with(self, model: str) -> tuple[float, float] | None:
        """Return mean NEES over its degrees of freedom where it is largest, and with another error model."""
        if not self.whole:
            return None
        largest = np.argsort(-self.mean_nees[: len(self.evidence)], kind="stable")[:OFF_MOST]
        try:
            settings = self.experiment.copy().update({"navigator.model": model})
            others = [settings.copy().update({"seed": self.seeds[run]}).run() for run in largest]
        except ValueError:  # of settings, or of a run that diverges
            return None
        before, after = (
            [one.means.mean_of(NEES) for one in some]
            for some in ([self.evidence[run] for run in largest], [other.evidence for other in others])
        )
        return float(np.mean(before)), float(np.mean(after))

    @property
    def _navigator(self) -> NavigatorSettings:
        found: NavigatorSettings = self.experiment.navigator
        return found

    @property
    def _farthest(self) -> feedforward.FreeRun:
        """How far the navigator of the farthest run runs free."""
        return _farthest(self.free)

    def _linear_runs(self) -> tuple[feedforward.FreeRun, Evidence]:
        """Return the evidence of the runs to judge, and how far the farthest of their navigators runs free.

        These are the runs within the linear model; all, if that is not the most of them.
        """
        runs = list(zip(self.free, self.evidence, strict=True))
        within = [run for run in runs if run[0].excess <= 1]
        free, evidence = zip(*(within if 2 * len(within) > len(runs) else runs), strict=True)
        return _farthest(free), reduce(operator.add, evidence)

    @cached_property
    def consistency(self) -> xr.Dataset:
        """NEES and NIS averaged over the runs, with their 95 % intervals (5.4.2-9).

        NEES of all states and NIS at each fix; NEES of the position also between the fixes.
        """
        import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

        variables = {}
        for name, clock, sums, total, degrees in (
            ("anees", "time_gps", self.at_fixes, "nees", self.degrees),
            ("anis", "time_gps", self.at_fixes, "nis", self.nis_degrees),
            ("anees_between", "time_between", self.between, "nees", self.between_degrees),
        ):
            mean, low, high = _averages(sums, total, degrees)
            label = f"{name.upper()}, {degrees} degrees of freedom"
            for suffix, series in (("", mean), ("_low", low), ("_high", high)):
                variables[name + suffix] = (clock, series, {"units": "", "long_name": label})
        coords = {
            name: (name, time, {"units": "s", "long_name": "time"})
            for name, time in (("time_gps", self.time), ("time_between", self.between.time))
        }
        return xr.Dataset(variables, coords=coords)

    @cached_property
    def agreement(self) -> pd.DataFrame:
        """Table of mean NEES and NIS over their degrees of freedom, judged by the scatter of the judged runs.

        `from` and `to` are the 95 % interval of the mean, `chance` is the probability that a matched filter
        is off as far, and `limit` that below which the verdict says so. See
        `lab.analysis.verdicts.agreement`.
        """
        import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

        found = agreements(self._linear_runs()[1].means)
        rows = [(str(one.figure), one.mean, one.low, one.high, one.chance, one.limit) for one in found]
        return pd.DataFrame(rows, columns=["figure", "mean", "from", "to", "chance", "limit"])

    def inside(self, after: float = 0.0) -> tuple[float, float]:
        """Return the fractions of the epochs with average NEES and NIS in their 95 % intervals.

        Parameters
        ----------
        after
            Epochs up to this time are omitted [s].
        """
        late = self.time > after
        parts = []
        for name, degrees in (("nees", self.degrees), ("nis", self.nis_degrees)):
            mean, low, high = (series[late] for series in _averages(self.at_fixes, name, degrees))
            known = ~np.isnan(mean)
            parts.append(float(np.mean((low < mean) & (mean < high), where=known)) if known.any() else np.nan)
        return parts[0], parts[1]

    @cached_property
    def whiteness(self) -> pd.DataFrame:
        """Table of the innovations of all runs in their σ: mean, variance, and whether they are white.

        The columns are those of `lab.analysis.consistency.whiteness_table`. Components that the receiver of a
        log does not measure have no row.
        """
        seen = self.innovations
        # The sums are in north, east, down, with position first.
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

        `mean ±` is the 95 % interval of the mean over independent runs; each run counts once. Where no run
        used a fix, all is NaN except for `rms`, which is that of the whole flights, and `mean ±`.
        """
        import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

        sums = self.at_fixes
        table = {
            "quantity": QUANTITIES,
            "unit": UNITS,
            "rms": np.sqrt(np.mean(self.rms**2, axis=0)),
            "mean [σ]": sums.mean_of_all("normalised"),
            "mean ±": consistency.whiteness_band(len(self.seeds)),
            "within ±1σ [%]": 100 * sums.mean_of_all("within 1"),
            "within ±3σ [%]": 100 * sums.mean_of_all("within 3"),
        }
        return pd.DataFrame(table)

    @cached_property
    def errors(self) -> xr.Dataset:
        """Errors of all runs after each fix: their mean, rms and covariance, and σ according to the filter.

        ``percentile`` has percentiles of the errors in their σ, of all fixes in each of 256 parts of the
        flight; those of a histogram, see `ErrorHistogram`.
        """
        import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

        sums, edges = self.at_fixes, self.histogram.edges
        mean, product = sums.mean("error"), sums.mean("product")
        square = np.diagonal(product, axis1=1, axis2=2)
        at, other = ("time_gps", "quantity"), ("time_gps", "quantity", "quantity_too")
        return xr.Dataset(
            {
                "mean": (at, mean, {"long_name": "mean error"}),
                "rms": (at, np.sqrt(square), {"long_name": "root mean square error"}),
                "sigma": (at, np.sqrt(sums.mean("variance")), {"long_name": "rms of the filter's σ"}),
                "covariance": (
                    other,
                    product - mean[:, :, None] * mean[:, None, :],
                    {"long_name": "covariance of the errors"},
                ),
                "percentile": (
                    ("percent", "time_part", "quantity"),
                    self.histogram.percentiles(PERCENT),
                    {"long_name": "percentile of the errors in their σ", "units": ""},
                ),
            },
            {
                "time_gps": ("time_gps", self.time, {"units": "s", "long_name": "time"}),
                "time_part": ("time_part", (edges[1:] + edges[:-1]) / 2, {"units": "s", "long_name": "time"}),
                "percent": list(PERCENT),
                "quantity": list(QUANTITIES),
                "quantity_too": list(QUANTITIES),
                "unit": ("quantity", list(UNITS)),
            },
        )

    @property
    def runs(self) -> xr.Dataset:
        """The figures of each run: rms and largest errors, NEES, NIS, and the horizontal error."""
        import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

        of_all, of_each = ("seed", "quantity"), "seed"
        units = ", ".join(dict.fromkeys(UNITS))
        # The seed of a run that hides something is in no file: its runs are numbered.
        seeds = list(range(1, len(self.seeds) + 1)) if self.experiment.hidden else list(self.seeds)
        return xr.Dataset(
            {
                "rms": (of_all, self.rms, {"long_name": "root mean square error", "units": units}),
                "largest": (of_all, self.largest, {"long_name": "largest error", "units": units}),
                "horizontal_95": (of_each, self.most, {"long_name": HORIZONTAL_95, "units": "m"}),
                "outage_end": (of_all, self.at_outage_ends[:, 0], {"long_name": OUTAGE_END, "units": units}),
                "nees": (of_each, self.mean_nees, {"long_name": "NEES, mean over the fixes", "units": "1"}),
                "nis": (of_each, self.mean_nis, {"long_name": "NIS, mean over the fixes", "units": "1"}),
            },
            {"seed": seeds, "quantity": list(QUANTITIES), "unit": ("quantity", list(UNITS))},
        )

    def to_netcdf(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write ``runs``, ``errors`` and ``consistency`` as groups of one netCDF file.

        Parameters
        ----------
        path
            The file, in a folder that exists.
        overwrite
            True replaces an existing file.

        Raises
        ------
        OSError
            If the file exists and may not be replaced, or cannot be written.
        """
        names = ("runs", "errors", "consistency")
        title = f"{len(self.seeds)} runs of {self.experiment.mission}"
        write_netcdf(
            Path(path),
            lambda: {name: getattr(self, name) for name in names},
            netcdf_attributes(self.facts, title),
            overwrite=overwrite,
        )

    @property
    def facts(self) -> dict[str, Any]:
        """What makes this ensemble again, as every export has it; see `lab.run.provenance`."""
        figures = (self.rms, self.largest, self.most, self.mean_nees, self.mean_nis)
        flight = mission(self.experiment.mission)
        is_one = self.experiment.hidden or isinstance(flight, LogMission)
        return collect_facts(
            self.experiment,
            flight,
            ENSEMBLE,
            algorithm=self.algorithm or None,
            seeds=None if is_one else seed_ranges(self.seeds),
            result_sha256=digest_arrays(figures),
        )

    def to_dict(self, verdict: Verdict | None = None) -> dict[str, Any]:
        """Return the ensemble as plain data of a fixed form, which ``docs/json.md`` describes.

        Parameters
        ----------
        verdict
            As `with_advice_tried` returns it; by default advice is not tried.
        """
        form: dict[str, Any] = find("ensemble", "json")(self, verdict or self.verdict)
        return form

    def __repr__(self) -> str:
        table = self.coverage.to_string(index=False, float_format=lambda value: f"{value:.4g}")
        lines = f"{len(self.seeds)} seeds: {self.verdict}", self.remark, table
        return f"Ensemble of {self.experiment.mission}, " + "\n".join(filter(None, lines))


def _farthest(free: Sequence[feedforward.FreeRun]) -> feedforward.FreeRun:
    """Return that of the navigator which runs farthest beyond what is linear."""
    return max(free, key=lambda one: one.excess, default=feedforward.CORRECTED)


def _averages(sums: EpochSums, name: str, degrees: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the mean over the runs at each epoch, and the ends of its 95 % interval."""
    counts = sums.count[name]
    limits = {
        int(count): consistency.chi_square_interval(degrees, int(count)) if count else (np.nan, np.nan)
        for count in np.unique(counts)
    }
    low, high = np.array([limits[int(count)] for count in counts]).reshape(-1, 2).T
    return sums.mean(name), low, high
