"""Consistency: NEES, NIS and the whiteness of the innovations, as tests of the filter's covariance.

References
----------
Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, ch. 5.4.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import special

from lab.base.arrays import FloatArray

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
    used = uncertain(covariances)
    # One part even without an epoch.
    parts = [slice(first, first + AT_ONCE) for first in range(0, max(vectors.shape[0], 1), AT_ONCE)]

    def squares(inverted: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
        found = []
        for part in parts:
            P, v = covariances[part][:, used[:, None], used], vectors[part][:, used]
            # Scaled to unit diagonal, because mixing metres and rad/s gives a bad condition number.
            sigma = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
            P /= sigma[:, :, None] * sigma[:, None, :]
            found.append(inverted(v / sigma, P))
        return np.concatenate(found)

    try:
        return squares(_by_root)
    except np.linalg.LinAlgError:
        return squares(_by_pseudoinverse)


def _by_root(v: FloatArray, P: FloatArray) -> FloatArray:
    """Return vᵀ P⁻¹ v of each epoch; raise `LinAlgError` if a P is singular."""
    root = np.linalg.cholesky(P)
    if (np.diagonal(root, axis1=1, axis2=2) < SINGULAR).any():
        raise np.linalg.LinAlgError
    # Forward substitution in all epochs at once; `np.linalg.solve` does not know that a root is triangular.
    columns, white = root.T.copy(), v.T.copy()
    for k in range(white.shape[0]):
        white[k] /= columns[k, k]
        white[k + 1 :] -= columns[k, k + 1 :] * white[k]
    return np.asarray(np.einsum("im,im->m", white, white))


def _by_pseudoinverse(v: FloatArray, P: FloatArray) -> FloatArray:
    inverse = np.linalg.pinv(P, rcond=SINGULAR**2, hermitian=True)
    return np.asarray(np.einsum("mi,mij,mj->m", v, inverse, v))


def uncertain(covariances: FloatArray) -> NDArray[np.intp]:
    """Return the indices of the states that have a variance at every epoch, given covariances (m, n, n)."""
    return np.flatnonzero((np.diagonal(covariances, axis1=1, axis2=2) > 0).all(axis=0))


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


def whiteness_band(count: int, probability: float = 0.95) -> float:
    """Return the half-width of the 95 % band of the autocorrelation of `count` white values (5.4.2-16).

    The mean of as many values of unit variance has the same band (5.4.2-13).
    """
    return float(special.ndtri(0.5 + probability / 2) / np.sqrt(count)) if count else 0.0
