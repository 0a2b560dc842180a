"""Lane sensors: the output of the IMUs of a block of runs, drawn and computed in one pass over the flight.

A triad whose errors stay the same during a flight needs no more than a few products for each sample, once its
noise is drawn. The draws are those of a single run, from the same generators.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.units import si
from lab.navigation.filters.filter import aligned_zeros
from lab.navigation.kernels import compilation
from lab.navigation.kernels.compilation import entry_kernel, kernel
from lab.navigation.kernels.lane_views import LANES
from lab.sensors import imu
from lab.sensors.draws import generator
from lab.sensors.suite import SensorSuite

Errors = imu.GyroErrors | imu.AccelerometerErrors


AT_ONCE = 64
"""Samples drawn together: those of eight runs take 12 kB, a part of the processor's first cache."""


class _Constants(NamedTuple):
    """What changes the samples of a triad; of each run of a block, in the last dimension."""

    added: FloatArray  # bias times dt (3, LANES)
    mixing: FloatArray  # I + M (3, 3, LANES)
    taken: FloatArray  # the bias found by an alignment, times dt (3, LANES)
    noise: FloatArray  # σ of a sample (3,)
    step: FloatArray  # quantisation of a sample, or zero (3,)
    limit: float


def empty_increments(samples: int) -> FloatArray:
    """Return room for the increments of a block, (samples, 6, LANES), zero and aligned for vectors."""
    return aligned_zeros(samples * 6 * LANES).reshape(samples, 6, LANES)


def are_constant(errors: Errors, sensors: SensorSuite) -> bool:
    """Return whether the errors of a triad stay the same during a flight, apart from its white noise."""
    shaken = isinstance(errors, imu.AccelerometerErrors) and any(errors.vibration_density)
    return not (
        imu.is_drifting(errors) or shaken or any(errors.bandwidth) or sensors.temperature.compensation
    )


def constant_triads(
    seeds: Sequence[int],
    errors: Errors,
    ideal: FloatArray,
    dt: float,
    found: Sequence[FloatArray],
    out: FloatArray,
) -> list[imu.Measured]:
    """Simulate the gyros or the accelerometers of up to eight runs, whose errors `are_constant`.

    Parameters
    ----------
    seeds
        Seeds of the runs.
    errors
        The errors of the triad.
    ideal : (n, 3) array
        True increments over each sample interval [rad] or [m/s].
    dt
        Length of the intervals [s].
    found
        The bias that an alignment found for each run (3,) [rad/s] or [m/s²]; it is subtracted.
    out : (n, 6, LANES) array
        Receives the increments of the block: three of the six. Unused lanes repeat the last run.

    Returns
    -------
    list of Measured
        The output of each run; its increments are views into `out`.
    """
    name, first = ("gyro", 0) if isinstance(errors, imu.GyroErrors) else ("accelerometer", 3)
    lanes = [*range(len(seeds)), *[len(seeds) - 1] * (LANES - len(seeds))]
    draws = [imu.ImuDraws.of(seed, name, 0, instability=False) for seed in seeds]
    bias = [imu.turn_on_bias(errors, one) for one in draws]
    M = [imu.cross_coupling(errors, one) for one in draws]
    constants = _Constants(
        np.stack([bias[lane] * dt for lane in lanes], axis=-1),
        np.stack([np.eye(3) + M[lane] for lane in lanes], axis=-1),
        np.stack([found[lane] * dt for lane in lanes], axis=-1),
        np.asarray(si(errors, "noise_density") * np.sqrt(dt), dtype=np.float64),
        np.asarray(si(errors, "quantisation") * dt, dtype=np.float64),
        float(si(errors, "range")) * dt,
    )
    saturated = np.zeros(LANES, dtype=np.int64)
    noise = tuple(generator(seeds[lane], f"{name}.noise") for lane in lanes)
    _sense(noise, ideal, constants, out, first, saturated)
    return [
        imu.Measured(
            out[:, first : first + 3, lane],
            np.broadcast_to((np.eye(3) + M[lane]) @ bias[lane] - found[lane], ideal.shape),
            np.broadcast_to(np.diag(M[lane]), ideal.shape),
            int(saturated[lane]),
        )
        for lane in range(len(seeds))
    ]


def is_ready() -> bool:
    """Return whether the function waits for no compiler: compiled here, or on the disk."""
    return compilation.is_ready(_sense)


@entry_kernel
def _sense(
    noise: tuple[np.random.Generator, ...],
    ideal: FloatArray,
    given: _Constants,
    out: FloatArray,
    first: int,
    saturated: NDArray[np.int64],
) -> None:
    """Write the samples of a triad of all runs, as `imu.measure` computes those of one."""
    drawn = np.empty((AT_ONCE, 3))
    for start in range(0, ideal.shape[0], AT_ONCE):
        count = min(AT_ONCE, ideal.shape[0] - start)
        for lane in range(LANES):
            _draw(noise[lane], drawn, count)
            saturated[lane] += _measure(ideal, start, count, given, drawn, out, first, lane)


@kernel
def _draw(noise: np.random.Generator, drawn: FloatArray, count: int) -> None:
    """Draw the next samples of a run; nothing else in the loop, which takes twice as long otherwise."""
    for k in range(count):
        for i in range(3):
            drawn[k, i] = noise.standard_normal()


@kernel
def _measure(
    ideal: FloatArray,
    start: int,
    count: int,
    given: _Constants,
    drawn: FloatArray,
    out: FloatArray,
    first: int,
    lane: int,
) -> int:
    """Write some samples of a run, given their unit noise; return how many values are saturated."""
    saturated, limit = 0, given.limit
    for i in range(3):
        x, y, z = given.mixing[i, 0, lane], given.mixing[i, 1, lane], given.mixing[i, 2, lane]
        offset = x * given.added[0, lane] + y * given.added[1, lane] + z * given.added[2, lane]
        sigma, step, taken = given.noise[i], given.step[i], given.taken[i, lane]
        for k in range(count):
            true = ideal[start + k]
            value = x * true[0] + y * true[1] + z * true[2] + offset + sigma * drawn[k, i]
            saturated += abs(value) > limit
            value = min(max(value, -limit), limit)
            if step > 0:
                value = np.rint(value / step) * step
            out[start + k, first + i, lane] = value - taken
    return saturated
