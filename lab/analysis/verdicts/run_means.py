"""Run means: NEES and NIS of a run over their degrees of freedom, for its whole flight and each quarter.

The errors at neighbouring fixes depend on each other, so a mean over a flight stands for few independent
values. The means of many runs are independent draws: `agreement` judges them by their own scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.verdicts.sums import Kept, Squares, Sum
from lab.base.arrays import FloatArray
from lab.navigation.filters.error_models import ACCEL_BIAS, ACCEL_SCALE, ATT, GYRO_BIAS, GYRO_SCALE, POS, VEL

NEES, BETWEEN, NIS = "NEES", "NEES between fixes", "NIS"
QUARTERS = ("first", "second", "third", "last")
"""Quarters of a flight."""
ALL = ""
"""Group of all states, or of all components of a fix."""
BLOCKS = {
    "position": POS,
    "velocity": VEL,
    "attitude": ATT,
    "gyro bias": GYRO_BIAS,
    "accelerometer bias": ACCEL_BIAS,
    "gyro scale": GYRO_SCALE,
    "accelerometer scale": ACCEL_SCALE,
}
"""Groups of states."""
FURTHER = "further states"
"""Group of all states beyond those of the inertial sensors."""


class Figure(NamedTuple):
    """What a mean is taken of.

    Attributes
    ----------
    quantity : str
        `NEES`, `BETWEEN` or `NIS`.
    group : str
        Group of states, or kind of innovation; empty for all together.
    quarter : str
        One of `QUARTERS`; empty for the whole flight.
    """

    quantity: str
    group: str = ALL
    quarter: str = ""

    def __str__(self) -> str:
        where = f" in the {self.quarter} quarter of the flight" if self.quarter else ""
        return f"{self.quantity}{f' of the {self.group}' if self.group else ''}{where}"


@dataclass(frozen=True)
class RunMeans(Sum):
    """Means of normalised squares, each over its degrees of freedom: 1 for a matched filter.

    Attributes
    ----------
    figures : tuple of Figure
        What each column is the mean of.
    means : (runs, figures) array
        The means; NaN for one without a fix or a variance.
    independent : (runs, figures) array
        Numbers of independent squares that each stands for.
    """

    figures: tuple[Figure, ...]
    means: Kept
    independent: Kept

    def __add__(self, other: RunMeans) -> RunMeans:
        """Return the means of the runs of both, which have the same figures."""
        return type(self)(
            self.figures,
            Kept(np.concatenate((self.means.values, other.means.values))),
            Kept(np.concatenate((self.independent.values, other.independent.values))),
        )

    def beside(self, other: RunMeans) -> RunMeans:
        """Return the figures of both, of the same runs."""
        return type(self)(
            self.figures + other.figures,
            Kept(np.concatenate((self.means.values, other.means.values), axis=1)),
            Kept(np.concatenate((self.independent.values, other.independent.values), axis=1)),
        )

    @property
    def runs(self) -> int:
        """Number of runs."""
        return int(self.means.values.shape[0])

    def mean_of(self, quantity: str) -> float:
        """Return the mean over the runs of a quantity, of all states and the whole flight."""
        return float(np.nanmean(self.means.values[:, self.figures.index(Figure(quantity))]))

    def together(self, figure: int) -> Squares:
        """Return the squares of a figure, of all runs together, as independent ones."""
        mean, number = self.means.values[:, figure], self.independent.values[:, figure]
        known = np.isfinite(mean)
        return Squares(np.array(mean[known] @ number[known]), np.array(number[known].sum()))


class Series(NamedTuple):
    """Normalised squares of a run, or of some runs, at m times.

    Attributes
    ----------
    figure : Figure
        What they are, for the whole flight.
    time : (m,) array
        Times [s].
    squares : (m,) or (runs, m) array
        Normalised squares.
    degrees : (m,) array
        Degrees of freedom of each.
    apart : float
        Time between two independent ones [s]; zero if each is.
    quartered : bool
        Whether each quarter has a figure of its own.
    """

    figure: Figure
    time: FloatArray
    squares: FloatArray
    degrees: FloatArray
    apart: float
    quartered: bool = True


def run_means(series: Sequence[Series], span: tuple[float, float]) -> RunMeans:
    """Return the means of a run, or of each of some runs.

    Parameters
    ----------
    series
        Its normalised squares.
    span
        Start and end of the flight [s].
    """
    figures, means, independent = list[Figure](), list[FloatArray](), list[float]()
    length, quarters = max(span[1] - span[0], 1e-9), len(QUARTERS)
    for one in series:
        at = np.clip((one.time - span[0]) / length * quarters, 0, quarters - 1).astype(int)
        count, degrees = (np.bincount(at, values, quarters) for values in (None, one.degrees))
        squares = binned_sums(at, np.atleast_2d(one.squares), quarters)
        parts = [("", count.sum(), squares.sum(axis=1), degrees.sum(), length)]
        if one.quartered:
            lasting = length / quarters
            parts += [(*each, lasting) for each in zip(QUARTERS, count, squares.T, degrees, strict=True)]
        for name, number, total, freedom, lasting in parts:
            figures.append(one.figure._replace(quarter=name))
            free = float(freedom)
            means.append(total / free if free else np.full(total.shape, np.nan))
            most = max(1.0, lasting / one.apart) if one.apart else np.inf
            independent.append(min(free, most * free / max(int(number), 1)))
    found = np.stack(means, axis=1)
    return RunMeans(tuple(figures), Kept(found), Kept(np.tile(independent, (len(found), 1))))


def binned_sums(at: NDArray[np.intp], values: FloatArray, bins: int) -> FloatArray:
    """Return the sums (runs, bins) of values (runs, m) that belong to bins (m,)."""
    runs = len(values)
    places = (at + bins * np.arange(runs)[:, None]).ravel()
    return np.asarray(np.bincount(places, np.ravel(values), bins * runs).reshape(runs, bins), np.float64)
