"""Flight columns: the columns of a simulator's or a flight deck's csv in SI units, and the rows left out.

Rows that cannot be used are left out and counted. Of several recordings in one file, each under its own
header, the longest is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.bounds import HEIGHTS, LATITUDES, MAX_SPEED, MIN_SAMPLES
from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.files.fields import GIVEN
from lab.data.files.profile import Profile, plain
from lab.data.files.unit_names import UNITS, refuse_unknown, unit_of
from lab.data.rebuild.raw_flight import ColumnUnit, Dropped, RawFlight
from lab.data.sheets.column_names import Heading
from lab.data.sheets.sheet import Sheet, sheet_below
from lab.data.sheets.sheet_blocks import recordings_in
from lab.data.sheets.sheet_cells import MISSING, NO_NUMBER
from lab.data.sheets.sheet_layout import (
    MAX_HEADER_LINE,
    MAX_IN_PROFILE,
    Layout,
    as_utf8,
    columns_by_profile,
    find_layout,
)

OTHER_RECORDING = "of another recording in the same file"
"""Why rows are dropped under a header that is not that of the longest recording."""
_MAX_NAMED = 12
"""Most headings for one need that a message names."""
_MAX_TIME = 1e12
"""Largest time stamp [s]: counts from the year 0 are 6e10 s."""
_MAX_OFFSET = 1e7
"""Largest coordinate in a Cartesian frame, local or fixed to the Earth [m]: its radius is 6.4e6 m."""
_MAX_ANGLE = 1e4
"""Largest angle [rad]: headings that count turns, of 1600 and more."""
_MAX_RATE = 200.0
"""Largest angular rate [rad/s]: 11 000 °/s, five times what gyros of vehicles measure."""
_MAX_ACCELERATION = 1e4
"""Largest acceleration [m/s²]: a thousand g, more than accelerometers of vehicles measure."""

LIMITS = {
    "time": (-_MAX_TIME, _MAX_TIME),
    "latitude": (float(np.radians(LATITUDES[0])), float(np.radians(LATITUDES[1]))),
    "depth": (-HEIGHTS[1], -HEIGHTS[0]),
    **dict.fromkeys(("ecef", "local"), (-_MAX_OFFSET, _MAX_OFFSET)),
    "angle": (-_MAX_ANGLE, _MAX_ANGLE),
    "length": HEIGHTS,
    "speed": (-MAX_SPEED, MAX_SPEED),
    "angular rate": (-_MAX_RATE, _MAX_RATE),
    "acceleration": (-_MAX_ACCELERATION, _MAX_ACCELERATION),
}
"""Range accepted for each kind of quantity, or for single ones [SI]."""


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns of one file in SI units, by quantity and axis.

    Attributes
    ----------
    values : dict
        The numbers of each column.
    rows_read, dropped, remarks
        As `RawFlight` has them.
    units : dict
        The unit each was read in.
    others : dict
        The other unit of those whose profile leaves it to the numbers.
    written : dict
        Units as the line above the headings writes them.
    lines : (n,) array
        The line of each row.
    """

    values: dict[str, FloatArray]
    rows_read: int
    dropped: tuple[Dropped, ...]
    units: dict[str, ColumnUnit]
    others: dict[str, str]
    written: dict[str, str]
    remarks: tuple[str, ...]
    lines: NDArray[np.int32]

    def get(self, key: str) -> FloatArray | None:
        """Return a column, or None if the file does not have it."""
        return self.values.get(key)

    def vector(self, *keys: str) -> FloatArray | None:
        """Return columns side by side; a minus sign before a key negates it. None if one is missing."""
        if not all(key.lstrip("-") in self.values for key in keys):
            return None
        return np.column_stack(
            [-self.values[key[1:]] if key.startswith("-") else self.values[key] for key in keys]
        )


def recognises_header(head: bytes, profile: Profile) -> bool:
    """Return whether the first bytes of a file hold a header with the headings of a profile."""
    return find_layout(as_utf8(head), "", profile=profile) is not None


