"""Arrays: the types of NumPy arrays that signatures name."""

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
