"""Sheet clock: the time stamps of a sheet in seconds: which column they are in, and their unit.

Of two tables of a log, one may count GPS time and the other UTC. The two are 18 s apart, which a log of a
minute does not show by its overlap. A log that its check refuses is tried again with the stamps of the fixes
moved by that; one that passes is reported if its tables begin and end that far apart, as tables do that were
recorded together.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import DAY, LEAP_SECONDS
from lab.data.checks.log_check import is_explained
from lab.data.clock.coarse_stamps import distribute_stamps
from lab.data.clock.faults import continue_times
from lab.data.clock.limits import LIMITS
from lab.data.clock.stamps import (
    IS_AMBIGUOUS,
    date_and_clock,
    has_zone,
    is_of_hour,
    over_leap_second,
    seconds_of_digits,
)
from lab.data.files.unit_names import UNITS
from lab.data.log.sensor_log import SINCE_1970, GnssLog, SensorLog
from lab.data.sheets.column_names import Heading
from lab.data.sheets.sheet import Sheet

_NEAR_LEAP = 1.0
"""Largest deviation of a begin and an end from that offset [s]: fixes are up to a second apart."""
_END_OF_EPOCH = 4e9
"""Time up to which stamps count from 1970 [s]: the year 2096; ns since switching on pass for ms otherwise."""
_LONGEST_STEP = 600.0
"""Longest usual step of such stamps [s]."""
_USUAL_STEP = {True: 0.02, False: 0.5}
"""Usual step between samples of an IMU, and between fixes [s]; the unit whose step comes nearest is taken: an
IMU has 0.6 to 600 ms, a receiver 16 ms to 16 s."""
_LONGEST = 10 * DAY
"""Longest log whose stamps are seconds since 1970 [s]: µs since switching on exceed 1e9 after 17 minutes."""
_MONTHS = 12
"""Number up to which a day may be a month."""
_MIN_KNOWN = 0.5
"""Smallest part of the rows in which a time stamp has to be known."""
_MIN_FORWARD = 0.5
"""Smallest part of the steps that do not go backwards in a column that is time."""
_MORE_FORWARD = 0.52
"""Smallest part of the steps forward among those that change it: a temperature called t goes to and fro."""

_ANOTHER_CLOCK = 0.01
"""Difference of stamps, over their size, from which they are of two clocks: 200 days since 1970."""
_HOUR, _MINUTE = 3600.0, 60.0
"""[s]."""
_MILLISECONDS = 1000
"""In a second."""
_PARTS, _DATE_PARTS = ("hour", "minute", "second"), ("year", "month", "day")
"""Columns of time stamps that have one for each part."""
_YEARS = (1980, 2107)
"""First and last year of such: GPS time begins, and 16 bits of a file system end."""
_DAYS_BEFORE_1970 = {"1900": (25_569.0, 36_526.0, 58_000.0), "year 0": (719_529.0, 730_486.0, 770_000.0)}
"""Days until 1970 of spreadsheets and of MATLAB, and the first and last that are taken for such: the year
2000, and 2058 (later numbers are modified Julian days) or 2108."""

_COUNTERS = (2.0**32, 2.0**24, 2.0**16)
"""Values of counters of 32, 24 and 16 bits: microseconds begin again after 72 minutes, 17 s and 66 ms."""
_OF_MINUTES = re.compile(r"(?:.*[ T])?\d{1,2}:\d{2}(?:\s?[AaPp]\.?[Mm]\.?)?")
"""A stamp without seconds."""


class Clock(NamedTuple):
    """Time stamps.

    Attributes
    ----------
    time : (n,) array
        Time of each row [s]; NaN where unknown.
    column : str
        The headings of the columns they are from.
    unit : str
        Their unit.
    guessed : bool
        Whether the unit is guessed.
    note : str
        What was done to the stamps; empty for nothing.
    """

    time: FloatArray
    column: str
    unit: str
    guessed: bool
    note: str = ""

    def report(self, what: str) -> str:
        """Return sentences about the stamps of the IMU or of the GPS."""
        how = " (guessed by its size and steps)" if self.guessed else ""
        note = f" {self.note}." if self.note else ""
        return f"Time of the {what}: {self.column}, in {self.unit}{how}.{note}"


def find_clock(sheet: Sheet, fast: bool, wanted: Sequence[str] = (), ordered: bool = True) -> Clock | None:
    """Return the time stamps of a sheet; None if no column has them.

    Parameters
    ----------
    sheet
        The sheet.
    fast
        Whether its rows are samples of an IMU, and not fixes.
    wanted
        Headings of time stamps that another sheet of the same log has: these are of the same clock.
    ordered
        Whether only a column counts that goes forward in most rows, and samples of one stamp are spread.
    """
    clock = _read_written_clock(sheet, fast, wanted, ordered)
    if clock is None or not ordered:
        return clock
    named = max(
        (sheet.all_of(name)[:1] for name in ("rate", "force", "latitude")),
        key=lambda found: np.isfinite(found[0][1]).sum() if found else 0,
    )
    if not named:
        return clock
    others = sheet.all_of("longitude")[:1] if named[0][0].quantity == "latitude" else []
    time, note = distribute_stamps(clock.time, np.column_stack([values for _, values in (*named, *others)]))
    return clock._replace(time=time, note=note)


def _read_written_clock(sheet: Sheet, fast: bool, wanted: Sequence[str], ordered: bool) -> Clock | None:
    fraction = next((pair for pair in sheet.all_of("time") if _is_fraction(*pair)), None)
    if fraction is None:
        return _of_column(sheet, fast, wanted, ordered, None)
    heading, values = fraction
    clock = _of_column(sheet, fast, wanted, ordered, heading)
    if clock is None or (clock.time[np.isfinite(clock.time)] % 1).any():
        return clock
    time, text = clock.time + values * UNITS["time"][heading.unit], f"{clock.column} + {heading.text}"
    return clock._replace(time=time, column=text)


def _is_fraction(heading: Heading, values: FloatArray) -> bool:
    """Return whether a column has milliseconds or microseconds that begin again with each second."""
    known = values[np.isfinite(values)] * UNITS["time"][heading.unit or "s"]
    within = known.size > 1 and heading.unit in ("ms", "µs", "ns") and ((known >= 0) & (known < 1)).all()
    return bool(within and (np.diff(known) < 0).any())


def _of_column(
    sheet: Sheet, fast: bool, wanted: Sequence[str], ordered: bool, fraction: Heading | None
) -> Clock | None:
    seconds, fractions = sheet.all_of("seconds"), sheet.all_of("fraction")
    if seconds and fractions:
        (whole, a), (part, b) = seconds[0], fractions[0]
        return _add_leap_second(Clock(a + b * 1e-9, f"{whole.text} + {part.text}", "s + ns", False), False)
    parts, used = _of_parts(sheet)
    # A counter beside is finer than the parts, which often have whole seconds.
    candidates = [
        pair
        for pair in sheet.all_of("time") + sheet.all_of("clock") + seconds
        if pair[0] not in used and pair[0] is not fraction
    ]
    # A column that the other sheets have too is of their clock, whatever its rank.
    candidates.sort(key=lambda pair: (pair[0].text not in wanted, pair[0].rank))
    # A column named Date may hold the time of the day too.
    candidates += [pair for pair in sheet.all_of("date") if ":" in sheet.texts.get(pair[0].text, "")]
    for heading, values in candidates:
        known = np.isfinite(values)
        # A column that stands still is a date or a constant.
        if known.mean() < _MIN_KNOWN or np.ptp(values[known]) == 0:
            continue
        steps = np.diff(values[known])
        if ordered and ((steps >= 0).mean() < _MIN_FORWARD or (steps[steps != 0] > 0).mean() < _MORE_FORWARD):
            continue
        if "header" in heading.text.lower() and _is_of_another_clock(values, candidates):
            continue
        if heading.text in sheet.texts:
            return _of_text(sheet, heading, values)
        may_be_of_day = heading.unit in ("", "s")
        if may_be_of_day and (of_day := seconds_of_digits(values)) is not None:
            return _add_leap_second(Clock(of_day, heading.text, "hhmmss", False), True)
        unit = heading.unit or _guessed_unit(values[known], fast)
        time = _count_onwards(values, UNITS["time"][unit])
        if unit == "days":
            size = float(np.nanmedian(values))
            for start, (before, first, last) in _DAYS_BEFORE_1970.items():
                if first < size < last:
                    time, unit = (values - before) * DAY, f"days since {start}"
        clock = Clock(time, heading.text, unit, not heading.unit)
        return _add_leap_second(clock, False) if np.median(time[known]) > SINCE_1970 else clock
    return parts


def _is_of_another_clock(stamps: FloatArray, others: Sequence[tuple[Heading, FloatArray]]) -> bool:
    """Return whether stamps count from another moment than others, such as the start of a device."""
    size = float(np.nanmedian(stamps))
    return any(abs(size - float(np.nanmedian(one))) > _ANOTHER_CLOCK * size for _, one in others)


def _of_parts(sheet: Sheet) -> tuple[Clock | None, list[Heading]]:
    """Return time stamps of which each part has a column, and these: hour, minute, second, maybe others."""
    found = [sheet.all_of(name)[:1] for name in _PARTS]
    found[-1] = found[-1] or [pair for pair in sheet.all_of("time") if pair[0].text.lower() == "seconds"][:1]
    if not all(found):
        return None, []
    parts = [one for (one,) in found]
    milliseconds = [
        pair
        for pair in sheet.all_of("time")
        if pair[0].unit == "ms" and ((pair[1] >= 0) & (pair[1] < _MILLISECONDS)).all()
    ][:1]
    hour, minute, second = (values for _, values in parts)
    time = _HOUR * hour + _MINUTE * minute + second
    for _, values in milliseconds:
        # The seconds may have a fraction of their own, which says the same more coarsely.
        time = np.floor(time) + values / _MILLISECONDS
    dates = [one for name in _DATE_PARTS for one in sheet.all_of(name)[:1]]
    dated = len(dates) == len(_DATE_PARTS)
    used = [heading for heading, _ in (*(dates if dated else ()), *parts, *milliseconds)]
    time = (
        DAY * _days(*(values for _, values in dates)) + time if dated else continue_times(time, DAY, DAY / 2)
    )
    clock = Clock(
        time, " + ".join(one.text for one in used), f"{'years' if dated else 'hours'} to seconds", False
    )
    return _add_leap_second(clock, not dated), used


def _days(year: FloatArray, month: FloatArray, day: FloatArray) -> FloatArray:
    """Return days since 1970; NaN where a part is not of the calendar."""
    fine = (year >= _YEARS[0]) & (year <= _YEARS[1]) & (month >= 1) & (month <= _MONTHS)
    # NaN cannot become a whole number; the rows that are not fine are replaced below.
    months = np.where(fine, _MONTHS * (year - 1970) + month - 1, 0).astype(np.int64)
    # NumPy counts months from 1970, and turns them into days by the calendar.
    first = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64)
    return np.where(fine, first + day - 1, np.nan)


def _of_text(sheet: Sheet, heading: Heading, values: FloatArray) -> Clock:
    """Return time stamps that are text, with the date in a column beside if there is one."""
    text = sheet.texts[heading.text]
    steps = np.diff(values[np.isfinite(values)])
    if _OF_MINUTES.fullmatch(text) and steps.size and np.median(steps) == 0:
        raise MissionError(
            f"{sheet.name}: the time stamps ({heading.text}, such as {text!r}) have no seconds, which a "
            "spreadsheet leaves out as it saves a csv: format the column as hh:mm:ss.000 before saving, or "
            "import the file as the logger wrote it"
        )
    if is_of_hour(text):
        return Clock(continue_times(values, _HOUR, _HOUR / 2), heading.text, "minutes and seconds", False)
    dates = sheet.all_of("date")
    order = _describe_date_order(text) or (
        _describe_date_order(sheet.texts.get(dates[0][0].text, "")) if dates else ""
    )
    of_day = bool(np.nanmax(values) < 2 * DAY)
    if not dates or not of_day:
        # Cells are read in parts, of which each begins at its own midnight.
        time = continue_times(values, DAY, DAY / 2) if of_day else values
        if has_zone(text):  # in UTC it may be of the day before or after
            time = time - DAY * np.floor(time[np.isfinite(time)][0] / DAY)
        return _add_leap_second(Clock(time, heading.text, f"text{order}", False), of_day)
    date, day = dates[0]
    changes = np.ptp(day[np.isfinite(day)]) > 0
    time = date_and_clock(day, values) if changes else day + continue_times(values, DAY, DAY / 2)
    return _add_leap_second(Clock(time, f"{date.text} + {heading.text}", f"text{order}", False), False)


def _add_leap_second(clock: Clock, of_day: bool) -> Clock:
    """Return a clock that counts a leap second, and says so."""
    time, leaps = over_leap_second(clock.time, of_day)
    return clock._replace(time=time, unit=f"{clock.unit} with a leap second") if leaps else clock


def _count_onwards(values: FloatArray, factor: float) -> FloatArray:
    """Return times [s] that go on where a counter begins again: of the day, of the week, of 32 bits.

    Parameters
    ----------
    values
        The times in the unit of the file.
    factor
        That unit [s].
    """
    time = values * factor
    known = np.flatnonzero(np.isfinite(time))
    largest = float(time[known].max())
    # Only values that reach nearly to its end show that there is a period.
    period = next(
        (
            one
            for one in (*(counter * factor for counter in _COUNTERS), DAY, 7 * DAY)
            if LIMITS.turn * one < largest < one
        ),
        0.0,
    )
    if not period or time[known].min() < 0:
        return time
    return continue_times(time, period, (1 - LIMITS.turn) * period)


def _describe_date_order(text: str) -> str:
    """Return what is assumed of the order of day and month; empty where it is known."""
    found = IS_AMBIGUOUS.match(text)
    both = found is not None and int(found[1]) <= _MONTHS and int(found[2]) <= _MONTHS
    return ", where the day is assumed to come before the month" if both else ""


def _guessed_unit(values: FloatArray, fast: bool) -> str:
    size = float(np.median(np.abs(values)))
    steps = np.diff(np.sort(values))
    steps = steps[steps > 0]
    # Rows with one stamp are a batch.
    step = min(float(np.median(steps)), float(np.ptp(values)) / (values.size - 1)) if steps.size else 1.0
    for unit in ("ns", "µs", "ms"):
        factor = UNITS["time"][unit]
        if SINCE_1970 <= size * factor < _END_OF_EPOCH and step * factor < _LONGEST_STEP:
            return unit
    if size >= SINCE_1970 and np.ptp(values) < _LONGEST:
        return "s"
    units = ("s", "ms", "µs", "ns", "days")
    return min(units, key=lambda unit: abs(np.log(step * UNITS["time"][unit] / _USUAL_STEP[fast])))


def offset_that_agrees(imu: FloatArray, gnss: GnssLog, read: Callable[[GnssLog], SensorLog]) -> str:
    """Return a sentence if a log agrees with fixes 18 s earlier or later; empty if it does not.

    Of the two shifts the one is tried that brings the ends of the tables together: by the other a minute has
    less than half of the motion left, which chance may fit.

    Parameters
    ----------
    imu
        Time stamps of the IMU [s].
    gnss
        The fixes, with the stamps of their table.
    read
        Returns the checked log with given fixes, or raises a MissionError.
    """
    shift = -float(np.copysign(LEAP_SECONDS, np.sum(_compare_ends(imu, gnss))))
    try:
        agrees = is_explained(read(replace(gnss, time=gnss.time + shift)))
    except MissionError:
        return ""
    if not agrees:
        return ""
    how, side = ("earlier", "late") if shift < 0 else ("later", "early")
    return (
        f"With the fixes {abs(shift):g} s {how} the log agrees: the stamps of the GPS are {abs(shift):g} s "
        f"{side} relative to the IMU's. One clock is likely to be GPS time and the other UTC, "
        f"{LEAP_SECONDS:g} leap seconds apart; accepted are stamps of one clock"
    )


def describe_ends(imu: FloatArray, gnss: GnssLog) -> str:
    """Return a remark if the fixes begin and end 18 s after the IMU, or both before it; empty if not."""
    begin, end = _compare_ends(imu, gnss)
    if max(abs(abs(one) - LEAP_SECONDS) for one in (begin, end)) >= _NEAR_LEAP or begin * end <= 0:
        return ""
    side = "after" if begin > 0 else "before"
    return (
        f"The fixes begin {abs(begin):.1f} s and end {abs(end):.1f} s {side} the IMU. If both were recorded "
        f"together, one clock is GPS time and the other UTC, {LEAP_SECONDS:g} leap seconds apart: the "
        "motion does not show it. The stamps are used as they are."
    )


def _compare_ends(imu: FloatArray, gnss: GnssLog) -> tuple[float, float]:
    """Return by how much the fixes begin and end after the IMU [s]."""
    fixes = gnss.time[np.isfinite(gnss.time)] - gnss.latency
    return float(fixes[0] - imu[0]), float(fixes[-1] - imu[-1])