def read_columns(path: Path, profile: Profile, units: Mapping[str, str], delimiter: str = "") -> Columns:
    """Read the columns of a file that a profile names.

    A column that is not needed and holds numbers in less than half of the rows counts as absent. Columns of
    words, such as dates, keep the rows in which they are unknown.

    Parameters
    ----------
    path
        The file, gzip-compressed or not.
    profile
        What its columns are.
    units
        Units that overrule those of the profile, by column as in the file.
    delimiter
        What separates the cells of a file without a header, whose columns are those of the profile.

    Raises
    ------
    MissionError
        For whatever is wrong with the file or the units.
    """
    data = as_utf8(read_whole(path, MAX_BYTES))
    try:
        sheets = (
            _read_headless(data, profile, delimiter) if delimiter else recordings_in(path.name, data, profile)
        )
    except MissionError as error:
        raise MissionError(f"{path}: {error}") from error
    if not sheets:
        needs = ", ".join(" or ".join(need) for need in profile.needs)
        raise MissionError(
            f"{path}: no header within the first {MAX_HEADER_LINE} lines; accepted is one with {needs} among "
            f"at most {MAX_IN_PROFILE} columns"
        )
    sheet = max(sheets, key=len)
    assert sheet.rows is not None
    table = _usable_table(path, sheet, profile)
    others = [one.rows for one in sheets if one is not sheet and one.rows and one.rows.read]
    dropped = list(table.dropped)
    if others:
        dropped.append(Dropped(OTHER_RECORDING, sum(one.read for one in others), others[0].first))
    rows_read = sum(one.rows.read for one in sheets if one.rows)
    if len(table.lines) < MIN_SAMPLES:
        raise MissionError(_too_few(path, len(table.lines), rows_read, dropped))
    return _in_si(path, table, units, rows_read, dropped)


def _read_headless(data: bytes, profile: Profile, delimiter: str) -> list[Sheet]:
    headings = tuple(profile.columns)
    layout = Layout(-1, delimiter, headings, columns_by_profile(headings, profile), profile)
    return [sheet_below("", data, layout, 1)]


@dataclass(frozen=True)
class _Table:
    """The best column of each quantity, in rows without a cell that is unknown."""

    headings: list[Heading]
    columns: list[FloatArray]
    lines: NDArray[np.int32]
    dropped: list[Dropped]
    remarks: list[str]


def _usable_table(path: Path, sheet: Sheet, profile: Profile) -> _Table:
    assert sheet.rows is not None
    lost, lines = dict(sheet.rows.lost), sheet.rows.lines
    columns = [np.where(np.isfinite(one), one, np.nan) for one in sheet.columns]
    essential = {next(iter(need)) for need in profile.needed if len(need) == 1}
    kept = np.ones(len(lines), dtype=bool)
    for heading, column in zip(sheet.headings, columns, strict=True):
        if plain(heading.text) in essential and heading.kind:
            kept &= ~np.isnan(column)
    found: dict[str, tuple[Heading, FloatArray]] = {}
    remarks = list(sheet.remarks)
    for heading, column in sorted(zip(sheet.headings, columns, strict=True), key=lambda one: one[0].rank):
        if heading.kind and 2 * np.isnan(column[kept]).sum() > kept.sum():
            remarks.append(f"Column {heading.text} is left out: most of its cells are empty or no numbers.")
        else:
            found.setdefault(heading.key, (heading, column))
    for heading, column in found.values():
        if heading.kind:
            kept &= ~np.isnan(column)
    if not kept.all():
        count, line = lost[NO_NUMBER]
        first = int(lines[np.argmin(kept)])
        lost[NO_NUMBER] = (count + int((~kept).sum()), min(line or first, first))
    remarks += [
        f"Column {text} is there more than once: the first is taken."
        for text in sheet.unknown
        if any(plain(text) == plain(one.text) for one in sheet.headings)
    ]
    dropped = [Dropped(reason, *lost[reason]) for reason in (MISSING, NO_NUMBER) if lost[reason][0]]
    there = {plain(one.text) for one, _ in found.values()}
    if kept.sum() >= MIN_SAMPLES and (missing := [need for need in profile.needed if need.isdisjoint(there)]):
        names = " or ".join(sorted(missing[0])[:_MAX_NAMED])
        raise MissionError(f"{path}: hardly a row has a number under {names}; accepted are most")
    return _Table(
        [heading for heading, _ in found.values()],
        [column if kept.all() else column[kept] for _, column in found.values()],
        lines[kept],
        dropped,
        remarks,
    )


