"""Outliers: fixes whose errors or innovations are not Gaussian, for any σ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.analysis.consistency import chi_square_interval
from lab.analysis.verdicts import limits
from lab.base.arrays import FloatArray

NEIGHBOURS = 10
"""Number of neighbouring fixes with which each fix is compared."""
MEDIAN = chi_square_interval(3, 1, 0.0)[0]
"""Median of the squares of three components."""


def largest_square() -> float:
    """Return the square of three components that outliers exceed."""
    return chi_square_interval(3, 1, 1 - 2 * limits.VERDICT.outlier_chance)[1]


def outliers(errors: FloatArray, settled: int = 0) -> NDArray[np.bool_]:
    """Return which errors (m,) stand out from those around them.

    Each is compared with the median of its neighbours, which removes slow changes (correlated errors, a
    latency). Its square is compared with the medians of the squares, local and overall. An R that is too
    small makes all errors large, and a bad constellation those of its time; neither makes outliers. If more
    than one error in five is an outlier, not all are found.

    Parameters
    ----------
    errors : (m, 6) array
        Errors of position and velocity, each divided by its assumed σ.
    settled
        Index of the first error that can be an outlier; before it, the filter is still recovering from its
        start.
    """
    found = np.zeros(errors.shape[0], dtype=np.bool_)
    while True:
        # Repeated among the remaining ones, because many outliers hide each other at first.
        left = np.flatnonzero(~found)
        new = left[_apart(errors[left]) & (left >= settled)]
        if not new.size:
            return found
        found[new] = True


def _middle(values: FloatArray) -> FloatArray:
    """Return the medians (…) of values (…, n): of few values each, sorting them is fastest."""
    ordered, n = np.sort(values, axis=-1), values.shape[-1]
    return np.asarray(0.5 * (ordered[..., (n - 1) // 2] + ordered[..., n // 2]))


def _apart(errors: FloatArray) -> NDArray[np.bool_]:
    """Return which errors (m,) stand out from those around them."""
    count = errors.shape[0]
    if count <= NEIGHBOURS:
        return np.zeros(count, dtype=np.bool_)
    half = NEIGHBOURS // 2
    first = np.clip(np.arange(count) - half, 0, count - NEIGHBOURS - 1)
    around = first[:, None] + np.arange(NEIGHBOURS)
    around += around >= np.arange(count)[:, None]
    apart = errors - _middle(errors.T[:, around]).T
    squares = np.sum(apart.reshape(count, 2, 3) ** 2, axis=2)
    usual = _middle(squares.T)
    for side in (around[:, :half], around[:, half:]):
        usual = np.maximum(usual, _middle(squares.T[:, side]).T)
    return np.asarray((squares > largest_square() * np.maximum(usual / MEDIAN, 1.0)).any(axis=1))
