"""Likely factor: by how much a variance of the filter is wrong, from the likelihood at some factors.

Between the factors, the log-likelihood is interpolated by what it is of Gaussian values: of n values whose
variance has the factor eˣ, −n/2 (x + s e⁻ˣ), where s is their mean square. Values that contain other noise
too depend less on the factor: further terms are its root and a polynomial in x.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray

AROUND = 6
"""Number of factors for each interpolation, and of its terms. On Montréal and the drive of a car, with steps
of half a decade, the most likely R and Q are then right to 4 % of their σ; with four terms, to 18 %."""
STEP = 0.002
"""Step of the logarithm at which the interpolation is evaluated: a fifth of a percent."""
LOSS = 1.920729
"""Loss of log-likelihood at the ends of a 95 % interval: half of χ² with one degree of freedom."""


class LikelyFactor(NamedTuple):
    """The most likely factor on a variance.

    Attributes
    ----------
    factor : float
        The most likely factor.
    low, high : float
        Its 95 % interval; 0 or infinite where it reaches beyond the factors that were tried.
    gain : float
        Log-likelihood with this factor, minus that without.
    """

    factor: float
    low: float
    high: float
    gain: float


def likely_factor(factors: FloatArray, gains: FloatArray) -> LikelyFactor:
    """Return the most likely factor.

    Parameters
    ----------
    factors : (k,) array
        Factors that were tried, 1 among them.
    gains : (k,) array
        Log-likelihood with each, minus that without; factors with one that is not finite are left out.
    """
    known = np.isfinite(gains)
    order = np.argsort(factors[known])
    x, y = np.log(factors[known][order]), gains[known][order]
    fine = np.linspace(x[0], x[-1], 1 + int(np.ceil((x[-1] - x[0]) / STEP)))
    value = _interpolation(fine.tobytes(), x.tobytes()) @ y
    best = int(np.argmax(value))
    fallen = value < value[best] - LOSS
    before, after = np.flatnonzero(fallen[:best]), np.flatnonzero(fallen[best:])
    return LikelyFactor(
        float(np.exp(fine[best])),
        float(np.exp(fine[before[-1]])) if before.size else 0.0,
        float(np.exp(fine[best + after[0]])) if after.size else np.inf,
        float(value[best]),
    )


@functools.lru_cache(maxsize=16)
def _interpolation(to: bytes, of: bytes) -> FloatArray:
    """Return the weights (m, k) for the log-likelihood at some logarithms (m,) of that at others (k,).

    Those of the `AROUND` nearest are not zero. The same factors are tried in each run.
    """
    at, x = np.frombuffer(to), np.frombuffer(of)
    between = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    terms = min(AROUND, x.size)
    weights = np.zeros((at.size, x.size))
    for index in range(x.size - 1):
        own = between == index
        first = int(np.clip(index + 1 - terms // 2, 0, x.size - terms))
        near = slice(first, first + terms)
        known, wanted = (_terms(some - x[index], terms) for some in (x[near], at[own]))
        weights[own, near] = np.linalg.solve(known.T, wanted.T).T
    return weights


def _terms(x: FloatArray, count: int) -> FloatArray:
    """Return the first terms (k, count) of the interpolation at some logarithms (k,)."""
    return np.stack([x**0, x, np.exp(-x), np.exp(-x / 2), x**2, x**3][:count], axis=-1)
