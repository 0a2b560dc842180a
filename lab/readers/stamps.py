"""Stamps: times that are written as text, as seconds: ISO 8601, dates of loggers, and times of day."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lab.units import DAY

FloatArray = NDArray[np.float64]

_CLOCK = re.compile(r"(?:[A-Z][a-z]{2} )?(\d{1,2}):(\d{2}):(\d{2})(?:[.,:](\d{1,9}))?\s*([AaPp][Mm])?")
_DATE_AND_CLOCK = re.compile(
    r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})[ T_](\d{1,2})[:-](\d{2})[:-](\d{2})(?:[.,_:](\d{1,9}))?"
)
_FORMATS = (
    "%d-%b-%Y %H:%M:%S.%f", "%d-%b-%Y %H:%M:%S", "%a %b %d %H:%M:%S %Y", "%d.%m.%Y %H:%M:%S.%f",
    "%d.%m.%Y %H:%M:%S", "%d-%b-%y", "%d-%b-%Y", "%d.%m.%Y", "%d/%m/%Y",
    "%d/%m/%Y %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S", "%m/%d/%Y",
    "%m/%d/%Y %I:%M:%S %p", "%m/%d/%Y %I:%M:%S.%f %p",
)  # fmt: skip
IS_AMBIGUOUS = re.compile(r"\s*(\d\d?)[/.](\d\d?)[/.]\d{4}\b")
"""A date with day and month as numbers; the day is taken to be first where both are possible."""
_ZONE_WORD = re.compile(r"(?: GMT)?([+-]\d{2}:?\d{2})(?= \d{4}$)| [A-Z]{3,4}(?= \d{4}$)")
_HUNDRED, _SIXTY, _HOURS = 100.0, 60.0, 24.0
"""Between the digits of hours, minutes and seconds in hhmmss; how many there are of each."""
_MIDNIGHT = DAY / 2
"""Step backwards of a time of day that is midnight [s]."""


def seconds_of_texts(texts: Sequence[str]) -> FloatArray:
    """Return time stamps as seconds since 1970, or since midnight for times of day; NaN for what is none.

    A stamp without a zone counts as UTC. A time of day that jumps back has passed midnight.
    """
    sample = next((text for text in texts if text), "")
    if _CLOCK.fullmatch(sample):
        return over_midnight(np.array([_clock(text) for text in texts]))
    if _DATE_AND_CLOCK.fullmatch(sample):
        return np.array([_date_and_clock(text) for text in texts])
    return _dates(texts)


def seconds_of_digits(values: FloatArray) -> FloatArray | None:
    """Return times of day that are written as the number hhmmss.ss in seconds; None for other numbers.

    After 59 seconds such a number goes on with 100, and seconds since a start would go on with 60.
    """
    minutes, seconds = np.divmod(values, _HUNDRED)
    hours, minutes = np.divmod(minutes, _HUNDRED)
    known = np.isfinite(values)
    if (values[known] < 0).any() or (hours[known] >= _HOURS).any() or np.ptp(minutes[known]) == 0:
        return None
    if (seconds[known] >= _SIXTY).any() or (minutes[known] >= _SIXTY).any():
        return None
    return over_midnight(np.asarray(hours * 3600 + minutes * 60 + seconds))


def _clock(text: str) -> float:
    found = _CLOCK.fullmatch(text)
    if found is None:
        return np.nan
    hours = int(found[1]) % 12 + 12 * (found[5].lower() == "pm") if found[5] else int(found[1])
    return hours * 3600 + int(found[2]) * 60 + int(found[3]) + float(f"0.{found[4] or 0}")


def _date_and_clock(text: str) -> float:
    found = _DATE_AND_CLOCK.fullmatch(text)
    if found is None:
        return np.nan
    year, month, day, hour, minute, second = (int(found[i]) for i in range(1, 7))
    try:
        days = np.datetime64(f"{year:04d}-{month:02d}-{day:02d}", "D").astype(int)
    except ValueError:
        return np.nan
    return float(days * DAY + hour * 3600 + minute * 60 + second) + float(f"0.{found[7] or 0}")


def over_midnight(seconds: FloatArray) -> FloatArray:
    """Return times of day that go on after midnight."""
    known = np.flatnonzero(np.isfinite(seconds))
    back = np.diff(seconds[known]) < -_MIDNIGHT
    seconds[known[1:]] += DAY * np.cumsum(back)
    return seconds


def _dates(texts: Sequence[str]) -> FloatArray:
    import pandas as pd  # noqa: PLC0415 - slow to import, and only reading needs it

    best = np.full(len(texts), np.nan)
    written = sum(map(bool, texts))
    plain = pd.Series([_ZONE_WORD.sub("", text) for text in texts])
    for form in ("ISO8601", *_FORMATS):
        with np.errstate(all="ignore"):
            times = pd.to_datetime(plain, format=form, utc=True, errors="coerce")
        values = times.to_numpy(dtype="datetime64[ns]")
        seconds = np.where(np.isnat(values), np.nan, values.astype(np.int64) * 1e-9)
        if np.isfinite(seconds).sum() > np.isfinite(best).sum():
            best = seconds
        if np.isfinite(best).sum() == written:
            break
    return best
