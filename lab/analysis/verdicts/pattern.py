"""Pattern: whether all values are inconsistent, or a stretch of time, a channel, or single fixes.

The pattern is determined before the cause: an R that is wrong for one channel or for half a minute is a
different fault from an R that is wrong as a whole.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lab.analysis.verdicts import limits
from lab.analysis.verdicts.finding import is_right
from lab.analysis.verdicts.run_means import binned_sums
from lab.analysis.verdicts.sums import Kept, Squares
from lab.base.arrays import FloatArray, running_sums

BINS = 40
"""Number of parts of a flight that are tested separately."""
AXES = ("north", "east", "down")
CAPPED = 16.3
"""Sum of three squares with unit variance that one in 1,000 exceeds."""
FEW = 1e-12
"""Smallest mean square before its logarithm is taken; innovations are never as small."""


class Stretch(NamedTuple):
    """A stretch of time, from bin `first` to bin `last`, without the latter.

    Attributes
    ----------
    squares : Squares
        Squares inside the stretch.
    gain : float
        Gain in log-likelihood with a separate variance.
    """

    first: int
    last: int
    squares: Squares
    gain: float


def bin_squares(values: FloatArray, times: FloatArray, span: tuple[float, float]) -> Squares:
    """Return the squares (2, 2, BINS) of position and velocity in each part of a flight.

    The second set limits the square of each fix to `CAPPED`, since a single fix does not make a stretch.

    Parameters
    ----------
    values : (m, 6) or (runs, m, 6) array
        Values that should have unit variance; NaN has no effect. Those of runs give squares of each.
    times : (m,) array
        Times of the values [s].
    span
        Start and end of the flight [s].
    """
    length = max(span[1] - span[0], 1e-9)
    at = np.clip(((times - span[0]) / length * BINS).astype(np.int64), 0, BINS - 1)
    shape = (*values.shape[:-2], 2, 2, BINS)
    known = np.isfinite(values).reshape(math.prod(shape[:-3]), times.size, 2, 3)
    total, number = np.zeros((len(known), 2, 2, BINS)), np.zeros((len(known), 2, 2, BINS))
    squares = np.sum(np.where(known, values.reshape(known.shape), 0.0) ** 2, axis=-1)
    count = known.sum(axis=-1)
    for kind in range(2):
        total[:, 0, kind] = binned_sums(at, squares[..., kind], BINS)
        total[:, 1, kind] = binned_sums(at, np.minimum(squares[..., kind], CAPPED), BINS)
        number[:, :, kind] = binned_sums(at, count[..., kind], BINS)[:, None]
    return Squares(total.reshape(shape), number.reshape(shape))


def _likelihood(total: FloatArray, number: FloatArray) -> FloatArray:
    """Return the log-likelihood of squares with a fitted variance."""
    mean = np.divide(total, number, out=np.ones_like(total), where=number > 0)
    return np.asarray(-0.5 * number * (np.log(np.maximum(mean, FEW)) + 1))


def stretch(squares: Squares, kind: int, *, alone: bool = False) -> Stretch | None:
    """Return the stretch that is too large while the rest is right, or None.

    Parameters
    ----------
    squares
        As from `bin_squares`.
    kind
        0 for position, 1 for velocity.
    alone
        Whether the innovations are all that is known, as of a filter that is not ours: then the stretch may
        reach an end of the flight, and the rest may be smaller than it should be. Otherwise what lasts to an
        end is left to causes that can be tried, of which only some begin in flight.
    """
    total = running_sums(squares.total[1, kind])
    number = running_sums(squares.number[1, kind])
    inside, count = total - total[:, None], number - number[:, None]
    outside, others = total[-1] - inside, number[-1] - count
    valid = (
        (count >= limits.VERDICT.stretch_values)
        & (others > 0)
        & (np.arange(BINS + 1) > np.arange(BINS + 1)[:, None])
    )
    if alone:  # what lies outside a stretch at an end of the flight is one, too, and gains as much
        valid &= inside * others > outside * count
    gain = np.where(
        valid,
        _likelihood(np.where(valid, inside, 0), np.where(valid, count, 0))
        + _likelihood(np.where(valid, outside, 0), np.where(valid, others, 0))
        - _likelihood(total[-1:], number[-1:]),
        -np.inf,
    )
    first, last = np.unravel_index(int(np.argmax(gain)), gain.shape)
    best = float(gain[first, last])
    size = inside[first, last] / max(count[first, last], 1)
    rest = float(outside[first, last]), float(others[first, last])
    # 800 stretches are tested, so the price is ln 800.
    if (
        best < limits.VERDICT.likelihood_ratio + np.log(BINS**2 / 2)
        or size < limits.VERDICT.wrong_factor
        or not (is_right(*rest) or (alone and rest[0] < rest[1]))
    ):
        return None
    return Stretch(
        int(first),
        int(last),
        Squares(np.array(squares.total[0, kind, first:last].sum()), np.array(count[first, last])),
        best,
    )


def stretch_times(found: Stretch, span: Kept) -> tuple[float, float]:
    """Return start and end of a stretch [s]; `span` holds those of each run."""
    begin, end = span.values.mean(axis=0)
    first, last = begin + (end - begin) * np.array((found.first, found.last)) / BINS
    return float(first), float(last)


def channel(squares: Squares) -> int | None:
    """Return the one of three channels (3,) that is wrong while the other two are right, otherwise None."""
    wrong = [
        axis
        for axis in range(3)
        if squares.number[axis]
        and not is_right(float(squares.total[axis]), float(squares.number[axis]), limits.VERDICT.doubt / 6)
    ]
    return wrong[0] if len(wrong) == 1 and np.count_nonzero(squares.number) > 1 else None
