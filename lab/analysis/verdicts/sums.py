"""Sums: figures of one run that add up over runs, or are kept one run after the other."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple, Self

import numpy as np

from lab.base.arrays import FloatArray


class Squares(NamedTuple):
    """Sums of squares of values that should have unit variance, and their numbers of independent values."""

    total: FloatArray
    number: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Mean squares: one if the assumption holds."""
        return np.divide(self.total, self.number, out=np.ones_like(self.total), where=self.number > 0)


class Fit(NamedTuple):
    """Normal equations of least squares on p causes (…, p, p), (…, p), and the squares (…)."""

    matrix: FloatArray
    vector: FloatArray
    squares: FloatArray


class Kept(NamedTuple):
    """Arrays whose first dimension is the run; those of many runs are concatenated."""

    values: FloatArray


@dataclass(frozen=True)
class Sum:
    """Figures that add up over runs."""

    def __add__(self, other: Self) -> Self:
        return type(self)(*(_add(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)))


def _add(one: object, other: object) -> object:
    if one is None or other is None:
        return None
    if isinstance(one, Kept) and isinstance(other, Kept):
        return Kept(np.concatenate((one.values, other.values)))
    for kind in (Squares, Fit):
        if isinstance(one, kind) and isinstance(other, kind):
            return kind(*(a + b for a, b in zip(one, other, strict=True)))
    return one + other  # type: ignore[operator]


def normal_equations(causes: FloatArray, values: FloatArray) -> Fit:
    """Return the normal equations of white values (…, m, c) on causes (…, m, c, p)."""
    rows = causes.reshape(*causes.shape[:-3], -1, causes.shape[-1])
    across, white = np.swapaxes(rows, -1, -2), values.reshape(*values.shape[:-2], -1, 1)
    return Fit(across @ rows, (across @ white)[..., 0], np.array(np.sum(white**2, axis=(-2, -1))))


def pseudoinverse(matrix: FloatArray, least: float = 1e-15) -> FloatArray:
    """Return the pseudoinverses of symmetric matrices (…, p, p).

    Eigenvalues whose size is at most the fraction `least` of the largest one count as zero. NumPy's own takes
    three times as long for small matrices: it sorts singular values, and gives each vector a sign.
    """
    values, along = np.linalg.eigh(matrix)
    size = np.abs(values)
    kept = size > least * size.max(axis=-1, keepdims=True, initial=0.0)
    weight = np.divide(1, values, out=np.zeros_like(values), where=kept)
    return np.asarray((along * weight[..., None, :]) @ np.swapaxes(along, -1, -2))
