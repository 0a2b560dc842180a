"""Coarse stamps: time stamps that are coarser than the samples, or jitter by more than their interval.

Loggers truncate the time to whole seconds or hundredths, or stamp a batch of samples when they read it. Then
rows of different samples have one stamp: they are spread evenly over its time. Stamps that jitter so much
that they run backwards are replaced by their moving average, in the order of the rows.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray, IntArray, running_sums
from lab.data.clock.limits import LIMITS


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
    if stamps.size < LIMITS.stamps or (np.diff(stamps) < 0).any():
        return time, ""
    again = np.diff(stamps) == 0
    differs = (np.diff(key[rows], axis=0) != 0).any(axis=1)
    count = int((again & differs).sum())
    # A sample that is written twice is no other sample.
    rows, stamps = rows[np.append(True, ~again | differs)], stamps[np.append(True, ~again | differs)]
    starts = np.flatnonzero(np.append(True, np.diff(stamps) > 0))
    if count < LIMITS.repeated * stamps.size or starts.size < LIMITS.stamps:
        return time, ""
    spaced, usual, truncated = _distribute_stamps(stamps[starts], np.diff(np.append(starts, stamps.size)))
    result = time.copy()
    inside = np.flatnonzero(np.isfinite(time))
    # Rows of other sensors, and repeated ones, lie where they stand between the samples.
    result[inside] = np.interp(inside, rows, spaced)
    cause = "after it, as of a time that is truncated", "before it, as of a batch stamped at its end"
    how = cause[0] if truncated else cause[1]
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
        abs(usual / one - 1) < LIMITS.like
        and np.abs(stamps / one - np.rint(stamps / one)).max() < LIMITS.rounded
        for one in LIMITS.truncated
    )
    long = np.maximum(counts * step, usual)
    if truncated:
        end = stamps + np.append(np.minimum(interval, LIMITS.missing * long[:-1]), counts[-1] * step)
        begin = np.append(end[0] - counts[0] * step, stamps[1:])
    else:
        end = stamps
        before = np.append(counts[0] * step, interval)
        begin = end - np.where(before < LIMITS.missing * long, before, counts * step)
    # The number of each sample among those of its stamp.
    place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    # Samples of a truncated stamp lie in the middle of their parts; the last of a batch ends with it.
    part = (place + (0.5 if truncated else 1.0)) / np.repeat(counts, counts)
    return np.repeat(begin, counts) + part * np.repeat(end - begin, counts), usual, truncated


def smooth(time: FloatArray) -> FloatArray:
    """Return stamps (n,) in the order of their rows with a moving average instead of their jitter [s]."""
    index = np.arange(time.size, dtype=np.float64)
    first = np.maximum(np.arange(time.size) - LIMITS.averaged, 0)
    last = np.minimum(np.arange(time.size) + LIMITS.averaged + 1, time.size)
    count = last - first

    def mean(values: FloatArray) -> FloatArray:
        sums = running_sums(values)
        return np.asarray((sums[last] - sums[first]) / count)

    # A line through the rows around each, since there are fewer on one side at the ends.
    since = time - time[0]
    centre, level = mean(index), mean(since)
    slope = (mean(index * since) - centre * level) / (mean(index**2) - centre**2)
    return np.asarray(time[0] + level + slope * (index - centre))
