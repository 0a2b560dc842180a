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
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.data.clock.stamps import is_date_in_digits, seconds_of_texts
from lab.data.files.profile import Profile, profile_of
from lab.data.files.unit_names import UNITS, unit_of
from lab.data.sheets.column_names import SCALARS, Heading, given_heading, heading_of
from lab.data.sheets.sheet_cells import (
    angles_of_cells,
    are_decimal_commas,
    numbers_of_cells,
    signs_of_sides,
    without_placeholders,
)

_DELIMITERS = (",", ";", "\t", "|", " ")
_OTHERS = 3
"""Commas, or other separators, from which these separate a line, and not the blanks in its headings."""
_MAX_HEADER_LINE = 100
"""Last line on which the header may stand."""
HEAD = 2**18
"""Bytes in which the header is looked for."""
_MAX_LINE = 65_536
"""Characters of a line in which a header is looked for."""
_MAX_COLUMNS = 1000
"""Most columns: exports of phones have some hundred."""
_LOOKED_AT, _ZEROS = 1000, 0.25
"""Bytes at the start, and the part of them that is every second a zero in UTF-16 of Latin letters."""
_MOSTLY = 0.5
"""Part of the cells from which a column is one of numbers."""
_CHUNK = 20_000
"""Rows that are text at a time where cells are not all numbers: a cell takes some 60 bytes as text."""
_NO_NUMBER = ("", "-", "null", "NULL", "None", "N/A", "n/a", "NA", "nan", "NaN", "NAN", "inf", "-inf", "∞")
"""How loggers write an unknown value."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_COORDINATES = ("latitude", "longitude")
_TIMES = ("time", "seconds", "fraction", "date", "clock")
_MINUS = re.compile(rb"\xe2\x88\x92|\xe2\x80\x93(?=[\d.])")
"""The minus sign of typesetters, and a dash before a number."""

Overrides = Mapping[str, str]
"""What a person says of columns, by heading: a quantity with its unit, as `given_heading` reads it."""


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

    def __len__(self) -> int:
        return len(self.columns[0]) if self.columns else 0

    def all_of(self, quantity: str) -> list[tuple[Heading, FloatArray]]:
        """Return all columns of a quantity, the best first."""
        found = [
            pair for pair in zip(self.headings, self.columns, strict=True) if pair[0].quantity == quantity
        ]
        return sorted(found, key=lambda pair: pair[0].rank)


@dataclass(frozen=True)
class Layout:
    """Where the header stands, and what is in it."""

    line: int
    delimiter: str
    headings: tuple[str, ...]
    known: tuple[Heading | None, ...]
    profile: Profile | None = None

    @property
    def worth(self) -> int:
        """How many quantities are named; a time alone is not worth much."""
        return len({(one.quantity, one.axis) for one in self.known if one is not None})


def as_utf8(data: bytes) -> bytes:
    """Return a text in UTF-8 with plain ends of lines and signs, whatever it was written in."""
    data = _decoded(data)
    if b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    return _MINUS.sub(b"-", data)


def _decoded(data: bytes) -> bytes:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", "replace").encode()
    head = data[:_LOOKED_AT]
    if head[1::2].count(0) > _ZEROS * len(head):
        return data.decode("utf-16-le", "replace").encode()
    data = data.removeprefix(b"\xef\xbb\xbf")
    try:
        data[: 2**16].rpartition(b"\n")[0].decode()
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace").encode()
    return data


def layout_of(head: bytes, name: str, overrides: Overrides | None = None) -> Layout | None:
    """Return the header of a csv; None if no line names a quantity.

    Parameters
    ----------
    head
        The first bytes, in UTF-8.
    name
        Name of the file, which names the sensor where headings are x, y and z.
    overrides
        What a person says of columns.
    """
    if overrides and all(one.isdigit() for one in overrides):
        return _numbered(head, overrides)
    best: Layout | None = None
    for place, line in enumerate(head.split(b"\n", _MAX_HEADER_LINE)[:_MAX_HEADER_LINE]):
        text = line[:_MAX_LINE].decode("utf-8", "replace").strip("\r")
        if not re.search("[A-Za-z]", text):
            continue
        for delimiter in _DELIMITERS:
            if delimiter not in text:
                continue
            cells = _cells(text, delimiter)
            if delimiter == " " and max(map(text.count, _DELIMITERS[:-1])) >= _OTHERS:
                continue
            if not 2 <= len(cells) <= _MAX_COLUMNS or sum(map(bool, map(_NUMBER.fullmatch, cells))) > 1:
                continue
            profile = profile_of(name, cells)
            layout = Layout(place, delimiter, cells, _known(cells, name, overrides or {}, profile), profile)
            if best is None or layout.worth > best.worth:
                best = layout
    return best if best is not None and best.worth else None


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
    layout = layout_of(data[:HEAD], name, overrides)
    if layout is None:
        return None
    start = 0
    for _ in range(layout.line + 1):
        start = data.find(b"\n", start) + 1
    return None if not start and layout.line >= 0 else sheet_below(name, data[start:], layout)


def sheet_below(name: str, data: bytes, layout: Layout) -> Sheet:
    """Return the columns of the rows below a header.

    Parameters
    ----------
    name
        Name of the file.
    data
        The rows, in UTF-8; the first may hold units.
    layout
        What the header says.

    Raises
    ------
    MissionError
        If the rows cannot be read.
    """
    units, start = _units_below(data, layout)
    layout = replace(layout, known=tuple(
        known if units.get(place, "-") else None for place, known in enumerate(layout.known)
    ))  # fmt: skip
    places = [place for place, known in enumerate(layout.known) if known is not None]
    headings = [replace(known, unit=known.unit or units.get(place, "")) for place in places
                if (known := layout.known[place]) is not None]  # fmt: skip
    places, headings = _in_two(places, headings)
    columns, texts = _numbers(name, data[start:], layout, places, headings)
    columns, headings, texts = _on_their_side(columns, headings, texts)
    columns, remarks = _without_placeholders(name, headings, columns)
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
        remarks=(*remarks, *_about(name, layout.profile)),
        profile=layout.profile,
    )


def _about(name: str, profile: Profile | None) -> tuple[str, ...]:
    """Return what the report says of a profile."""
    if profile is None or not profile.columns:
        return profile.remarks if profile else ()
    return (
        f"The profile {profile.name} ({profile.path.name}) says what columns of {name} are.",
        *profile.remarks,
    )


def _without_placeholders(
    name: str, headings: list[Heading], columns: list[FloatArray]
) -> tuple[list[FloatArray], tuple[str, ...]]:
    """Return columns with NaN where they say that a value is unknown, and a report of it."""
    kept, reported = [], []
    for heading, values in zip(headings, columns, strict=True):
        known, found = (values, "") if heading.quantity in _TIMES else without_placeholders(values)
        kept.append(known)
        reported += [f"{heading.text}: {found}"] if found else []
    return kept, (
        f"{name} has numbers that stand for unknown values: {'; '.join(reported)}.",
    ) if reported else ()


def _in_two(places: list[int], headings: list[Heading]) -> tuple[list[int], list[Heading]]:
    """Return columns with a latitude and a longitude for each place, which has both in one cell."""
    pairs = [
        (place, one if quantity is None else replace(one, quantity=quantity))
        for place, one in zip(places, headings, strict=True)
        for quantity in (("latitude", "longitude") if one.quantity == "place" else (None,))
    ]
    return [place for place, _ in pairs], [one for _, one in pairs]


def _on_their_side(
    columns: list[FloatArray], headings: list[Heading], texts: dict[int, str]
) -> tuple[list[FloatArray], list[Heading], dict[int, str]]:
    """Return columns with the sign of the hemisphere that the column after a coordinate names.

    The columns of hemispheres are left out; texts are by the places of the others.
    """
    for i in range(1, len(headings)):
        if headings[i].quantity == "side" and headings[i - 1].quantity in _COORDINATES:
            sides = columns[i]
            columns[i - 1] = np.where(np.isfinite(sides), np.abs(columns[i - 1]) * sides, columns[i - 1])
    kept = [i for i, one in enumerate(headings) if one.quantity != "side"]
    own = {place: texts[i] for place, i in enumerate(kept) if i in texts}
    return [columns[i] for i in kept], [headings[i] for i in kept], own


def _numbered(head: bytes, overrides: Overrides) -> Layout | None:
    """Return the layout of a csv without a header whose columns a person names by their numbers, from 1."""
    lines = [line.decode("utf-8", "replace").strip() for line in head.split(b"\n")[:_MAX_HEADER_LINE]]
    for place, text in enumerate(lines):
        for delimiter in _DELIMITERS:
            cells = _cells(text, delimiter) if delimiter in text else ()
            if len(cells) > 1 and all(map(_NUMBER.fullmatch, cells)):
                names = tuple(str(number) for number in range(1, len(cells) + 1))
                known = tuple(
                    given_heading(overrides[one], one) if one in overrides else None for one in names
                )
                return Layout(place - 1, delimiter, names, known)
    return None


def _cells(text: str, delimiter: str) -> tuple[str, ...]:
    if delimiter == " ":
        return tuple(text.lstrip("#% ").split())
    try:
        cells = next(csv.reader([text.lstrip("#%/ ")], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        cells = text.split(delimiter)
    return tuple(cell.strip().strip("\"'\ufeff").strip() for cell in cells)


def numbered(cells: Sequence[str]) -> list[str]:
    """Return headings, with their number those that stand before already: ``altitude#2``."""
    counts: Counter[str] = Counter()
    found = []
    for cell in cells:
        counts[cell] += 1
        found.append(f"{cell}#{counts[cell]}" if counts[cell] > 1 else cell)
    return found


