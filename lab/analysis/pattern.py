"""Pattern: whether everything is inconsistent, a stretch of time, a channel, or single fixes.

That is asked before any cause is looked for: an R that is wrong for one channel or for half a minute is
another fault than one that is wrong altogether.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.analysis.finding import DOUBT, MATTERS, RATIO, is_right
from lab.analysis.sums import Kept, Squares

FloatArray = NDArray[np.float64]

BINS = 40
"""Parts of a flight that are looked at one by one."""
AXES = ("north", "east", "down")
FEWEST = 30
"""Values from which on a stretch is one, and not a single fix or two."""
CAPPED = 16.3
"""Sum of three squares of unit variance that one in 1,000 exceeds."""
FEW = 1e-12
"""Least mean square whose logarithm is taken: no innovations are as small."""


class Stretch(NamedTuple):
    """A stretch of time, as bins from `first` up to `last`, that last one not included.

    Attributes
    ----------
    squares : Squares
        Of what lies inside.
    gain : float
        By how much a variance of its own raises the logarithm of the likelihood.
    """

    first: int
    last: int
    squares: Squares
    gain: float


def binned(values: FloatArray, times: FloatArray, span: tuple[float, float]) -> Squares:
    """Return the squares (2, 2, BINS) of position and velocity in each part of a flight.

    Last of all those in which no single fix counts for more than `CAPPED`, since one makes no stretch.

    Parameters
    ----------
    values : (m, 6) array
        What should be of unit variance; NaN counts for nothing.
    times : (m,) array
        Its times [s].
    span
        Begin and end of the flight [s].
    """
    length = max(span[1] - span[0], 1e-9)
    at = np.clip(((times - span[0]) / length * BINS).astype(np.int64), 0, BINS - 1)
    total, number = np.zeros((2, 2, BINS)), np.zeros((2, 2, BINS))
    known = np.isfinite(values)
    squares = np.where(known, values, 0.0) ** 2
    for kind in range(2):
        own = slice(3 * kind, 3 * kind + 3)
        sums = squares[:, own].sum(axis=1)
        total[0, kind] = np.bincount(at, sums, BINS)
        total[1, kind] = np.bincount(at, np.minimum(sums, CAPPED), BINS)
        number[:, kind] = np.bincount(at, known[:, own].sum(axis=1), BINS)
    return Squares(total, number)


def _likelihood(total: FloatArray, number: FloatArray) -> FloatArray:
    """Return the logarithm of the likelihood of squares whose variance is fitted."""
    mean = np.divide(total, number, out=np.ones_like(total), where=number > 0)
    return np.asarray(-0.5 * number * (np.log(np.maximum(mean, FEW)) + 1))


def stretch(squares: Squares, kind: int) -> Stretch | None:
    """Return the stretch that is too large where all else is right, or None.

    Parameters
    ----------
    squares
        As of `binned`.
    kind
        0 for position, 1 for velocity.
    """
    total = np.append(0.0, np.cumsum(squares.total[1, kind]))
    number = np.append(0.0, np.cumsum(squares.number[1, kind]))
    inside, count = total - total[:, None], number - number[:, None]
    outside, others = total[-1] - inside, number[-1] - count
    valid = (count >= FEWEST) & (others > 0) & (np.arange(BINS + 1) > np.arange(BINS + 1)[:, None])
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
    # 800 stretches are tried, which costs ln 800.
    if best < RATIO + np.log(BINS**2 / 2) or size < MATTERS or not is_right(*rest):
        return None
    return Stretch(
        int(first),
        int(last),
        Squares(np.array(squares.total[0, kind, first:last].sum()), np.array(count[first, last])),
        best,
    )


def stretch_words(found: Stretch, span: Kept) -> str:
    """Return from when to when a stretch lasts, in words; `span` holds begin and end of each run [s]."""
    begin, end = span.values.mean(axis=0)
    edges = begin + (end - begin) * np.array((found.first, found.last)) / BINS
    return f"from {edges[0]:.0f} s to {edges[1]:.0f} s"


def channel(squares: Squares) -> int | None:
    """Return the one of three channels (3,) that is wrong where the other two are right, else None."""
    wrong = [
        axis
        for axis in range(3)
        if squares.number[axis]
        and not is_right(float(squares.total[axis]), float(squares.number[axis]), DOUBT / 6)
    ]
    return wrong[0] if len(wrong) == 1 and np.count_nonzero(squares.number) > 1 else None