def _too_few(path: Path, usable: int, rows_read: int, dropped: Sequence[Dropped], advice: str = "") -> str:
    why = "; ".join(f"{drop.count} left out from row {drop.first_row} on: {drop.reason}" for drop in dropped)
    return (
        f"{path}: {usable} of {rows_read} rows of samples can be used{f' ({why})' if why else ''}; accepted "
        f"are at least {MIN_SAMPLES}{advice}"
    )


def _in_si(
    path: Path, table: _Table, units: Mapping[str, str], rows_read: int, dropped: list[Dropped]
) -> Columns:
    """Return columns in SI units, without the rows with numbers that no flight has."""
    used = {plain(one.text): one.text for one in table.headings if one.kind}
    given = {plain(column): unit for column, unit in units.items()}
    refuse_unknown(path, {used.get(plain(one), one): unit for one, unit in units.items()}, used.values())
    values: dict[str, FloatArray] = {}
    read_in: dict[str, ColumnUnit] = {}
    others: dict[str, str] = {}
    kept = np.ones(len(table.lines), dtype=bool)
    for heading, column in zip(table.headings, table.columns, strict=True):
        key = heading.key
        values[key] = column
        if not heading.kind:
            continue
        unit, source, other = heading.unit, heading.source, heading.other
        if (own := given.get(plain(heading.text))) is not None:
            unit, source, other = unit_of(heading.kind, own), GIVEN, ""
            if not unit:
                raise MissionError(
                    f"{path}, column {heading.text}: {own!r} is not a known unit of {heading.kind}; accepted "
                    f"are {', '.join(UNITS[heading.kind])}"
                )
        factor = heading.sign * UNITS[heading.kind][unit]
        values[key] = column * factor
        read_in[key] = ColumnUnit(heading.text, unit, source)
        if other:
            others[key] = other
        low, high = LIMITS.get(heading.quantity) or LIMITS[heading.kind]
        fine = (values[key] >= low) & (values[key] <= high)
        low, high = sorted((low / factor, high / factor))
        reason = f"{heading.text} beyond {low:.6g} to {high:.6g} {unit}, which is what a flight can have"
        dropped += Dropped.of(reason, kept & ~fine, table.lines)
        kept &= fine
    if kept.sum() < MIN_SAMPLES:
        advice = ". If the unit of a column is another one, give it"
        raise MissionError(_too_few(path, int(kept.sum()), rows_read, dropped, advice))
    if not kept.all():
        values = {key: value[kept] for key, value in values.items()}
    written = {one.key: one.written for one in table.headings}
    remarks = tuple(table.remarks)
    return Columns(values, rows_read, tuple(dropped), read_in, others, written, remarks, table.lines[kept])


def raw_flight(
    name: str, columns: Columns, remarks: Sequence[str] = (), **motion: FloatArray | None
) -> RawFlight:
    """Return the flight of an aircraft out of its columns.

    Parameters
    ----------
    name
        Of the format.
    columns
        Whose time, position and air data are taken as they are.
    remarks
        Remarks of the reader, put before those of the table.
    **motion
        What the format has in another form, as `RawFlight` has it.
    """
    as_they_are = ("time", "latitude", "longitude", "height", "airspeed", "alpha", "beta")
    arrays: dict[str, Any] = {key: columns.get(key) for key in as_they_are} | motion
    return RawFlight(
        name,
        **arrays,
        rows_read=columns.rows_read,
        dropped=columns.dropped,
        units=tuple(columns.units.values()),
        remarks=(*remarks, *columns.remarks),
        vehicle="aircraft",
    )


def refuse_no_motion(path: Path, flight: RawFlight, advice: str) -> None:
    """Raise if a flight has no motion: no velocity, no position, and no airspeed with attitude.

    Parameters
    ----------
    path
        The file, for the message.
    flight
        As read.
    advice
        What the user should record instead, as whole sentences.

    Raises
    ------
    MissionError
        If there is neither velocity nor position nor airspeed with attitude.
    """
    by_air = flight.airspeed is not None and flight.euler is not None
    by_position = flight.latitude is not None and flight.longitude is not None
    if flight.velocity_n is None and not by_position and not by_air:
        raise MissionError(
            f"{path}: there is neither velocity nor position nor airspeed with attitude in it. {advice}"
        )
