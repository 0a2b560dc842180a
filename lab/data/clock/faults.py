"""Faults: rows out of order, equal samples, gaps, and clocks that are set back or begin again.

A file gives whole columns, and a stream its next rows. Where a fault shows by the rows so far, a function
takes both.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import Flags, FloatArray, IntArray, interpolate_columns
from lab.data.clock.limits import LIMITS


def increasing(time: FloatArray, after: float = -np.inf) -> Flags:
    """Return which times (n,) are later than all before, and than `after` [s]; unknown ones are not."""
    if time.size == 1:
        return np.asarray(time > after)
    # `fmax` passes over NaN, so an unknown time does not hide those before it.
    return np.asarray(time > np.fmax.accumulate(np.append(after, time))[:-1])


def steps_from(before: float, time: FloatArray) -> FloatArray:
    """Return the steps of times (n,) from a time before them [s]; n > 0."""
    steps = np.empty_like(time)
    steps[0] = time[0] - before
    np.subtract(time[1:], time[:-1], out=steps[1:])
    return steps


def usual_step(time: FloatArray) -> float:
    """Return the median of the steps forward between times (n,) [s]; 0 without any."""
    steps = np.diff(time)
    return float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0


def equal_runs(samples: FloatArray) -> tuple[IntArray, IntArray]:
    """Return where the run of equal ones of each sample (n, m) begins, and how long it is."""
    # The slice is for no samples at all: then there is no first one.
    first = np.append(True, (samples[1:] != samples[:-1]).any(axis=1))[: len(samples)]
    start = np.maximum.accumulate(np.where(first, np.arange(first.size), 0))
    return start, np.bincount(start, minlength=first.size)[start]


def filled(
    time: FloatArray, values: FloatArray, usual: FloatArray, gaps: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return samples with gaps filled linearly, at the usual spacing.

    Parameters
    ----------
    time : (n,) array
        Increasing times [s].
    values : (n, m) array
        Samples.
    usual : (n - 1,) array
        Usual interval at each interval [s].
    gaps : (k,) array
        Intervals that are filled.
    """
    inner = [
        np.linspace(time[i], time[i + 1], round((time[i + 1] - time[i]) / usual[i]) + 1)[1:-1] for i in gaps
    ]
    times = np.sort(np.concatenate((time, *inner)))
    return times, interpolate_columns(times, time, values)


class UsualInterval:
    """How far samples are apart: the median of the last intervals, renewed after each `ClockLimits.block`.

    A sample is missing where an interval is much longer. Batch and live navigator must agree about that to
    give the same solution, so it depends on the past only, and not on the pieces in which samples arrive.

    >>> usual = UsualInterval()
    >>> usual.accept(np.full(30, 0.01))[-1]
    0.01
    """

    def __init__(self) -> None:
        self.now = np.nan
        """Usual interval for the next one [s]; NaN before there is one."""
        self._last = np.empty(0)
        self._due = LIMITS.block  # intervals up to the next median

    def accept(self, intervals: FloatArray) -> FloatArray:
        """Return the usual interval at each of some intervals.

        Parameters
        ----------
        intervals : (n,) array
            The next intervals [s]. The first call takes at least `ClockLimits.first_intervals`, or all there
            are.

        Returns
        -------
        (n,) array
            The usual interval when each of them ends [s].
        """
        if np.isnan(self.now) and intervals.size:
            self.now = float(np.median(intervals[: LIMITS.first_intervals]))
        usual, done = np.empty(intervals.size), 0
        while done < intervals.size:
            end = min(done + self._due, intervals.size)
            usual[done:end] = self.now
            self._last = np.concatenate((self._last, intervals[done:end]))[-LIMITS.intervals :]
            self._due -= end - done
            if not self._due:
                self.now, self._due = float(np.median(self._last)), LIMITS.block
            done = end
        return usual


def continue_times(time: FloatArray, period: float, slack: float) -> FloatArray:
    """Return times that go on where they begin again.

    Parameters
    ----------
    time : (n,) array
        Times [s]; NaN where unknown.
    period
        After how long they begin again [s].
    slack
        By how much less or more they may fall back [s].
    """
    known = np.flatnonzero(np.isfinite(time))
    result = time.copy()
    # A fall back by about one period is a new turn of the counter; any other one is left as it is.
    result[known[1:]] += period * np.cumsum(np.abs(np.diff(time[known]) + period) < slack)
    return result


def over_rollovers(time: FloatArray, weeks_of: FloatArray) -> tuple[FloatArray, str]:
    """Return stamps that go on where their week number begins again, in the weeks of others, and a remark.

    Parameters
    ----------
    time : (m,) array
        Stamps of a receiver [s]; NaN where unknown.
    weeks_of : (n,) array
        Stamps of the IMU [s].
    """
    others, period, beside = weeks_of[np.isfinite(weeks_of)], LIMITS.rollover, LIMITS.beside
    if others.size == 0 or not np.isfinite(time).any():
        return time, ""
    result = continue_times(time, period, beside)
    middle, first, last = float(np.nanmedian(result)), float(others.min()), float(others.max())
    behind = round(((first + last) / 2 - middle) / period)
    if abs(behind) <= LIMITS.rollovers and first - beside < middle + behind * period < last + beside:
        result += behind * period
    if np.array_equal(result, time, equal_nan=True):
        return time, ""
    return result, (
        "The stamps of the GPS are off by 1,024 weeks or a multiple, after which the week number of GPS "
        "begins again: they are taken in the weeks of the IMU."
    )


def is_regular(time: FloatArray) -> bool:
    """Return whether stamps (n,) in order of time are about equally far apart."""
    step, usual = np.diff(time), usual_step(time)
    if not usual:
        return False
    near = (step > LIMITS.soonest * usual) & (step < LIMITS.missing * usual)
    return bool(near.mean() >= LIMITS.regular)


def set_backs(time: FloatArray) -> list[tuple[int, float]]:
    """Return the rows from which a clock is behind, and by how much it was set back [s].

    Rows that were written late are followed by a jump forward, and a clock that was set back by none.

    Parameters
    ----------
    time : (n,) array
        Finite stamps in the order of the rows [s].
    """
    steps, usual = np.diff(time), usual_step(time)
    rows = np.flatnonzero(steps < 0) + 1
    if not 0 < rows.size <= LIMITS.most_set or not usual:
        return []
    found = []
    for row in rows.tolist():
        again = row + int(np.argmax(np.append(time[row:], np.inf) > time[row - 1]))
        # A clock that was not set would have stepped by the usual interval.
        size = usual - float(steps[row - 1])
        if again >= time.size or (steps[row:again] < 0).any():
            return []
        # A jump forward where it catches up: the rows were only written late.
        if steps[again - 1] > LIMITS.missing * usual or size < LIMITS.missing * usual:
            return []
        found.append((row, size))
    return found
