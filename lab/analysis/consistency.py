"""Consistency: NEES, NIS and the whiteness of the innovations, as tests of the filter's covariance.

References
----------
Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, ch. 5.4.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import special

from lab.base.arrays import FloatArray, of_kernel
from lab.navigation.kernels.compilation import entry_kernel

if TYPE_CHECKING:
    import pandas as pd


AT_ONCE = 1024
"""Epochs whose covariances are inverted together, with some 20 kB each at 21 states."""
MAX_LAG = 30
"""Largest lag of the innovations' autocorrelation."""
SINGULAR = 1e-6
"""A state counts as a combination of the others if its remaining σ is below this fraction."""


def normalised_squares(vectors: FloatArray, covariances: FloatArray) -> FloatArray:
    """Return vᵀ P⁻¹ v of each epoch (m,): NEES of errors, NIS of innovations (5.4.2-2, 5.4.2-11).

    States without variance, such as a certain bias, are omitted from the sum. So are combinations of states
    without variance, as a singular P0 may have.

    Parameters
    ----------
    vectors : (m, n) array
        Errors or innovations.
    covariances : (m, n, n) array
        Their covariances according to the filter; if one is unknown (NaN), the sum of its epoch is NaN.
    """
    if vectors.shape[0] == 0:
        return np.zeros(0)
    if not np.isfinite(covariances).all():
        return np.full(vectors.shape[0], np.nan)
    used = find_uncertain_states(covariances)
    if used.size < vectors.shape[1]:
        vectors, covariances = vectors[:, used], covariances[:, used[:, None], used]
    white = whitened(vectors[:, :, None], covariances, SINGULAR)
    return _by_pseudoinverse(vectors, covariances) if white is None else np.sum(white[:, :, 0] ** 2, axis=1)


def whitened(values: FloatArray, covariances: FloatArray, least: float = 0.0) -> FloatArray | None:
    """Return L⁻¹ v (m, n, k) of values with covariances L Lᵀ; None if one is not positive definite.

    Parameters
    ----------
    values : (m, n, k) array
        Of each epoch, k vectors.
    covariances : (m, n, n) array
        Their covariances.
    least
        Smallest σ that may remain of a component beside the others, in its own σ.
    """
    white = np.array(values, dtype=np.float64, order="C")
    return white if _whiten(white, of_kernel(covariances), least * least) else None


@entry_kernel
def _whiten(values: FloatArray, P: FloatArray, least: float) -> bool:
    """Divide values (m, n, k) by the roots of P (m, n, n); return whether all of these have one.

    Each P is scaled to unit diagonal, because mixing metres and rad/s gives a bad condition number.
    """
    n = P.shape[1]
    root, per, scale = np.empty((n, n)), np.empty(n), np.empty(n)
    for e in range(P.shape[0]):
        for i in range(n):
            # Not `<= 0`: NaN must be refused too.
            if not P[e, i, i] > 0:
                return False
            scale[i] = 1 / math.sqrt(P[e, i, i])
            # Cholesky of the correlations: what is left of 1 is what the states before do not explain.
            diagonal = 1.0
            for j in range(i):
                entry = P[e, i, j] * scale[i] * scale[j]
                for m in range(j):
                    entry -= root[i, m] * root[j, m]
                root[i, j] = entry * per[j]
                diagonal -= root[i, j] * root[i, j]
            if not diagonal > least:
                return False
            per[i] = 1 / math.sqrt(diagonal)
            for c in range(values.shape[2]):
                rest = values[e, i, c] * scale[i]
                for m in range(i):
                    rest -= root[i, m] * values[e, m, c]
                values[e, i, c] = rest * per[i]
    return True


def _by_pseudoinverse(vectors: FloatArray, covariances: FloatArray) -> FloatArray:
    """Return vᵀ P⁻¹ v of each epoch, some thousand epochs at a time."""
    found = []
    for first in range(0, len(vectors), AT_ONCE):
        v, P = vectors[first : first + AT_ONCE], covariances[first : first + AT_ONCE]
        sigma = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
        inverse = np.linalg.pinv(
            P / (sigma[:, :, None] * sigma[:, None, :]), rcond=SINGULAR**2, hermitian=True
        )
        found.append(np.einsum("mi,mij,mj->m", v / sigma, inverse, v / sigma))
    return np.concatenate(found)


def find_uncertain_states(covariances: FloatArray) -> NDArray[np.intp]:
    """Return the indices of the states that have a variance at every epoch, given covariances (m, n, n)."""
    return np.flatnonzero((np.diagonal(covariances, axis1=1, axis2=2) > 0).all(axis=0))


