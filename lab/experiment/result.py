"""Result: the user interface of a run: its datasets with units, its tables, its verdict, its files.

A result is a `Run` with its arrays. Users read it as `xarray.Dataset`s, which are built at their first use:
degrees, datasheet units for the sensors, east-north-up. There are results of a simulation
(`lab.experiment.simulated_result`) and of a sensor log (`lab.experiment.log_result`).
"""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from param.parameterized import ParameterizedABC

from lab.analysis import budget, feedforward, observability
from lab.analysis.verdicts import linear_verdict
from lab.analysis.verdicts.run_evidence import Filtered
from lab.base import result_files
from lab.base.histories import cached_unless_long
from lab.base.notebook_card import HtmlFrame, NotebookCard
from lab.base.numbers import format_number
from lab.base.progress import Progress
from lab.base.registry import find
from lab.experiment.datasets import flight, innovations, sensors, tables
from lab.experiment.judged_run import JudgedRun
from lab.experiment.result_plots import ResultPlots
from lab.motion.frames.projection import Projection
from lab.navigation.algorithm import Algorithm
from lab.navigation.filters.error_models import ATT
from lab.run.experiment_settings import ExperimentSettings
from lab.run.provenance import facts_block, facts_of_run, netcdf_attributes, time_stamp_now

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from lab.analysis.identification.identification import Identification


DATASETS = (
    "truth",
    "solution",
    "errors",
    "sigma",
    "state_sigma",
    "imu",
    "gps",
    "track",
    "sensor_errors",
    "innovations",
    "autocorrelation",
    "consistency",
)
"""Names of the datasets of every result, as in files."""


DRAWN = 2**16
"""Samples of a long flight among which a drawing chooses the some thousand points of a path: in four hours
one each 0.22 s, in which an aircraft at 60 m/s moves a 5000th of the drawing of a flight of 65 km."""


