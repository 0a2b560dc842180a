"""Readings: what a sensor with one number measures, and the parts that all such sensors share.

A reading is the true value plus a constant, a slow and a white error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.sensors import processes
from lab.sensors.draws import Seed, unit_draws
from lab.sensors.gps import within

FloatArray = NDArray[np.float64]


class Readings(NamedTuple):
    """Readings of a sensor with one number.

    Attributes
    ----------
    time : (a,) array
        Times [s].
    value : (a,) array
        What it reads.
    bias : (a,) array
        The slow part of its error, which a filter may estimate.
    """

    time: FloatArray
    value: FloatArray
    bias: FloatArray


def reading_times(period: float, duration: float) -> FloatArray:
    """Return the times of all readings of a flight, the first one period after the start [s]."""
    return period * np.arange(1.0, int(duration / period + 1e-9) + 1)


def slow_error(
    seed: Seed, name: str, times: FloatArray, constant: float, drift: float, correlation_time: float
) -> FloatArray:
    """Return a constant plus a first-order Gauss-Markov process (a,).

    Parameters
    ----------
    seed
        Seed of the run.
    name
        Name of the sensor, which names its draws.
    times : (a,) array
        Times, one period apart [s].
    constant, drift
        Standard deviations of both parts.
    correlation_time
        Of the process [s].
    """
    error = np.full(times.size, constant * float(unit_draws(seed, f"{name}.constant", (1,))[0]))
    if drift and times.size:
        draws = unit_draws(seed, f"{name}.drift", (times.size, 1))
        decay = float(np.exp(-times[0] / correlation_time))
        error += drift * processes.gauss_markov(draws[0], draws, decay)[:, 0]
    return error


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
    keep = ~within(outages, times)
    return Readings(times[keep], value[keep], bias[keep])
