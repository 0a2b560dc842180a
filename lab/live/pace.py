"""Pace: which samples of a stream are used, where fewer are wanted than come."""

from __future__ import annotations

import math
from typing import Final

EARLY: Final = 0.25
"""How much earlier than due a sample is taken, as a part of the period: stamps jitter, and a sample at the
wanted rate that came a moment early must not wait for the next."""


class Pace:
    """Chooses samples about a period apart, by their times; the mean period is kept as far as samples come.

    >>> pace = Pace(0.02)
    >>> [pace.is_due(time) for time in (1.0, 1.01, 1.0199, 1.03, 1.04)]
    [True, False, True, False, True]

    Parameters
    ----------
    period
        The period [s].
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._due = -math.inf

    @property
    def next(self) -> float:
        """Time from which a sample is used [s]."""
        return self._due - EARLY * self._period

    def is_due(self, time: float) -> bool:
        """Return whether a sample at a time [s] is used; a clock that was set back begins anew."""
        late = time - self._due
        if -2 * self._period <= late < -EARLY * self._period:
            return False
        self._due = (self._due if abs(late) <= self._period else time) + self._period
        return True
