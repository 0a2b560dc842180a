"""Sheet blocks: the tables of one file: under headers of their own, or under one that is repeated.

A logger that appends to its file repeats the header at each start; some write the IMU and the receiver below
each other. Rows under an equal header are one sheet while their time goes on.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace

import numpy as np

from lab.base.files.mission_error import MissionError
from lab.data.clock.faults import is_regular
from lab.data.files.profile import Profile
from lab.data.sheets.sheet import Sheet, read_sheet, sheet_below
from lab.data.sheets.sheet_cells import name_of_code
from lab.data.sheets.sheet_clock import find_clock
from lab.data.sheets.sheet_layout import HEAD, Layout, Overrides, find_layout

_TITLED = re.compile(rb"\n[ \t\"'#%/]*[A-Za-z_][^\n]*")
"""A line that begins with a word, and the end of the one before, by which lines are found quickly."""
_TIMED = re.compile(rb"(?i)time|stamp|utc|date|sec|milli|micro|clock|epoch|tow|cts|\b(?:t|ms|us|gmt)\b")
"""What a header has in it that names a time."""
_MAX_TRIED = 2000
"""Most lines with a word of time that are looked at, and are no header: each takes 50 µs."""
_TIMES = {"time", "seconds", "clock", "date"}
_MIN_QUANTITIES = 3
"""Fewest quantities that a further header names: time, and two more."""
MAX_BLOCKS = 1000
"""Most headers in a file."""
_MAX_LATE = 2.0
"""Displacement of a row in time from which whole rows are sorted [s]; `lab.data.sheets.sheet_imu.in_order`
sorts what is less."""
_MAX_INSTANCES = 16
"""Most sensors of a kind whose samples lie in one table; more numbers are those of rows."""
_MIN_TRACK = 4
"""Fewest rows of a sensor or a vehicle: numbers with fewer are those of rows."""
_SHUFFLED = 0.1
"""Part of the rows that are earlier than the one before, from which rows are shuffled; of recordings that lie
over each other, as after a clock was set back, there are few."""


def read_sheets(name: str, data: bytes, overrides: Overrides | None = None) -> list[Sheet]:
    """Return the tables of a file, those below each other under equal headers as one.

    Parameters and errors are those of `lab.data.sheets.sheet.read_sheet`.
    """
    blocks = _headers(name, data, overrides or {})
    if len(blocks) < 2:
        found = read_sheet(name, data, overrides)
        return [] if found is None else [found]
    sheets: dict[tuple[str, ...], list[Sheet]] = {}
    for start, below, end, layout in _add_ends(blocks, data):
        rows = sheet_below(name, data[below:end], layout)
        if len(rows):
            line = data.count(b"\n", 0, start) + 1
            named = replace(rows, name=f"{name} from line {line}" if sheets else name)
            sheets.setdefault(layout.headings, []).append(named)
    return [_join_sheets(parts) for parts in sheets.values()]


def recordings_in(name: str, data: bytes, profile: Profile) -> list[Sheet]:
    """Return the tables of a simulator's or a flight deck's file under their headers, with their lines.

    Parameters
    ----------
    name
        Name of the file.
    data
        Its bytes, in UTF-8.
    profile
        What its columns are.

    Raises
    ------
    MissionError
        If the rows cannot be read.
    """
    first = find_layout(data[:HEAD], name, profile=profile)
    if first is None:
        return []
    start = 0
    for _ in range(first.line + 1):
        start = data.find(b"\n", start) + 1 or len(data)
    further = _headers(name, data, {}, profile, start)
    if len(further) == MAX_BLOCKS:
        raise MissionError(f"more than {MAX_BLOCKS} headers; accepted is one flight")
    found, line = [], 1
    for begin, below, end, layout in _add_ends([(0, start, first), *further], data):
        found.append(sheet_below(name, data[below:end], layout, line + data.count(b"\n", begin, below)))
        line += data.count(b"\n", begin, end)
    return found


def _add_ends(
    blocks: Sequence[tuple[int, int, Layout]], data: bytes
) -> Iterator[tuple[int, int, int, Layout]]:
    """Yield where headers and the rows below begin, where these end, and what the header says."""
    ends = [start for start, _, _ in blocks[1:]] + [len(data)]
    for (start, below, layout), end in zip(blocks, ends, strict=True):
        yield start, below, end, layout


def _headers(
    name: str, data: bytes, overrides: Overrides, profile: Profile | None = None, begin: int = 0
) -> list[tuple[int, int, Layout]]:
    """Return where headers with rows below begin and end, from a place on, and what they say."""
    found: list[tuple[int, int, Layout]] = []
    tried = 0
    for start, end in _find_titles(data, begin):
        line = data[start:end]
        if not _TIMED.search(line):
            continue
        tried += 1
        if tried > _MAX_TRIED + len(found):
            break
        layout = find_layout(line, name, overrides, profile) if len(line) <= HEAD else None
        if layout is None or layout.line < 0:
            continue
        quantities = {one.quantity for one in layout.known if one is not None}
        if profile is None and (layout.worth < _MIN_QUANTITIES or not quantities & _TIMES):
            continue
        if profile is None and found and not data[found[-1][1] : start].strip():
            continue  # a row of units
        found.append((start, end + 1, layout))
        if len(found) == MAX_BLOCKS:
            break
    return found


def _find_titles(data: bytes, begin: int) -> Iterator[tuple[int, int]]:
    """Yield begin and end of the lines that begin with a word, from a place on."""
    if not begin and _TITLED.match(b"\n" + data[:HEAD]):
        end = data.find(b"\n")
        yield 0, end if end >= 0 else len(data)
    for match in _TITLED.finditer(data, max(begin - 1, 0)):
        yield match.start() + 1, match.end()


def _join_sheets(parts: list[Sheet]) -> Sheet:
    """Return sheets under equal headers as one, with the columns that all of them have."""
    if len(parts) == 1:
        return parts[0]
    texts = [one.text for one in parts[0].headings]
    common = [
        text for text in texts if all(text in {one.text for one in part.headings} for part in parts[1:])
    ]
    places = [{one.text: place for place, one in enumerate(part.headings)} for part in parts]
    columns = [
        np.concatenate([part.columns[place[text]] for part, place in zip(parts, places, strict=True)])
        for text in common
    ]
    return replace(
        parts[0],
        headings=tuple(one for one in parts[0].headings if one.text in common),
        columns=tuple(columns),
        odd_stamps={text: cell for part in parts for text, cell in part.odd_stamps.items()},
        remarks=tuple(dict.fromkeys(remark for part in parts for remark in part.remarks)),
        restarts=tuple(int(row) for row in np.cumsum([len(part) for part in parts])[:-1]),
    )


def one_recording(sheets: Sequence[Sheet]) -> list[Sheet]:
    """Return sheets with the rows of the longest of several recordings, where the time begins again.

    Sheets with as many recordings were started together, and have the same one.
    """
    if not any(sheet.restarts for sheet in sheets):
        return list(sheets)
    starts = [_find_starts(sheet) for sheet in sheets]
    chosen: dict[int, int] = {}
    order = sorted(range(len(sheets)), key=lambda i: not sheets[i].all_of("rate"))
    for i in order:
        if len(starts[i]) > 1:
            lengths = np.diff([*starts[i], len(sheets[i])])
            chosen.setdefault(len(starts[i]), int(np.argmax(lengths)))
    return [
        _cut_sheet(sheet, begun, chosen[len(begun)]) if len(begun) > 1 else sheet
        for sheet, begun in zip(sheets, starts, strict=True)
    ]


def _find_starts(sheet: Sheet) -> list[int]:
    """Return the rows at which recordings begin: a header is repeated, and the time is earlier."""
    starts = [0]
    if not sheet.restarts:
        return starts
    clock = find_clock(sheet, sheet.has_imu)
    if clock is None:
        return starts
    time = clock.time
    for row in sheet.restarts:
        before, after = (part[np.isfinite(part)] for part in (time[starts[-1] : row], time[row:]))
        if before.size and after.size and after[0] < before.max():
            starts.append(row)
    return starts


def _cut_sheet(sheet: Sheet, starts: Sequence[int], which: int) -> Sheet:
    begin, end = [*starts, len(sheet)][which : which + 2]
    remark = (
        f"{sheet.name} has {len(starts)} recordings, each under its own header, whose times begin again: "
        f"recording {which + 1}, the longest, is read ({end - begin} of {len(sheet)} rows)."
    )
    return sheet.of_rows(slice(begin, end), remark)


def in_time_order(sheet: Sheet) -> Sheet:
    """Return a sheet with its rows in order of time: they may be reversed, shuffled or of a ring buffer."""
    clock = find_clock(sheet, sheet.has_imu, ordered=False)
    if clock is None:
        return sheet
    known = np.flatnonzero(np.isfinite(clock.time))
    time = clock.time[known]
    if time.size < 2 or (np.maximum.accumulate(time) - time).max() <= _MAX_LATE:
        return sheet
    # Equal stamps of reversed rows stay reversed.
    falls = np.diff(time) < 0
    backwards = not (np.diff(time) > 0).any()
    order = np.arange(time.size)[::-1] if backwards else np.argsort(time, kind="stable")
    shuffled = falls.mean() > _SHUFFLED and is_regular(time[order])
    # Stretches that go forward, and do not lie over each other, may stand in any order.
    starts = np.flatnonzero(np.append(True, falls))
    begin, end = time[starts], time[np.append(starts[1:] - 1, time.size - 1)]
    by_begin = np.argsort(begin, kind="stable")
    apart = (end[by_begin][:-1] <= begin[by_begin][1:]).all()
    if not backwards and not shuffled and not apart:
        return sheet
    what = "in reverse order" if backwards else f"out of order at {int(falls.sum())} places"
    remark = f"The rows of {sheet.name} were {what} and were sorted by {clock.column}."
    return sheet.of_rows(known[order], remark)


_VELOCITY = ("north", "east", "down", "up", "speed", "course", "speed_sigma")
"""What a table of velocities has for one of positions."""
_MAX_APART = 3.0
"""Longest interval of velocities between which one is interpolated, over the usual one."""
_COVERED = 0.5
"""Part of the positions that must have a velocity: tables of another clock have none in common."""


def with_velocities(sheets: Sequence[Sheet]) -> list[Sheet]:
    """Return sheets, that of the positions with the velocities of another one if it has none itself.

    Courses are those of the nearest row, since they may be in any unit.
    """
    places = [one for one in sheets if one.all_of("latitude") and one.all_of("longitude")]
    bare = [one for one in places if not any(one.all_of(name) for name in _VELOCITY)]
    others = [one for one in sheets if one not in places and has_velocity({h.quantity for h in one.headings})]
    if len(bare) != 1 or len(places) != 1 or len(others) != 1:
        return list(sheets)
    (place,), (other,) = bare, others
    clock, theirs = find_clock(place, fast=False), None
    if clock is not None and not other.has_imu:
        theirs = find_clock(other, fast=False, wanted=[one.text for one in place.headings])
    if clock is None or theirs is None:
        return list(sheets)
    known = np.flatnonzero(np.isfinite(theirs.time))
    rows = known[np.argsort(theirs.time[known], kind="stable")]
    time = theirs.time[rows]
    after = np.clip(np.searchsorted(time, clock.time), 1, max(time.size - 1, 1))
    if time.size < _MIN_TRACK or np.isnan(clock.time).all():
        return list(sheets)
    step = np.diff(time)
    near = (clock.time >= time[0]) & (clock.time <= time[-1])
    near &= step[after - 1] <= _MAX_APART * float(np.median(step))
    nearest = rows[after - (clock.time - time[after - 1] < time[after] - clock.time)]
    headings, columns = list(place.headings), list(place.columns)
    for heading, values in zip(other.headings, other.columns, strict=True):
        if heading.quantity in _VELOCITY:
            is_angle = heading.quantity == "course"
            at = values[nearest] if is_angle else np.interp(clock.time, time, values[rows])
            headings.append(heading)
            columns.append(np.where(near, at, np.nan))
    if near.mean() < _COVERED:
        return list(sheets)
    remark = f"The velocities of {other.name} are taken at the times of the positions of {place.name}."
    joined = replace(
        place, headings=tuple(headings), columns=tuple(columns), remarks=(*place.remarks, remark)
    )
    return [joined if one is place else one for one in sheets]


def has_velocity(quantities: AbstractSet[str]) -> bool:
    """Return whether quantities are of a velocity over ground."""
    return {"north", "east"} <= quantities or {"speed", "course"} <= quantities


def of_one_instance(sheet: Sheet) -> Sheet:
    """Return a sheet with the rows of one of the sensors, or of the vehicles, of that with most rows."""
    for heading, values in (*sheet.all_of("craft"), *sheet.all_of("instance")):
        numbers, first, counts = np.unique(values[np.isfinite(values)], return_index=True, return_counts=True)
        most = _MAX_INSTANCES if heading.quantity == "instance" else values.size
        if not 1 < numbers.size <= most or (numbers % 1 != 0).any() or counts.max() < _MIN_TRACK:
            continue
        # The I of some phones' tables is the light, which changes seldom: sensors take turns.
        if heading.text.strip() == "I" and 2 * np.count_nonzero(np.diff(values)) < values.size - counts.max():
            continue
        taken = numbers[np.lexsort((first, -counts))[0]]
        rows = np.flatnonzero(values == taken)
        if heading.quantity == "craft" and any(
            np.isfinite(column).any() and not np.isfinite(column[rows]).any() for column in sheet.columns
        ):
            continue  # its rows are of one kind of sensor
        others = [name_of_code(number) for number in numbers if number != taken]
        more = f" or one of {len(others) - _MAX_INSTANCES} more" if len(others) > _MAX_INSTANCES else ""
        remark = (
            f"{sheet.name}: {heading.text} is {name_of_code(taken)} in the rows that are read, and not "
            f"{', '.join(others[:_MAX_INSTANCES])}{more}."
        )
        return sheet.of_rows(rows, remark, tuple(np.searchsorted(rows, sheet.restarts).tolist()))
    return sheet
