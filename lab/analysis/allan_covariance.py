"""Allan covariance: how estimates of the Allan variance at several averaging times vary together.

The estimate at a cluster of m samples is the mean square of z(k) = θ(k + 2m) − 2 θ(k + m) + θ(k), θ being the
integral of the rate. The z of two clusters m and m' have at lag t the covariance

    c(t) = Σ_p Σ_q a_p a_q G(t + p m − q m'),    a = (1, −2, 1),

with the generalised covariance G of θ: −N² |t| / 2 of white noise, B² t² ln|t| / (2π) of bias instability and
K² |t|³ / 12 of a random walk. What is not in G is a polynomial that the differences take away. Of Gaussian
noise, the products of two mean squares vary with 2 c².

References
----------
C. A. Greenhall, *The Generalized Autocovariance: A Tool for Clock Noise Statistics*, TMO Progress Report
42-137, Jet Propulsion Laboratory (1999).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

TERMS = 3
"""White noise, bias instability, random walk: each of unit coefficient."""

_CLOSE = 12
"""Lags, in the shorter cluster, that are all taken on both sides of an end of the longer one."""
_STEPS = 4
"""Lags in each shorter cluster, where there are more than that."""
_SPREAD = 1.15
"""Ratio of one lag to the next beyond."""
_FAR = 30.0
"""Distance, in clusters, from which on the fourth difference of G is its fourth derivative."""


@lru_cache(maxsize=4)
def covariance(samples: int, lengths: tuple[int, ...]) -> FloatArray:
    """Return the covariance of the Allan variances, in the unit of a rate² per sample interval.

    Parameters
    ----------
    samples
        Number of samples of the record.
    lengths
        Numbers k of samples averaged over.

    Returns
    -------
    (3, 3, k, k) array
        W: with the squares s of N, B and K for an interval of one, the covariance is Σ_ab s_a s_b W_ab.
    """
    count = len(lengths)
    W = np.zeros((TERMS, TERMS, count, count))
    for i in range(count):
        for j in range(i + 1):
            W[:, :, i, j] = W[:, :, j, i] = _pair(samples, lengths[j], lengths[i])
    return W


def _pair(samples: int, short: int, long: int) -> FloatArray:
    """Return W (3, 3) of two clusters."""
    # Lag t = k − l of the k-th difference of the short cluster and the l-th of the long one.
    first, last = -(samples - 2 * long), samples - 2 * short
    lags, weights = _lags(first, last, short, long)
    # How many pairs (k, l) have the lag, of so many differences each.
    kmax, lmax = samples - 2 * short + 1, samples - 2 * long + 1
    pairs = np.minimum(kmax, lmax + lags) - np.maximum(0, lags)
    c = _cross_covariance(lags.astype(np.float64), float(short), float(long))
    scale = 2.0 * kmax * lmax * float(short) ** 2 * float(long) ** 2
    return np.asarray((c * (weights * pairs)) @ c.T / scale, dtype=np.float64)


def _lags(first: int, last: int, short: int, long: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Return lags from the first to the last and how many lags each stands for: dense where c(t) bends."""
    step = max(1, short // _STEPS)
    close = step * np.arange(_CLOSE * _STEPS + 1)
    beyond = max(1, _CLOSE * short)
    octaves = np.log(max(2.0, (last - first) / beyond)) / np.log(_SPREAD)
    away = np.append(close, np.round(beyond * _SPREAD ** np.arange(1, octaves + 1)).astype(np.int64))
    bends = long * np.arange(3)[:, None] - short * np.arange(3)
    around = (bends.ravel()[:, None, None] + np.stack((away, -away))).ravel()
    lags = np.unique(np.concatenate((around[(around > first) & (around < last)], (first, last))))
    weights = np.ones(lags.size)
    gaps = np.diff(lags).astype(np.float64)
    if lags.size > 1:
        # The trapezoid rule; of neighbouring lags each counts once, the ends too.
        weights[:] = (np.append(gaps, 1.0) + np.append(1.0, gaps)) / 2
    return lags, weights


def _cross_covariance(lags: FloatArray, short: float, long: float) -> FloatArray:
    """Return c (3, n) of two clusters for each term."""
    a = (1.0, -2.0, 1.0)
    c = np.zeros((TERMS, lags.size))
    for p in range(3):
        for q in range(3):
            t = np.abs(lags + p * short - q * long)
            logarithm = np.log(np.maximum(t, 1.0))
            c += a[p] * a[q] * np.stack((-t / 2, t**2 * logarithm / (2 * np.pi), t**3 / 12))
    # White noise and the increments of a walk have no part in what does not overlap.
    middle = np.abs(lags + short - long)
    c[[0, 2]] *= middle < short + long
    # There the difference of large numbers would be all rounding.
    far = middle > _FAR * (short + long)
    c[1, far] = -2 * (short * long) ** 2 / (2 * np.pi * middle[far] ** 2)
    return c
