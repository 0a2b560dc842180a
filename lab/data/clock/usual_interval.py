"""Usual interval: how far the samples of an IMU are apart, known from the samples so far.

A sample is missing where an interval is much longer than the usual one. Batch and live navigator must agree
about that to give the same solution, so the usual interval depends on the past only, and not on the pieces in
which samples arrive.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lab.base.arrays import FloatArray

FIRST_INTERVALS: Final = 20
"""Intervals of which the first median is taken: a live stream waits for them, 0.2 s at 100 Hz."""
INTERVALS: Final = 512
"""Intervals of which the usual one is the median; a new rate of the device counts after half of them."""
BLOCK: Final = 128
"""Intervals after which the median is taken again."""


class UsualInterval:
    """The median of the last intervals, renewed after each `BLOCK`.

    >>> usual = UsualInterval()
    >>> usual.accept(np.full(30, 0.01))[-1]
    0.01
    """

    def __init__(self) -> None:
        self.now = np.nan
        """Usual interval for the next one [s]; NaN before there is one."""
        self._last = np.empty(0)
        self._due = BLOCK  # intervals up to the next median

    def accept(self, intervals: FloatArray) -> FloatArray:
        """Return the usual interval at each of some intervals.

        Parameters
        ----------
        intervals : (n,) array
            The next intervals [s]. The first call takes at least `FIRST_INTERVALS`, or all there are.

        Returns
        -------
        (n,) array
            The usual interval when each of them ends [s].
        """
        if np.isnan(self.now) and intervals.size:
            self.now = float(np.median(intervals[:FIRST_INTERVALS]))
        usual, done = np.empty(intervals.size), 0
        while done < intervals.size:
            end = min(done + self._due, intervals.size)
            usual[done:end] = self.now
            self._last = np.concatenate((self._last, intervals[done:end]))[-INTERVALS:]
            self._due -= end - done
            if not self._due:
                self.now, self._due = float(np.median(self._last)), BLOCK
            done = end
        return usual
