"""Time grid: the evenly spaced times of a rebuilt flight."""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError

MAX_SAMPLES = 20_000_000
"""Most samples a rebuilt flight may have."""

_ROUND_RATES = np.array([1.0, 2.0, 4.0, 5.0, 8.0])
"""Leading digits of the rates that a grid may have [Hz]: their steps have few decimals."""
_NEARLY = 0.999
"""Part of the wanted rate that a round one must reach: rounded stamps move the usual step by as little."""
_MAX_UNEVEN = 1e-4
"""How far samples may lie off even times, in steps, to keep them: 0.1 µs at 1 kHz, the rounding of stamps."""
_GRID_TIMES_PER_STEP = 2
"""Grid times for each usual step of uneven samples, so that the grid follows what lies between them."""
_MAX_GRID_TIMES_PER_SAMPLE = 4
"""Grid times for each sample at most: a few in quick succession do not make the whole flight dense."""


def regular_grid(time: FloatArray, rate: float, least_rate: float) -> FloatArray:
    """Return evenly spaced times from the first sample to the last.

    Evenly spaced samples keep their times; others get two times for each usual step.

    Parameters
    ----------
    time : (n,) array
        Increasing times of the samples, from 0 [s].
    rate
        Rate of the grid; 0 for one that suits the samples [Hz].
    least_rate
        The grid is at least as dense as this, by a whole multiple of the samples' own rate [Hz].

    Raises
    ------
    MissionError
        If the grid would have more than `MAX_SAMPLES`.
    """
    steps = np.diff(time)
    usual, span = float(np.median(steps)), float(time[-1])
    if rate:
        step = 1 / rate
    elif _is_even(time, usual):
        step = span / max(round(span / usual), 1)
        step /= max(np.ceil(least_rate * step - 1e-6), 1)
    else:
        rate_of_samples = min(_GRID_TIMES_PER_STEP / usual, _MAX_GRID_TIMES_PER_SAMPLE * len(time) / span)
        wanted = max(rate_of_samples, least_rate)
        decade = 10.0 ** np.floor(np.log10(wanted))
        step = (
            1 / (decade * _ROUND_RATES[_ROUND_RATES * decade >= wanted * _NEARLY][0])
            if wanted <= _ROUND_RATES[-1] * decade
            else 0.1 / decade
        )
    count = int(span / step + 1e-6)
    if count > MAX_SAMPLES:
        raise MissionError(
            f"{span:.6g} s at {1 / step:.4g} Hz are more than {MAX_SAMPLES} samples; accepted is a "
            "lower rate "
            "(setting rate), or a shorter flight"
        )
    grid = np.arange(count + 1) * step
    # Rounding must not carry the last point beyond the last sample.
    return np.minimum(grid, span) if count > 2 else np.linspace(0.0, span, 4)


def _is_even(time: FloatArray, step: float) -> bool:
    """Return whether samples are evenly spaced, some perhaps missing."""
    count = np.round(time / step)
    step = float(time[-1] / max(count[-1], 1))
    return bool(np.abs(time - step * np.round(time / step)).max() < _MAX_UNEVEN * step)