class Runnable(ExperimentSettings, ParameterizedABC):
    """Settings that can be run: the part of the experiment that a result needs."""

    @abstractmethod
    def run(self, progress: Progress | None = None, *, algorithm: Algorithm | None = None) -> Result:
        """Compute the experiment; see `lab.experiment.experiment.Experiment.run`."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Result(NotebookCard, JudgedRun):
    """The result of one run.

    The datasets are made from the arrays at their first use. Two threads may both make the same one. Some
    datasets of a sensor log are unknown: `missing_reason` says why, and reading one raises `ResultError`.

    Attributes
    ----------
    experiment : Experiment
        The settings of the run. The arrays are those of `Run`.
    """

    CARD = "result"

    experiment: Runnable

    @property
    @abstractmethod
    def realisation(self) -> str:
        """Text that distinguishes runs with the same settings: ``"seed 1"``; empty for a log."""

    @property
    @abstractmethod
    def has_temperature(self) -> bool:
        """Whether a temperature profile is simulated; without one the IMU is at 25 °C."""

    @cached_unless_long
    def truth(self) -> xr.Dataset:
        """The true flight; for a log, its reference."""
        return flight.truth(self)

    @cached_unless_long
    def solution(self) -> xr.Dataset:
        """The estimated flight."""
        return flight.solution(self)

    @cached_unless_long
    def errors(self) -> xr.Dataset:
        """Errors of the solution: estimate minus truth; for a log, minus its reference, or NaN."""
        return flight.errors(self)

    @cached_unless_long
    def sigma(self) -> xr.Dataset:
        """One standard deviation of the errors, according to the filter."""
        return flight.sigma(self)

    @cached_unless_long
    def state_sigma(self) -> xr.Dataset:
        """One standard deviation of all error states, according to the filter; each in its own unit."""
        return flight.state_sigma(self)

    @cached_unless_long
    def imu(self) -> xr.Dataset:
        """Output of the IMU as mean rates over each sample; for a simulation, also of a perfect IMU."""
        return sensors.imu(self)

    @cached_unless_long
    def temperature(self) -> xr.Dataset:
        """Temperature of the IMU in each sample interval, and the reading of its thermometer."""
        return sensors.temperature(self)

    @cached_property
    def gps(self) -> xr.Dataset:
        """The GPS fixes and, if simulated, their errors; those of a log as used, reduced to the IMU."""
        return sensors.gps(self, self.projection)

    @cached_unless_long
    def track(self) -> xr.Dataset:
        """True and estimated path in metres on the map; for a log, the reference, if any, is the true one."""
        return flight.track(self, self.projection)

    @cached_property
    def drawn_track(self) -> xr.Dataset:
        """The track for a drawing: of a long flight, some `DRAWN` samples, evenly spaced, and the last."""
        samples = self.time.size
        if not self.is_long:
            return self.track
        chosen = np.append(np.arange(0, samples - 1, -(-samples // DRAWN)), samples - 1)
        return flight.track(self, self.projection, chosen)

    def places(self, samples: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the estimated easting, northing and height (m, 3) of some samples (m,) [m]."""
        if self.is_long:
            there, samples = flight.track(self, self.projection, samples), np.arange(samples.size)
        else:
            there = self.track
        track = there.sel(path="estimated")
        return np.stack([track[name].values[samples] for name in ("easting", "northing", "height")], axis=-1)

    @cached_property
    def projection(self) -> Projection:
        """Map projection of the flight."""
        latitude, longitude = self._origin
        return Projection.at(float(latitude), float(longitude))

    @property
    @abstractmethod
    def _origin(self) -> tuple[float, float]:
        """Latitude and longitude [rad] of the centre of the projection."""

    @cached_unless_long
    def sensor_errors(self) -> xr.Dataset:
        """Estimated biases with σ, and the true ones if simulated; with 21 states also scale factors."""
        return sensors.sensor_errors(self)

    @cached_unless_long
    def further_states(self) -> xr.Dataset:
        """Estimates and σ of the further states of the filter, and their true values if simulated.

        Each state has its `unit`. Empty for a filter that has the states of the IMU only.
        """
        return innovations.further_states(self)

    @cached_property
    def aiding(self) -> xr.Dataset:
        """Innovations of the measurements besides GPS (navigator minus measurement), and their σ.

        Each has its `kind` and `unit`; `used` is false for those that the gate rejected. Empty without other
        sensors.
        """
        return innovations.aiding(self)

    @cached_property
    def innovations(self) -> xr.Dataset:
        """Innovations of the fixes (navigator minus GPS), their σ, and NIS; NaN for a fix not used.

        A fix rejected by the gate keeps its innovation, and has no NIS. Unmeasured components of a real
        receiver are NaN. Attribute `degrees` of `nis`: number of measurements per fix.
        """
        return innovations.innovations(self)

    @cached_property
    def autocorrelation(self) -> xr.Dataset:
        """Normalised autocorrelation of the innovations; attribute `band`: half-width of the 95 % band."""
        return innovations.autocorrelation(self, self.innovations)

    @cached_property
    def consistency(self) -> xr.Dataset:
        """NEES of the states after each fix; attribute `degrees` of `nees`: states that have a variance.

        NaN with 0 degrees if no fix was used, or a user's algorithm gave no covariance.
        """
        return innovations.consistency(self)

    @cached_property
    def budget(self) -> xr.Dataset:
        """Error budget: the contribution of each source to the σ of the errors; see `budget.error_budget`."""
        return budget.error_budget(self)

    @cached_property
    def observability(self) -> xr.Dataset:
        """Reduction of σ by manoeuvre; see `observability.observability`."""
        return observability.observability(self)

    def update_at(self, time: float) -> xr.Dataset:
        """Return the update of the filter by the last fix at a time or before, in numbers.

        The filter runs again up to that fix, which takes as long as a run's navigation.

        Parameters
        ----------
        time
            Time since the start of the flight [s].

        Returns
        -------
        xr.Dataset
            ``before`` and ``after`` (state, other_state): P before and after the fix, each state in its
            `unit`; ``start`` (state): σ at the start. ``H`` (measurement, state), ``R`` and ``S``
            (measurement, other_measurement): measurement matrix, and covariances of the fix as used and of
            the innovation. ``innovation`` (measurement): navigator minus fix [m], [m/s]. ``gain`` (state,
            measurement): K, zero for a rejected fix; ``correction`` (state): K y. ``ratio`` (direction): σ
            now over σ at the start, ``along`` (direction, state): directions of the error, the least observed
            first; see `lab.analysis.fix_update.directions`. Attributes: `time` [s] and number of the `fix`,
            its `outcome` (used, rejected, or recovered), whether `heading_held`, `nis`, and the interval
            `nis_from`, `nis_to` that contains 95 % of a right filter's.

        Raises
        ------
        ResultError
            If there is no fix yet, or the updates are unknown: of a user's algorithm, of a smoothed log, of a
            run that hides settings.
        """
        return innovations.update_at(self, time)

    @cached_property
    def position_covariance(self) -> xr.DataArray:
        """Covariance of the position error after each fix, east, north, up [m²]."""
        return innovations.position_covariance(self)

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Table of the errors over the whole flight: rms, maximum, and 95 % quantile.

        For a log, only of quantities in the reference, and with mean and standard deviation, since a
        reference may have a constant error.
        """
        return tables.summary(self)

    @property
    def filtered(self) -> Filtered:
        """The filter's own run: for a smoothed run, its forward run, otherwise the solution.

        For a long simulated flight that was smoothed, without most histories; see `renavigation.filter_run`.
        """
        if self.algorithm or not self.experiment.navigator.smoother:
            return Filtered(self.solution_arrays)
        alone = self.experiment.copy()
        alone.set("navigator.smoother", False)
        return Filtered(alone.run().solution_arrays)

    def repeated(self, experiment: ExperimentSettings) -> Result:
        """Return the run with a changed copy of its settings."""
        assert isinstance(experiment, Runnable)
        return experiment.run()

    @cached_property
    def coverage(self) -> pd.DataFrame:
        """Table of the errors in their σ: mean, and percentage within ±1σ and ±3σ."""
        self.known_truth("coverage")
        parts = ((part.errors, part.sigma) for part in self.parts())
        return tables.coverage(parts, self.time.size)

    @cached_property
    def whiteness(self) -> pd.DataFrame:
        """Table of the innovations in their σ: mean, variance, and whether they are white.

        The columns are those of `lab.analysis.consistency.whiteness_table`. Components that the receiver of a
        log does not measure have no row.
        """
        return tables.whiteness(self.innovations)

    @cached_property
    @abstractmethod
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the reliability of the result, such as a saturated sensor, rejected or missing fixes."""

    def _run_remarks(self) -> list[str]:
        """Return remarks about the run itself."""
        remarks = []
        for sensor, measured in (("gyro", self.gyro), ("accelerometer", self.accelerometer)):
            if measured.saturated:
                part = 100 * measured.saturated / measured.increments.size
                remarks.append(
                    f"The {sensor}s saturated (sensors.{sensor}.range) in {measured.saturated} values, "
                    f"{format_number(part)} % of all; the filter does not model this."
                )
        rejected = int(self.solution_arrays.fix_rejected.sum())
        if rejected:
            remarks.append(
                f"The filter rejected {rejected} of {self.fixes.time.size} GPS fixes as implausible "
                f"(navigator.gate {self.experiment.navigator.gate:g})."
            )
        recovered = int(self.solution_arrays.fix_recovered.sum())
        if recovered:
            remarks.append(
                f"The filter recovered {recovered} time{'s' if recovered > 1 else ''}: several fixes in a "
                "row were so implausible that the filter took itself to be wrong; it raised P and used the "
                "fix."
            )
        straight = observability.describe_straight_flight(self)
        remarks += [straight] if straight else []
        beyond = feedforward.remark(self.free_run, self.experiment.navigator)
        # A navigator that is far off contradicts all that is measured.
        remarks += [beyond] if beyond else innovations.larger_than_assumed(self)
        start = float(np.sqrt(np.diag(self.belief.P0)[ATT].max()))
        wide = "" if self.algorithm else linear_verdict.remark(start, self.experiment.navigator)
        remarks += [wide] if wide else []
        if not self.fixes.time.size:
            remarks.append(
                "No GPS fix during the flight (sensors.gps.outages, sensors.gps.period): the navigator ran "
                "free."
            )
        return remarks

    @property
    def facts(self) -> dict[str, Any]:
        """What makes this run again, as every export has it; see `lab.run.provenance`."""
        return {**self._facts, "made": time_stamp_now()}

    @cached_property
    def _facts(self) -> dict[str, Any]:
        return facts_of_run(self)

    @property
    def plot(self) -> ResultPlots:
        """The plots of this result, such as ``result.plot.errors()``; Tab completes their names."""
        return ResultPlots(self)

    def view3d(self, *, dark: bool = True, height: int = 500) -> HtmlFrame:
        """Return the flight in three dimensions, for a notebook: paths, fixes, and 3σ ellipsoids.

        Parameters
        ----------
        dark
            Whether the background is dark.
        height
            Height of the frame [px].
        """
        frame: HtmlFrame = find("result", "view3d")(self, dark=dark, height=height)
        return frame

    def explore(self) -> Any:
        """Return the plots of this result as one Panel layout, for a notebook that ran ``pn.extension()``.

        A tab for each page of the dashboard that shows one result. All time axes are linked, and two sliders
        move the visible stretch of time and the time cursor.
        """
        return find("result", "explore")(self)

    def datasets(self) -> dict[str, xr.Dataset]:
        """Return all known datasets of this run by name; some only if their settings make them meaningful."""
        names = (*DATASETS, *(["temperature"] if self.has_temperature else []))
        names += ("further_states",) if self.solution_arrays.further.shape[1] else ()
        names += ("aiding",) if self.aids.time.size else ()
        return {name: getattr(self, name) for name in names if not self.missing_reason(name)}

    def to_netcdf(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write all datasets as groups of one netCDF file, what made them in its attributes.

        `lab.open_result` reads it, and runs its settings again.

        Raises
        ------
        FileExistsError
            If the file exists and `overwrite` is not given.
        FileNotFoundError
            If the folder does not exist.
        """
        about = netcdf_attributes(self.facts, f"INS Lab: {self.mission.title}")
        about["settings"] = self.experiment.to_toml()
        result_files.write_netcdf(Path(path), self.datasets, about, overwrite=overwrite)

    def to_csv(
        self, folder: str | Path, *, overwrite: bool = False, progress: Progress | None = None
    ) -> None:
        """Write each dataset as a csv file with units in the column names, and ``settings.toml``.

        That has all settings, and what made the files in comments. `lab.open_result` reads the folder.

        Raises
        ------
        FileExistsError
            If one of the files exists and `overwrite` is not given.
        """
        facts = {name: value for name, value in self.facts.items() if name != "settings"}
        settings = f"{facts_block(facts, '# ')}\n{self.experiment.to_toml()}"
        result_files.write_csv(
            Path(folder), self.datasets(), self.overview, settings, overwrite=overwrite, progress=progress
        )

    def to_dict(
        self, *, budget: bool = False, identification: Identification | None = None
    ) -> dict[str, Any]:
        """Return this run as plain data of a fixed form, without NaN; ``docs/json.md`` describes each field.

        The advice of the verdict is tried, which takes some runs. Of a homework or a run of the gallery,
        nothing that is hidden is in it.

        Parameters
        ----------
        budget
            Whether the error budget at the end is in it, which takes a while.
        identification
            What `identify` found, if that is to be in it.
        """
        form: dict[str, Any] = find("result", "json")(self, budget, identification)
        return form

    def to_json(self, *, budget: bool = False, identification: Identification | None = None) -> str:
        """Return this run as JSON text; see `to_dict`."""
        return json.dumps(self.to_dict(budget=budget, identification=identification), indent=2)

    def report(
        self, path: str | Path, *, overwrite: bool = False, notes: Sequence[tuple[float, float, str]] = ()
    ) -> None:
        """Write this run as one HTML file: verdict, changed settings, plots, tables, versions, all settings.

        It opens without a network, and prints on a few pages. The advice of the verdict is tried, which takes
        some runs.

        Parameters
        ----------
        path
            The file to write.
        overwrite
            Whether a file that exists is replaced.
        notes
            Notes on the flight: start and end of a stretch of time [s], and a text.

        Raises
        ------
        FileExistsError
            If the file exists and `overwrite` is not given.
        FileNotFoundError
            If the folder does not exist.
        ValueError
            If a note ends before it starts, or is not within the flight.
        """
        find("result", "report")(self, Path(path), overwrite=overwrite, notes=notes)

    @property
    def overview(self) -> tuple[str, pd.DataFrame]:
        """Name and content of the main table: the errors, or the innovations if the errors are unknown."""
        return ("whiteness", self.whiteness) if self.missing_reason("summary") else ("summary", self.summary)

    def __repr__(self) -> str:
        _, table = self.overview
        lines = table.to_string(index=False, float_format=lambda value: f"{value:.4g}")
        name = ", ".join(part for part in (self.mission.name, self.realisation) if part)
        return "\n".join((f"Result of {name}:", lines, *self.remarks))
