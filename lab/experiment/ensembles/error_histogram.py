"""Error histogram: how the errors of many runs in their σ are distributed, in bounded memory.

Percentiles need all values, or a histogram. The bins are narrow near zero and grow with the error, and the
flight is cut into parts, so that neither more runs nor a longer flight take more memory. Whole numbers add up
to the same histogram in any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray

PARTS = 256
"""Number of parts of a flight; with fixes once a second, those of four minutes have one each."""
STEPS = 16
"""Bins per unit of arsinh of an error in its σ: their width is 0.06 σ below one σ, and 6 % of an error far
above it."""
LARGEST = 1000.0
"""Error in the last bin [σ], with all that is larger: only a diverged filter gets there."""

_HALF = int(np.ceil(STEPS * np.arcsinh(LARGEST)))  # bins of errors of one sign
_BINS = 2 * _HALF + 1  # the one in the middle is that of zero


@dataclass(eq=False)
class ErrorHistogram:
    """Histogram of errors in their σ, in parts of a flight.

    Attributes
    ----------
    edges : (PARTS + 1,) array
        Times at which the parts begin, and the end [s].
    counts : (PARTS, channels, bins) array
        Number of errors in each part and bin.
    """

    edges: FloatArray
    counts: NDArray[np.int32]

    @classmethod
    def over(cls, start: float, end: float, channels: int) -> Self:
        """Return an empty histogram of some channels over a flight [s]."""
        return cls(np.linspace(start, end, PARTS + 1), np.zeros((PARTS, channels, _BINS), dtype=np.int32))

    def add(self, time: FloatArray, normalised: FloatArray) -> None:
        """Add errors in their σ (m, channels) at some times (m,) [s]; NaN is omitted."""
        part = np.clip(np.searchsorted(self.edges, time, side="right") - 1, 0, PARTS - 1)
        with np.errstate(over="ignore"):
            steps = np.clip(np.rint(STEPS * np.arcsinh(normalised)), -_HALF, _HALF)
        channels = normalised.shape[1]
        row = (part * channels)[:, None] + np.arange(channels)
        place = row * float(_BINS) + (steps + _HALF)
        # A number of another type takes twenty times as long.
        np.add.at(self.counts.reshape(-1), place[~np.isnan(steps)].astype(np.intp), np.int32(1))

    def percentiles(self, percent: Sequence[float]) -> FloatArray:
        """Return percentiles (percent, parts, channels) in σ, interpolated within a bin; NaN without errors.

        Parameters
        ----------
        percent
            Each from 0 to 100.
        """
        below = np.cumsum(self.counts, axis=-1, dtype=np.float64)
        found = np.full((len(percent), *below.shape[:2]), np.nan)
        for index, wanted in enumerate(percent):
            target = wanted / 100 * below[..., -1:]
            last = np.argmax(below >= np.maximum(target, 0.5), axis=-1)[..., None]
            here = np.take_along_axis(self.counts, last, axis=-1)
            before = np.take_along_axis(below, last, axis=-1) - here
            inside = np.divide(target - before, here, out=np.zeros(target.shape), where=here > 0)
            value = np.sinh((last - _HALF - 0.5 + np.clip(inside, 0, 1)) / STEPS)
            found[index] = np.where(below[..., -1:] > 0, value, np.nan)[..., 0]
        return found

    def copy(self) -> Self:
        """Return the histogram so far, which further errors do not change."""
        return type(self)(self.edges, self.counts.copy())
