"""IMU: simulated measurements of inertial sensors from true rates and specific forces (the truth side).

x_meas = (I + M) (x_true + b) + ν, then the bandwidth, the range and the quantisation, in this order, applied
to the increments of each sample; see Groves, *Principles of GNSS, Inertial and Multisensor Integrated
Navigation Systems*, 2nd ed., ch. 4.4, eqs. 4.16-4.18. b is the turn-on bias plus a first-order Gauss-Markov
process, flicker, a random walk, and the contributions of temperature and, for gyros, specific force. M
contains the scale factors (given, drawn and due to temperature) and the misalignments. ν is white with the
given density.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.histories import shrink_history
from lab.base.parameters.units import si
from lab.sensors import processes
from lab.sensors.draws import Seed, unit_draws
from lab.sensors.imu_draws import ImuDraws
from lab.sensors.imu_errors import OFF_DIAGONAL, AccelerometerErrors, GyroErrors
from lab.sensors.temperature import REFERENCE

__all__ = [
    "REFERENCE_ENVIRONMENT",
    "AccelerometerErrors",
    "Environment",
    "GyroErrors",
    "ImuDraws",
    "Measured",
    "Memory",
    "as_kept",
    "compensate",
    "cross_coupling",
    "drift",
    "induced_bias",
    "is_drifting",
    "mean_at_rest",
    "measure",
    "misalignment",
    "turn_on_bias",
    "with_vibration",
    "without_bias",
]


class Measured(NamedTuple):
    """The output of a triad of sensors.

    Attributes
    ----------
    increments : (n, 3) array
        Integrals of the measured quantity over each sample interval [rad] or [m/s].
    bias : (n, 3) array
        True bias in each interval as the output shows it, (I + M) b [rad/s] or [m/s²].
    scale : (n, 3) array
        True scale factor error in each interval.
    saturated : int
        Number of saturated values.
    """

    increments: FloatArray
    bias: FloatArray
    scale: FloatArray
    saturated: int

    def taken(self, intervals: NDArray[np.intp] | slice) -> Measured:
        """Return the output in some intervals; the number of saturated values remains that of all."""
        return self._replace(
            increments=self.increments[intervals], bias=self.bias[intervals], scale=self.scale[intervals]
        )


class Environment(NamedTuple):
    """The environment of a triad, besides the quantity it measures.

    Attributes
    ----------
    temperature : (n,) array, or scalar
        Temperature in each sample interval [°C].
    dvelocity : (n, 3) array, or (3,)
        Integral of the specific force over each sample interval, which acts on gyros that are sensitive to it
        [m/s].
    """

    temperature: FloatArray
    dvelocity: FloatArray


@dataclass
class Memory:
    """What a triad keeps from one piece of its samples to the next; new for the first piece.

    Attributes
    ----------
    instability : (3,) array or None
        Last sample of the Gauss-Markov bias, in its σ.
    lag : dict of int to float
        States of the lags of the axes that have one.
    """

    instability: FloatArray | None = None
    lag: dict[int, float] = field(default_factory=dict)


REFERENCE_ENVIRONMENT = Environment(np.array(REFERENCE), np.zeros(3))
"""At the temperature of calibration, in free fall."""


def measure(
    ideal: FloatArray,
    dt: float,
    errors: GyroErrors | AccelerometerErrors,
    draws: ImuDraws,
    environment: Environment = REFERENCE_ENVIRONMENT,
    memory: Memory | None = None,
) -> Measured:
    """Return the output of a triad with the given errors, for all samples or for a piece of them.

    Parameters
    ----------
    ideal : (n, 3) array
        True increments over each sample interval [rad] or [m/s], those of accelerometers as `with_vibration`.
    dt
        Length of the intervals [s].
    errors
        The errors of the triad.
    draws
        Unit draws for n samples, with the long draws of the errors in `errors`.
    environment
        Temperature and specific force in the same intervals.
    memory
        Of the piece before, which is updated; without it, the samples are the first.
    """
    memory = Memory() if memory is None else memory
    bias = turn_on_bias(errors, draws) + drift(errors, draws, dt, memory)
    drifting = bias + induced_bias(errors, environment, dt)
    M = cross_coupling(errors, draws)
    biased = ideal + drifting * dt
    increments = biased @ (np.eye(3) + M).T if M.any() else biased
    bias = drifting @ (np.eye(3) + M).T
    scale, by_temperature = np.diag(M), si(errors, "scale_temperature")
    if by_temperature.any():
        warming = by_temperature * _above_reference(environment.temperature)
        # M is constant at 25 °C; the temperature adds to its diagonal, sample by sample.
        scale, increments, bias = scale + warming, increments + warming * biased, bias + warming * drifting
    # A lag starts settled on the noiseless output: the sensor was on before the first sample.
    settled = increments[0].copy()
    # White noise of density N has σ N √Δt in an integral over Δt.
    increments += si(errors, "noise_density") * np.sqrt(dt) * draws.noise
    _lag(increments, settled, si(errors, "bandwidth") * dt, memory.lag)
    limit = float(si(errors, "range")) * dt
    saturated = 0
    if increments.max() > limit or increments.min() < -limit:
        saturated = int(np.count_nonzero(np.abs(increments) > limit))
        np.clip(increments, -limit, limit, out=increments)
    _quantise(increments, si(errors, "quantisation") * dt)
    return Measured(
        increments, np.broadcast_to(bias, ideal.shape), np.broadcast_to(scale, ideal.shape), saturated
    )


def turn_on_bias(errors: GyroErrors | AccelerometerErrors, draws: ImuDraws) -> FloatArray:
    """Return the constant part of the bias (…, 3): given plus drawn [rad/s] or [m/s²]."""
    return si(errors, "bias") + si(errors, "bias_sigma") * draws.bias


def drift(
    errors: GyroErrors | AccelerometerErrors, draws: ImuDraws, dt: float, memory: Memory | None = None
) -> FloatArray:
    """Return the sum of the random processes of the bias, (n, 3), or (3,) zeros without any.

    Gauss-Markov instability, flicker and random walk [rad/s] or [m/s²]; with a memory, those of the next
    piece.
    """
    total = np.zeros(3)
    instability, flicker = si(errors, "instability"), si(errors, "flicker")
    walk = si(errors, "rate_random_walk")
    if instability.any():
        decay = float(np.exp(-dt / si(errors, "correlation_time")))
        before = None if memory is None else memory.instability
        process = processes.gauss_markov(draws.start, draws.drive, decay, before)
        if memory is not None:
            memory.instability = process[-1].copy()
        total = instability * process
    if flicker.any():
        total = total + flicker * draws.flicker
    if walk.any():
        total = total + walk * np.sqrt(dt) * draws.walk
    return total


def induced_bias(errors: GyroErrors | AccelerometerErrors, environment: Environment, dt: float) -> FloatArray:
    """Return the bias induced by temperature and specific force, (n, 3), or (3,) zeros without any.

    In [rad/s] or [m/s²].
    """
    total = np.zeros(3)
    by_temperature = si(errors, "bias_temperature")
    if by_temperature.any():
        total = by_temperature * _above_reference(environment.temperature)
    if isinstance(errors, GyroErrors) and any(errors.g_sensitivity):
        total = total + si(errors, "g_sensitivity") * environment.dvelocity / dt
    return total


def cross_coupling(errors: GyroErrors | AccelerometerErrors, draws: ImuDraws) -> FloatArray:
    """Return M (…, 3, 3) at 25 °C: scale factor errors on the diagonal, misalignments [rad] off it."""
    scale = si(errors, "scale_factor") + si(errors, "scale_factor_sigma") * draws.scale
    return np.asarray(scale[..., None] * np.eye(3) + misalignment(errors))


def misalignment(errors: GyroErrors | AccelerometerErrors) -> FloatArray:
    """Return the misalignments [rad] off the diagonal of a matrix (3, 3)."""
    M = np.zeros((3, 3))
    for name, value in zip(OFF_DIAGONAL, si(errors, "misalignment"), strict=True):
        M["xyz".index(name[0]), "xyz".index(name[1])] = value
    return M


def mean_at_rest(
    errors: GyroErrors | AccelerometerErrors,
    draws: ImuDraws,
    at_rest: FloatArray,
    environment: Environment,
) -> FloatArray:
    """Return the mean output of a triad at rest (3,), without noise [rad/s] or [m/s²].

    Parameters
    ----------
    errors
        The errors of the triad; its instability, range and quantisation do not show in a mean.
    draws
        Unit draws of its constants.
    at_rest : (3,) array
        True rate or specific force in b.
    environment
        Temperature and specific force at rest, for one second.
    """
    bias = turn_on_bias(errors, draws) + induced_bias(errors, environment, 1.0).reshape(-1, 3)[0]
    M = cross_coupling(errors, draws)
    M = M + np.diag(si(errors, "scale_temperature") * _above_reference(environment.temperature)[0])
    return np.asarray((np.eye(3) + M) @ (at_rest + bias))


def with_vibration(errors: AccelerometerErrors, seed: Seed, dvelocity: FloatArray, dt: float) -> FloatArray:
    """Return the velocity increments in b with the vibration of the vehicle added, (n, 3) [m/s].

    Parameters
    ----------
    errors
        Errors of the accelerometers, among them the density of the vibration.
    seed
        Seed of the run, or the stream of its draws.
    dvelocity : (n, 3) array
        Increments of the smooth true flight [m/s].
    dt
        Length of the sample intervals [s].
    """
    density = si(errors, "vibration_density")
    if not density.any():
        return dvelocity
    return np.asarray(dvelocity + density * np.sqrt(dt) * unit_draws(seed, "vibration", dvelocity.shape))


def compensate(
    measured: Measured,
    dt: float,
    errors: GyroErrors | AccelerometerErrors,
    temperature: FloatArray,
    reading: FloatArray,
) -> Measured:
    """Return the output of a triad corrected by its known temperature coefficients and a thermometer.

    x = x_meas / (1 + s ΔT) − c ΔT. The correction does not know the remaining scale factor error and the
    misalignments. The remaining true bias and scale factor are those at 25 °C, and the noise of the
    thermometer adds to the noise.

    Parameters
    ----------
    measured
        Output of the triad; its bias includes the effect of temperature.
    dt
        Length of the sample intervals [s].
    errors
        The errors of the triad; only the temperature coefficients are used.
    temperature, reading : (n,) arrays
        True temperature in each sample interval, and the reading of the thermometer [°C].
    """
    scale, bias = si(errors, "scale_temperature"), si(errors, "bias_temperature")
    excess, by_scale = _above_reference(reading), 1 + scale * _above_reference(temperature)
    return Measured(
        measured.increments / (1 + scale * excess) - bias * excess * dt,
        measured.bias / by_scale - bias * _above_reference(temperature),
        (1 + measured.scale) / by_scale - 1,
        measured.saturated,
    )


def without_bias(measured: Measured, dt: float, bias: FloatArray) -> Measured:
    """Return the output of a triad minus a bias that was estimated before; the rest of the bias remains.

    Parameters
    ----------
    measured
        Output of the triad.
    dt
        Length of the sample intervals [s].
    bias : (3,) array
        The bias estimated from the output [rad/s] or [m/s²].
    """
    return measured._replace(increments=measured.increments - bias * dt, bias=measured.bias - bias)


def is_drifting(errors: GyroErrors | AccelerometerErrors) -> bool:
    """Return whether the bias of a triad may change during a flight."""
    terms = ("instability", "flicker", "rate_random_walk", "bias_temperature", "scale_temperature")
    g_sensitive = isinstance(errors, GyroErrors) and any(errors.g_sensitivity)
    return g_sensitive or any(any(getattr(errors, term)) for term in terms)


def as_kept(measured: Measured) -> Measured:
    """Return the output of a triad for storage: for a long flight, the true errors are float32."""
    return measured._replace(bias=shrink_history(measured.bias), scale=shrink_history(measured.scale))


def _above_reference(temperature: FloatArray) -> FloatArray:
    """Return temperatures above that of calibration, as a column (n, 1) or (1,) [K]."""
    return np.asarray(temperature)[..., None] - REFERENCE


def _lag(increments: FloatArray, settled: FloatArray, cutoff: FloatArray, states: dict[int, float]) -> None:
    """Filter increments by the first-order lag of each axis, in place; the states are updated."""
    for axis in np.flatnonzero(cutoff).tolist():
        angle = 2 * np.pi * cutoff[axis]
        state = states.get(axis)
        if state is None:
            state = processes.settled_lag(settled[axis], angle)
        increments[:, axis], states[axis] = processes.apply_lag(increments[:, axis], state, angle)


def _quantise(increments: FloatArray, step: FloatArray) -> None:
    """Round increments to whole steps on the axes with quantisation, in place."""
    for axis in np.flatnonzero(step):
        increments[:, axis] = np.round(increments[:, axis] / step[axis]) * step[axis]
