"""Run: the frozen arrays of one run, simulated or of a log, and values derived directly from them.

Analyses and datasets are functions of a `Run`. `lab.experiment.result` is its user interface.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.histories import LONG, cached_unless_long
from lab.missions import Mission, SensorLog
from lab.motion.frames.rotation import euler_from_quaternion
from lab.motion.kinematics.ideal_imu import IdealImu
from lab.motion.truth.trajectory import Truth
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.alignment.alignment import Alignment
from lab.navigation.alignment.rest_alignment import Aligned
from lab.navigation.belief import assumed_latency
from lab.navigation.filters.blocks import DRIFTS, GYRO_G
from lab.navigation.solution import HISTORIES, Belief, Solution
from lab.run.experiment_settings import ExperimentSettings
from lab.run.further_truth import bias_drift, felt_by_gyros, further_truth
from lab.sensors import temperature as thermal
from lab.sensors.gps import GpsFixes
from lab.sensors.imu import Measured
from lab.sensors.readings import Readings

AT_ONCE = 2**16
"""Samples in one part of a long flight, with some 600 bytes of datasets each."""


class ResultError(ValueError):
    """The requested data are unknown for this run; the message says why, and which data are known."""


class Recorded(NamedTuple):
    """Data of a run on a sensor log.

    Attributes
    ----------
    log : SensorLog
        The log, repaired.
    time : (n + 1,) array
        Times of the IMU samples that were navigated [s].
    alignment : Alignment
        The start of the navigator, and how it was found.
    notes : tuple of str
        Repairs and assumptions, as text.
    """

    log: SensorLog
    time: FloatArray
    alignment: Alignment
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Run(ABC):
    """The arrays of one run, in SI units.

    Attributes
    ----------
    experiment : ExperimentSettings
        A copy of the settings, which does not change.
    mission : Mission
        The mission.
    truth_arrays : Truth or None
        The true flight. For a log, its reference, with NaN where it has no values, or None.
    ideal : IdealImu or None
        Output of a perfect IMU; None for a log.
    gyro, accelerometer : Measured
        Output of the inertial sensors; for a log, the biases are NaN.
    fixes : GpsFixes
        Output of the receiver; for a log, the errors are NaN.
    belief : Belief
        The assumptions of the filter.
    solution_arrays : Solution
        The solution of the navigator.
    seconds : float
        Computing time of the solution [s].
    algorithm : str
        Name of the user's algorithm that navigated; empty for the navigator of the settings.
    recorded : Recorded or None
        Further data of a log.
    aligned : Aligned or None
        The start of the navigator of a simulated run.
    blocks : tuple of str
        The further blocks of states of the filter.
    aids : Aids
        The measurements besides GPS that the filter was given.
    readings : mapping of str to Readings
        Readings of the other sensors of a simulated run, by their group in the settings.
    """

    experiment: ExperimentSettings
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
    blocks: tuple[str, ...] = ()
    aids: Aids = NO_AIDS
    readings: Mapping[str, Readings] = field(default_factory=dict)

    @property
    @abstractmethod
    def time(self) -> FloatArray:
        """Times of the IMU samples (n + 1,) [s]."""

    @property
    @abstractmethod
    def flown(self) -> Truth:
        """The flight at the IMU times as well as it is known: the true one, or of a log the estimated one."""

    @property
    @abstractmethod
    def truth_word(self) -> str:
        """The data to which errors are differences: ``"truth"``, or the ``"reference"`` of a log."""

    @property
    @abstractmethod
    def own_latency(self) -> float:
        """The latency of the fixes, as simulated, or as the log says [s]."""

    @property
    @abstractmethod
    def own_lever_arm(self) -> FloatArray:
        """The lever arm (3,) of the antenna, as simulated, or as the log says [m]."""

    @property
    def simulated_settings(self) -> ExperimentSettings:
        """The settings with which the sensors were simulated: those of the run, unless some are hidden."""
        return self.experiment

    @property
    def shows_sensor_errors(self) -> bool:
        """Whether datasets show the true errors of the sensors; they are unknown for a log."""
        return self.recorded is None

    @property
    def is_long(self) -> bool:
        """Whether the flight is so long that derived histories are not kept."""
        return int(self.solution_arrays.position.shape[0]) > LONG

    def part(self, first: int, last: int) -> Self:
        """Return the run with the histories of the samples from `first` up to `last`, without the latter.

        Its histories over time are those of the run. The fixes are all there, and refer to samples of the
        whole run. True biases and scale factors belong to intervals, so those of the first sample are known
        only if that is the first of the flight.
        """
        samples, intervals = slice(first, last), slice(first, last - 1)
        solution = {name: getattr(self.solution_arrays, name)[samples] for name in HISTORIES}
        ideal, recorded = self.ideal, self.recorded
        return replace(
            self,
            truth_arrays=None if self.truth_arrays is None else self.truth_arrays.taken(samples),
            ideal=None if ideal is None else ideal.part(first, last),
            gyro=self.gyro.taken(intervals),
            accelerometer=self.accelerometer.taken(intervals),
            solution_arrays=self.solution_arrays._replace(**solution),
            recorded=None if recorded is None else recorded._replace(time=recorded.time[samples]),
        )

    def bare(self) -> Self:
        """Return the run with its first sample alone, which keeps no history in memory."""
        first = self.part(0, 1)
        histories = {name: getattr(first.solution_arrays, name).copy() for name in HISTORIES}
        truth, ideal, recorded = first.truth_arrays, first.ideal, first.recorded
        only, none = np.arange(1), np.arange(0)
        return replace(
            first,
            truth_arrays=None if truth is None else truth.taken(only),
            ideal=None if ideal is None else ideal.copy(),
            gyro=first.gyro.taken(none),
            accelerometer=first.accelerometer.taken(none),
            solution_arrays=first.solution_arrays._replace(**histories),
            recorded=None if recorded is None else recorded._replace(time=recorded.time.copy()),
        )

    def parts(self) -> Iterator[Self]:
        """Iterate over the run in parts; a run that is not long is one part."""
        samples = int(self.solution_arrays.position.shape[0])
        if not self.is_long:
            yield self
            return
        for first in range(0, samples, AT_ONCE):
            yield self.part(first, min(first + AT_ONCE, samples))

    @property
    def latency(self) -> float:
        """The latency of the fixes that the filter assumed [s]."""
        return assumed_latency(self.experiment.navigator, self.own_latency)

    @property
    @abstractmethod
    def fix_validity(self) -> FloatArray:
        """Times of validity (m,) of the fixes, as the filter assumed them [s]."""

    @cached_unless_long
    def euler(self) -> FloatArray:
        """Estimated roll, pitch, heading (n + 1, 3) [rad]."""
        return euler_from_quaternion(self.solution_arrays.q_nb)

    @cached_unless_long
    def true_bias(self) -> FloatArray:
        """True gyro and accelerometer biases (n + 1, 6) at the IMU times [rad/s], [m/s²].

        Without their drift and what gyros feel of the specific force, if the filter has states for these.
        """
        gyro, accelerometer = self.gyro.bias, self.accelerometer.bias
        if GYRO_G in self.blocks and self.ideal is not None:
            settings = self.simulated_settings
            felt = felt_by_gyros(settings.sensors.gyro, settings.seed, self.ideal.dvelocity, self.ideal.dt)
            gyro = gyro - felt
        whole = at_samples(gyro, accelerometer)
        if DRIFTS[0] not in self.blocks or self.recorded is not None:
            return whole
        drift = [bias_drift(self.simulated_settings, triad, self.time) for triad in range(2)]
        return np.asarray(whole - np.concatenate(drift, axis=1))

    @cached_unless_long
    def true_scale(self) -> FloatArray:
        """True scale factor errors of gyros and accelerometers (n + 1, 6) at the IMU times."""
        return at_samples(self.gyro.scale, self.accelerometer.scale)

    def true_further(self) -> FloatArray:
        """Return the true values (n + 1, k) of the states after the scale factors, at the IMU times."""
        return further_truth(self.simulated_settings, self.blocks, self.time)

    def imu_temperature(self) -> FloatArray:
        """Return the temperature of the IMU (n,) in each sample interval of a simulated run [°C].

        Raises
        ------
        ResultError
            If the run is that of a log.
        """
        height = self.known_truth("temperature").height
        settings = self.experiment.sensors.temperature
        return thermal.temperature(settings, self.time[1:], height[1:] - height[0])

    @abstractmethod
    def missing_reason(self, name: str) -> str:
        """Return, in a sentence, why something is unknown for this run; empty if it is known.

        Parameters
        ----------
        name
            Name of a dataset, or ``"summary"``, ``"coverage"``, ``"budget"``.
        """

    def lacks(self, name: str) -> str:
        """Return `missing_reason`, as version 0.1 called it; warns, and goes after 0.2."""
        warnings.warn("Result.lacks is Result.missing_reason now", DeprecationWarning, stacklevel=2)
        return self.missing_reason(name)

    def known_truth(self, name: str) -> Truth:
        """Return the truth, or the reference of a log, to compute the data `name`.

        Raises
        ------
        ResultError
            If it is unknown.
        """
        reason = self.missing_reason(name)
        if reason or self.truth_arrays is None:
            raise ResultError(reason or self.missing_reason("truth"))
        return self.truth_arrays

    def true_flight(self, name: str) -> tuple[Truth, IdealImu]:
        """Return truth and ideal IMU of a simulated run, to compute the data `name`.

        The increments of a long flight are float32; see `IdealImu.to_compute_on`.

        Raises
        ------
        ResultError
            If the run is that of a log.
        """
        truth = self.known_truth(name)
        if self.ideal is None:
            raise ResultError(self.missing_reason("budget"))
        return truth, self.ideal


def at_samples(gyro: FloatArray, accelerometer: FloatArray) -> FloatArray:
    """Return values of gyros and accelerometers in each interval, (n, 3) each, at all samples, (n + 1, 6).

    If they are views of such an array already, as from `in_one`, it is returned.
    """
    whole = gyro.base
    if isinstance(whole, np.ndarray) and whole is accelerometer.base and whole.shape == (len(gyro) + 1, 6):
        return whole
    constant = not (gyro.strides[0] or accelerometer.strides[0])
    if constant:
        values = np.concatenate((gyro[:1], accelerometer[:1]), axis=1)
        return np.broadcast_to(values, (gyro.shape[0] + 1, 6))
    values = np.empty((gyro.shape[0] + 1, 6), dtype=np.result_type(gyro, accelerometer))
    values[1:, :3], values[1:, 3:] = gyro, accelerometer
    if not gyro.size:
        return values[:0]
    values[0] = values[1]
    return values


def in_one(gyro: Measured, accelerometer: Measured) -> tuple[Measured, Measured]:
    """Return outputs of a long flight whose biases share the one array that `Run.true_bias` is.

    Two drifting biases of four hours and their copy at all samples take 70 MB each; constant ones take none.
    """
    biases = gyro.bias, accelerometer.bias
    if not all(bias.strides[0] for bias in biases):
        return gyro, accelerometer
    whole = at_samples(*biases)
    whole.setflags(write=False)
    return gyro._replace(bias=whole[1:, :3]), accelerometer._replace(bias=whole[1:, 3:])
