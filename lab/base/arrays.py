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
