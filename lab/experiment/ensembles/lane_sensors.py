"""Lane sensors: the output of the IMUs of a block of runs, drawn and computed in one pass over the flight.

The draws are those of a single run. White noise is drawn where it is used, eight runs abreast
(`lane_draws`); of the slow processes of a bias, the samples are drawn before.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.cache import StageCache
from lab.base.parameters.units import si
from lab.experiment.ensembles import lane_draws
from lab.experiment.ensembles.lane_draws import Streams, draw, seed_streams, seeds_abreast
from lab.experiment.sensor_stages import SampledFlight
from lab.navigation.filters.filter import aligned_zeros
from lab.navigation.kernels import compilation
from lab.navigation.kernels.compilation import kernel, loop_kernel
from lab.navigation.kernels.lane_views import LANES, wide, wide_vectors
from lab.sensors import imu, processes
from lab.sensors import temperature as thermal
from lab.sensors.draws import Seed, unit_draws
from lab.sensors.suite import SensorSuite

Errors = imu.GyroErrors | imu.AccelerometerErrors


AT_ONCE = 64
"""Samples computed together: a triad of eight runs takes 12 kB, a part of the processor's first cache."""


BIAS, MIXING, TAKEN, ROWS = 0, 3, 12, 15
"""Where the numbers of a triad begin that each run has of its own, in eights: the constant part of the bias,
I + M, and the bias of a sample that an alignment found; and their number."""


class _Triad(NamedTuple):
    """What changes the samples of a triad."""

    own: FloatArray  # of each run: see `BIAS` (ROWS * LANES,)
    noise: FloatArray  # σ of a sample (3,)
    step: FloatArray  # quantisation of a sample, or zero (3,)
    limit: float
    dt: float
    process: FloatArray  # slow part of the bias (LANES, 3, n), or (LANES, 3, 0) without any
    warmer: FloatArray  # temperature above that of calibration (n,) [K], or (0,) without an effect
    bias_by_temperature: FloatArray  # (3,)
    scale_by_temperature: FloatArray  # (3,)
    dvelocity: FloatArray  # specific force that acts on gyros (n, 3) [m/s], or (0, 3)
    bias_by_force: FloatArray  # (3,)
    held: FloatArray  # mean of a step after a lag (3,), or one without a lag; see `processes.apply_lag`
    forget: FloatArray  # what is left of a value after a sample with that lag (3,)


class _Part(NamedTuple):
    """Some samples of all runs, (3 * AT_ONCE * LANES,): output, biases, and true quantities with them."""

    values: FloatArray
    bias: FloatArray
    biased: FloatArray
    lag: FloatArray  # states of the lags (3 * LANES,)

    @classmethod
    def empty(cls) -> _Part:
        """Return room for them."""
        values, bias, biased = (aligned_zeros(3 * AT_ONCE * LANES) for _ in range(3))
        return cls(values, bias, biased, aligned_zeros(3 * LANES))


FLICKER = StageCache(limit=64 * 2**20)
"""Flicker with a coefficient of 1: that of eight runs of three minutes takes 16 MB. Many sensors that are run
with the same seeds share it, and it takes as long to draw as all other errors of a sensor."""


class SensorRoom:
    """Room for the output of the sensors of a block; each use takes the same, because new memory takes time.

    Parameters
    ----------
    samples
        Number n of samples.

    Attributes
    ----------
    increments : (n, 6, LANES) array
        Aligned for vectors.
    """

    def __init__(self, samples: int) -> None:
        self.increments = aligned_zeros(samples * 6 * LANES).reshape(samples, 6, LANES)
        self.samples = samples

    def part(self, samples: int) -> SensorRoom:
        """Return room for fewer samples in the same memory."""
        if samples == self.samples:
            return self
        found = copy.copy(self)
        found.samples, found.increments = samples, self.increments[:samples]
        for name, shape in (("process", (LANES, 3, samples)), ("shown", (2, LANES, samples, 3))):
            whole = getattr(self, name).reshape(-1)
            setattr(found, name, whole[: math.prod(shape)].reshape(shape))
        return found

    @cached_property
    def some(self) -> _Part:
        """Room for the samples that are computed together."""
        return _Part.empty()

    @cached_property
    def process(self) -> FloatArray:
        """Slow part of the biases of a triad (LANES, 3, n)."""
        return np.empty((LANES, 3, self.samples))

    @cached_property
    def shown(self) -> FloatArray:
        """Biases of gyros and accelerometers as their output shows them (2, LANES, n, 3)."""
        return np.empty((2, LANES, self.samples, 3))


