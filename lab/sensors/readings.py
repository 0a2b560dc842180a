"""Readings: what a sensor with one number measures, and the base of all such sensors.

A reading is the true value plus a constant, a slow and a white error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import param
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_kinds import Intervals, Quantity
from lab.base.parameters.settings import Settings
from lab.base.parameters.units import si
from lab.motion.truth.trajectory import Trajectory
from lab.sensors import processes
from lab.sensors.draws import Seed, unit_draws
from lab.sensors.gps import mask_within

NO_FIELD = np.zeros((0, 3))
"""No magnetic field, read-only."""
NO_FIELD.setflags(write=False)
NO_SIGMA = np.zeros(0)
"""No σ, read-only."""
NO_SIGMA.setflags(write=False)


class Readings(NamedTuple):
    """Readings of a sensor with one number.

    Attributes
    ----------
    time : (a,) array
        Times [s].
    value : (a,) array
        What it reads.
    field : (a, 3) array, or (0, 3)
        Direction of the magnetic field in b, if that is measured; the value is then the declination.
    sigma : (a,) array, or (0,)
        σ that the device itself gives, in units of the value; NaN or 0 where it gives none.
    """

    time: FloatArray
    value: FloatArray
    field: FloatArray = NO_FIELD
    sigma: FloatArray = NO_SIGMA


# Common declarations of all such sensors.


def fitted(what: str) -> param.Boolean:
    """Return the declaration of whether there is a sensor; `what` says which, as the end of a sentence."""
    return param.Boolean(default=False, label="Fitted", doc=f"Whether there is {what}")


def period(default: float) -> Quantity:
    """Return the declaration of the time between readings."""
    return Quantity(
        default,
        unit="s",
        bounds=(0.01, 60),
        softbounds=(0.1, 10),
        step=0.1,
        label="Period",
        doc="Time from reading to reading; the first is one period after the start.",
    )


def noise(default: float, **size: Any) -> Quantity:
    """Return the declaration of the white error."""
    doc = "Standard deviation of the white error of a reading."
    return Quantity(default, label="Noise, σ", doc=doc, **size)


def bias_sigma(default: float, **size: Any) -> Quantity:
    """Return the declaration of the constant error."""
    doc = "Standard deviation of the constant part of the bias, drawn anew for each seed."
    return Quantity(default, label="Bias, σ", doc=doc, **size)


def drift_sigma(default: float, **size: Any) -> Quantity:
    """Return the declaration of the slow error."""
    doc = "Standard deviation of the slow part of the bias, a first-order Gauss-Markov process."
    return Quantity(default, label="Drift, σ", doc=doc, **size)


def correlation_time(default: float) -> Quantity:
    """Return the declaration of the correlation time of the slow error."""
    return Quantity(
        default,
        unit="s",
        bounds=(1, 1e6),
        softbounds=(10, 7200),
        step=10,
        label="Correlation time",
        doc="Correlation time of the drift.",
    )


def scale_factor_sigma(quantity: str) -> Quantity:
    """Return the declaration of the error of the scale factor of a quantity."""
    return Quantity(
        1.0,
        unit="%",
        bounds=(0, 50),
        softbounds=(0, 5),
        step=0.1,
        label="Scale factor error, σ",
        doc=f"Standard deviation of the relative error of the {quantity}, drawn anew for each seed.",
    )


def outages() -> Intervals:
    """Return the declaration of times without readings."""
    doc = "Times without readings, as [start, end] pairs in seconds."
    return Intervals(default=[], label="Outages", doc=doc)


def reading_times(period: float, duration: float) -> FloatArray:
    """Return the times of all readings of a flight, the first one period after the start [s]."""
    # A reading at the very end counts, even if the quotient is rounded down.
    return period * np.arange(1.0, int(duration / period + 1e-9) + 1)


def slow_error(errors: Settings, seed: Seed, name: str, times: FloatArray) -> FloatArray:
    """Return the bias (a,) of a sensor in SI units: a constant plus a first-order Gauss-Markov process.

    Parameters
    ----------
    errors
        Errors with `bias_sigma`, `drift_sigma` and `correlation_time`.
    seed
        Seed of the run.
    name
        Name of the sensor, which names its draws.
    times : (a,) array
        Times, one period apart [s].
    """
    constant, drift = float(si(errors, "bias_sigma")), float(si(errors, "drift_sigma"))
    error = np.full(times.size, constant * float(unit_draws(seed, f"{name}.constant", (1,))[0]))
    if drift and times.size:
        draws = unit_draws(seed, f"{name}.drift", (times.size, 1))
        decay = float(np.exp(-times[0] / float(si(errors, "correlation_time"))))
        error += drift * processes.gauss_markov(draws[0], draws, decay)[:, 0]
    return error


def interpolate_slow_error(errors: Settings, seed: Seed, name: str, time: FloatArray) -> FloatArray:
    """Return the bias (n,) of a sensor at some times, also where an outage has no readings.

    Parameters
    ----------
    errors, seed, name
        As of `slow_error`; the errors have a `period` too.
    time : (n,) array
        Times up to the end of the flight, not decreasing [s]; the bias is interpolated between readings.
    """
    if not time.size:
        return np.zeros(0)
    period = float(si(errors, "period"))
    times = reading_times(period, max(float(time[-1]), period))
    return np.interp(time, times, slow_error(errors, seed, name, times))


def scale_error(errors: Settings, seed: Seed, name: str) -> float:
    """Return the relative error of the scale of a sensor with a `scale_factor_sigma`."""
    return float(si(errors, "scale_factor_sigma")) * float(unit_draws(seed, f"{name}.scale", (1,))[0])


def read(
    seed: Seed,
    name: str,
    times: FloatArray,
    true: FloatArray,
    bias: FloatArray,
    noise: FloatArray | float,
    outages: Sequence[tuple[float, float]],
) -> Readings:
    """Return the readings outside of outages.

    Parameters
    ----------
    seed, name, times
        As of `slow_error`.
    true, bias : (a,) arrays
        True values, and slow errors.
    noise : (a,) array or float
        Standard deviation of the white error.
    outages
        Times without readings [s].
    """
    value = true + bias + noise * unit_draws(seed, f"{name}.noise", times.shape)
    keep = ~mask_within(outages, times)
    return Readings(times[keep], value[keep])


class AidSensor(Settings):
    """Errors and timing of a sensor with one number: the base of the classes in `lab.base.aid_table`.

    A subclass declares `fitted`, `period`, `noise` and `outages`; and either `bias_sigma`, `drift_sigma` and
    `correlation_time`, or `scale_factor_sigma`.
    """

    NAME: ClassVar[str]
    """Its name in the table."""
    IDLE_IN_A_LOG: ClassVar[tuple[str, ...]] = ("period", "outages")
    """Settings without effect on the navigation of a log."""
    UNUSED: ClassVar[str] = "zero"
    """What readings are that a filter cannot use, as the end of a sentence."""

    def truth(self, trajectory: Trajectory, seed: Seed, times: FloatArray) -> FloatArray:
        """Return what it would read without errors at times (a,) [s], in SI units (a,)."""
        raise NotImplementedError

    def shown(self, trajectory: Trajectory, found: Readings) -> Readings:
        """Return readings in the form in which the sensor gives them."""
        return found

    def usable(self, value: FloatArray) -> NDArray[np.bool_]:
        """Return the mask (a,) of the readings that a filter uses."""
        return np.ones(value.shape, dtype=np.bool_)

    def state_at(self, seed: Seed, time: FloatArray) -> FloatArray:
        """Return the true bias or scale factor error (n,) at times (n,), in outages too."""
        if hasattr(self, "scale_factor_sigma"):
            return np.full(time.size, scale_error(self, seed, self.NAME))
        return interpolate_slow_error(self, seed, self.NAME, time)

    @classmethod
    def effective_in_a_log(cls) -> tuple[str, ...]:
        """Return the settings with an effect on the navigation of a log: what the filter assumes."""
        idle = {"name", *cls.IDLE_IN_A_LOG}
        return tuple(name for name in cls.param.objects("existing") if name not in idle)


def measure(trajectory: Trajectory, errors: AidSensor, seed: Seed) -> Readings:
    """Return the readings of a sensor.

    Parameters
    ----------
    trajectory
        The flight.
    errors
        Errors and timing.
    seed
        Seed of the run.
    """
    times = reading_times(float(si(errors, "period")), trajectory.duration)
    true = errors.truth(trajectory, seed, times)
    if hasattr(errors, "scale_factor_sigma"):
        bias = scale_error(errors, seed, errors.NAME) * true
    else:
        bias = slow_error(errors, seed, errors.NAME, times)
    noise = float(si(errors, "noise"))
    found = read(seed, errors.NAME, times, true, bias, noise, errors.get("outages"))
    return errors.shown(trajectory, found)
