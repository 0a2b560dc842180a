"""Selection: the causes that explain the observations, the best first, one after the other.

Each cause has one or more regressors. Causes resemble each other, so all are compared by the likelihood that
each reaches alone. A second cause is reported only for observations that the first does not explain (forward
selection).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.sums import Fit, pseudoinverse
from lab.base.arrays import FloatArray


class Explained(NamedTuple):
    """A selected cause.

    Attributes
    ----------
    name : str
        Name of the cause.
    gain : float
        Gain in log-likelihood beyond the causes selected before it.
    estimate, sigma : (b, k) arrays
        Size of each of its regressors in each record, and its standard deviation, with all selected causes
        fitted together.
    """

    name: str
    gain: float
    estimate: FloatArray
    sigma: FloatArray


def likelihood_gain(fit: Fit, columns: Sequence[int]) -> float:
    """Return the gain in log-likelihood of white values with several regressors together."""
    return (
        float(0.5 * np.sum(_part(fit, columns)[0] * fit.vector[:, np.asarray(columns, dtype=np.intp)]))
        if len(columns)
        else 0.0
    )


def estimates(fit: Fit, columns: Sequence[int]) -> FloatArray:
    """Return the sizes (b, k) of regressors fitted together."""
    return _part(fit, columns)[0]


def select_causes(fit: Fit, causes: Mapping[str, Sequence[int]], least: float) -> list[Explained]:
    """Return the causes that explain white values, the best first.

    Parameters
    ----------
    fit
        Normal equations of b records of values of unit variance on p regressors, (b, p, p) and (b, p); each
        record has its own estimates.
    causes
        The regressors of each cause.
    least
        Smallest logarithm of the likelihood ratio, minus the price, at which a cause is selected.
    """
    chosen: list[str] = []
    gains: list[float] = []
    columns: list[int] = []
    price = _price_causes(fit, causes)
    while len(chosen) < len(causes):
        worth = {
            name: likelihood_gain(fit, [*columns, *own]) - sum(gains)
            for name, own in causes.items()
            if name not in chosen
        }
        best = max(worth, key=lambda name: worth[name] - price[name])
        if worth[best] - price[best] < least:
            break
        chosen.append(best)
        gains.append(worth[best])
        columns += causes[best]
    if not chosen:
        return []
    estimate, sigma = _part(fit, columns)
    ends = np.cumsum([len(causes[name]) for name in chosen])[:-1]
    parts = zip(chosen, gains, np.split(estimate, ends, axis=1), np.split(sigma, ends, axis=1), strict=True)
    return [Explained(*part) for part in parts]


def rivals(
    fit: Fit, causes: Mapping[str, Sequence[int]], chosen: Explained, least: float
) -> dict[str, FloatArray]:
    """Return the causes that may be there instead of the only chosen one, with their sizes (b, k).

    `select_causes` would choose them, too, and the likelihood ratio at which one explanation is preferred to
    another
    is not reached between the chosen one and them.
    """
    price = _price_causes(fit, causes)
    least = max(least, chosen.gain - price[chosen.name] - limits.VERDICT.likelihood_ratio)
    return {
        name: estimates(fit, own)
        for name, own in causes.items()
        if name != chosen.name and likelihood_gain(fit, own) - price[name] >= least
    }


def _price_causes(fit: Fit, causes: Mapping[str, Sequence[int]]) -> dict[str, float]:
    """Return the prices of the regressors of each cause that are present."""
    present = np.diagonal(fit.matrix, axis1=1, axis2=2) > 0
    return {name: limits.VERDICT.price * float(present[:, list(own)].sum()) for name, own in causes.items()}


def _part(fit: Fit, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return estimates and their σ (b, k) with some of the regressors.

    The regressors have different units or are nearly equal, so the normal equations are scaled to a unit
    diagonal.
    """
    at = np.asarray(columns, dtype=np.intp)
    matrix = fit.matrix[:, at[:, None], at]
    scale = np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
    scale = np.divide(1, scale, out=np.zeros_like(scale), where=scale > 0)
    inverse = scale[:, :, None] * scale[:, None, :]
    if at.size > 1:
        inverse *= pseudoinverse(matrix * inverse, 1e-9)
    sigma = np.sqrt(np.maximum(np.diagonal(inverse, axis1=1, axis2=2), 0))
    return np.einsum("bij,bj->bi", inverse, fit.vector[:, at]), sigma
