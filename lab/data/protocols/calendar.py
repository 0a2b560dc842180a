"""Calendar: date and time of day, as receivers send them, as seconds since 1970."""

from __future__ import annotations

from datetime import UTC, datetime

from lab.data.protocols.samples import NAN

_FIRST_YEAR, _LAST_YEAR = 1980, 2100
"""Years that are believed: GPS counts from 1980."""
_LEAP = 61.0
"""End of a minute with a leap second [s]."""


def utc_seconds(year: int, month: int, day: int, hour: int, minute: int, second: float) -> float:
    """Return seconds since 1970; NaN for what is no date and time of day.

    Parameters
    ----------
    year, month, day, hour, minute, second
        In UTC; the second may be just below zero, as u-blox rounds.
    """
    if not (_FIRST_YEAR <= year <= _LAST_YEAR and -1.0 < second < _LEAP):
        return NAN
    try:
        start = datetime(year, month, day, hour, minute, tzinfo=UTC)
    except ValueError:
        return NAN
    return start.timestamp() + second
