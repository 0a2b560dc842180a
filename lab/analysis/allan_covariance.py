"""Allan covariance: the covariance of estimates of the Allan variance at several averaging times.

The estimate at a cluster of m samples is the mean square of z(k) = θ(k + 2m) − 2 θ(k + m) + θ(k), θ being the
integral of the rate. The z of two clusters m and m' have at lag t the covariance

    c(t) = Σ_p Σ_q a_p a_q G(t + p m − q m'),    a = (1, −2, 1),

with the generalised covariance G of θ: Q² where t = 0 of quantisation noise, −N² |t| / 2 of white noise, B²
t² ln|t| / (2π) of bias instability and K² |t|³ / 12 of a random walk. G is defined up to a polynomial that
the differences remove. For Gaussian noise, two mean squares have the covariance 2 c². A ramp R of the rate is
not random: it gives z(k) the mean R m², which adds 4 c R² m² m'² to the covariance.

References
----------
C. A. Greenhall, *The Generalized Autocovariance: A Tool for Clock Noise Statistics*, TMO Progress Report
42-137, Jet Propulsion Laboratory (1999).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray

LETTERS = "QNBKR"
"""Quantisation noise, white noise, bias instability, random walk and ramp: each of unit coefficient."""

_RANDOM = 4
"""Number of random terms: all but the ramp."""

_CLOSE = 12
"""Lags, in units of the shorter cluster, on both sides of an end of the longer one that are all evaluated."""
_STEPS = 4
"""Lags evaluated in each shorter cluster, if it has more."""
_SPREAD = 1.15
"""Ratio of successive lags beyond."""
_FAR = 30.0
"""Distance, in clusters, above which the fourth derivative of G replaces its fourth difference."""


@lru_cache(maxsize=4)
def covariance(samples: int, lengths: tuple[int, ...]) -> FloatArray:
    """Return the covariance of the Allan variances, in the unit of a rate² per sample interval.

    Parameters
    ----------
    samples
        Number of samples of the record.
    lengths
        Averaging lengths k in samples.

    Returns
    -------
    (5, 5, k, k) array
        W: with the squares s of the coefficients in the order of `LETTERS`, for an interval of one, the
        covariance is Σ_ab s_a s_b W_ab.
    """
    count = len(lengths)
    W = np.zeros((len(LETTERS), len(LETTERS), count, count))
    for i in range(count):
        for j in range(i + 1):
            W[:, :, i, j] = W[:, :, j, i] = _pair(samples, lengths[j], lengths[i])
    return W


def _pair(samples: int, short: int, long: int) -> FloatArray:
    """Return W (5, 5) of two clusters."""
    # Lag t = k − l of the k-th difference of the short cluster and the l-th of the long one.
    first, last = -(samples - 2 * long), samples - 2 * short
    # Number of pairs (k, l) with the lag.
    kmax, lmax = samples - 2 * short + 1, samples - 2 * long + 1

    def pairs(lags: NDArray[np.int64]) -> FloatArray:
        return np.asarray(np.minimum(kmax, lmax + lags) - np.maximum(0, lags), dtype=np.float64)

    lags, weights = _lags(first, last, short, long)
    c = _cross_covariance(lags.astype(np.float64), float(short), float(long))
    weighted = c * (weights * pairs(lags))
    W = np.zeros((len(LETTERS), len(LETTERS)))
    W[1:_RANDOM, 1:_RANDOM] = 2 * weighted @ c.T
    ramp = 2.0 * float(short) ** 2 * float(long) ** 2 * weighted.sum(axis=1)
    # Quantisation noise contributes at single lags only, which a sum over strides of lags must not miss.
    met, quantum = _meetings(first, last, short, long)
    at_met = np.vstack((quantum, _cross_covariance(met.astype(np.float64), float(short), float(long))))
    W[0, :_RANDOM] = W[:_RANDOM, 0] = 2 * at_met @ (quantum * pairs(met))
    ramp = np.append(2.0 * float(short) ** 2 * float(long) ** 2 * (quantum @ pairs(met)), ramp)
    W[:_RANDOM, _RANDOM] = W[_RANDOM, :_RANDOM] = ramp
    return W / (4.0 * kmax * lmax * float(short) ** 2 * float(long) ** 2)


def _meetings(first: int, last: int, short: int, long: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Return the lags at which samples of two clusters coincide, and c of quantisation noise there."""
    lags = (long * np.arange(3) - short * np.arange(3)[:, None]).ravel()
    products = np.outer((1.0, -2.0, 1.0), (1.0, -2.0, 1.0)).ravel()
    met, places = np.unique(lags, return_inverse=True)
    c = np.bincount(places, weights=products)
    inside = (met >= first) & (met <= last)
    return met[inside], c[inside]


def _lags(first: int, last: int, short: int, long: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Return lags from the first to the last, and how many lags each represents: dense where c(t) bends."""
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
        # The trapezoid rule; neighbouring lags count once each, including the ends.
        weights[:] = (np.append(gaps, 1.0) + np.append(1.0, gaps)) / 2
    return lags, weights


def _cross_covariance(lags: FloatArray, short: float, long: float) -> FloatArray:
    """Return c (3, n) of two clusters for white noise, bias instability and random walk."""
    a = (1.0, -2.0, 1.0)
    c = np.zeros((3, lags.size))
    for p in range(3):
        for q in range(3):
            t = np.abs(lags + p * short - q * long)
            logarithm = np.log(np.maximum(t, 1.0))
            c += a[p] * a[q] * np.stack((-t / 2, t**2 * logarithm / (2 * np.pi), t**3 / 12))
    # White noise and the increments of a walk do not contribute without overlap.
    middle = np.abs(lags + short - long)
    c[[0, 2]] *= middle < short + long
    # There, the difference of large numbers would consist of rounding errors.
    far = middle > _FAR * (short + long)
    c[1, far] = -2 * (short * long) ** 2 / (2 * np.pi * middle[far] ** 2)
    return c
