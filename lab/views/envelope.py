"""Envelope: long series thinned for the screen without losing a peak."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.floating]

BUCKETS = 600
"""Number of intervals to which a curve is thinned: about one for each pixel of a plot."""
SMALLEST_DRAWN = 1e-37
"""Numbers below this count as zero: plots use single precision, whose smallest normal number is 1.2e-38."""
CONSTANT = 1e-6
"""Relative extent below which a series counts as constant: single precision resolves 6e-8, so a plot would
show only its steps."""


def envelope(
    time: FloatArray, series: Sequence[FloatArray], window: tuple[float, float], buckets: int = BUCKETS
) -> tuple[FloatArray, list[FloatArray]]:
    """Thin series to the smallest and the largest value in each of `buckets` stretches of a time window.

    Parameters
    ----------
    time : (n,) array
        Times of the samples, increasing.
    series : sequence of (n,) arrays
        Series to thin; NaN marks a gap, which stays visible.
    window : (start, end)
        Visible time window; one sample beyond either end is kept, so that lines reach the edges.
    buckets : int
        Number of stretches.

    Returns
    -------
    time : (m,) array
        Times of the thinned samples, m <= 2 `buckets`, common to all series. If the window holds no more
        samples than that, all are kept.
    series : list of (m,) arrays
        Two values for each stretch: the smaller first where the series rises over the stretch.
    """
    first, last = _find_visible(time, window)
    if last - first <= 2 * buckets:
        return time[first:last], [values[first:last] for values in series]
    starts, ends = _stretches(first, last, buckets)
    return _thinned_time(time, starts, ends), [_extremes(values, starts, ends) for values in series]


def envelope_in_parts(
    time: FloatArray,
    read: Callable[[int, int], Sequence[FloatArray]],
    window: tuple[float, float],
    buckets: int,
    at_once: int,
) -> tuple[FloatArray, list[FloatArray]]:
    """Thin series as `envelope` does, that are never in memory as a whole.

    Parameters
    ----------
    time, window, buckets
        As of `envelope`.
    read : callable
        Returns the samples of all series from one number up to another, without the latter.
    at_once : int
        Largest number of samples that are read together, unless a stretch has more.
    """
    first, last = _find_visible(time, window)
    if last - first <= 2 * buckets:
        return time[first:last], list(read(first, last))
    starts, ends = _stretches(first, last, buckets)
    parts, begin = [], 0
    while begin < buckets:
        end = max(int(np.searchsorted(ends, starts[begin] + at_once, "right")), begin + 1)
        there = slice(begin, end)
        zero = int(starts[begin])
        values = read(zero, int(ends[end - 1]))
        parts.append([_extremes(one, starts[there] - zero, ends[there] - zero) for one in values])
        begin = end
    return _thinned_time(time, starts, ends), [np.concatenate(one) for one in zip(*parts, strict=True)]


def _find_visible(time: FloatArray, window: tuple[float, float]) -> tuple[int, int]:
    """Return the first sample of a window, and the one after the last, with one more at either end."""
    first = max(int(np.searchsorted(time, window[0], "left")) - 1, 0)
    return first, min(int(np.searchsorted(time, window[1], "right")) + 1, len(time))


def _stretches(first: int, last: int, buckets: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first sample of each stretch, and the one after its last."""
    edges = np.linspace(first, last, buckets + 1).astype(np.intp)
    return edges[:-1], edges[1:]


def _thinned_time(time: FloatArray, starts: NDArray[np.intp], ends: NDArray[np.intp]) -> FloatArray:
    """Return two times for each stretch: its start and its middle."""
    thinned = np.empty(2 * len(starts))
    thinned[0::2] = time[starts]
    thinned[1::2] = time[(starts + ends) // 2]
    return thinned


def _extremes(values: FloatArray, starts: NDArray[np.intp], ends: NDArray[np.intp]) -> FloatArray:
    part = np.ascontiguousarray(values[: ends[-1]])
    low, high = np.minimum.reduceat(part, starts), np.maximum.reduceat(part, starts)
    # The two values stand in the order in which the line is likely to pass them.
    rising = part[ends - 1] >= part[starts]
    out = np.empty(2 * len(starts))
    out[0::2] = np.where(rising, low, high)
    out[1::2] = np.where(rising, high, low)
    return out


def thin_path(points: FloatArray, count: int) -> NDArray[np.intp]:
    """Choose samples of a path so that its drawing keeps length and turns.

    Parameters
    ----------
    points : (n, d) array
        Positions along the path; rows that are not finite are never chosen.
    count : int
        Largest number of samples to keep.

    Returns
    -------
    indices : (m,) array of int
        Chosen rows, increasing, first and last included, m <= `count`.

    Notes
    -----
    Samples are spread evenly over the sum of relative arc length and relative turning.
    """
    valid = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(valid) <= count:
        return valid
    steps = np.diff(points[valid], axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / np.where(lengths > 0, lengths, 1)[:, None]
    turns = np.zeros_like(lengths)
    turns[1:] = np.linalg.norm(np.diff(directions, axis=0), axis=1)
    # At rest, the direction of a step is noise; the weight by its length removes it.
    turns *= lengths
    progress = np.concatenate([[0.0], np.cumsum(_share(lengths) + _share(turns))])
    chosen = np.searchsorted(progress, np.linspace(0, progress[-1], count))
    return valid[np.unique(np.clip(chosen, 0, len(valid) - 1))]


def _share(weights: FloatArray) -> FloatArray:
    total = weights.sum()
    return weights / total if total > 0 else np.full_like(weights, 1 / len(weights))


def nice_limit(value: float) -> float:
    """Round a positive number up to 1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6 or 8 times a power of ten.

    Such an axis limit stays constant while a curve moves a little. Numbers below `SMALLEST_DRAWN` count as
    zero, which gives 1.
    """
    if not np.isfinite(value) or value < SMALLEST_DRAWN:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    steps = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
    return float(power * next(step for step in steps if step * power >= value * (1 - 1e-12)))


def limits(series: Sequence[FloatArray], scale: str) -> tuple[float, float]:
    """Return axis limits that hold all finite values, on round numbers.

    A constant is shown in the middle of an axis of its own size, zero between -1 and 1. A logarithmic axis
    ignores zeros.

    Parameters
    ----------
    series : sequence of arrays
        All values drawn.
    scale : {"symmetric", "free", "logarithmic"}
        Zero in the middle; the range of the values; or, for positive values, limits 10^(k/4) with integer k.

    Returns
    -------
    low, high : float
        With high > low.
    """
    lows, highs = [], []
    for values in series:
        # Double precision, because single precision would round a small threshold to zero.
        finite = values[np.isfinite(values)].astype(np.float64)
        finite = finite[finite >= SMALLEST_DRAWN] if scale == "logarithmic" else finite
        if len(finite):
            lows.append(float(finite.min()))
            highs.append(float(finite.max()))
    if not lows:
        return (0.1, 1.0) if scale == "logarithmic" else (-1.0, 1.0)
    low, high = min(lows), max(highs)
    if scale == "logarithmic":
        return 10 ** (np.floor(np.log10(low * 0.9) * 4) / 4), 10 ** (np.ceil(np.log10(high * 1.1) * 4) / 4)
    if scale == "symmetric":
        limit = nice_limit(1.02 * max(abs(low), abs(high)))
        return -limit, limit
    size = max(abs(low), abs(high))
    if size < SMALLEST_DRAWN:
        return -1.0, 1.0
    extent = high - low if high - low > CONSTANT * size else size
    step = nice_limit(extent) / 10
    return step * np.floor(low / step - 0.2), step * np.ceil(high / step + 0.2)
