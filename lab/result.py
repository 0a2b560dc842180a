"""Result: everything one run of an experiment gave, as labelled datasets with units.

Inside, the arrays of the stages; what a person takes out is an `xarray.Dataset`, built when first asked
for: degrees, datasheet units for the sensors, east-north-up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab import report
from lab.analysis import budget, consistency, errors, observability
from lab.analysis.algorithm_verdict import algorithm_evidence, judge
from lab.analysis.evidence import Evidence, Reference, evidence
from lab.analysis.verdict import Verdict
from lab.ideal_imu import IdealImu
from lab.missions import Mission, SensorLog
from lab.navigation.alignment import Alignment
from lab.navigation.error_models import ATT, POS, STATES
from lab.navigation.kalman import MEASUREMENTS
from lab.navigation.solution import Belief, Fixes, Imu, Solution
from lab.projection import Projection
from lab.rotation import euler_from_quaternion, wrap
from lab.sensors import temperature as thermal
from lab.sensors.gps import GpsFixes
from lab.sensors.imu import Measured
from lab.trajectory import Truth
from lab.units import TO_SI

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from lab.experiment import Experiment

FloatArray = NDArray[np.float64]

EAST_NORTH_UP = ["east", "north", "up"]
ANGLES = ["roll", "pitch", "heading"]
BODY_AXES = ["x", "y", "z"]
STATE_UNITS = ("m",) * 3 + ("m/s",) * 3 + ("°",) * 3 + ("°/s",) * 3 + ("mg",) * 3 + ("%",) * 6
"""Units in which the σ of the error states are shown."""

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

_COORDINATES: dict[str, list[str]] = {
    "axis": EAST_NORTH_UP,
    "angle": ANGLES,
    "body_axis": BODY_AXES,
}
_DEGREE = 1 / TO_SI["°"]
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

    @property
    def time(self) -> FloatArray:
        """Times of the IMU samples (n + 1,) [s]."""
        return self.recorded.time if self.recorded else self.known_truth("time").time

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
        return truth, self.ideal

    @cached_property
    def euler(self) -> FloatArray:
        """Estimated roll, pitch, heading (n + 1, 3) [rad]."""
        return euler_from_quaternion(self.solution_arrays.q_nb)

    @cached_property
    def true_bias(self) -> FloatArray:
        """True gyro and accelerometer biases (n + 1, 6) at the IMU times [rad/s], [m/s²]."""
        bias = np.concatenate((self.gyro.bias, self.accelerometer.bias), axis=1)
        return np.concatenate((bias[:1], bias))

    @cached_property
    def true_scale(self) -> FloatArray:
        """True scale factor errors of gyros and accelerometers (n + 1, 6) at the IMU times."""
        scale = np.concatenate((self.gyro.scale, self.accelerometer.scale), axis=1)
        return np.concatenate((scale[:1], scale))

    @cached_property
    def truth(self) -> xr.Dataset:
        """The true flight; of a log its reference."""
        truth = self.known_truth("truth")
        position = np.stack((truth.latitude, truth.longitude, truth.height), axis=-1)
        return self._flight(position, truth.velocity_n, truth.euler, "reference" if self.recorded else "true")

    @cached_property
    def solution(self) -> xr.Dataset:
        """The flight as navigated."""
        solution = self.solution_arrays
        return self._flight(solution.position, solution.velocity_n, self.euler, "estimated")

    @cached_property
    def errors(self) -> xr.Dataset:
        """Errors of the solution: estimate minus truth; of a log minus its reference, NaN without."""
        truth = self.known_truth("errors")
        position = errors.to_enu(errors.position_error(self.solution_arrays.position, truth))
        velocity = errors.to_enu(self.solution_arrays.velocity_n - truth.velocity_n)
        attitude = wrap(self.euler - truth.euler) * _DEGREE
        return self._dataset(
            position=(("time", "axis"), position, "m", "position error"),
            velocity=(("time", "axis"), velocity, "m/s", "velocity error"),
            attitude=(("time", "angle"), attitude, "°", "attitude error"),
        )

    @cached_property
    def sigma(self) -> xr.Dataset:
        """One standard deviation of the errors, according to the filter."""
        variance, covariance = self.solution_arrays.variance, self.solution_arrays.covariance
        attitude = errors.euler_sigma(self.euler, variance[:, ATT], covariance[:, 1]) * _DEGREE
        return self._dataset(
            position=(("time", "axis"), np.sqrt(variance[:, [1, 0, 2]]), "m", "σ of the position error"),
            velocity=(("time", "axis"), np.sqrt(variance[:, [4, 3, 5]]), "m/s", "σ of the velocity error"),
            attitude=(("time", "angle"), attitude, "°", "σ of the attitude error"),
        )

    @cached_property
    def state_sigma(self) -> xr.Dataset:
        """One standard deviation of all error states, according to the filter; each in its own unit."""
        n = self.solution_arrays.states
        scale = np.array([1 / TO_SI[unit] for unit in STATE_UNITS[:n]])
        sigma = np.sqrt(self.solution_arrays.variance) * scale
        dataset = self._dataset(sigma=(("time", "state"), sigma, "", "σ of the error states"))
        return dataset.assign_coords(state=list(STATES[:n]), unit=("state", list(STATE_UNITS[:n])))

    @cached_property
    def imu(self) -> xr.Dataset:
        """What the IMU put out, as mean rates over each sample; if simulated, what a perfect one had."""
        dims = ("time_imu", "body_axis")
        dt = np.diff(self.time)[:, None] if self.ideal is None else self.ideal.dt
        rate, force = _DEGREE / dt, 1 / dt
        variables = {
            "angular_rate": (dims, self.gyro.increments * rate, "°/s", "measured angular rate"),
            "specific_force": (
                dims,
                self.accelerometer.increments * force,
                "m/s²",
                "measured specific force",
            ),
        }
        if self.ideal is not None:
            variables |= {
                "angular_rate_true": (dims, self.ideal.dtheta * rate, "°/s", "true angular rate"),
                "specific_force_true": (dims, self.ideal.dvelocity * force, "m/s²", "true specific force"),
            }
        return self._dataset(**variables)

    @cached_property
    def temperature(self) -> xr.Dataset:
        """Temperature of the IMU in each sample interval, and what its thermometer showed."""
        settings, height = self.experiment.sensors.temperature, self.known_truth("temperature").height
        true = thermal.temperature(settings, self.time[1:], height[1:] - height[0])
        reading = thermal.thermometer(settings, self.experiment.seed, true)
        return self._dataset(
            true=(("time_imu",), true, "°C", "temperature of the IMU"),
            reading=(("time_imu",), reading, "°C", "temperature the thermometer shows"),
        )

    @property
    def has_temperature(self) -> bool:
        """Whether a temperature profile is simulated; without one the IMU is at 25 °C."""
        return self.recorded is None and bool(self.experiment.sensors.temperature.profile != "none")

    @cached_property
    def gps(self) -> xr.Dataset:
        """The GPS fixes and, if simulated, their errors; those of a log as they were used, of the IMU."""
        fixes = self.fixes
        easting, northing = self.projection.project(fixes.position)
        dims = ("time_gps", "axis")
        variables = {
            "latitude": (("time_gps",), fixes.position[:, 0] * _DEGREE, "°", "latitude"),
            "longitude": (("time_gps",), fixes.position[:, 1] * _DEGREE, "°", "longitude"),
            "height": (("time_gps",), fixes.position[:, 2], "m", "height above the ellipsoid"),
            "easting": (("time_gps",), easting, "m", f"easting, {self.projection.label}"),
            "northing": (("time_gps",), northing, "m", f"northing, {self.projection.label}"),
            "velocity": (dims, errors.to_enu(fixes.velocity_n), "m/s", "velocity"),
        }
        if self.recorded is None:
            variables |= {
                "position_error": (dims, fixes.position_error, "m", "position error of the fix"),
                "velocity_error": (dims, fixes.velocity_error, "m/s", "velocity error of the fix"),
            }
        return self._dataset(**variables)

    @cached_property
    def track(self) -> xr.Dataset:
        """True and estimated path in metres on the map; of a log the reference, if any, is the true one."""
        truth = self.truth_arrays
        paths = {"estimated": self.solution_arrays.position}
        if truth is not None:
            true = np.stack((truth.latitude, truth.longitude, truth.height), axis=-1)
            paths = {"true": true} | paths
        projected = [self.projection.project(path) for path in paths.values()]
        dims = ("path", "time")
        label = self.projection.label
        dataset = self._dataset(
            easting=(dims, np.stack([east for east, _ in projected]), "m", f"easting, {label}"),
            northing=(dims, np.stack([north for _, north in projected]), "m", f"northing, {label}"),
            height=(
                dims,
                np.stack([path[:, 2] for path in paths.values()]),
                "m",
                "height above the ellipsoid",
            ),
        )
        return dataset.assign_coords(path=list(paths))

    @cached_property
    def projection(self) -> Projection:
        """Map projection of the flight."""
        if self.recorded:
            start = self.solution_arrays.position[0]
            return Projection.at(float(start[0]), float(start[1]))
        truth = self.known_truth("truth")
        return Projection.at(float(truth.latitude[0]), float(truth.longitude[0]))

    @cached_property
    def sensor_errors(self) -> xr.Dataset:
        """Biases and their σ as estimated, if simulated as they were; with 21 states also scale factors."""
        solution, dims = self.solution_arrays, ("time", "body_axis")
        kinds = {"bias": ("bias", 9, ("°/s", "mg"), solution.bias, self.true_bias)}
        if solution.scale.size:
            kinds["scale"] = ("scale factor error", 15, ("%", "%"), solution.scale, self.true_scale)
        variables = {}
        for kind, (words, first, units, estimate, true) in kinds.items():
            sigma = np.sqrt(solution.variance[:, first : first + 6])
            for number, (name, unit) in enumerate(zip(("gyro", "accelerometer"), units, strict=True)):
                part = slice(3 * number, 3 * number + 3)
                for suffix, values, label in (
                    ("", estimate, "estimated"),
                    *([] if self.recorded else [("_true", true, "true")]),
                    ("_sigma", sigma, "σ of the estimated"),
                ):
                    shown = values[:, part] / TO_SI[unit]
                    variables[f"{name}_{kind}{suffix}"] = (dims, shown, unit, f"{label} {name} {words}")
        return self._dataset(**variables)

    @cached_property
    def innovations(self) -> xr.Dataset:
        """Innovations of the fixes (navigator minus GPS), their σ, and NIS; NaN for a fix not used.

        A fix rejected by the gate keeps its innovation, and has no NIS. What a real receiver does not measure
        is NaN; attribute `degrees` of `nis`: how much the fixes measure.
        """
        nu, S = self.solution_arrays.innovation, self.solution_arrays.innovation_covariance
        sigma = np.where(np.isnan(nu), np.nan, np.sqrt(np.diagonal(S, axis1=1, axis2=2)))
        measured = np.isfinite(nu).sum(axis=1)
        degrees = int(measured.max()) if measured.any() else MEASUREMENTS
        dims = ("time_gps", "axis")
        dataset = self._dataset(
            position=(dims, errors.to_enu(nu[:, :3]), "m", "position innovation"),
            velocity=(dims, errors.to_enu(nu[:, 3:]), "m/s", "velocity innovation"),
            position_sigma=(dims, sigma[:, [1, 0, 2]], "m", "σ of the position innovation"),
            velocity_sigma=(dims, sigma[:, [4, 3, 5]], "m/s", "σ of the velocity innovation"),
            nis=(
                ("time_gps",),
                self._used_fixes(consistency.normalised_squares, np.nan_to_num(nu), S),
                "",
                f"NIS, {degrees} degrees of freedom",
            ),
            rejected=(
                ("time_gps",),
                self.solution_arrays.fix_rejected.astype(np.float64),
                "",
                "1 for a fix rejected by the gate",
            ),
        )
        dataset.nis.attrs["degrees"] = degrees
        return dataset

    @cached_property
    def autocorrelation(self) -> xr.Dataset:
        """Normalised autocorrelation of the innovations; attribute `band`: half-width of the 95 % band."""
        sets = self.innovations
        used = np.isfinite(sets["nis"].values)
        normalised = [(sets[name] / sets[f"{name}_sigma"]).values[used] for name in ("position", "velocity")]
        r = [
            np.where(np.isnan(values).all(axis=0), np.nan, consistency.autocorrelation(np.nan_to_num(values)))
            for values in normalised
        ]
        dims = ("lag", "axis")
        dataset = self._dataset(
            position=(dims, r[0], "", "autocorrelation of the position innovations"),
            velocity=(dims, r[1], "", "autocorrelation of the velocity innovations"),
        ).assign_coords(lag=np.arange(r[0].shape[0]))
        return dataset.assign_attrs(band=consistency.whiteness_band(int(used.sum())))

    @cached_property
    def consistency(self) -> xr.Dataset:
        """NEES of the states after each fix; attribute `degrees` of `nees`: states that have a variance.

        NaN, and 0 degrees, where no fix was used, or a user's algorithm gave no covariance.
        """
        solution = self.solution_arrays
        samples = np.maximum(solution.fix_sample, 0)
        scale = self.true_scale if solution.scale.size else None
        x = errors.error_state(solution, samples, self.known_truth("consistency"), self.true_bias, scale)
        nees = self._used_fixes(consistency.normalised_squares, x, solution.fix_covariance)
        used = solution.fix_covariance[solution.fix_sample >= 0]
        degrees = int(consistency.uncertain(used).size) if used.size else 0
        label = f"NEES, {degrees} degrees of freedom" if degrees else "NEES, not known"
        dataset = self._dataset(nees=(("time_gps",), nees, "", label))
        dataset.nees.attrs["degrees"] = degrees
        return dataset

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
        import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

        P = errors.NED_TO_ENU @ self.solution_arrays.fix_covariance[:, POS, POS] @ errors.NED_TO_ENU.T
        return xr.DataArray(
            P,
            dims=("time_gps", "axis", "axis_2"),
            coords={"time_gps": self.fixes.time, "axis": EAST_NORTH_UP, "axis_2": EAST_NORTH_UP},
            attrs={"units": "m²", "long_name": "covariance of the position error"},
        )

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Table of the errors over the whole flight: rms, largest, and what 95 % stay below.

        Of a log, of what the reference knows; with mean and standard deviation, since a reference may be
        off by a constant.
        """
        import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

        rows = []
        for name, array in self.errors.data_vars.items():
            for component, column in zip(array[array.dims[1]].values, array.values.T, strict=True):
                known = column[np.isfinite(column)] if self.recorded else column
                if not known.size:
                    continue
                size = np.abs(known)
                figures = [np.sqrt(np.mean(size**2)), size.max(), np.quantile(size, 0.95)]
                figures += [known.mean(), known.std()] if self.recorded else []
                rows.append((f"{name} {component}", array.attrs["units"], *map(float, figures)))
        columns = ["quantity", "unit", "rms", "max", "95 %", *(["mean", "std"] if self.recorded else [])]
        return pd.DataFrame(rows, columns=columns)

    @cached_property
    def verdict(self) -> Verdict:
        """Whether the filter tells the truth about itself, judged by errors and innovations."""
        return judge(self.evidence)

    @cached_property
    def innovation_verdict(self) -> Verdict:
        """The same judged by the innovations alone, as in a flight of which nobody knows the truth."""
        return judge(self.evidence.without_truth())

    @cached_property
    def evidence(self) -> Evidence:
        """What this run says for and against each assumption of the filter; of a log its innovations."""
        fixes, reference = self.fixes, None
        if self.recorded is None:
            truth, ideal = self.true_flight("evidence")
            scale = self.true_scale if self.solution_arrays.scale.size else None
            reference = Reference(truth, self.true_bias, ideal.dtheta, ideal.dvelocity, scale)
        if self.algorithm:
            return algorithm_evidence(self.solution_arrays, reference)
        return evidence(
            self.solution_arrays,
            self.belief,
            Fixes(fixes.time, fixes.position, fixes.velocity_n),
            Imu(self.time, self.gyro.increments, self.accelerometer.increments),
            reference,
        )

    @cached_property
    def coverage(self) -> pd.DataFrame:
        """Table of the errors in their σ: their mean, and how many percent lie within ±1σ and ±3σ."""
        import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

        if reason := self.lacks("coverage"):
            raise ResultError(reason)
        rows = []
        for name, array in self.errors.data_vars.items():
            values, sigma = array.values, self.sigma[name].values
            within = [100 * consistency.coverage(values, sigma, factor) for factor in (1, 3)]
            mean = np.mean(values / sigma, axis=0)
            for index, component in enumerate(array[array.dims[1]].values):
                figures = (mean[index], within[0][index], within[1][index])
                rows.append((f"{name} {component}", *map(float, figures)))
        return pd.DataFrame(rows, columns=["quantity", "mean [σ]", "within ±1σ [%]", "within ±3σ [%]"])

    @cached_property
    def whiteness(self) -> pd.DataFrame:
        """Table of the innovations in their σ: mean, variance, and whether they are white.

        The columns are those of `lab.analysis.consistency.whiteness_table`. What the receiver of a log does
        not measure has no row.
        """
        sets = self.innovations
        used = np.isfinite(sets["nis"].values)
        parts = [(sets[name] / sets[f"{name}_sigma"]).values[used] for name in ("position", "velocity")]
        values = np.concatenate(parts, axis=1)
        known = np.isfinite(values)
        count, values = np.maximum(known.sum(axis=0), 1), np.nan_to_num(values)
        table = consistency.whiteness_table(
            values.sum(axis=0) / count,
            np.sum(values**2, axis=0) / count,
            consistency.autocorrelation(values),
            len(values),
        )
        # A real receiver may leave out a channel.
        return table[known.any(axis=0)].reset_index(drop=True) if known.any() else table

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
        if not self.fixes.time.size:
            remarks.append(
                "No GPS fix during the flight (sensors.gps.outages, sensors.gps.period): the navigator ran "
                "free."
            )
        if self.recorded:
            return (*self.recorded.notes, *remarks)
        return (*remarks, *self.experiment.sensors.remarks())

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

    def _flight(
        self, position: FloatArray, velocity_n: FloatArray, euler: FloatArray, word: str
    ) -> xr.Dataset:
        return self._dataset(
            latitude=(("time",), position[:, 0] * _DEGREE, "°", f"{word} latitude"),
            longitude=(("time",), position[:, 1] * _DEGREE, "°", f"{word} longitude"),
            height=(("time",), position[:, 2], "m", f"{word} height above the ellipsoid"),
            velocity=(("time", "axis"), errors.to_enu(velocity_n), "m/s", f"{word} velocity"),
            attitude=(("time", "angle"), euler * _DEGREE, "°", f"{word} attitude"),
        )

    def _used_fixes(self, function: Any, vectors: FloatArray, covariances: FloatArray) -> FloatArray:
        """Apply a function to the fixes the filter used; the others become NaN."""
        used = self.solution_arrays.fix_sample >= 0
        out = np.full(used.shape, np.nan)
        out[used] = function(vectors[used], covariances[used])
        return out

    def _dataset(self, **variables: tuple[tuple[str, ...], FloatArray, str, str]) -> xr.Dataset:
        """Return a dataset of variables given as (dimensions, values, unit, long name)."""
        import xarray as xr  # noqa: PLC0415 - takes a while to import, and a run does without

        times = {"time": self.time, "time_imu": self.time[1:], "time_gps": self.fixes.time}
        used = {dim for dims, *_ in variables.values() for dim in dims}
        coords: dict[str, Any] = {
            dim: (dim, values, {"units": "s", "long_name": "time"})
            for dim, values in times.items()
            if dim in used
        }
        coords |= {dim: names for dim, names in _COORDINATES.items() if dim in used}
        return xr.Dataset(
            {
                name: (dims, values, {"units": unit, "long_name": label})
                for name, (dims, values, unit, label) in variables.items()
            },
            coords=coords,
        )
