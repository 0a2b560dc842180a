"""Sheet: a csv of unknown origin as columns of numbers: any separator, encoding, header and clock.

Cells are separated by commas, semicolons, tabs, ``|`` or blanks; numbers may have decimal commas. The text is
UTF-8, UTF-16 or Latin; the header is the line, among the first hundred, whose headings name the most
quantities. A file may have several tables, each under its own header (`lab.data.sheets.sheet_blocks`).
"""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray, IntArray
from lab.base.files.mission_error import MissionError
from lab.data.clock.stamps import is_date_in_digits, seconds_of_texts
from lab.data.files.profile import Profile
from lab.data.files.unit_names import unit_of
from lab.data.sheets.column_names import Heading, heading_of
from lab.data.sheets.sheet_cells import (
    Rows,
    angles_of_cells,
    are_decimal_commas,
    are_fixes,
    codes_of_names,
    find_rows,
    numbers_of_cells,
    offsets_of_zones,
    signs_of_sides,
    without_long_lines,
    without_placeholders,
)
from lab.data.sheets.sheet_layout import (
    HEAD,
    MAX_LINE,
    Layout,
    Overrides,
    cells_of,
    count_headings,
    find_layout,
    units_below,
)

_MOSTLY = 0.5
"""Part of the cells from which a column is one of numbers."""
_CHUNK = 20_000
"""Rows that are text at a time where cells are not all numbers: a cell takes some 60 bytes as text."""
_NO_NUMBER = ("", "-", "null", "NULL", "None", "N/A", "n/a", "NA", "nan", "NaN", "NAN", "inf", "-inf", "∞")
"""How loggers write an unknown value."""
_COORDINATES = ("latitude", "longitude")
_MINUTES = 60.0
"""Largest minutes of a degree."""
_TIMES = ("time", "seconds", "fraction", "date", "clock")
_HEIGHTS_ABOVE = re.compile(
    rb"(?im)^[#%][^\n]{0,200}height[^\n]{0,60}[/ =](ellipsoid|geodetic|sea level|msl\b)"
)
"""In a remark above the header: above what heights are, as RTKLIB writes it."""
_OF_TEXTS = {
    "side": signs_of_sides, "zone": offsets_of_zones, "fix": are_fixes, "craft": codes_of_names,
}  # fmt: skip
"""Quantities whose cells are words."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """The columns of one csv that are known.

    Attributes
    ----------
    name : str
        Name of the file.
    headings : tuple of Heading
        What each column is.
    columns : tuple of (n,) arrays
        Their numbers, in the unit of the file; NaN where a cell is empty or no number. Time stamps that are
        text are seconds.
    texts : dict
        The first cell of time stamps that are text, by heading.
    unknown : tuple of str
        Headings of columns that are not read.
    odd_stamps : dict
        The first cell of time stamps that are not understood, by heading.
    restarts : tuple of int
        Rows before which the header is repeated.
    remarks : tuple of str
        The report on its rows.
    signed : bool
        Whether it is known that its accelerations are specific force, and not the negative of it.
    profile : Profile or None
        Its profile.
    rows : Rows or None
        Which lines its rows are, if a simulator or a flight deck wrote it.
    ellipsoid : bool or None
        Whether its heights are above the ellipsoid, if the lines above the header say it.
    """

    name: str
    headings: tuple[Heading, ...]
    columns: tuple[FloatArray, ...]
    texts: Mapping[str, str]
    unknown: tuple[str, ...]
    odd_stamps: Mapping[str, str] = field(default_factory=dict)
    restarts: tuple[int, ...] = ()
    remarks: tuple[str, ...] = ()
    signed: bool = False
    profile: Profile | None = None
    rows: Rows | None = None
    ellipsoid: bool | None = None

    def __len__(self) -> int:
        return len(self.columns[0]) if self.columns else 0

    @property
    def has_imu(self) -> bool:
        """Whether it has rates or forces, of which rows come fast."""
        return any(one.quantity in ("rate", "force") for one in self.headings)

    def all_of(self, quantity: str) -> list[tuple[Heading, FloatArray]]:
        """Return all columns of a quantity, the best first."""
        found = [
            pair for pair in zip(self.headings, self.columns, strict=True) if pair[0].quantity == quantity
        ]
        return sorted(found, key=lambda pair: pair[0].rank)

    def of_rows(self, rows: slice | IntArray, remark: str, restarts: tuple[int, ...] = ()) -> Sheet:
        """Return the sheet with some of its rows, or in another order, and a remark on that."""
        columns = tuple(column[rows] for column in self.columns)
        return replace(self, columns=columns, restarts=restarts, remarks=(*self.remarks, remark))


def read_sheet(name: str, data: bytes, overrides: Overrides | None = None) -> Sheet | None:
    """Return the columns of a csv that are known; None if its header names none.

    Parameters
    ----------
    name
        Name of the file.
    data
        Its bytes, in UTF-8.
    overrides
        What a person says of columns, by heading.

    Raises
    ------
    MissionError
        If a person names a quantity or unit that is not accepted, or the rows cannot be read.
    """
    layout = find_layout(data[:HEAD], name, overrides)
    if layout is None:
        return None
    start = 0
    for _ in range(layout.line + 1):
        start = data.find(b"\n", start) + 1
    if not start and layout.line >= 0:
        return None
    said = _HEIGHTS_ABOVE.search(data[:start])
    sheet = sheet_below(name, data[start:], layout)
    if layout.rate:
        sheet = _timed_by_rate(sheet, layout.rate)
    return replace(sheet, ellipsoid=said[1].lower().startswith(b"ellipsoid") if said else None)


def _timed_by_rate(sheet: Sheet, rate: float) -> Sheet:
    """Return a sheet whose samples come at a rate, with times: of a counter of samples, or of its rows."""
    counted = [np.nanmedian(np.diff(values)) == 1 for _, values in sheet.all_of("time") if len(values) > 1]
    remark = (
        f"No column of {sheet.name} has times: the lines above its header say {rate:.6g} samples a second."
    )
    sheet = replace(sheet, remarks=(*sheet.remarks, remark))
    if any(counted):
        return sheet
    rest = [i for i, one in enumerate(sheet.headings) if one.quantity != "time"]
    heading = Heading("number of the row", "time", unit=f"s/{rate:.6g}")
    return replace(
        sheet,
        headings=(heading, *(sheet.headings[i] for i in rest)),
        columns=(np.arange(float(len(sheet))), *(sheet.columns[i] for i in rest)),
    )


def sheet_below(name: str, data: bytes, layout: Layout, first_line: int = 0) -> Sheet:
    """Return the columns of the rows below a header.

    Parameters
    ----------
    name
        Name of the file.
    data
        The rows, in UTF-8; the first may hold units.
    layout
        What the header says.
    first_line
        Number of the first of the lines; those of a simulator's rows are counted then.

    Raises
    ------
    MissionError
        If the rows cannot be read.
    """
    units, start = units_below(data, layout)
    layout = _with_first_column(data[start:], layout)
    rows = None
    if first_line:
        # A logger may end each line, or the header only, with a delimiter.
        fewest = count_headings(layout.headings)
        most = max(len(layout.headings), fewest + 1)
        layout = replace(
            layout,
            headings=layout.headings + ("",) * (most - len(layout.headings)),
            known=layout.known + (None,) * (most - len(layout.headings)),
        )
        line = first_line + data.count(b"\n", 0, start)
        rows, start = find_rows(data[start:], line, layout.delimiter, fewest, most), 0
        data, rows = rows.data, rows._replace(data=b"")
    layout = replace(layout, known=tuple(
        _in_unit(known, units.get(place, "")) for place, known in enumerate(layout.known)
    ))  # fmt: skip
    places = [place for place, known in enumerate(layout.known) if known is not None]
    headings = [replace(known, unit=known.unit or units.get(place, "")) for place in places
                if (known := layout.known[place]) is not None]  # fmt: skip
    pairs = [
        (place, one if quantity is None else replace(one, quantity=quantity))
        for place, one in zip(places, headings, strict=True)
        for quantity in (_COORDINATES if one.quantity == "place" else (None,))  # a cell that has both
    ]
    places, headings = [place for place, _ in pairs], [one for _, one in pairs]
    width = len(layout.headings) if rows else count_headings(layout.headings)
    columns: list[FloatArray] = [np.empty(0)] * len(places)
    texts: dict[int, str] = {}
    below, long = (data[start:], 0) if rows else without_long_lines(data[start:])
    if rows is None or rows.lines.size:
        columns, texts = _numbers(name, below, layout, places, headings, width)
    if rows is not None:
        columns = [column[1:] for column in columns]  # pandas takes the number of cells from the first row
    if rows is not None and any(len(column) != len(rows.lines) for column in columns):
        raise MissionError(f"{name}: its rows cannot be told from each other; accepted is one row a line")
    columns, headings, texts = _on_their_side(columns, headings, texts)
    columns, remarks = _without_placeholders(name, headings, columns)
    if long:
        remarks += (f"{name}: {long} lines are many times as long as the others, and are left out.",)
    if layout.profile is not None:
        own = layout.profile
        is_named = own.columns and not own.simulator
        said = f"The profile {own.name} ({own.path.name}) says what columns of {name} are."
        remarks += (*([said] if is_named else []), *own.remarks)
    kept = [i for i, column in enumerate(columns) if np.isfinite(column).any()]
    return Sheet(
        name=name,
        headings=tuple(headings[i] for i in kept),
        columns=tuple(columns[i] for i in kept),
        texts={headings[i].text: texts[i] for i in kept if i in texts},
        unknown=tuple(
            text for text, known in zip(layout.headings, layout.known, strict=True) if known is None and text
        ),
        odd_stamps={headings[i].text: texts[i] for i in texts if i not in kept},
        remarks=remarks,
        profile=layout.profile,
        rows=rows,
    )


def _in_unit(known: Heading | None, unit: str) -> Heading | None:
    """Return what a column is by its heading and the unit below it; None if they contradict each other."""
    if known is None or not unit or unit_of(known.kind, unit):
        return known
    found = heading_of(f"{known.text} [{unit}]")
    return found and replace(found, text=known.text)


_LEADING_ZERO = re.compile(rb"(?m)(?:^|[,;\t| \"])0\d")
"""In rows with names of vehicles that are numbers: 007 is another one than 7."""
_OF_DATE = re.compile(r"\d{4}[-/.]\d\d?[-/.]\d\d?|\d\d?[-/.]\d\d?[-/.]\d{4}")
"""A date."""


def _with_first_column(data: bytes, layout: Layout) -> Layout:
    """Return a layout with a heading for a first column that the header leaves out.

    R and pandas number the rows there, in quotes or between blanks. Between blanks, a time stamp with its
    date is two cells: RTKLIB writes both under ``GPST``.
    """
    lines = data[: 2 * MAX_LINE].split(b"\n", 2)[:2]
    cells = [cells_of(line.decode("utf-8", "replace").rstrip("\r"), layout.delimiter) for line in lines]
    if any(len(row) != len(layout.headings) + 1 or not row[-1] for row in cells):
        return layout
    first, (begin, *_), (then, *_) = layout.known[0], cells[0], cells[-1]
    of_time = layout.delimiter == " " and first is not None and first.kind == "time"
    is_marked = layout.delimiter == " " or lines[0].startswith(b'"')
    if not of_time and not (is_marked and begin in ("0", "1") and then == str(int(begin) + 1)):
        return layout
    date = Heading("date", "date") if of_time and _OF_DATE.fullmatch(begin) else None
    return replace(layout, headings=("date" if date else "", *layout.headings), known=(date, *layout.known))


def _without_placeholders(
    name: str, headings: list[Heading], columns: list[FloatArray]
) -> tuple[list[FloatArray], tuple[str, ...]]:
    """Return columns with NaN where they say that a value is unknown, and a report of it."""
    kept, reported = [], []
    for heading, values in zip(headings, columns, strict=True):
        more = (-1.0,) if heading.quantity in _COORDINATES else ()
        known, found = (values, "") if heading.quantity in _TIMES else without_placeholders(values, *more)
        kept.append(known)
        reported += [f"{heading.text}: {found}"] if found else []
    return kept, (
        f"{name} has numbers that stand for unknown values: {'; '.join(reported)}.",
    ) if reported else ()


def _on_their_side(
    columns: list[FloatArray], headings: list[Heading], texts: dict[int, str]
) -> tuple[list[FloatArray], list[Heading], dict[int, str]]:
    """Return coordinates with their minutes and seconds, and the sign of the hemisphere that comes after.

    The columns of these are left out; texts are by the places of the others.
    """
    columns, headings, texts = _with_minutes(columns, headings, texts)
    for i in range(1, len(headings)):
        if headings[i].quantity == "side" and headings[i - 1].quantity in _COORDINATES:
            sides = columns[i]
            columns[i - 1] = np.where(np.isfinite(sides), np.abs(columns[i - 1]) * sides, columns[i - 1])
    kept = [i for i, one in enumerate(headings) if one.quantity != "side"]
    own = {place: texts[i] for place, i in enumerate(kept) if i in texts}
    return [columns[i] for i in kept], [headings[i] for i in kept], own


def _with_minutes(
    columns: list[FloatArray], headings: list[Heading], texts: dict[int, str]
) -> tuple[list[FloatArray], list[Heading], dict[int, str]]:
    """Return whole degrees of a coordinate with the minutes and seconds beside, and without these columns."""
    parts: list[int] = []
    for name in _COORDINATES:
        of = {one.unit: i for i, one in reversed(list(enumerate(headings))) if one.quantity == name}
        if not {"°", "′"} <= of.keys() or (columns[of["°"]] % 1 > 0).any():
            continue
        degrees, minutes = columns[of["°"]], np.abs(columns[of["′"]])
        if "°/3600" in of:
            minutes = minutes + np.abs(columns[of["°/3600"]]) / 60
        if not (minutes <= _MINUTES).any():
            continue
        columns[of["°"]] = degrees + np.copysign(minutes / 60, degrees)
        parts += [i for unit, i in of.items() if unit != "°"]
    kept = [i for i in range(len(headings)) if i not in parts]
    own = {place: texts[i] for place, i in enumerate(kept) if i in texts}
    return [columns[i] for i in kept], [headings[i] for i in kept], own


def _numbers(
    name: str, data: bytes, layout: Layout, places: list[int], headings: list[Heading], width: int
) -> tuple[list[FloatArray], dict[int, str]]:
    """Return the known columns as numbers, and the first cell of those that were text."""
    import pandas as pd  # noqa: PLC0415 - slow to import, and only reading needs it

    how: dict[str, Any] = {
        "header": None, "names": list(range(width)), "usecols": sorted(set(places)),
        "index_col": False,
        "sep": layout.delimiter if layout.delimiter != " " else r"\s+", "engine": "c", "encoding": "utf-8",
        "encoding_errors": "replace", "on_bad_lines": "skip", "skipinitialspace": True, "comment": None,
    }  # fmt: skip
    if b'"' in data and data.count(b'"') % 2:  # a damaged cell would swallow all rows to the next quote
        how["quoting"] = csv.QUOTE_NONE
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)
        try:
            has_names = any(one.quantity == "craft" for one in headings) and _LEADING_ZERO.search(data)
            if has_names or _has_dates_in_digits(data, layout, places, headings):
                raise ValueError  # noqa: TRY301 - doubles hold no leading zeros, and not all fractions
            frame = pd.read_csv(io.BytesIO(data), dtype=np.float64, na_values=list(_NO_NUMBER), **how)
            return [frame[place].to_numpy() for place in places], {}
        except (ValueError, OverflowError, pd.errors.ParserError):
            pass
        parts: list[list[FloatArray]] = [[np.empty(0)] for _ in places]
        texts: dict[int, str] = {}
        separates: bool | None = None
        try:
            for chunk in pd.read_csv(
                io.BytesIO(data), dtype=object, na_filter=False, chunksize=_CHUNK, **how
            ):
                written = [chunk[place].astype(str).str.strip().str.strip("\"'") for place in places]
                if separates is None:
                    separates = layout.delimiter == "," and not are_decimal_commas(written)
                for i, cells in enumerate(written):
                    numbers, unit = _parse_cells(cells, headings[i].quantity, separates, i, texts)
                    parts[i].append(numbers)
                    unit = unit_of(headings[i].kind, unit) if unit and headings[i].kind else ""
                    headings[i] = replace(headings[i], unit=headings[i].unit or unit)
        except (ValueError, OverflowError, pd.errors.ParserError) as error:
            raise MissionError(f"{name}: its rows cannot be read: {error}") from error
    return [np.concatenate(part) for part in parts], texts


def _parse_cells(
    cells: Any, quantity: str, comma_separates: bool, place: int, texts: dict[int, str]
) -> tuple[FloatArray, str]:
    """Return the numbers of a column of texts, times that are no numbers as seconds; and their unit."""
    if quantity in _OF_TEXTS:
        return _OF_TEXTS[quantity](cells), ""
    numbers, unit = numbers_of_cells(cells, comma_separates)
    if quantity in _COORDINATES:
        angles = angles_of_cells(cells, quantity == "longitude")
        return np.where(np.isfinite(angles), angles, numbers), ""
    first = next((text for text in cells if text), "") if quantity in _TIMES else ""
    if np.isfinite(numbers).mean() > _MOSTLY and place not in texts and not is_date_in_digits(first):
        return numbers, unit
    if first and (place in texts or not np.isfinite(numbers).any() or is_date_in_digits(first)):
        texts.setdefault(place, first)
        stamps = seconds_of_texts(list(cells))
        if np.isfinite(stamps).any():
            return stamps, ""
    return numbers, unit


def _has_dates_in_digits(data: bytes, layout: Layout, places: list[int], headings: list[Heading]) -> bool:
    """Return whether a time stamp of the first row is one number with date and time of day."""
    end = data.find(b"\n")
    cells = cells_of(data[: end if end >= 0 else MAX_LINE].decode("utf-8", "replace"), layout.delimiter)
    times = (place for place, one in zip(places, headings, strict=True) if one.quantity in _TIMES)
    return any(is_date_in_digits(cells[place]) for place in times if place < len(cells))
