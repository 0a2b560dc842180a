"""Aid verdict: whether the noise of measurements other than GPS fixes is as the filter assumes.

References
----------
Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, ch. 5.4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.advice_table import ADVICE
from lab.analysis.verdicts.finding import Weighed, judge_size
from lab.analysis.verdicts.finding_table import FINDINGS
from lab.analysis.verdicts.sums import Squares
from lab.base.arrays import FloatArray
from lab.navigation.aids import DOWNWARD, NAMES, RIGHTWARD, SENSORS
from lab.navigation.filters.kalman import gate as largest_nis
from lab.navigation.solution import Solution

_EVEN = 1 / 3
"""Mean square of values that are spread evenly between -1 and 1."""
_SIGMAS = 1e-6, 20.0
"""Factors on σ between which that of accepted innovations lies, `gate_filled` of `limits` considered."""


def aid_squares(solution: Solution, kinds: NDArray[np.int64], gate: float = 0.0) -> Squares:
    """Return the squared innovations of each kind of measurement, and their numbers.

    With a gate, only accepted measurements count: a slip or an outlier that was rejected says nothing about
    the noise. Their squares are scaled to those of the Gaussian that the gate has cut off at both ends.

    Parameters
    ----------
    solution
        The solution of the filter.
    kinds : (a,) array
        Kinds of the measurements that it was given.
    gate
        Fraction of the good measurements that pass the gate; 0 without a gate.
    """
    squares = solution.aid_innovation**2 / solution.aid_variance
    known = np.isfinite(squares)
    total, number = np.zeros(len(NAMES)), np.zeros(len(NAMES))
    for kind in np.unique(kinds[known]):
        mine = squares[known & (kinds == kind)]
        if gate:
            mine = _undo_gate(mine, largest_nis(gate, 1))
        total[kind], number[kind] = mine.sum(), mine.size
    return Squares(total, number)


def _undo_gate(squares: FloatArray, limit: float) -> FloatArray:
    """Return the accepted squares, scaled to the mean square of the Gaussian of which a gate has passed them.

    Where the noise is so large that they fill the gate evenly, all squares are returned.

    Parameters
    ----------
    squares : (k,) array
        Normalised squares of all innovations.
    limit
        Largest accepted one.
    """
    from scipy.optimize import brentq  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    accepted = squares[squares <= limit]
    if accepted.size == 0 or accepted.mean() >= limits.VERDICT.gate_filled * _EVEN * limit:
        return squares
    mean, end = float(accepted.mean()), np.sqrt(limit)
    if mean <= _SIGMAS[0] ** 2:
        return accepted
    sigma = brentq(lambda sigma: sigma**2 * _variance_within(end / sigma) - mean, *_SIGMAS)
    return accepted * (sigma**2 / mean)


def _variance_within(end: float) -> float:
    """Return the variance of a normal variable that is known to lie between -end and end."""
    density = np.exp(-(end**2) / 2) / np.sqrt(2 * np.pi)
    return float(1 - 2 * end * density / erf(end / np.sqrt(2)))


def judge_aids(squares: Squares) -> list[Weighed]:
    """Judge the assumed noise of each kind of measurement by the size of its innovations.

    A condition, such as zero velocity at rest, may hold better than assumed: only its violation is reported.
    """
    found: list[Weighed] = []
    for kind, name in enumerate(NAMES):
        total, number = squares.total[kind], squares.number[kind]
        if kind not in SENSORS and total <= number:
            continue
        row = "raise the slip" if kind in (RIGHTWARD, DOWNWARD) else "raise the speed at rest"
        row = "set their noise" if kind in SENSORS else row
        found += judge_size(
            Squares(total, number),
            FINDINGS["noise of a measurement"].with_advice(ADVICE[row]),
            f"innovations of the {name}",
            aid=name,
            setting=SENSORS.get(kind, ""),
        )
    return found