@functools.lru_cache(maxsize=1024)
def chi_square_interval(degrees: float, runs: int = 1, probability: float = 0.95) -> tuple[float, float]:
    """Return the two-sided interval of a χ² variable averaged over runs (5.4.2-5 to 5.4.2-9)."""
    tail = (1 - probability) / 2
    # Quantiles of χ² from the gamma distribution, because importing scipy.stats takes a quarter of a second.
    low, high = 2 * special.gammaincinv(degrees * runs / 2, [tail, 1 - tail]) / runs
    return float(low), float(high)


def ljung_box(correlations: FloatArray, count: float, runs: int = 1) -> tuple[FloatArray, FloatArray]:
    """Return the Ljung-Box Q of each channel, and the probability of a larger Q for white values.

    Q = n (n + 2) Σ r_k² / (n − k) is χ² with as many degrees of freedom as there are lags (G. M. Ljung, G. E.
    P. Box, *On a Measure of Lack of Fit in Time Series Models*, Biometrika 65 (1978), eq. 1.3).

    Parameters
    ----------
    correlations : (lags + 1, channels) array
        Autocorrelation for lags from 0 on, as from `autocorrelation`.
    count
        Number of values.
    runs
        Number of independent records of as many values each, if the correlations are of their sums.
    """
    lags = np.arange(1, correlations.shape[0])
    Q = runs * count * (count + 2) * np.sum(correlations[1:] ** 2 / (count - lags)[:, None], axis=0)
    return Q, special.chdtrc(lags.size, Q) if lags.size else np.ones_like(Q)


def whiteness_table(
    mean: FloatArray, variance: FloatArray, correlations: FloatArray, count: float, runs: int = 1
) -> pd.DataFrame:
    """Return a table of innovations in their σ, with a row for each channel.

    `mean ±`, `variance from` and `variance to` are the 95 % intervals of a matched filter; `Q` is the
    Ljung-Box statistic over `lags` lags, and `p white` the probability of a larger Q.

    Parameters
    ----------
    mean, variance : (6,) arrays
        Mean and variance of the innovations, position and velocity, east, north, up.
    correlations, count, runs
        As of `ljung_box`.
    """
    import pandas as pd  # noqa: PLC0415 - takes a while to import, and a run does without

    number = round(count * runs)
    if not number:  # without innovations, all is NaN
        mean = variance = np.full(mean.shape, np.nan)
    low, high = chi_square_interval(1, number) if number else (np.nan, np.nan)
    Q, white = ljung_box(correlations, count, runs) if number else (mean, mean)
    table = {
        "innovation": [
            f"{kind} {axis}" for kind in ("position", "velocity") for axis in ("east", "north", "up")
        ],
        "mean": mean,
        "mean ±": whiteness_band(number),
        "variance": variance,
        "variance from": low,
        "variance to": high,
        "Q": Q,
        "lags": max(correlations.shape[0] - 1, 0),
        "p white": white,
    }
    return pd.DataFrame(table)


def coverage(errors: FloatArray, sigma: FloatArray, factor: float = 3.0) -> FloatArray:
    """Return the fraction of the errors (m, channels) within ± `factor` σ, for each channel."""
    if not errors.shape[0]:
        return np.full(errors.shape[1], np.nan)
    return np.asarray(np.mean(np.abs(errors) <= factor * sigma, axis=0))


def autocorrelation(innovations: FloatArray, max_lag: int = MAX_LAG) -> FloatArray:
    """Return the normalised autocorrelation (lags + 1, channels) for lags from 0 on (5.4.2-15).

    Parameters
    ----------
    innovations : (m, channels) array
        Innovations, each divided by its σ.
    max_lag
        Largest lag; shorter records give fewer lags.
    """
    m = innovations.shape[0]
    lags = min(max_lag, m - 1)
    if lags < 0:
        return np.zeros((0, innovations.shape[1]))
    power = np.einsum("mc,mc->c", innovations, innovations)
    sums = np.stack(
        [np.einsum("mc,mc->c", innovations[lag:], innovations[: m - lag]) for lag in range(lags + 1)]
    )
    return np.asarray(np.divide(sums, power, out=np.zeros_like(sums), where=power > 0))


def whiteness_band(count: int) -> float:
    """Return the half-width of the 95 % band of the autocorrelation of `count` white values (5.4.2-16).

    The mean of as many values of unit variance has the same band (5.4.2-13).
    """
    return float(special.ndtri(0.975) / np.sqrt(count)) if count else 0.0