def _known(
    cells: Sequence[str], name: str, overrides: Overrides, profile: Profile | None
) -> tuple[Heading | None, ...]:
    """Return what columns are: as a person says, or a profile, or the heading.

    The first of two with one heading counts, unless the profile names the second: ``altitude#2``.
    """
    known: list[Heading | None] = []
    for cell, name_of in zip(cells, numbered(cells), strict=True):
        if profile is not None and name_of in profile.columns and name_of not in overrides:
            known.append(_of_profile(name_of, profile))
        elif cell != name_of:
            known.append(None)
        elif cell in overrides:
            known.append(_corrected(cell, overrides[cell], name))
        else:
            found = heading_of(cell, name) if cell else None
            known.append(found if found is None or profile is None else _defaulted(found, profile))
    return tuple(known)


def _of_profile(cell: str, profile: Profile) -> Heading | None:
    """Return what a profile says that a column is."""
    try:
        found = given_heading(profile.columns[cell], cell)
    except MissionError as error:
        raise MissionError(f"{profile.path}: {error}") from None
    source = f"as {profile.name} writes"
    return found and replace(found, sensor=profile.name, source=source)


def _defaulted(found: Heading, profile: Profile) -> Heading:
    """Return a column in the unit that a profile says for its quantity, if its heading names none."""
    unit = unit_of(found.kind, profile.defaults.get(found.quantity, ""))
    return found if found.unit or not unit else replace(found, unit=unit, source=f"as {profile.name} writes")


