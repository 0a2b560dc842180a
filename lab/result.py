"""Result: everything one run of an experiment gave, as labelled datasets with units.

Inside, the arrays of the stages; what a person takes out is an `xarray.Dataset`, built when first asked
for: degrees, datasheet units for the sensors, east-north-up.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab import report
from lab.analysis import budget, feedforward, observability, trial
from lab.analysis.algorithm_verdict import judge
from lab.analysis.evidence import Evidence
from lab.analysis.run_evidence import evidence_of
from lab.analysis.verdict import Verdict
from lab.datasets import flight, innovations, sensors, tables
from lab.histories import LONG, made_when_asked
from lab.ideal_imu import IdealImu
from lab.missions import Mission, SensorLog
from lab.navigation.alignment import Alignment
from lab.navigation.belief import assumed_latency
from lab.navigation.rest_alignment import Aligned
from lab.navigation.solution import Belief, Solution
from lab.projection import Projection
from lab.rotation import euler_from_quaternion
from lab.sensors.gps import GpsFixes
from lab.sensors.imu import Measured
from lab.trajectory import Truth

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from lab.analysis.identification import Identification
    from lab.experiment import Experiment

FloatArray = NDArray[np.float64]

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
"""Names of the datasets every result has, as they are written to files."""

NEEDS_TRUTH = frozenset(("truth", "errors", "summary"))
"""What is not known of a log without a reference."""
NEEDS_SIMULATION = frozenset(("consistency", "coverage", "budget", "temperature"))
"""What is not known of any log: a reference knows neither the biases nor its own errors."""

_KNOWN = "the innovations and the verdict on them tell whether the filter is right."
_SPOKEN = {
    "consistency": "NEES",
    "coverage": "the coverage of the errors",
    "budget": "the error budget",
    "temperature": "a simulated temperature",
}


class ResultError(ValueError):
    """What was asked for is not known of this run; the message says why, and what is known."""


class Recorded(NamedTuple):
    """What a log of real sensors has, of which nothing is simulated.

    Attributes
    ----------
    log : SensorLog
        The log, repaired.
    time : (n + 1,) array
        Times of the IMU samples that were navigated [s].
    alignment : Alignment
        Where the navigator started, and how that was found.
    notes : tuple of str
        What was repaired and assumed, for people.
    """

    log: SensorLog
    time: FloatArray
    alignment: Alignment
    notes: tuple[str, ...]


def _at_samples(gyro: FloatArray, accelerometer: FloatArray) -> FloatArray:
    """Return what gyros and accelerometers have in each interval (n, 3) as at all samples, (n + 1, 6)."""
    constant = not (gyro.strides[0] or accelerometer.strides[0])
    rows = slice(0, 1) if constant else slice(None)
    values = np.concatenate((gyro[rows], accelerometer[rows]), axis=1)
    if constant:
        return np.broadcast_to(values, (gyro.shape[0] + 1, 6))
    return np.concatenate((values[:1], values))


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """What one run gave.

    The datasets are made from the arrays when first asked for. Two threads that ask at once may both make
    one; it is the same. Of a log of real sensors some are not known: `lacks` says which and why, and asking
    for one raises `ResultError`.

    Attributes
    ----------
    experiment : Experiment
        The settings it was computed with.
    mission : Mission
        The mission that was flown.
    truth_arrays, ideal, gyro, accelerometer, fixes, belief, solution_arrays
        What the stages computed, in SI units. Of a log there is no `ideal`, the biases and the errors of the
        fixes are NaN, and the truth is its reference, NaN where that knows nothing, or None.
    seconds
        Time the navigator took when it computed the solution [s].
    algorithm
        Name of the user's algorithm that navigated; empty for the navigator of the settings.
    recorded : Recorded or None
        What a log has beside.
    aligned : Aligned or None
        Where the navigator of a simulated run started.
    """

    experiment: Experiment
    mission: Mission
    truth_arrays: Truth | None
    ideal: IdealImu | None
    gyro: Measured
    accelerometer: Measured
    fixes: GpsFixes
    belief: Belief
    solution_arrays: Solution
    seconds: float
    algorithm: str = ""
    recorded: Recorded | None = None
    aligned: Aligned | None = None

    @property
    def time(self) -> FloatArray:
        """Times of the IMU samples (n + 1,) [s]."""
        return self.recorded.time if self.recorded else self.known_truth("time").time

    @property
    def is_long(self) -> bool:
        """Whether the flight is so long that what is made of its samples is not kept."""
        return int(self.solution_arrays.position.shape[0]) > LONG

    @property
    def epoch(self) -> float:
        """What time 0 is in the clock that outages are given in [s]: of a log, that of its file."""
        return self.recorded.log.epoch if self.recorded else 0.0

    @property
    def truth_word(self) -> str:
        """What errors are differences to: ``"truth"``, or the ``"reference"`` of a log."""
        return "reference" if self.recorded else "truth"

    def lacks(self, name: str) -> str:
        """Return why something is not known of this run, in a sentence; empty if it is.

        Parameters
        ----------
        name
            Name of a dataset, or ``"summary"``, ``"coverage"``, ``"budget"``.
        """
        if self.recorded is None:
            return ""
        if name in NEEDS_SIMULATION:
            return (
                "Nobody knows the true flight and the true biases of a log of real sensors, which "
                f"{_SPOKEN.get(name, name)} needs; {_KNOWN}"
            )
        if name in NEEDS_TRUTH and self.truth_arrays is None:
            return f"This log of real sensors has no reference, so its errors are not known; {_KNOWN}"
        return ""

    def known_truth(self, name: str) -> Truth:
        """Return the truth, or the reference of a log, for what is called `name`.

        Raises
        ------
        ResultError
            If it is not known.
        """
        reason = self.lacks(name)
        if reason or self.truth_arrays is None:
            raise ResultError(reason or self.lacks("truth"))
        return self.truth_arrays

    def true_flight(self, name: str) -> tuple[Truth, IdealImu]:
        """Return truth and ideal IMU of a simulated run, for what is called `name`.

        Raises
        ------
        ResultError
            If the run is that of a log.
        """
        truth = self.known_truth(name)
        if self.ideal is None:
            raise ResultError(self.lacks("budget"))
        return truth, self.ideal.to_compute_on()

    @made_when_asked
    def euler(self) -> FloatArray:
        """Estimated roll, pitch, heading (n + 1, 3) [rad]."""
        return euler_from_quaternion(self.solution_arrays.q_nb)

    @cached_property
    def feedforward_drift(self) -> float:
        """Largest attitude error of the free-running navigator of a feedforward filter [rad]; else zero."""
        return feedforward.drift(self)

    @property
    def fix_validity(self) -> FloatArray:
        """Times (m,) that the filter took for those of the fixes' validity [s]."""
        if self.recorded:
            return self.fixes.time
        settings = self.experiment
        return self.fixes.time - assumed_latency(settings.navigator, settings.sensors.gps.latency)

    @made_when_asked
    def true_bias(self) -> FloatArray:
        """True gyro and accelerometer biases (n + 1, 6) at the IMU times [rad/s], [m/s²]."""
        return _at_samples(self.gyro.bias, self.accelerometer.bias)

    @made_when_asked
    def true_scale(self) -> FloatArray:
        """True scale factor errors of gyros and accelerometers (n + 1, 6) at the IMU times."""
        return _at_samples(self.gyro.scale, self.accelerometer.scale)

    @made_when_asked
    def truth(self) -> xr.Dataset:
        """The true flight; of a log its reference."""
        return flight.truth(self)

    @made_when_asked
    def solution(self) -> xr.Dataset:
        """The flight as navigated."""
        return flight.solution(self)

    @made_when_asked
    def errors(self) -> xr.Dataset:
        """Errors of the solution: estimate minus truth; of a log minus its reference, NaN without."""
        return flight.errors(self)

    @made_when_asked
    def sigma(self) -> xr.Dataset:
        """One standard deviation of the errors, according to the filter."""
        return flight.sigma(self)

    @made_when_asked
    def state_sigma(self) -> xr.Dataset:
        """One standard deviation of all error states, according to the filter; each in its own unit."""
        return flight.state_sigma(self)

    @made_when_asked
    def imu(self) -> xr.Dataset:
        """What the IMU put out, as mean rates over each sample; if simulated, what a perfect one had."""
        return sensors.imu(self)

    @made_when_asked
    def temperature(self) -> xr.Dataset:
        """Temperature of the IMU in each sample interval, and what its thermometer showed."""
        return sensors.temperature(self)

    @property
    def has_temperature(self) -> bool:
        """Whether a temperature profile is simulated; without one the IMU is at 25 °C."""
        return self.recorded is None and bool(self.experiment.sensors.temperature.profile != "none")

    @cached_property
    def gps(self) -> xr.Dataset:
        """The GPS fixes and, if simulated, their errors; those of a log as they were used, of the IMU."""
        return sensors.gps(self)

    @made_when_asked
    def track(self) -> xr.Dataset:
        """True and estimated path in metres on the map; of a log the reference, if any, is the true one."""
        return flight.track(self)

    @cached_property
    def projection(self) -> Projection:
        """Map projection of the flight."""
        if self.recorded:
            start = self.solution_arrays.position[0]
            return Projection.at(float(start[0]), float(start[1]))
        truth = self.known_truth("truth")
        return Projection.at(float(truth.latitude[0]), float(truth.longitude[0]))

    @made_when_asked
    def sensor_errors(self) -> xr.Dataset:
        """Biases and their σ as estimated, if simulated as they were; with 21 states also scale factors."""
        return sensors.sensor_errors(self)

    @cached_property
    def innovations(self) -> xr.Dataset:
        """Innovations of the fixes (navigator minus GPS), their σ, and NIS; NaN for a fix not used.

        A fix rejected by the gate keeps its innovation, and has no NIS. What a real receiver does not measure
        is NaN; attribute `degrees` of `nis`: how much the fixes measure.
        """
        return innovations.innovations(self)

    @cached_property
    def autocorrelation(self) -> xr.Dataset:
        """Normalised autocorrelation of the innovations; attribute `band`: half-width of the 95 % band."""
        return innovations.autocorrelation(self)

    @cached_property
    def consistency(self) -> xr.Dataset:
        """NEES of the states after each fix; attribute `degrees` of `nees`: states that have a variance.

        NaN, and 0 degrees, where no fix was used, or a user's algorithm gave no covariance.
        """
        return innovations.consistency(self)

    @cached_property
    def budget(self) -> xr.Dataset:
        """Error budget: what each source contributes to the σ of the errors; see `budget.error_budget`."""
        return budget.error_budget(self)

    @cached_property
    def observability(self) -> xr.Dataset:
        """How far σ came down, and in which manoeuvre; see `observability.observability`."""
        return observability.observability(self)

    @cached_property
    def position_covariance(self) -> xr.DataArray:
        """Covariance of the position error after each fix, east, north, up [m²]."""
        return innovations.position_covariance(self)

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Table of the errors over the whole flight: rms, largest, and what 95 % stay below.

        Of a log, of what the reference knows; with mean and standard deviation, since a reference may be
        off by a constant.
        """
        return tables.summary(self)

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the filter tells the truth about itself, judged by errors and innovations."""
        return feedforward.judge(self, judge(self.evidence))

    @cached_property
    def tried_verdict(self) -> Verdict:
        """The verdict, its advice tried: with what it brings, or not given where it makes things worse.

        Costs three runs and more; `verdict` is the same without.
        """
        if not trial.can_be_tried(self.verdict, self.algorithm):
            return self.verdict
        return trial.tried(self.verdict, [self])

    @cached_property
    def innovation_verdict(self) -> Verdict:
        """The same judged by the innovations alone, as in a flight of which nobody knows the truth."""
        return feedforward.judge(self, judge(self.evidence.without_truth()))

    @cached_property
    def evidence(self) -> Evidence:
        """What this run says for and against each assumption of the filter; of a log its innovations."""
        return evidence_of(self)

    @cached_property
    def coverage(self) -> pd.DataFrame:
        """Table of the errors in their σ: their mean, and how many percent lie within ±1σ and ±3σ."""
        return tables.coverage(self)

    @cached_property
    def whiteness(self) -> pd.DataFrame:
        """Table of the innovations in their σ: mean, variance, and whether they are white.

        The columns are those of `lab.analysis.consistency.whiteness_table`. What the receiver of a log does
        not measure has no row.
        """
        return tables.whiteness(self)

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """What to know before believing the result: a saturated sensor, rejected fixes, or none at all."""
        remarks = []
        for sensor, measured in (("gyro", self.gyro), ("accelerometer", self.accelerometer)):
            if measured.saturated:
                part = 100 * measured.saturated / measured.increments.size
                remarks.append(
                    f"The {sensor}s met the end of their range (sensors.{sensor}.range) in "
                    f"{measured.saturated} values, {part:.2g} % of all; the filter is not told."
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
                f"The filter recovered {recovered} time{'s' if recovered > 1 else ''}: fixes in a row were "
                "so implausible that the filter itself had to be in error; it raised P and used the fix."
            )
        drift = self.feedforward_drift
        if drift > feedforward.LINEAR:
            remarks.append(
                f"Feedforward: the free-running navigator is up to {np.degrees(drift):.3g}° off in attitude, "
                f"and the filter is linear up to {np.degrees(feedforward.LINEAR):g}°: its σ is not that of "
                "its errors. navigator.correction = feedback keeps the navigator close to the truth."
            )
        if not self.fixes.time.size:
            remarks.append(
                "No GPS fix during the flight (sensors.gps.outages, sensors.gps.period): the navigator ran "
                "free."
            )
        sensors = self.experiment.sensors
        if self.recorded:
            assumed = sensors.assumed_remark()
            return (*self.recorded.notes, *remarks, *((assumed,) if assumed else ()))
        alignment = float(self.experiment.navigator.alignment)
        if alignment:
            remarks.append(
                f"An alignment of {alignment:g} s at rest before the flight (navigator.alignment) levelled "
                "the navigator and took the constant gyro biases off: the gyro biases shown, true and "
                "estimated, are what is left."
            )
        return (*remarks, *sensors.remarks(self.experiment.navigator.states))

    def identify(self, progress: Callable[[str, float], None] | None = None) -> Identification:
        """Return what the innovations say of the sensors: noise, bias drive, R, latency and lever arm.

        The most likely values with error bars, and how well fixes that are withheld for 10 s are predicted
        with them and without; see `lab.analysis.identification`.

        Parameters
        ----------
        progress
            Called with a phrase and the fraction done, from 0 to 1.

        Raises
        ------
        ResultError
            If a user's algorithm navigated, or there are too few fixes.
        """
        from lab.identify import identify  # noqa: PLC0415 - it runs experiments, and so imports results

        return identify(self, progress)

    def datasets(self) -> dict[str, xr.Dataset]:
        """Return by name all datasets that are known of this run; the temperature where a profile is set."""
        names = (*DATASETS, "temperature") if self.has_temperature else DATASETS
        return {name: getattr(self, name) for name in names if not self.lacks(name)}

    def to_netcdf(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write all datasets as groups of one netCDF file, the settings in its attributes.

        Raises
        ------
        FileExistsError
            If the file exists and `overwrite` is not given.
        FileNotFoundError
            If the folder does not exist.
        """
        report.write_netcdf(self, Path(path), overwrite=overwrite)

    def to_csv(self, folder: str | Path, *, overwrite: bool = False) -> None:
        """Write each dataset as a csv file in a folder, units in the column names, and the settings as TOML.

        Raises
        ------
        FileExistsError
            If one of the files exists and `overwrite` is not given.
        """
        report.write_csv(self, Path(folder), overwrite=overwrite)

    def __repr__(self) -> str:
        table = self.whiteness if self.lacks("summary") else self.summary
        lines = table.to_string(index=False, float_format=lambda value: f"{value:.4g}")
        seed = "" if self.recorded else f", seed {self.experiment.seed}"
        return "\n".join((f"Result of {self.mission.name}{seed}:", lines, *self.remarks))

    def _repr_html_(self) -> str:
        return report.html(self)
