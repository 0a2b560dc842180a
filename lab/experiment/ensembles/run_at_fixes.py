"""Run at fixes: what an ensemble takes from one run, at the fixes and for the whole flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.feedforward import FreeRun
from lab.analysis.verdicts.evidence import Evidence
from lab.analysis.verdicts.innovation_evidence import Innovations, sizes
from lab.analysis.verdicts.sums import Squares, Sum
from lab.base.arrays import FloatArray


@dataclass(frozen=True)
class ChannelSums(Sum):
    """Sums over the innovations in their σ of each channel; see `Innovations`.

    Attributes
    ----------
    squares : Squares
        Squares of each channel (6,).
    sums : (6,) array
        Sums of each channel.
    lagged : (lags, 6) array
        Sums of products with later innovations.
    """

    squares: Squares
    sums: FloatArray
    lagged: FloatArray

    @classmethod
    def of(cls, innovations: Innovations) -> ChannelSums:
        """Return the sums in the evidence of a run."""
        return cls(innovations.squares, innovations.sums, innovations.lagged)

    @classmethod
    def of_used(cls, innovation: FloatArray, covariance: FloatArray) -> ChannelSums:
        """Return the sums of innovations (m, 6) of used fixes with covariances (m, 6, 6); NaN is unknown."""
        known = np.isfinite(innovation)
        sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        squares, sums, lagged = sizes(np.nan_to_num(innovation) / sigma)
        return cls(Squares(squares.total, known.sum(axis=0).astype(np.float64)), sums, lagged)


WITHOUT_ENDS = np.full((2, 9), np.nan, dtype=np.float32)
"""What `rms_at_ends` returns of a flight without outages."""


def most_of(horizontal: FloatArray) -> float:
    """Return the 95 % quantile of a horizontal error (n,); NaN if it is unknown."""
    known = horizontal[np.isfinite(horizontal)]
    return float(np.quantile(known, 0.95)) if known.size else float("nan")


def rms_at_ends(error: FloatArray, sigma: FloatArray) -> NDArray[Any]:
    """Return the root mean square (2, 9) of errors (k, 9), and of σ of the filter; NaN if unknown.

    It is in single precision, because it is kept of each of many runs.
    """
    both = np.stack((error, sigma))
    known = np.isfinite(both)
    count, square = known.sum(axis=1), np.sum(both**2, axis=1, where=known)
    mean = np.divide(square, count, out=np.full(count.shape, np.nan), where=count > 0)
    return np.asarray(np.sqrt(mean), dtype=np.float32)


class RunAtFixes(NamedTuple):
    """The values of one run: at the m fixes that it used, at k times between them, and for the whole run.

    Attributes
    ----------
    time, nees, nis : (m,) arrays
        Times of the fixes [s], NEES and NIS.
    grid, between : (k,) arrays
        Times between the fixes [s], and NEES of the position there.
    between_degrees, degrees, nis_degrees : int
        Degrees of freedom of `between`, `nees` and `nis`.
    error, sigma : (m, 9) arrays
        Errors after the fixes, and their σ, in the order of `ensemble.QUANTITIES` and in `ensemble.UNITS`.
    rms, largest : (9,) arrays
        Root mean square and largest size of the errors along the flight.
    most : float
        95 % quantile of the horizontal error along the flight [m]; NaN if unknown.
    at_outage_ends : (2, 9) array
        Root mean square of the errors, and of their σ, over the ends of the GPS outages; NaN if unknown, or
        without an outage.
    innovations : ChannelSums
        Sums of the innovations.
    span : tuple of float
        Start and end of the flight [s].
    evidence : Evidence or None
        Evidence of the run; None for one that is not judged.
    free : FreeRun
        How far its navigator runs free.
    seconds : float
        Computing time of the navigator [s].
    algorithm : str
        Name of the user's own navigator; empty for those of the lab.
    """

    time: FloatArray
    nees: FloatArray
    nis: FloatArray
    grid: FloatArray
    between: FloatArray
    between_degrees: int
    error: FloatArray
    sigma: FloatArray
    rms: FloatArray
    largest: FloatArray
    most: float
    at_outage_ends: NDArray[Any]
    degrees: int
    nis_degrees: int
    innovations: ChannelSums
    span: tuple[float, float]
    evidence: Evidence | None
    free: FreeRun
    seconds: float
    algorithm: str
