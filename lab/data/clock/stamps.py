"""Stamps: times that are text, as seconds: ISO 8601, dates of loggers and spreadsheets, times of day.

The second 60 of a leap second is the first of the next day, as in Unix time, which then counts that second
twice: `over_leap_second` finds the step back.

The abbreviations of zones are those of RFC 5322, section 4.3, and of the IANA time zone database where they
stand for one offset only. BST, IST, AST and the like stand for several, so a stamp with one of them is not
understood.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.units import DAY
from lab.data.clock.faults import continue_times

_HOURS_EAST = {
    "Z": 0, "UTC": 0, "UT": 0, "GMT": 0, "WET": 0, "WEST": 1, "CET": 1, "CEST": 2, "MEZ": 1, "MESZ": 2,
    "EET": 2, "EEST": 3, "MSK": 3, "EST": -5, "EDT": -4, "CST": -6, "CDT": -5, "MST": -7, "MDT": -6,
    "PST": -8, "PDT": -7, "AKST": -9, "AKDT": -8, "HST": -10, "JST": 9, "KST": 9, "AEST": 10, "AEDT": 11,
    "ACST": 9.5, "ACDT": 10.5, "AWST": 8, "NZST": 12, "NZDT": 13, "SGT": 8, "HKT": 8, "SAST": 2,
}  # fmt: skip
"""Hours of a zone east of Greenwich."""
_ZONE_PATTERN = r"(?:Z|(?:UTC|GMT)?[+-]\d{2}:?(?:\d{2})?|[A-Z]{2,5})"
"""A zone in a stamp, as a regular expression without groups."""
_ZONE_OFFSET = re.compile(r"(?:UTC|GMT)?([+-])(\d{2}):?(\d{2})?")


def offset_of(zone: str | None) -> float:
    """Return by how much a zone is ahead of UTC [s]: 0 for none, NaN for one that is not known."""
    if not zone:
        return 0.0
    if found := _ZONE_OFFSET.fullmatch(zone):
        size = int(found[2]) * _HOUR + int(found[3] or 0) * _SIXTY
        return -size if found[1] == "-" else size
    return _HOURS_EAST[zone] * _HOUR if zone in _HOURS_EAST else math.nan


_ZONE = rf"\s?({_ZONE_PATTERN})?(?:\[[\w/+-]{{1,40}}\])?"
_HALF = r"(?:\s?([AaPp])\.?[Mm]\.?)?"
_CLOCK = re.compile(
    rf"(?:[A-Z][a-z]{{2}} |0 days )?(\d{{1,3}}):(\d{{2}}):(\d{{2}})(?:[.,:](\d{{1,9}}))?{_HALF}{_ZONE}"
)
_OF_HOUR = re.compile(r"(\d{1,3}):(\d{2})[.,](\d{1,9})")
"""Minutes and seconds, which spreadsheets keep of a time with a fraction."""
_IN_LETTERS = re.compile(r"(?:(\d{1,3})h ?)?(\d{1,3})m ?(\d{1,2})(?:[.,](\d{1,9}))?s")
"""Time since the start as apps of DJI write it: 1m 2.5s."""
_OF_DATE = (
    r"(?:[A-Z][a-z]{2,8},? )?(\d{1,4})(?:[-/.年]|\.? )(\d{1,2}|[^\W\d_]{3,9})\.?(?:[-/.月]|,? )"
    r"(\d{4}|\d{2})日?"
)
_MONTH_FIRST = r"([^\W\d_]{3,9})\.? (\d{1,2}),? (\d{4})"
_THEN_CLOCK = (
    rf"(?:[ T_,]{{1,3}}(\d{{1,2}})[:-](\d{{2}})(?:[:-](\d{{2}})(?:[.,_:](\d{{1,9}}))?)?{_HALF}{_ZONE})?"
)
_DATED = re.compile(_OF_DATE + _THEN_CLOCK)
_DATED_MONTH_FIRST = re.compile(_MONTH_FIRST + _THEN_CLOCK)
_DIGITS = re.compile(r"((?:19|20)\d{2})(\d{2})(\d{2})(\d{2})(\d{2})(\d{2})(?:\.?(\d{1,9}))?")
"""A date and a time of day as one number: 20231114221320.5, or with ms, 20231114221320500."""
_FORMATS = ("%a %b %d %H:%M:%S %Y", "%a %b %d %H:%M:%S.%f %Y")
_MONTHS = (
    "jan ene gen", "feb fev fév", "mar mär mrz", "apr avr abr", "may mai mag", "jun juin giu",
    "jul juil lug", "aug aou aoû ago", "sep set", "oct okt ott out", "nov", "dec dez déc dic",
)  # fmt: skip
"""How names of months begin in English, German, French, Italian, Spanish and Portuguese."""
_MONTH_OF = {begin: number for number, begins in enumerate(_MONTHS, 1) for begin in begins.split()}
"""Number of a month by the letters it begins with."""
_LAST_MONTH = 12
"""Number of December."""
IS_AMBIGUOUS = re.compile(r"\s*(\d\d?)[-/.](\d\d?)[-/.]\d{2,4}\b")
"""A date with day and month as numbers; the day is taken to be first where both are possible."""
ACCEPTED = "2023-11-14T22:13:20.5Z, 14.11.2023 22:13:20,5, 11/14/2023 10:13:20.5 PM or 22:13:20.5"
ZONES = "with a zone such as +01:00, UTC, CET or PST, or without"
"""Examples of stamps, and zones of them, for messages."""
_ZONE_WORD = re.compile(rf" ({_ZONE_PATTERN})(?= \d{{4}}$)")
"""A zone before the year, as Unix and Java write it."""
_HUNDRED, _SIXTY, _HOURS, _HOUR = 100.0, 60.0, 24.0, 3600.0
"""Between the digits of hours, minutes and seconds in hhmmss; how many there are of each; an hour [s]."""
_CENTURY = 2000
"""Year to which two digits are added."""
_LEAP_TOLERANCE = 0.25
"""Largest deviation of the step back at a leap second from a second [s]: stamps jitter."""
_LEAP_MONTHS = (1, 7)
"""Months that begin after a leap second: all 27 since 1972 ended June or December."""


def seconds_of_texts(texts: Sequence[str]) -> FloatArray:
    """Return time stamps as seconds since 1970, or since midnight for times of day; NaN for what is none.

    A stamp without a zone counts as UTC, one with a zone that is not known is none. A time of day that
    jumps back has passed midnight. Minutes and seconds without an hour count from the hour.
    """
    texts = _with_zeros(texts)
    sample = next((text for text in texts if text), "")
    if _CLOCK.fullmatch(sample):
        return continue_times(np.array([_clock(text) for text in texts]), DAY, DAY / 2)
    if _OF_HOUR.fullmatch(sample):
        return np.array([_of_hour(text) for text in texts])
    if _IN_LETTERS.fullmatch(sample):
        return np.array([_in_letters(text) for text in texts])
    if is_date_in_digits(sample):
        return np.array([_of_digits(text) for text in texts])
    pattern = _DATED if _DATED.fullmatch(sample) else _DATED_MONTH_FIRST
    if pattern.fullmatch(sample):
        return _read_dates([pattern.fullmatch(text) for text in texts], pattern is _DATED_MONTH_FIRST)
    return _dates(texts)


_FRACTION = re.compile(r"(.*\d:\d{2}[.,:])(\d{1,6})(?=\D*$)")
"""A stamp up to its fraction of a second, and this."""
_DIGITS_OF_COUNTS = (3, 6)
"""Most digits of whole milliseconds and microseconds."""


def _with_zeros(texts: Sequence[str]) -> Sequence[str]:
    """Return stamps with the zeros that a logger leaves out before milliseconds: 12:00:01.7 is 1.007 s.

    As decimals, such stamps run backwards within a second, and as whole numbers they do not.
    """
    if len(set(map(len, texts))) == 1:
        return texts
    found = [_FRACTION.match(text) for text in texts]
    width = max((len(one[2]) for one in found if one), default=0)
    pairs = [(a[2], b[2]) for a, b in pairwise(filter(None, found)) if a[1] == b[1]]
    backwards = any(f"{a:0<{width}}" > f"{b:0<{width}}" for a, b in pairs)
    if width not in _DIGITS_OF_COUNTS or not backwards or any(int(a) > int(b) for a, b in pairs):
        return texts
    return [
        f"{one[1]}{one[2]:0>{width}}{text[one.end() :]}" if one else text
        for one, text in zip(found, texts, strict=True)
    ]


def is_of_hour(text: str) -> bool:
    """Return whether a stamp has minutes and seconds only."""
    return _OF_HOUR.fullmatch(text) is not None


def is_date_in_digits(text: str) -> bool:
    """Return whether a stamp is one number with date and time of day."""
    return bool(np.isfinite(_of_digits(text)))


def seconds_of_digits(values: FloatArray) -> FloatArray | None:
    """Return times of day that are written as the number hhmmss.ss in seconds; None for other numbers.

    After 59 seconds such a number goes on with 100, and seconds since a start would go on with 60.
    """
    minutes, seconds = np.divmod(values, _HUNDRED)
    hours, minutes = np.divmod(minutes, _HUNDRED)
    known = np.isfinite(values)
    if (values[known] < 0).any() or (hours[known] >= _HOURS).any() or np.ptp(minutes[known]) == 0:
        return None
    # A leap second is 235960.
    last = (hours == _HOURS - 1) & (minutes == _SIXTY - 1)
    if (seconds[known] >= _SIXTY + last[known]).any() or (minutes[known] >= _SIXTY).any():
        return None
    return continue_times(np.asarray(hours * _HOUR + minutes * _SIXTY + seconds), DAY, DAY / 2)


def over_leap_second(time: FloatArray, of_day: bool) -> tuple[FloatArray, bool]:
    """Return times that count a leap second, and whether there is one.

    Parameters
    ----------
    time : (n,) array
        Time since 1970, or of the day, in UTC, which steps back by a second at a leap second [s].
    of_day
        Whether the day is unknown.
    """
    known = np.flatnonzero(np.isfinite(time))
    step = np.diff(time[known])
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 0.0
    after = time[known[1:]]
    # Unix time counts the leap second twice: there the step is a second less than usual.
    back = np.abs(step - (usual - 1)) < _LEAP_TOLERANCE
    # It is at midnight: a second before at the earliest, a usual step after at the latest.
    back &= (after + 1 + _LEAP_TOLERANCE) % DAY < 1 + 2 * _LEAP_TOLERANCE + usual
    if not of_day:
        first = np.rint(after[back] / DAY).astype("datetime64[D]")
        month = first.astype("datetime64[M]")
        begins = (first == month.astype("datetime64[D]")) & np.isin(
            month.astype(int) % _LAST_MONTH + 1, _LEAP_MONTHS
        )
        back[back] = begins
    if not 0 < usual <= 1 or back.sum() != 1:
        return time, False
    time = time.copy()
    time[known[1:]] += np.cumsum(back)
    return time, True


def date_and_clock(date: FloatArray, clock: FloatArray) -> FloatArray:
    """Return time since 1970 of a date and a time of day in columns of their own [s].

    Parameters
    ----------
    date : (n,) array
        Midnight of the date [s].
    clock : (n,) array
        Time of the day [s]; it may go on after midnight, although the date does so too.
    """
    time = date + clock % DAY
    known = np.flatnonzero(np.isfinite(time))
    begun = np.flatnonzero(np.diff(date[known]) != 0) + 1
    # A leap second belongs to the date before, although it is after 24 h.
    for i in np.flatnonzero(np.diff(time[known]) < -DAY / 2) + 1:
        end = begun[np.searchsorted(begun, i)] if begun.size and i < begun[-1] else len(known)
        time[known[i:end]] += DAY
    return time


def _clock(text: str) -> float:
    found = _CLOCK.fullmatch(text)
    if found is None:
        return np.nan
    return _seconds(found[1], found[2], found[3], found[4], found[5]) - offset_of(found[6])


def has_zone(text: str) -> bool:
    """Return whether a time of day names a zone."""
    found = _CLOCK.fullmatch(text)
    return found is not None and bool(found[6])


def _seconds(
    hours: str, minutes: str, seconds: str | None, fraction: str | None, half: str | None = None
) -> float:
    if int(minutes) >= _SIXTY or int(seconds or 0) > _SIXTY:
        return np.nan
    # 12 AM is midnight, and 12 PM noon.
    whole = int(hours) % 12 + 12 * (half in "Pp") if half else int(hours)
    return whole * _HOUR + int(minutes) * _SIXTY + int(seconds or 0) + float(f"0.{fraction or 0}")


def _of_hour(text: str) -> float:
    found = _OF_HOUR.fullmatch(text)
    return np.nan if found is None else int(found[1]) * _SIXTY + int(found[2]) + float(f"0.{found[3]}")


def _in_letters(text: str) -> float:
    found = _IN_LETTERS.fullmatch(text)
    return np.nan if found is None else _seconds(found[1] or "0", found[2], found[3], found[4])


def _of_digits(text: str) -> float:
    found = _DIGITS.fullmatch(text)
    if found is None or int(found[4]) >= _HOURS or int(found[5]) >= _SIXTY or int(found[6]) > _SIXTY:
        return np.nan
    return _day(int(found[1]), int(found[2]), int(found[3])) + _seconds(
        found[4], found[5], found[6], found[7]
    )


def _day(year: int, month: int, day: int) -> float:
    """Return midnight since 1970 [s]; NaN if there is no such day."""
    try:
        return float(np.datetime64(f"{year:04d}-{month:02d}-{day:02d}", "D").astype(int) * DAY)
    except ValueError:
        return np.nan


def _read_dates(found: Sequence[re.Match[str] | None], month_first: bool) -> FloatArray:
    """Return the seconds of dates, with a time of day or without."""
    dates = [one.group(1, 2, 3) if one else None for one in found]
    kinds = set(dates) - {None}
    month_first |= any(
        b.isdigit() and int(b) > _LAST_MONTH and len(a) <= 2 for a, b, _ in filter(None, kinds)
    )
    midnights = {one: _midnight(one, month_first) for one in kinds if one is not None}
    times = np.full(len(found), np.nan)
    for row, (one, date) in enumerate(zip(found, dates, strict=True)):
        if one is not None and date is not None:
            time = midnights[date]
            if one[4]:
                time += _seconds(*one.group(4, 5, 6, 7, 8)) - offset_of(one[9])
            times[row] = time
    return times


def _midnight(date: tuple[str, ...], month_first: bool) -> float:
    a, b, c = date
    if len(a) > 2 and a.isdigit():
        year, month, day = a, b, c
    else:
        day, month, year = (b, a, c) if month_first else (a, b, c)
    number = _month(month)
    century = 0 if len(year) > 2 else _CENTURY
    return _day(century + int(year), number, int(day)) if number else np.nan


def _month(text: str) -> int:
    if text.isdigit():
        return int(text)
    name = text.lower()
    return _MONTH_OF.get(name[:4]) or _MONTH_OF.get(name[:3]) or 0


def _dates(texts: Sequence[str]) -> FloatArray:
    import pandas as pd  # noqa: PLC0415 - slow to import, and only reading needs it

    best = np.full(len(texts), np.nan)
    written = sum(map(bool, texts))
    plain = pd.Series([_ZONE_WORD.sub("", text) for text in texts])
    zones = np.array([offset_of(one[1]) if (one := _ZONE_WORD.search(text)) else 0.0 for text in texts])
    for form in ("ISO8601", *_FORMATS):
        with np.errstate(all="ignore"):
            times = pd.to_datetime(plain, format=form, utc=True, errors="coerce")
        values = times.to_numpy(dtype="datetime64[ns]")
        seconds = np.where(np.isnat(values), np.nan, values.astype(np.int64) * 1e-9) - zones
        if np.isfinite(seconds).sum() > np.isfinite(best).sum():
            best = seconds
        if np.isfinite(best).sum() == written:
            break
    return best
