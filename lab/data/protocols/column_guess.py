"""Column guess: the column map of text lines, found in their header or in their numbers.

A header names columns and units, as that of a csv file does, or words between the numbers of each line do
(`lab.data.protocols.labelled_lines`). What they leave open is guessed by the numbers
(`lab.data.protocols.number_guess`). Each guess says so in a remark; where the unit of the rate is one, the
map is in doubt, and the first turn decides (`lab.data.streams.unit_question`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.toml_file import read_toml
from lab.data.files.profile import profile_of
from lab.data.files.unit_names import unit_of
from lab.data.protocols import text_cells
from lab.data.protocols.column_map import (
    CLOCK,
    IGNORED,
    MAX_COLUMNS,
    OF_A_FIX,
    OF_FURTHER,
    SEPARATORS,
    SOURCE,
    VECTORS,
    Column,
    ColumnMap,
    ColumnMapError,
)
from lab.data.protocols.labelled_lines import AXES, PERIODS, labelled_samples
from lab.data.protocols.line_shape import find_header, find_prefix, find_shape, says_little, split_cells
from lab.data.protocols.line_sources import are_devices, find_alternating_sources, is_source
from lab.data.protocols.number_guess import (
    FINE,
    GROWS,
    MIN_LINES,
    columns_by_numbers,
    is_believed,
    time_column,
    unit_of_steps,
    with_units,
)
from lab.data.protocols.text_cells import IS_CELL, cells_in
from lab.data.sheets.column_names import given_heading, heading_of

_STREAMED = (
    ("count", "", re.compile(r"count|counter|sample|n|index")),
    ("temperature", "", re.compile(r"temp|temperature|t imu")),
    ("pressure", "pressure", re.compile(r"pres|baro")),
    # A heading without a word is often magnetic, and a speed that of a receiver: both have to be said.
    ("heading", "angle", re.compile(r"true heading|heading true")),
    ("speed", "speed", re.compile(r"(?:wheel|odo|odometer) ?speed|odo|odometer")),
    *((name, kind, re.compile(name.replace("_", " "))) for name, kind in OF_FURTHER.items()),
)
"""Names of what only streams have, each with the kind of its unit."""
_SHARED = {
    "time": "time", "seconds": "time", "fraction": "fraction", "clock": "time", "rate": "rate",
    "force": "force", "field": "magnetic", "pressure": "pressure", "height": "altitude",
    **{one: one for one in OF_A_FIX},
}  # fmt: skip
"""What the quantities are called here whose headings csv files share (`lab.data.sheets.column_names`)."""
_MOVES = re.compile(r"(?i)[a-z][ _]?[xyz]$|yaw|pitch|roll|heading|angle|course|quat")
"""Headings of what may grow evenly while a device turns: of these, only whole numbers are times."""
_LARGEST = 1e30
"""Number from which one is damaged; nanoseconds since 1970 are 1.7e18, and squares must not overflow."""
_KNOWN = tuple(
    (re.compile(one["pattern"]), ColumnMap.of(one["map"]), one["whose"])
    for one in read_toml(Path(__file__).with_name("known_lines.toml"))["lines"]
)
"""Lines that their begin shows: a pattern, the map, and whose they are."""


def guess_columns(
    lines: Sequence[str], said: Mapping[str, str] | None = None, whole: bool = False
) -> ColumnMap | None:
    """Return the column map of lines; None if they do not show it.

    Parameters
    ----------
    lines
        Whole lines, without their ends; the header, if they have one, among them.
    said
        What a person says of columns, by heading or by number from 1: ``force_x[g]``, or ``-`` for one that
        is not read.
    whole
        Whether no more lines will come.

    Raises
    ------
    ColumnMapError
        If what is said is no column.
    """
    said = {heading: str(Column.of(text)) for heading, text in (said or {}).items()}
    for pattern, columns, whose in () if said else _KNOWN:
        is_whole = all(any(line.startswith(first) for line in lines) for first, *_ in columns.texts)
        if is_whole and sum(pattern.match(line) is not None for line in lines) >= PERIODS:
            return replace(columns, remarks=(f"{whose}.",))
    if not said and text_cells.have_decimal_commas(lines):
        return None  # which comma ends a number is not known
    try:
        return _of_separated(lines, said, whole) or _map_labelled(lines, said, whole)
    except _MoreLinesError:
        return None


class _MoreLinesError(Exception):
    """More lines show whether these are of several devices."""


def _of_separated(lines: Sequence[str], said: Mapping[str, str], whole: bool) -> ColumnMap | None:
    """Return the map of lines of cells with separators."""
    # A network may deliver each line twice.
    lines = [line for line, before in zip(lines, ("", *lines), strict=False) if line != before]
    shape = find_shape(lines)
    if shape is None:
        return None
    count = shape.rows.shape[1]
    headings = find_header(lines, shape.separator, count) or [""] * count
    remarks: list[str] = []
    columns = _map_by_profile(headings, remarks) or name_columns(headings, remarks)
    columns = _apply_said(columns, headings, said)
    if shape.prefix and not shape.prefix.endswith((shape.separator, "=", ":")):
        headings[0] = headings[0] or shape.prefix  # such as IMU before the number of the device
    form = shape.separator, shape.prefix, shape.comma
    if shape.others:
        begin = ", ".join(map(repr, shape.others))
        remarks.append(f"Lines that begin with {begin}, as of another device, are not read.")
    numbers = headings, shape.rows, shape.clocks, shape.cells
    return _map_columns(columns, *numbers, remarks, whole, *form)


def _map_labelled(lines: Sequence[str], said: Mapping[str, str], whole: bool) -> ColumnMap | None:
    """Return the map of lines with words between the numbers, if there is one with rates and forces."""
    first = None
    for sample in labelled_samples(lines):
        remarks: list[str] = []
        columns = _apply_said(name_columns(sample.headings, remarks, sample.others), sample.headings, said)
        cells = [[f"{value:g}" for value in row] for row in sample.rows]
        numbers = sample.headings, sample.rows, sample.clocks, cells
        found = _map_columns(
            columns, *numbers, remarks, whole, texts=sample.texts, guessed=not sample.is_named
        )
        if found is not None and {"rate_x", "force_x"} <= _names(found.columns):
            return found
        first = first or found
    return first


def _apply_said(columns: list[Column], headings: Sequence[str], said: Mapping[str, str]) -> list[Column]:
    """Return the columns with what a person says of them, by heading or number, in place of a guess."""
    given = {
        place: Column.of(text)
        for place, heading in enumerate(headings)
        if (text := said.get(heading) or said.get(str(place + 1)))
    }
    taken = {column.quantity for column in given.values()}
    return [
        given.get(place) or (Column() if column.quantity in taken else column)
        for place, column in enumerate(columns)
    ]


def _map_by_profile(headings: Sequence[str], remarks: list[str]) -> list[Column] | None:
    """Return the columns by the profile of a maker; None if none has these headings."""
    try:
        profile = profile_of("the stream", headings)
        if profile is None:
            return None
        given = [
            given_heading(profile.columns[one], one) if one in profile.columns else None for one in headings
        ]
    except MissionError:
        return None
    if any(one is not None and one.sign < 0 for one in given):
        return None
    remarks.append(f"The headings are those of {profile.name}. {' '.join(profile.remarks)}".strip())
    columns = []
    for one in given:
        ours = "" if one is None else _SHARED.get(one.quantity, "")
        if one is None or not ours:
            columns.append(Column())
        else:
            name = f"{ours}_{one.axis}" if one.axis else ours
            columns.append(Column(name, one.unit or profile.defaults.get(one.quantity, "")))
    return columns


def _map_columns(
    columns: list[Column],
    headings: Sequence[str],
    rows: FloatArray,
    clocks: Sequence[bool],
    cells: list[list[str]],
    remarks: list[str],
    whole: bool,
    separator: str = ",",
    prefix: str = "",
    comma: bool = False,
    texts: tuple[tuple[str, ...], ...] = (),
    guessed: bool = True,
) -> ColumnMap | None:
    """Return the map of columns that are named, or else of their numbers; None if neither shows an IMU.

    Where the lines are of several devices, it is that of one of them.
    """
    rows = np.where(np.abs(rows) < _LARGEST, rows, np.nan)
    said = next((at for at, column in enumerate(columns) if column.quantity == SOURCE), None)
    if said is not None:
        rows = rows[[is_source(line[said], columns[said].unit) for line in cells]]
    for sources in () if said is not None else find_alternating_sources(cells, columns):
        first, other, *_ = sources.names
        mine = list(columns)
        mine[sources.place] = Column(SOURCE, first)
        part = rows[[is_source(line[sources.place], first) for line in cells]]
        one = _columns(mine, headings, part, clocks, [], guessed) or []
        read = [at for at, column in enumerate(one) if column.kind in ("rate", "force")]
        if (are := are_devices(sources, cells, headings, rows[:, read])) is None and not whole:
            raise _MoreLinesError
        if are and not sources.is_written:
            return None
        if are:
            columns, rows = mine, part
            remarks.append(
                f"The lines are of {len(sources.names)} devices, which column {sources.place + 1} tells "
                f"apart, and only those of {first} are read. "
                f"--column '{sources.place + 1}=source[{other}]' reads those of {other}."
            )
            break
    found = _columns(columns, headings, rows, clocks, remarks, guessed)
    if found is None:
        return None
    found, doubt = with_units(found, rows, remarks)
    try:
        return ColumnMap(tuple(found), separator, prefix, comma, tuple(dict.fromkeys(remarks)), texts, doubt)
    except ColumnMapError:
        return None


def _columns(
    columns: list[Column],
    headings: Sequence[str],
    rows: FloatArray,
    clocks: Sequence[bool],
    remarks: list[str],
    guessed: bool,
) -> list[Column] | None:
    """Return the columns, by their names or else by their numbers; None if neither shows an IMU."""
    named_ones = _drop_incomplete_vectors(_add_time_column(columns, headings, rows, clocks, remarks))
    if len(rows) < MIN_LINES and "time" not in _names(named_ones):
        free = [at for at, column in enumerate(named_ones) if column.quantity == IGNORED]
        if (np.diff(rows[:, free], axis=0) > 0).all(axis=0).any():
            return None  # more lines show whether it is a time
    if any(column.kind in ("rate", "force") for column in named_ones):
        return named_ones
    there = _names(named_ones)
    placed = named_ones if "latitude" in there else None
    if len(rows) < MIN_LINES or not guessed:
        return placed
    numbers = rows.copy()
    numbers[:, [column.quantity != IGNORED for column in named_ones]] = np.nan
    why: list[str] = []
    found = columns_by_numbers(numbers, why)
    read = rows[:, [one.kind in ("rate", "force") for one in found]]
    # Angles and the parts of a quaternion may be as long as 1 g; so may the numbers of a covariance beside a
    # position, which do not change.
    if "rate_x" not in _names(found) or (placed and not (np.diff(read, axis=0) != 0).any()):
        return placed
    remarks += why
    return [
        known
        if known.quantity != IGNORED
        else Column()
        if one.quantity in there or (one.quantity == "count" and "time" in there)
        else Column("time", CLOCK)
        if one.quantity == "time" and clocks[at]
        else one
        for at, (known, one) in enumerate(zip(named_ones, found, strict=True))
    ]


def _drop_incomplete_vectors(columns: Sequence[Column]) -> list[Column]:
    """Return the columns without those of vectors that lack an axis, and of a place that is none."""
    axes = Counter(column.kind for column in columns if column.kind in VECTORS)
    there = _names(columns)
    left_out = {kind for kind, count in axes.items() if count < AXES}
    left_out |= set() if set(OF_A_FIX[:2]) <= there else set(OF_A_FIX)
    left_out |= set() if set(OF_A_FIX[3:5]) <= there else set(OF_A_FIX[3:])
    return [Column() if column.kind in left_out else column for column in columns]


def _add_time_column(
    columns: list[Column],
    headings: Sequence[str],
    rows: FloatArray,
    clocks: Sequence[bool],
    remarks: list[str],
) -> list[Column]:
    """Return the columns with a time that increases; without a heading, it is found by its steps."""
    columns = list(columns)
    place = next((at for at, column in enumerate(columns) if column.quantity == "time"), None)
    if place is not None:
        steps = np.diff(rows[:, place])
        if clocks[place]:
            columns[place] = Column("time", CLOCK)
        elif columns[place].unit == FINE and steps.size and not is_believed(1e-4 * float(np.median(steps))):
            columns[place] = Column("time", unit_of_steps(float(np.median(steps))) or FINE)
        if len(rows) < PERIODS or np.mean(steps > 0) > GROWS or "fraction" in _names(columns):
            return columns
        columns[place] = Column()
        remarks.append(f"time: column {place + 1} does not increase from line to line, and is not read.")
    if len(rows) < MIN_LINES:
        return columns
    free = [at for at, column in enumerate(columns) if column.quantity == IGNORED]
    # What has a name that is none of a time counts, if it increases by one.
    free = [at for at in free if not headings[at].strip() or (np.diff(rows[:, at]) != 1).any()]
    free = [at for at in free if not _MOVES.search(headings[at]) or (rows[:, at] % 1 == 0).all()]
    found = time_column(rows, remarks, free)
    if found is not None:
        columns[found[0]] = Column("time", CLOCK) if clocks[found[0]] else found[1]
    return columns


def _names(columns: Sequence[Column]) -> set[str]:
    return {column.quantity for column in columns}


def advice_on_lines(lines: Sequence[str]) -> str:
    """Return a sentence on text whose columns are not recognised: its last lines, and what names them.

    Parameters
    ----------
    lines
        The last lines; without any, there is nothing to say.
    """
    if not lines:
        return ""
    cells = cells_to_name(lines)
    shown = "\n".join(f"  {line}" for line in lines)
    if len(cells) < AXES:
        return f"The last lines are:\n{shown}\nNone has three numbers."
    return (
        f"The last lines are:\n{shown}\nThey have {len(cells)} columns, {', '.join(cells)}. Say what these "
        "are: --column '1=QUANTITY[UNIT]' --column '2=…' and so on, such as --column '1=force_x[g]'."
    )


def cells_to_name(lines: Sequence[str]) -> tuple[str, ...]:
    """Return the numbers of the last line with most of them, for a person who names what they are.

    Parameters
    ----------
    lines
        The last lines of a text whose columns are not recognised.
    """
    best: list[str] = []
    for line in reversed(lines):
        for separator in SEPARATORS.values():
            cells = split_cells(line[len(find_prefix(line, separator)) :], separator)
            if all(says_little(cell, separator) for cell in cells) and len(cells) > max(len(best), AXES - 1):
                best = cells
        if not best and len(cells_in(line).kinds) >= AXES:
            best = [cell[0] for cell in IS_CELL.finditer(line) if cell.lastgroup != "name"]
    return tuple(best[:MAX_COLUMNS])


def name_columns(headings: Sequence[str], remarks: list[str], others: Sequence[str] = ()) -> list[Column]:
    """Return columns by their headings; a unit that is not named is left open.

    Parameters
    ----------
    headings
        The headings.
    remarks
        Gets a sentence on each column.
    others
        Headings in place of those that name nothing, such as ``x (rad/s)``.
    """
    found = [_quantity(heading) for heading in headings]
    for place, heading in enumerate(others):
        if found[place][0] == IGNORED and heading:
            found[place] = _quantity(heading)
    best: dict[str, int] = {}  # the place of the best column of each quantity
    for place, (quantity, _unit_name, rank) in enumerate(found):
        if quantity != IGNORED and (quantity not in best or rank < found[best[quantity]][2]):
            best[quantity] = place
    for quantity, place in sorted(best.items(), key=lambda item: item[1]):
        alike = sum(found[place] == one for one in found) if quantity in ("force_x", "rate_x") else 1
        more = f"; {alike - 1} more of it, as of another device, are not read" if alike > 1 else ""
        remarks.append(f"{quantity}: the heading is {headings[place]!r}{more}.")
    return [
        Column(quantity, unit) if best.get(quantity) == place else Column()
        for place, (quantity, unit, _rank) in enumerate(found)
    ]


def _quantity(heading: str) -> tuple[str, str, int]:
    """Return the quantity, unit and rank of a heading; the lowest rank is the best of one quantity."""
    stem, _, unit = heading.rstrip(")] ").replace("[", "(").partition("(")
    name = stem.replace("_", " ").strip().lower()
    for quantity, kind, pattern in _STREAMED:
        if pattern.fullmatch(name):
            return quantity, unit_of(kind, unit) if kind else "", 0
    named = heading_of(heading)
    if named is None or named.quantity not in _SHARED:
        return "-", "", 0
    ours = _SHARED[named.quantity]
    return f"{ours}_{named.axis}" if named.axis else ours, named.unit, named.rank
