"""Agreement: whether the mean NEES and NIS of many runs agree with their degrees of freedom.

The scatter of the runs themselves says how well their mean is known: a run is one draw, however many fixes it
has. The mean of positive squares is skewed, so its cube root is judged, which is close to normal, and what
skewness is left beyond that of χ² is taken into account.

References
----------
E. B. Wilson, M. M. Hilferty, *The distribution of chi-square*, Proc. Nat. Acad. Sci. 17 (1931); N. J.
Johnson, *Modified t tests and confidence intervals for asymmetrical populations*, J. American Statistical
Association 73 (1978).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import special

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import (
    Weighed,
    Wording,
    is_right,
    mean_square,
    size_weight,
    wrong_direction,
)
from lab.analysis.verdicts.finding_table import IN_QUARTER, TOGETHER, VALUES
from lab.analysis.verdicts.run_means import BETWEEN, NEES, NIS, Figure, RunMeans
from lab.base.arrays import FloatArray
from lab.base.numbers import format_number

FAR = 3.0
"""Deviation in its σ up to which the expansion in the skewness holds: at three, of 30 runs, the correction is
half a σ."""
NAMED = 3
"""Most figures that a finding shows; the others are their parts, or overlap them."""


class Agreement(NamedTuple):
    """How a figure of many runs agrees with a matched filter.

    Attributes
    ----------
    figure : Figure
        The figure.
    mean : float
        Its mean over the runs: 1 for a matched filter.
    low, high : float
        95 % interval of the mean by the scatter of the runs.
    chance : float
        Probability that a matched filter is off as far, to either side.
    limit : float
        Probability below which the runs disagree.
    """

    figure: Figure
    mean: float
    low: float
    high: float
    chance: float
    limit: float

    @property
    def holds(self) -> bool:
        """Whether chance explains the mean."""
        return self.chance >= self.limit

    def __str__(self) -> str:
        return f"{self.figure} {self.mean:.3g} × its degrees of freedom ({self.low:.3g} to {self.high:.3g})"


def agreements(means: RunMeans) -> list[Agreement]:
    """Return how each figure of two runs or more agrees; without those of which there is no scatter."""
    values = means.means.values
    runs = values.shape[0]
    if runs < 2:
        return []
    known = np.flatnonzero(np.isfinite(values).all(axis=0) & (np.ptp(np.nan_to_num(values), axis=0) > 0))
    quantities = {means.figures[at].quantity for at in known}
    first = Figure(NEES if NEES in quantities else NIS)
    found = []
    for at in known:
        mean, low, high, chance = _judge_mean(values[:, at])
        figure = means.figures[at]
        limit = limits.VERDICT.family_chance / 2 / (1 if figure == first else max(known.size - 1, 1))
        found.append(Agreement(figure, mean, low, high, chance, limit))
    return found


def _judge_mean(values: FloatArray) -> tuple[float, float, float, float]:
    """Return the mean of positive draws (runs,), its 95 % interval, and the probability if it should be 1."""
    runs, mean, sigma = values.size, float(values.mean()), float(values.std(ddof=1))
    # The variance of the cube root of a χ² variable, in units of its mean: 2/9 of one over its degrees.
    variance = (sigma / mean) ** 2 / (9 * runs)
    root = np.sqrt(variance)
    wide = -float(special.stdtrit(runs - 1, 0.025)) * root
    low, high = ((1 - variance + side * wide) ** 3 for side in (-1, 1))
    off = (np.cbrt(mean) - (1 - variance)) / root
    # Sums of slow and fast errors are more skewed than χ², so the scatter of the draws grows with their mean.
    thirds = float(np.mean((values - mean) ** 3)) / sigma**3
    skewness = thirds * runs**2 / ((runs - 1) * max(runs - 2, 1))
    off += max(skewness - 2 * sigma / mean, 0.0) * (2 * min(off**2, FAR**2) + 1) / (6 * np.sqrt(runs))
    return mean, mean / high, mean / low if low > 0 else np.inf, 2 * float(special.stdtr(runs - 1, -abs(off)))


class FigureWording(NamedTuple):
    """How a figure that is off is worded.

    Attributes
    ----------
    wording : Wording
        The row of the table of findings.
    small : Wording or None
        The row for errors or innovations that are too small; None if it is the same.
    between : tuple of str
        Quantity and words for the errors of the position between the fixes.
    """

    wording: Wording
    small: Wording | None = None
    between: tuple[str, str] = (BETWEEN, VALUES[BETWEEN])


class _Off(NamedTuple):
    """A figure that does not agree, the gain in likelihood if its variance is set right, and the evidence."""

    figure: Figure
    ratio: float
    weight: float
    evidence: str


def judge_agreement(means: RunMeans, worded: FigureWording) -> list[Weighed]:
    """Judge the size of errors and innovations, for which no cause was found.

    A figure is off if the runs disagree by their own scatter. It is off too, also of a single run, if all
    runs together are beyond `doubt` of `limits` as squares of which so many are independent, by a factor that
    matters.

    Parameters
    ----------
    means
        The means of the runs.
    worded
        How it is worded.
    """
    by_scatter = {one.figure: one for one in agreements(means)}
    off: dict[str, list[_Off]] = {}
    for at, figure in enumerate(means.figures):
        squares, agreement = means.together(at), by_scatter.get(figure)
        if not squares.number:
            continue
        ratio, doubt = max(float(squares.mean), 1e-12), limits.VERDICT.doubt
        if figure != Figure(figure.quantity):
            doubt /= len(means.figures)
        weight = size_weight(float(squares.total), float(squares.number))
        if not is_right(float(squares.total), float(squares.number), doubt):
            evidence = mean_square(squares, f"{_what(figure, worded)} (by {_name(figure, worded)})", doubt)
        elif agreement is not None and not agreement.holds:
            evidence = f"mean {agreement}, by the scatter of {means.runs} runs"
        else:
            continue
        off.setdefault(figure.quantity, []).append(_Off(figure, ratio, weight, evidence))
    return [_weighed(found, worded) for found in off.values()]


def _weighed(off: list[_Off], worded: FigureWording) -> Weighed:
    """Return the finding on a quantity of which some figures are off."""
    first = max(off, key=lambda one: (one.figure == Figure(one.figure.quantity), one.weight))
    also = [one for one in sorted(off, key=lambda one: -one.weight) if one is not first][: NAMED - 1]
    evidence, more = [one.evidence for one in (first, *also)], len(off) - 1 - len(also)
    factor = max(first.ratio, 1 / first.ratio)
    wording = worded.wording if first.ratio > 1 or worded.small is None else worded.small
    finding = wording.finding(
        factor,
        "; ".join((*evidence, f"and {more} more") if more else evidence),
        quantity=_name(first.figure, worded),
        direction=wrong_direction(1 / first.ratio),
        values=_values(first.figure, worded),
        size=format_number(np.sqrt(first.ratio), 2 if factor > limits.VERDICT.wrong_factor else 3),
    )
    return Weighed(first.weight, finding)


def _name(figure: Figure, worded: FigureWording) -> str:
    return worded.between[0] if figure.quantity == BETWEEN else figure.quantity


def _values(figure: Figure, worded: FigureWording) -> str:
    """Return what a sentence calls the values of a figure."""
    values = _what(figure, worded)
    if figure.quarter:
        return IN_QUARTER.format(values=values, quarter=figure.quarter)
    # Each may fit its own σ: what does not fit may be their correlations in P.
    return values if figure.group else TOGETHER.format(values=values)


def _what(figure: Figure, worded: FigureWording) -> str:
    if figure.quantity == BETWEEN:
        return worded.between[1]
    return VALUES[f"{figure.quantity} of a group" if figure.group else figure.quantity].format(
        group=figure.group
    )
