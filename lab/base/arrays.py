"""Arrays: the types of NumPy arrays that signatures name, and what is done with series everywhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""Numbers, as all computations use them."""
IntArray = NDArray[np.int64]
"""Whole numbers, such as row numbers."""
ComplexArray = NDArray[np.complex128]
"""Complex numbers, such as spectra and attitudes about the vertical."""
Flags = NDArray[np.bool_]
"""Truth values, such as masks of rows."""


def of_kernel(values: FloatArray) -> FloatArray:
    """Return numbers as a compiled function takes them, float64 and row by row; a copy if they are not.

    Each other kind of array, also one that is only to be read, would be compiled for by itself.
    """
    return np.require(values, np.float64, ["C", "W"])


def interpolate_columns(
    at: FloatArray, time: FloatArray, values: FloatArray, outside: float | None = None
) -> FloatArray:
    """Return vectors (n, k) of some times (n,) at other ones (m,), linear in between, as (m, k).

    Parameters
    ----------
    at, time
        Wanted times, and those of the vectors, which increase.
    values
        The vectors.
    outside
        What stands before the first and after the last of them; by default these themselves.
    """
    return np.stack([np.interp(at, time, column, outside, outside) for column in values.T], axis=-1)


def running_sums(values: FloatArray) -> FloatArray:
    """Return the sums (n + 1, …) of values (n, …) until each, from that of none on."""
    sums = np.zeros((len(values) + 1, *values.shape[1:]))
    np.cumsum(values, axis=0, out=sums[1:])
    return sums
