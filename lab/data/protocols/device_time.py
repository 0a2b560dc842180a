"""Device time: dates, times of day and wrapping counters of devices, as seconds and continued numbers."""

from __future__ import annotations

from datetime import UTC, datetime

from lab.data.protocols.samples import NAN

FIRST_YEAR, LAST_YEAR = 1980, 2100
"""Years that are believed: GPS counts from 1980."""
GPS_EPOCH = 315_964_800.0
"""Begin of the first week of GPS, 1980-01-06, since 1970 [s]."""
_LEAP = 61.0
"""End of a minute with a leap second [s]."""


def utc_seconds(year: int, month: int, day: int, hour: int, minute: int, second: float) -> float:
    """Return seconds since 1970; NaN for what is no date and time of day.

    Parameters
    ----------
    year, month, day, hour, minute, second
        In UTC; the second may be just below zero, as u-blox rounds.
    """
    if not (FIRST_YEAR <= year <= LAST_YEAR and -1.0 < second < _LEAP):
        return NAN
    try:
        start = datetime(year, month, day, hour, minute, tzinfo=UTC)
    except ValueError:
        return NAN
    return start.timestamp() + second


class WrappingCounter:
    """Continues a counter past its end.

    A step is taken as the shortest one, forwards or backwards by less than half of the modulus: where more is
    missing, the value is wrong by a multiple of the modulus.

    Parameters
    ----------
    modulus
        The number after the largest value.
    """

    def __init__(self, modulus: int) -> None:
        self._modulus = modulus
        self._last: int | None = None

    def continued(self, value: int) -> int:
        """Return the value with all starts from zero so far counted in.

        Parameters
        ----------
        value
            As the device sends it, from 0 to the modulus - 1.
        """
        if self._last is None:
            self._last = value
        else:
            # The nearer way round, forwards or back: messages may be a little out of order.
            half = self._modulus // 2
            self._last += (value - self._last + half) % self._modulus - half
        return self._last
