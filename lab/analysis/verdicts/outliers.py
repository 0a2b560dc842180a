"""Outliers: fixes whose errors or innovations are not Gaussian, for any σ."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.analysis.consistency import chi_square_interval
from lab.analysis.verdicts import limits
from lab.base.arrays import FloatArray, of_kernel
from lab.navigation.kernels.compilation import entry_kernel

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


def _apart(errors: FloatArray) -> NDArray[np.bool_]:
    """Return which errors (m,) stand out from those around them."""
    count = errors.shape[0]
    if count <= NEIGHBOURS:
        return np.zeros(count, dtype=np.bool_)
    half = NEIGHBOURS // 2
    apart = errors - _middle(errors, 0, NEIGHBOURS)
    squares = np.sum(apart.reshape(count, 2, 3) ** 2, axis=2)
    if not (squares > largest_square()).any():
        return np.zeros(count, dtype=np.bool_)
    usual = np.maximum(_middle(squares, 0, half), _middle(squares, half, half))
    usual = np.maximum(usual, np.median(squares, axis=0))
    return np.asarray((squares > largest_square() * np.maximum(usual / MEDIAN, 1.0)).any(axis=1))


def _middle(values: FloatArray, first: int, count: int) -> FloatArray:
    """Return the medians (m, c) of some of the neighbours of each of m values (m, c)."""
    middle = np.empty(values.shape)
    _write_middle(of_kernel(values), first, count, NEIGHBOURS, middle)
    return middle


@entry_kernel
def _write_middle(values: FloatArray, first: int, count: int, neighbours: int, middle: FloatArray) -> None:
    ordered = np.empty(count)
    for k in range(values.shape[0]):
        start = min(max(k - neighbours // 2, 0), values.shape[0] - neighbours - 1) + first
        for c in range(values.shape[1]):
            for i in range(count):
                row = start + i
                value, at = values[row + (row >= k), c], i
                while at > 0 and ordered[at - 1] > value:
                    ordered[at] = ordered[at - 1]
                    at -= 1
                ordered[at] = value
            middle[k, c] = 0.5 * (ordered[(count - 1) // 2] + ordered[count // 2])