def _corrected(cell: str, text: str, name: str) -> Heading | None:
    """Return what a person says of a column: a quantity with its unit, or, in brackets, a unit alone."""
    if not text.startswith("["):
        return given_heading(text, cell)
    known = heading_of(cell, name)
    if known is None:
        raise MissionError(
            f"column {cell}: its heading does not say what it is; accepted is a quantity with its unit, "
            "such as force_x[g]"
        )
    unit = unit_of(known.kind, text)
    if not unit:
        raise MissionError(
            f"column {cell}: {text.strip('[]')!r} is no unit of {known.quantity}; accepted are "
            f"{', '.join(UNITS.get(known.kind, {}))}"
        )
    return replace(known, unit=unit)


def _units_below(data: bytes, layout: Layout) -> tuple[dict[int, str], int]:
    """Return units by column if the first row that is not empty holds them, and where the rows begin.

    The unit is empty for what its heading does not say: VerticalAcc in g is no accuracy of the height.
    """
    start = end = 0
    cells: tuple[str, ...] = ()
    while not any(cells) and end >= 0 and start < len(data):
        end = data.find(b"\n", start)
        line = data[start : end if end >= 0 else len(data)]
        cells = _cells(line.decode("utf-8", "replace").strip("\r"), layout.delimiter)
        start = end + 1
    units = {}
    for place, known in enumerate(layout.known[: len(cells)]):
        if known is None or not cells[place] or not known.kind:
            continue
        unit = unit_of(known.kind, cells[place])
        if unit or (known.quantity in SCALARS and unit_of("acceleration", cells[place])):
            units[place] = unit
    return (units, start) if any(units.values()) and end >= 0 else ({}, 0)


def _numbers(
    name: str, data: bytes, layout: Layout, places: list[int], headings: list[Heading]
) -> tuple[list[FloatArray], dict[int, str]]:
    """Return the known columns as numbers, and the first cell of those that were text."""
    import pandas as pd  # noqa: PLC0415 - slow to import, and only reading needs it

    how: dict[str, Any] = {
        "header": None, "names": list(range(_ended(layout.headings))), "usecols": sorted(set(places)),
        "index_col": False,
        "sep": layout.delimiter if layout.delimiter != " " else r"\s+", "engine": "c", "encoding": "utf-8",
        "encoding_errors": "replace", "on_bad_lines": "skip", "skipinitialspace": True, "comment": None,
    }  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pd.errors.ParserWarning)
        try:
            if _has_dates_in_digits(data, layout, places, headings):
                raise ValueError  # noqa: TRY301 - doubles do not hold their fractions
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
                    numbers, unit = _parsed(cells, headings[i].quantity, separates, i, texts)
                    parts[i].append(numbers)
                    unit = unit_of(headings[i].kind, unit) if unit and headings[i].kind else ""
                    headings[i] = replace(headings[i], unit=headings[i].unit or unit)
        except (ValueError, OverflowError, pd.errors.ParserError) as error:
            raise MissionError(f"{name}: its rows cannot be read: {error}") from error
    return [np.concatenate(part) for part in parts], texts


def _ended(headings: Sequence[str]) -> int:
    """Return how many headings there are: a logger may end its header with a delimiter, and its rows not."""
    return max(place + 1 for place, text in enumerate(headings) if text.strip())


def _parsed(
    cells: Any, quantity: str, comma_separates: bool, place: int, texts: dict[int, str]
) -> tuple[FloatArray, str]:
    """Return the numbers of a column of texts, times that are no numbers as seconds; and their unit."""
    if quantity == "side":
        return signs_of_sides(cells), ""
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
    cells = _cells(data.partition(b"\n")[0].decode("utf-8", "replace"), layout.delimiter)
    times = (place for place, one in zip(places, headings, strict=True) if one.quantity in _TIMES)
    return any(is_date_in_digits(cells[place]) for place in times if place < len(cells))
