"""Foreign evidence: sizes, correlations and biases of the innovations of a filter that is not ours.

Neither its model nor its gains are known, only innovations and their σ. So each figure is one of a single
measurement: the mean square of its normalised innovations, 1 for a matched filter; their correlation from one
to the next, 0; and their mean, 0. Real innovations depend on each other, so that each figure counts as many
independent values as their autocorrelation leaves.

References
----------
Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, ch. 5.4.

R. K. Mehra, *On the Identification of Variances and Adaptive Kalman Filtering*, IEEE Trans. Automatic Control
15 (1970): what a wrong Q and a wrong R do to the autocorrelation of the innovations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lab.analysis.consistency import autocorrelation, chi_square_interval
from lab.analysis.verdicts import limits
from lab.analysis.verdicts.innovation_evidence import LAGS
from lab.analysis.verdicts.outliers import NEIGHBOURS, outliers
from lab.analysis.verdicts.pattern import Stretch, bin_squares, stretch, stretch_times
from lab.analysis.verdicts.sums import Kept
from lab.base.arrays import Flags, FloatArray
from lab.data.log.filter_log import Innovations

SETTLED = NEIGHBOURS // 2
"""Innovations at the start that are not judged: the filter is still recovering from its start."""
FEWEST = 30
"""Fewest innovations of a measurement that are judged. A mean square of as many independent values lies
between 0.4 and 2 with the probability that a verdict asks for."""
AXES = 3
"""Most components of a measurement."""
LARGEST = 1e6
"""Size beyond which all values are equally far off [σ]: damaged bytes hold any number."""
LONGEST_MEMORY = 100
"""Largest lag at which innovations are taken to depend on each other."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """The figures of the innovations of one measurement.

    Attributes
    ----------
    innovations : Innovations
        Those that are judged.
    mean_square : float
        Of the normalised innovations.
    independent : float
        How many independent squares it stands for.
    interval : (float, float)
        What a matched filter gives for it.
    lagged : (LAGS,) array
        Correlation with the innovations one or more rows later, mean over the axes; NaN if unknown.
    values : float
        Number of innovations, of all axes, whose σ is known.
    bias : (k,) array
        Mean of the normalised innovations of each axis; NaN if unknown.
    bias_sigma : (k,) array
        σ of these means.
    apart : Stretch or None
        A stretch that is too large while the rest is not.
    offered : Innovations
        The same with single outliers, which the filter may have rejected.
    """

    innovations: Innovations
    mean_square: float
    independent: float
    interval: tuple[float, float]
    lagged: FloatArray
    values: float
    bias: FloatArray
    bias_sigma: FloatArray
    apart: Stretch | None
    offered: Innovations

    @property
    def count(self) -> int:
        """Number of innovations."""
        return len(self.innovations.time)

    @property
    def rejected(self) -> Flags:
        """Which of those offered the filter's own test rejected."""
        return np.asarray(self.offered.ratio > 1)

    @property
    def worst(self) -> float:
        """Largest test ratio of the filter; NaN without one."""
        ratio = self.offered.ratio
        return float(np.nanmax(ratio)) if np.isfinite(ratio).any() else float("nan")

    @property
    def follows(self) -> float:
        """Correlation from one innovation to the next few, in its σ; 0 if unknown."""
        return lag_correlation(self.lagged, self.values)

    @property
    def apart_times(self) -> tuple[float, float]:
        """Start and end of the stretch [s]."""
        assert self.apart is not None
        time = self.innovations.time
        return stretch_times(self.apart, Kept(np.array([[time[0], time[-1]]])))

    @property
    def is_judged(self) -> bool:
        """Whether there are enough innovations with a known size."""
        return self.count >= FEWEST and bool(np.isfinite(self.mean_square))


def lag_correlation(lagged: FloatArray, values: float) -> float:
    """Return the sum of the correlations over the lags in its σ for white innovations; 0 if unknown."""
    total = float(np.nansum(lagged))
    return total * float(np.sqrt(values / LAGS)) if np.isfinite(lagged).all() else 0.0


def measure_innovations(one: Innovations) -> Measurement:
    """Return the figures of the innovations of one measurement."""
    judged = _take_rows(one, slice(SETTLED, None)) if len(one.time) > FEWEST + SETTLED else one
    offered = judged
    size = np.sqrt(judged.square) if np.isfinite(judged.square).all() else np.zeros(len(judged.time))
    judged = _take_rows(judged, ~find_isolated(np.column_stack((np.nan_to_num(judged.normalised), size))))
    count, axes = judged.values.shape
    fine = np.isfinite(judged.normalised).all(axis=1)
    values = judged.normalised[fine]
    known = bool(len(values) >= FEWEST and values.any())
    nothing = np.full(axes, np.nan)
    rho = autocorrelation(values, LONGEST_MEMORY) if known else np.zeros((0, axes))
    centred = autocorrelation(values - values.mean(axis=0), LONGEST_MEMORY) if known else rho
    mean_square = (
        float(np.mean(judged.square)) if np.isfinite(judged.square).all() and count else float("nan")
    )
    independent = count * axes / memory(rho**2, len(values))
    interval = (float("nan"), float("nan"))
    if independent:
        low, high = chi_square_interval(round(independent, 1), 1, 1 - limits.VERDICT.doubt)
        interval = low / independent, high / independent
    return Measurement(
        judged,
        mean_square,
        independent,
        interval,
        np.asarray(rho[1 : LAGS + 1].mean(axis=1)) if known else np.full(LAGS, np.nan),
        float(values.size) if known else 0.0,
        values.mean(axis=0) if known else nothing,
        np.sqrt(np.var(values, axis=0) * memory(centred, len(values)) / len(values)) if known else nothing,
        _find_odd_stretch(judged) if known else None,
        offered,
    )


def find_isolated(values: FloatArray) -> Flags:
    """Return which values (n, k), of up to four columns, are single ones far off those around them.

    Multipath makes them, and damaged bytes of a log. A large part of the values is none: see `outliers`.
    """
    padded = np.zeros((len(values), 2 * AXES))
    padded[:, : values.shape[1]] = np.clip(values, -LARGEST, LARGEST)
    found = outliers(padded)
    return found if found.mean() <= limits.VERDICT.outlying_fixes else np.zeros(len(values), dtype=bool)


def _take_rows(one: Innovations, rows: slice | Flags) -> Innovations:
    kept = {name: getattr(one, name)[rows] for name in ("time", "values", "normalised", "square", "ratio")}
    return replace(one, **kept)


def memory(correlations: FloatArray, count: int) -> float:
    """Return how many values count as one, from the correlations of what is averaged.

    Parameters
    ----------
    correlations : (lags + 1, k) array
        Autocorrelation of the averaged quantity: of a mean of squares, the squared one of the values.
    count
        Number of values.

    The sum ends where the correlations are those of chance: noise of a hundred lags would drown it.
    """
    if correlations.shape[0] < 2:
        return 1.0
    mean = correlations[1:].mean(axis=1)
    chance = np.flatnonzero(np.abs(mean) < 1 / np.sqrt(max(count, 1)))
    end = int(chance[0]) if chance.size else len(mean)
    return max(1.0, float(1 + 2 * np.sum(mean[:end])))


def _find_odd_stretch(one: Innovations) -> Stretch | None:
    """Return the stretch in which the innovations are too large while the others are not."""
    values = np.full((len(one.time), 6), np.nan)
    values[:, : one.values.shape[1]] = one.normalised[:, :3]
    span = float(one.time[0]), float(one.time[-1])
    return stretch(bin_squares(values, one.time, span), 0, alone=True)
