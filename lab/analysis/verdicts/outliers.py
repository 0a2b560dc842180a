"""Outliers: fixes whose errors or innovations are not Gaussian, for any σ."""

from __future__ import annotations

import numpy as np

from lab.analysis.consistency import chi_square_interval
from lab.analysis.verdicts import limits
from lab.base.arrays import Flags, FloatArray, of_kernel
from lab.navigation.kernels.compilation import entry_kernel

NEIGHBOURS = 10
"""Number of neighbouring fixes with which each fix is compared."""
MEDIAN = chi_square_interval(3, 1, 0.0)[0]
"""Median of the squares of three components."""


def largest_square() -> float:
    """Return the square of three components that outliers exceed."""
    return chi_square_interval(3, 1, 1 - 2 * limits.VERDICT.outlier_chance)[1]


def outliers(errors: FloatArray, settled: int = 0) -> Flags:
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
        new = left[_find_apart(errors[left]) & (left >= settled)]
        if not new.size:
            return found
        found[new] = True


def stands_out(errors: FloatArray, settled: int = 0) -> Flags:
    """Return whether `outliers` finds any in the errors of each run, (runs, m, 6)."""
    return np.asarray(_find_apart(errors)[..., settled:].any(axis=-1))


def _find_apart(errors: FloatArray) -> Flags:
    """Return which errors (…, m) stand out from those around them."""
    count = errors.shape[-2]
    none = np.zeros(errors.shape[:-1], dtype=np.bool_)
    if count <= NEIGHBOURS:
        return none
    half = NEIGHBOURS // 2
    apart = errors - _neighbour_medians(errors, 0, NEIGHBOURS)
    squares = np.sum(apart.reshape(*errors.shape[:-1], 2, 3) ** 2, axis=-1)
    if not (squares > largest_square()).any():
        return none
    usual = np.maximum(_neighbour_medians(squares, 0, half), _neighbour_medians(squares, half, half))
    usual = np.maximum(usual, np.median(squares, axis=-2, keepdims=True))
    return np.asarray((squares > largest_square() * np.maximum(usual / MEDIAN, 1.0)).any(axis=-1))


def _neighbour_medians(values: FloatArray, first: int, count: int) -> FloatArray:
    """Return the medians (…, m, c) of some of the neighbours of each of m values (…, m, c)."""
    m = values.shape[-2]
    columns = np.moveaxis(values, -2, 0)
    middle, room = np.empty(columns.shape), np.empty((count, columns.size // m))
    _write_middle(of_kernel(columns).reshape(m, -1), first, NEIGHBOURS, middle.reshape(m, -1), room)
    return np.moveaxis(middle, 0, -2)


@entry_kernel
def _write_middle(
    values: FloatArray, first: int, neighbours: int, middle: FloatArray, room: FloatArray
) -> None:
    """Write the medians of neighbours of values (m, columns), with `room` for these, (count, columns).

    Neighbours change places until they are in order, in all columns at once and without a branch.
    """
    count, columns = room.shape
    for k in range(values.shape[0]):
        start = min(max(k - neighbours // 2, 0), values.shape[0] - neighbours - 1) + first
        for i in range(count):
            row = start + i + (start + i >= k)
            for c in range(columns):
                room[i, c] = values[row, c]
        for turn in range(count):
            for i in range(turn % 2, count - 1, 2):
                for c in range(columns):
                    low, high = room[i, c], room[i + 1, c]
                    room[i, c], room[i + 1, c] = min(low, high), max(low, high)
        for c in range(columns):
            middle[k, c] = 0.5 * (room[(count - 1) // 2, c] + room[count // 2, c])
