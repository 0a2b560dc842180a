"""Sheet stamps: time stamps that are coarser than the samples, or jitter by more than their interval.

Loggers truncate the time to whole seconds or hundredths, or stamp a batch of samples when they read it. Then
rows of different samples have one stamp: they are spread evenly over its time. Stamps that jitter so much
that they run backwards are replaced by their moving average, in the order of the rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray

IntArray = NDArray[np.intp]

MIN_REPEATED = 0.01
"""Part of the samples that have the stamp of the one before, from which all are spread: a stamp that repeats
now and then is a fault of its own."""
_MIN_STAMPS = 3
"""Fewest different stamps that show how far they are apart."""
_STEPS = (1.0, 0.1, 0.01, 0.001)
"""Steps to which loggers truncate time [s]."""
_LIKE = 0.25
"""Largest deviation of the usual interval between stamps from such a step, in steps."""
_ROUNDED = 1e-3
"""Largest distance of a stamp from a multiple of the step, in steps: doubles of Unix time hold 0.2 µs."""
_WIDE = 1.5
"""Interval between stamps, in usual ones, from which samples are missing in it."""
_REGULAR, _SLACK = 0.8, (0.5, 1.5)
"""Part of the steps between rows in order of time that are like the usual step, and which are, in such steps.
Of two recordings that lie over each other some steps are shorter and some are zero."""
_MOST_SET = 3
"""Most steps of a clock that was set back: with more, the stamps jitter."""
_AVERAGED = 50
"""Rows before and after a stamp that jitters, with which it is averaged."""


def distribute_stamps(time: FloatArray, key: FloatArray) -> tuple[FloatArray, str]:
    """Return time stamps with those that samples share spread evenly, and a report.

    Parameters
    ----------
    time : (n,) array
        Time stamps [s].
    key : (n, k) array
        Values of one sensor; rows with NaN are of others, and keep their place between its samples.

    Returns
    -------
    (n,) array, str
        The stamps; the report is empty where they are unchanged.
    """
    rows = np.flatnonzero(np.isfinite(time) & np.isfinite(key).all(axis=1))
    stamps = time[rows]
    if stamps.size < _MIN_STAMPS or (np.diff(stamps) < 0).any():
        return time, ""
    again = np.diff(stamps) == 0
    differs = (np.diff(key[rows], axis=0) != 0).any(axis=1)
    count = int((again & differs).sum())
    # A sample that is written twice is no other sample.
    rows, stamps = rows[np.append(True, ~again | differs)], stamps[np.append(True, ~again | differs)]
    starts = np.flatnonzero(np.append(True, np.diff(stamps) > 0))
    if count < MIN_REPEATED * stamps.size or starts.size < _MIN_STAMPS:
        return time, ""
    spaced, usual, truncated = _distribute_stamps(stamps[starts], np.diff(np.append(starts, stamps.size)))
    result = time.copy()
    inside = np.flatnonzero(np.isfinite(time))
    # Rows of other sensors, and repeated ones, lie where they stand between the samples.
    result[inside] = np.interp(inside, rows, spaced)
    how = (
        "after it, as of a time that is truncated"
        if truncated
        else "before it, as of a batch stamped at its end"
    )
    return result, (
        f"{count} samples have the time stamp of the one before and other values: the samples of a stamp "
        f"are spread evenly {how}. Their delay is uncertain by up to {usual:.2g} s"
    )


def _distribute_stamps(stamps: FloatArray, counts: IntArray) -> tuple[FloatArray, float, bool]:
    """Return the times of all samples, the usual interval of stamps [s], and whether these are truncated.

    Parameters
    ----------
    stamps : (g,) array
        The stamps, each once.
    counts : (g,) array
        How many samples have each.
    """
    interval = np.diff(stamps)
    usual = float(np.median(interval))
    step = float(np.median(interval / counts[:-1]))
    truncated = any(
        abs(usual / one - 1) < _LIKE and np.abs(stamps / one - np.rint(stamps / one)).max() < _ROUNDED
        for one in _STEPS
    )
    long = np.maximum(counts * step, usual)
    if truncated:
        end = stamps + np.append(np.minimum(interval, _WIDE * long[:-1]), counts[-1] * step)
        begin = np.append(end[0] - counts[0] * step, stamps[1:])
    else:
        end = stamps
        before = np.append(counts[0] * step, interval)
        begin = end - np.where(before < _WIDE * long, before, counts * step)
    place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    part = (place + (0.5 if truncated else 1.0)) / np.repeat(counts, counts)
    return np.repeat(begin, counts) + part * np.repeat(end - begin, counts), usual, truncated


def is_regular(time: FloatArray) -> bool:
    """Return whether stamps (n,) in order of time are about equally far apart."""
    step = np.diff(time)
    if not (step > 0).any():
        return False
    usual = float(np.median(step[step > 0]))
    return bool(((step > _SLACK[0] * usual) & (step < _SLACK[1] * usual)).mean() >= _REGULAR)


def set_backs(time: FloatArray) -> list[tuple[int, float]]:
    """Return the rows from which a clock is behind, and by how much it was set back [s].

    Rows that were written late are followed by a jump forward, and a clock that was set back by none.

    Parameters
    ----------
    time : (n,) array
        Finite stamps in the order of the rows [s].
    """
    steps = np.diff(time)
    rows = np.flatnonzero(steps < 0) + 1
    if not 0 < rows.size <= _MOST_SET or not (steps > 0).any():
        return []
    usual = float(np.median(steps[steps > 0]))
    found = []
    for row in rows.tolist():
        again = row + int(np.argmax(np.append(time[row:], np.inf) > time[row - 1]))
        size = usual - float(steps[row - 1])
        if again >= time.size or (steps[row:again] < 0).any() or steps[again - 1] > _WIDE * usual:
            return []
        if size < _WIDE * usual:
            return []
        found.append((row, size))
    return found


def smooth(time: FloatArray) -> FloatArray:
    """Return stamps (n,) in the order of their rows with a moving average instead of their jitter [s]."""
    index = np.arange(time.size, dtype=np.float64)
    first = np.maximum(np.arange(time.size) - _AVERAGED, 0)
    last = np.minimum(np.arange(time.size) + _AVERAGED + 1, time.size)
    count = last - first

    def mean(values: FloatArray) -> FloatArray:
        sums = np.append(0.0, np.cumsum(values))
        return np.asarray((sums[last] - sums[first]) / count)

    # A line through the rows around each, since there are fewer on one side at the ends.
    since = time - time[0]
    centre, level = mean(index), mean(since)
    slope = (mean(index * since) - centre * level) / (mean(index**2) - centre**2)
    return np.asarray(time[0] + level + slope * (index - centre))