def can_sense(errors: Errors, sensors: SensorSuite) -> bool:
    """Return whether `triads` simulates these errors: without vibration, and without a thermometer."""
    feels = isinstance(errors, imu.AccelerometerErrors) or any(errors.g_sensitivity)
    shaken = feels and any(sensors.accelerometer.vibration_density)
    return not (shaken or sensors.temperature.compensation)


def triads(
    seeds: Sequence[int],
    errors: Errors,
    sensors: SensorSuite,
    flight: SampledFlight,
    found: Sequence[FloatArray],
    room: SensorRoom,
) -> list[imu.Measured]:
    """Simulate the gyros or the accelerometers of up to eight runs, whose errors `can_sense` admits.

    Parameters
    ----------
    seeds
        Seeds of the runs.
    errors, sensors
        The errors of the triad, and the suite that it is a part of.
    flight
        The flight.
    found
        The bias that an alignment found for each run (3,) [rad/s] or [m/s²]; it is subtracted.
    room
        Receives the output: of the increments, three of the six. Unused lanes repeat the last run.

    Returns
    -------
    list of Measured
        The output of each run: views into the room.
    """
    name, first = ("gyro", 0) if isinstance(errors, imu.GyroErrors) else ("accelerometer", 3)
    ideal, dt = flight.ideal.dvelocity if first else flight.ideal.dtheta, flight.ideal.dt
    lanes = [*range(len(seeds)), *[len(seeds) - 1] * (LANES - len(seeds))]
    abreast = seeds_abreast(seeds)
    draws = imu.ImuDraws.constants(abreast, name)
    bias, M = imu.turn_on_bias(errors, draws), imu.cross_coupling(errors, draws)
    out, process = room.increments, _processes(seeds, abreast, name, errors, dt, room)
    warmer = _temperature_rise(errors, sensors, flight)
    felt = si(errors, "g_sensitivity") if isinstance(errors, imu.GyroErrors) else np.zeros(3)
    cutoff = 2 * np.pi * si(errors, "bandwidth") * dt
    lags = cutoff > 0
    forget = np.where(lags, np.exp(-cutoff), 0.0)
    own = aligned_zeros(ROWS * LANES).reshape(ROWS, LANES)
    own[BIAS:MIXING] = bias[lanes].T
    own[MIXING:TAKEN] = (np.eye(3) + M[lanes]).reshape(LANES, 9).T
    own[TAKEN:] = np.transpose([found[lane] * dt for lane in lanes])
    given = _Triad(
        own.reshape(-1),
        np.asarray(si(errors, "noise_density") * np.sqrt(dt), dtype=np.float64),
        np.asarray(si(errors, "quantisation") * dt, dtype=np.float64),
        float(si(errors, "range")) * dt,
        dt,
        process,
        warmer,
        si(errors, "bias_temperature"),
        si(errors, "scale_temperature"),
        flight.ideal.dvelocity if felt.any() else np.zeros((0, 3)),
        felt,
        # (1 − exp(−x)) / x, of which expm1 keeps all digits for a small x.
        np.where(lags, -np.expm1(-cutoff) / np.where(lags, cutoff, 1.0), 1.0),
        forget,
    )
    varies = process.shape[2] > 0 or warmer.size > 0 or felt.any()
    shown = room.shown[first // 3] if varies else np.empty((LANES, 0, 3))
    saturated = np.zeros(LANES, dtype=np.int64)
    streams = seed_streams([seeds[lane] for lane in lanes], f"{name}.noise")
    _sense(streams, ideal, given, room.some, out.reshape(-1), first, shown, saturated)
    warming = warmer[:, None] * given.scale_by_temperature
    return [
        imu.Measured(
            out[:, first : first + 3, lane],
            shown[lane]
            if varies
            else np.broadcast_to((np.eye(3) + M[lane]) @ bias[lane] - found[lane], ideal.shape),
            np.diag(M[lane]) + warming if warming.any() else np.broadcast_to(np.diag(M[lane]), ideal.shape),
            int(saturated[lane]),
        )
        for lane in range(len(seeds))
    ]


def _processes(
    seeds: Sequence[int], abreast: Sequence[Seed], name: str, errors: Errors, dt: float, room: SensorRoom
) -> FloatArray:
    """Return the slow part of the bias of each run (LANES, 3, n) [rad/s] or [m/s²]; (LANES, 3, 0) without."""
    flicker = si(errors, "flicker")
    others = {"instability": any(errors.instability), "walk": any(errors.rate_random_walk)}
    if not (flicker.any() or any(others.values())):
        return np.zeros((LANES, 3, 0))
    total = room.process
    # The room still has the processes of the runs before.
    total[:] = 0.0
    if flicker.any():
        for lane, (seed, own) in enumerate(zip(seeds, abreast, strict=True)):
            np.multiply(flicker[:, None], _flicker(seed, own, name, total.shape[2]), out=total[lane])
    if any(others.values()):
        rest = errors.copy()
        rest.set("flicker", 0.0)
        for lane, own in enumerate(abreast):
            draws = imu.ImuDraws.of(own, name, total.shape[2], noise=False, **others)
            total[lane] += imu.drift(rest, draws, dt).T
    return total


def _flicker(seed: int, own: Seed, name: str, samples: int) -> FloatArray:
    """Return the flicker of a triad with a coefficient of 1 (3, n), kept for other sensors of the seed."""

    def made() -> FloatArray:
        drawn = unit_draws(own, f"{name}.flicker", (samples, 3))
        return processes.flicker(np.ascontiguousarray(drawn.T), axis=-1)

    return FLICKER.get("flicker", f"{seed} {name} {samples}", made)


def _temperature_rise(errors: Errors, sensors: SensorSuite, flight: SampledFlight) -> FloatArray:
    """Return the temperature above that of calibration (n,) [K]; (0,) if it changes nothing."""
    if not (any(errors.bias_temperature) or any(errors.scale_temperature)):
        return np.zeros(0)
    height = flight.truth.height[1:] - flight.truth.height[0]
    warmer = thermal.temperature(sensors.temperature, flight.ideal.time[1:], height) - thermal.REFERENCE
    return warmer if warmer.any() else np.zeros(0)


def is_ready() -> bool:
    """Return whether the function waits for no compiler: compiled here, or on the disk."""
    return compilation.is_ready(_sense) and lane_draws.is_ready()


@loop_kernel
def _sense(
    streams: Streams,
    ideal: FloatArray,
    given: _Triad,
    part: _Part,
    out: FloatArray,
    first: int,
    shown: FloatArray,
    saturated: NDArray[np.int64],
) -> None:
    """Write the samples of a triad of all runs, as `imu.measure` computes those of one."""
    wide_vectors()
    for start in range(0, ideal.shape[0], AT_ONCE):
        count = min(AT_ONCE, ideal.shape[0] - start)
        # In the order of a single run: sample by sample, and within it axis by axis.
        for k in range(count):
            for i in range(3):
                draw(streams, part.values, (i * AT_ONCE + k) * LANES)
        _bias(ideal, start, count, given, part)
        for i in range(3):
            _measure(start, count, given, part, i)
            _limit(count, given, part, i, saturated)
            _write(start, count, given, part, i, out, first)
        if shown.shape[1] > 0:
            _write_shown_bias(start, count, given, part, shown)


@kernel
def _bias(ideal: FloatArray, start: int, count: int, given: _Triad, part: _Part) -> None:
    """Write biases, and true quantities with them, of some samples."""
    dt, own = given.dt, wide(given.own, 0)
    for i in range(3):
        at = i * AT_ONCE
        bias, biased, constant = wide(part.bias, at), wide(part.biased, at), own[BIAS + i]
        for k in range(count):
            bias[k] = constant
        if given.process.shape[2] > 0:
            for lane in range(LANES):
                process = given.process[lane, i]
                for k in range(count):
                    part.bias[(at + k) * LANES + lane] += process[start + k]
        if given.warmer.size > 0:
            for k in range(count):
                bias[k] += given.bias_by_temperature[i] * given.warmer[start + k]
        if given.dvelocity.shape[0] > 0:
            for k in range(count):
                bias[k] += given.bias_by_force[i] * given.dvelocity[start + k, i] / dt
        for k in range(count):
            biased[k] = ideal[start + k, i] + bias[k] * dt


@kernel
def _measure(start: int, count: int, given: _Triad, part: _Part, i: int) -> None:
    """Write some samples of an axis before range and quantisation; the lag is kept from part to part."""
    values, by_x, by_y = wide(part.values, i * AT_ONCE), wide(part.biased, 0), wide(part.biased, AT_ONCE)
    by_z, biased, sigma = wide(part.biased, 2 * AT_ONCE), wide(part.biased, i * AT_ONCE), given.noise[i]
    own, lag = wide(given.own, MIXING + 3 * i), wide(part.lag, i)
    x, y, z = own[0], own[1], own[2]
    settled = x * by_x[0] + y * by_y[0] + z * by_z[0]
    for k in range(count):
        values[k] = x * by_x[k] + y * by_y[k] + z * by_z[k] + values[k] * sigma
    if given.warmer.size > 0:
        warming = given.scale_by_temperature[i]
        settled += warming * given.warmer[start] * biased[0]
        for k in range(count):
            values[k] += warming * given.warmer[start + k] * biased[k]
    held, forget = given.held[i], given.forget[i]
    if held < 1:
        if start == 0:
            lag[0] = settled * held
        state = lag[0]
        for k in range(count):
            left = (1 - held) * values[k] + state
            state = (held - forget) * values[k] + forget * left
            values[k] = left
        lag[0] = state


@kernel
def _limit(count: int, given: _Triad, part: _Part, i: int, saturated: NDArray[np.int64]) -> None:
    """Apply range and quantisation of an axis to some samples, and count the values beyond the range."""
    limit, step, first, beyond = given.limit, given.step[i], i * AT_ONCE * LANES, 0
    last = first + count * LANES
    for at in range(first, last):
        beyond += abs(part.values[at]) > limit
    if beyond > 0:
        for at in range(first, last):
            saturated[at % LANES] += abs(part.values[at]) > limit
            part.values[at] = min(max(part.values[at], -limit), limit)
    if step > 0:
        for at in range(first, last):
            part.values[at] = np.rint(part.values[at] / step) * step


@kernel
def _write(start: int, count: int, given: _Triad, part: _Part, i: int, out: FloatArray, first: int) -> None:
    """Write some samples of an axis into the output (n * 6 * LANES,)."""
    values, found, taken = (
        wide(part.values, i * AT_ONCE),
        wide(out, 6 * start + first + i),
        wide(given.own, TAKEN),
    )
    for k in range(count):
        found[6 * k] = values[k] - taken[i]


@kernel
def _write_shown_bias(start: int, count: int, given: _Triad, part: _Part, shown: FloatArray) -> None:
    """Write the true bias of some samples as the output shows it."""
    own, dt, last = given.own, given.dt, 2 * AT_ONCE * LANES
    for lane in range(LANES):
        for i in range(3):
            row = (MIXING + 3 * i) * LANES + lane
            x, y, z = own[row], own[row + LANES], own[row + 2 * LANES]
            taken, axis = own[(TAKEN + i) * LANES + lane] / dt, i * AT_ONCE * LANES
            for k in range(count):
                at = k * LANES + lane
                by_x, by_y, by_z = part.bias[at], part.bias[AT_ONCE * LANES + at], part.bias[last + at]
                shown[lane, start + k, i] = x * by_x + y * by_y + z * by_z - taken
            if given.warmer.size > 0:
                warming = given.scale_by_temperature[i]
                for k in range(count):
                    bias = part.bias[axis + k * LANES + lane]
                    shown[lane, start + k, i] += warming * given.warmer[start + k] * bias
