"""Sheet layout: the text of a csv in UTF-8, where its header stands, and what this says of the columns.

The text is UTF-8, UTF-16 or Latin; the header is the line, among the first hundred, whose headings name the
most quantities, or that has the headings of a given profile.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from lab.base.files.mission_error import MissionError
from lab.data.files.fields import NAMED
from lab.data.files.profile import Profile, plain, profile_of
from lab.data.files.unit_names import UNITS, unit_of
from lab.data.sheets.column_names import (
    GIVEN,
    QUANTITIES,
    QUANTITIES_OF_FLIGHTS,
    SCALARS,
    Heading,
    given_heading,
    heading_of,
)

_DELIMITERS = (",", ";", "\t", "|", " ")
_OTHERS = 3
"""Commas, or other separators, from which these separate a line, and not the blanks in its headings."""
MAX_HEADER_LINE = 300
"""Last line on which the header may stand."""
HEAD = 2**18
"""Bytes in which the header is looked for."""
MAX_LINE = 65_536
"""Characters of a line in which a header is looked for."""
_MAX_COLUMNS, MAX_IN_PROFILE = 1000, 10_000
"""Most columns, without and with a profile: exports of phones and of simulators have some hundred."""
_LOOKED_AT, _ZEROS = 1000, 0.25
"""Bytes at the start, and the part of them that is every second a zero in UTF-16 of Latin letters."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_MINUS = re.compile(rb"\xe2\x88\x92|\xe2\x80\x93(?=[\d.])")
"""The minus sign of typesetters, and a dash before a number."""

TIMES = {"time", "seconds", "clock", "date", "second"}
"""Quantities that are a time stamp, or part of one."""
Overrides = Mapping[str, str]
"""What a person says of columns, by heading: a quantity with its unit, as `given_heading` reads it."""


@dataclass(frozen=True)
class Layout:
    """Where the header stands, and what is in it."""

    line: int
    delimiter: str
    headings: tuple[str, ...]
    known: tuple[Heading | None, ...]
    profile: Profile | None = None
    rate: float = 0.0
    """Samples per second [Hz] that the lines above say, of a table without times; 0 for unknown."""

    @property
    def worth(self) -> int:
        """How many quantities are named; a time alone is not worth much."""
        return len({(one.quantity, one.axis) for one in self.known if one is not None})


def as_utf8(data: bytes) -> bytes:
    """Return a text in UTF-8 with plain ends of lines and signs, whatever it was written in."""
    data = _decode_text(data)
    if b"\r" in data and data.count(b"\r") != data.count(b"\r\n"):  # as on an old Macintosh
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return _MINUS.sub(b"-", data)


def _decode_text(data: bytes) -> bytes:
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


def find_layout(
    head: bytes, name: str, overrides: Overrides | None = None, profile: Profile | None = None
) -> Layout | None:
    """Return the header of a csv; None if no line names a quantity.

    Parameters
    ----------
    head
        The first bytes, in UTF-8.
    name
        Name of the file, which names the sensor where headings are x, y and z.
    overrides
        What a person says of columns.
    profile
        What the file has to be; the first header with its headings is taken. Without one, the profile is that
        of the headings.
    """
    if overrides and all(one.isdigit() for one in overrides):
        return numbered_layout(head, overrides)
    best: Layout | None = None
    most = _MAX_COLUMNS if profile is None else MAX_IN_PROFILE
    lines = head.split(b"\n", MAX_HEADER_LINE)[:MAX_HEADER_LINE]
    if profile is not None and not profile.may_head(b"".join(lines).decode("utf-8", "replace")):
        return None
    for place, line in enumerate(lines):
        text = line[:MAX_LINE].decode("utf-8", "replace").strip("\r")
        if not re.search("[A-Za-z]", text):
            continue
        for delimiter in _DELIMITERS:
            if delimiter not in text:
                continue
            cells = cells_of(text, delimiter)
            if delimiter == " " and max(map(text.count, _DELIMITERS[:-1])) >= _OTHERS:
                continue
            if not 2 <= len(cells) <= most or sum(map(bool, map(_NUMBER.fullmatch, cells))) > 1:
                continue
            if profile is not None:
                if not profile.fits(set(map(plain, cells))):
                    continue
                above = lines[place - 1] if place else b""
                return _with_units_above(
                    above, Layout(place, delimiter, cells, columns_by_profile(cells, profile), profile)
                )
            found = profile_of(name, cells)
            layout = Layout(
                place, delimiter, cells, _known_columns(cells, name, overrides or {}, found), found
            )
            if best is None or layout.worth > best.worth:
                best = layout
    return _counted(best, lines[: best.line]) if best is not None and best.worth else None


_STATED = re.compile(
    r"(?i)(?P<words>[^\d\n]{0,80}(?:[^\W\d]\d{1,6}[^\d\n]{0,80})?)(?<![\w.])"
    r"(?P<number>\d{1,9}(?:[.,]\d{1,9})?)\s*(?P<unit>k?hz|ms)?(?![\w/:])"
)
"""A number above a header, with the words before it and its unit."""
_OF_SAMPLES = re.compile(
    r"(?i)sampl|abtast|chantillonn|muestreo|campionamento|amostragem|próbkowan|дискретизац|采样"
)
_A_RATE = re.compile(r"(?i)rate|fr[eé][qc]u|hz|частот|频率")
"""Words of how often samples are taken, in some languages: of samples, and of a rate."""
_OF_OTHERS = re.compile(r"(?i)filter|cut|band|baud|baro|(?<![a-z])mag|gps|gnss|heart|video|frame")
"""Words of another frequency than that of the samples."""
_COUNTERS = re.compile(
    r"(?:packet|sample|frame|data)?(?:counter|count|number|no|nr|index|id)?|seq|sequence|n|i"
)
"""Headings of columns that count samples, as `plain` gives them."""
_RATES = (1.0, 1e5)
"""Lowest and highest rate of samples [Hz]."""
_MAX_STATED = 500
"""Characters of a line in which a rate is looked for."""


def _counted(layout: Layout, above: Sequence[bytes]) -> Layout:
    """Return a layout with the rate of its samples, if it names no time and the lines above say that rate."""
    names = {one.quantity for one in layout.known if one is not None}
    if names & TIMES or not names & {"rate", "force"}:
        return layout
    rates = set()
    for line in above:
        for found in _STATED.finditer(line[:_MAX_STATED].decode("utf-8", "replace")):
            unit = (found["unit"] or ("ms" if "(ms)" in found["words"] else "")).lower()
            is_named = _OF_SAMPLES.search(found["words"]) and (unit or _A_RATE.search(found["words"]))
            if _OF_OTHERS.search(found["words"]) or not (is_named or "hz" in unit):
                continue
            number = float(found["number"].replace(",", "."))
            rate = 1000 / number if unit == "ms" and number else number * (1000 if unit == "khz" else 1)
            rates.add(rate)
    if len(rates) != 1 or not _RATES[0] <= min(rates) <= _RATES[1]:
        return layout
    places = (i for i, one in enumerate(layout.known) if one is None and layout.headings[i])
    counter = next((i for i in places if _COUNTERS.fullmatch(plain(layout.headings[i]))), -1)
    known = list(layout.known)
    if counter >= 0:
        known[counter] = Heading(layout.headings[counter], "time", unit=f"s/{min(rates):.6g}")
    return replace(layout, known=tuple(known), rate=min(rates))


def numbered_layout(head: bytes, overrides: Overrides) -> Layout | None:
    """Return the layout of a csv without a header whose columns a person names by their numbers, from 1."""
    lines = [line.decode("utf-8", "replace").strip() for line in head.split(b"\n")[:MAX_HEADER_LINE]]
    for place, text in enumerate(lines):
        for delimiter in _DELIMITERS:
            cells = cells_of(text, delimiter) if delimiter in text else ()
            if len(cells) > 1 and all(map(_NUMBER.fullmatch, cells)):
                names = tuple(str(number) for number in range(1, len(cells) + 1))
                known = tuple(
                    given_heading(overrides[one], one) if one in overrides else None for one in names
                )
                return Layout(place - 1, delimiter, names, known)
    return None


def cells_of(text: str, delimiter: str) -> tuple[str, ...]:
    """Return the cells of a line, without the marks of a remark before them and quotes around them."""
    if delimiter == " ":
        return tuple(text.lstrip("#% ").split())
    text = text.lstrip("#% ").removeprefix("//").lstrip()
    try:
        cells = next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        cells = text.split(delimiter)
    return tuple(cell.strip().strip("\"'\ufeff").strip() for cell in cells)


def number_headings(cells: Sequence[str]) -> list[str]:
    """Return headings, with their number those that stand before already: ``altitude#2``."""
    counts: Counter[str] = Counter()
    found = []
    for cell in cells:
        counts[cell] += 1
        found.append(f"{cell}#{counts[cell]}" if counts[cell] > 1 else cell)
    return found


def _known_columns(
    cells: Sequence[str], name: str, overrides: Overrides, profile: Profile | None
) -> tuple[Heading | None, ...]:
    """Return what columns are: as a person says, or a profile, or the heading.

    The first of two with one heading counts, unless the profile names the second: ``altitude#2``.
    """
    known: list[Heading | None] = []
    triples = _from_one(cells)
    for cell, name_of in zip(cells, number_headings(cells), strict=True):
        if profile is not None and plain(name_of) in profile.meanings and name_of not in overrides:
            known.append(_of_profile(name_of, profile))
        elif cell != name_of:
            known.append(None)
        elif cell in overrides:
            known.append(_correct_heading(cell, overrides[cell], name))
        else:
            found = heading_of(triples[cell], name) if cell in triples else None
            found = replace(found, text=cell) if found else heading_of(cell, name) if cell else None
            if found is not None and profile is not None and not found.unit:
                unit = unit_of(found.kind, profile.defaults.get(found.quantity, ""))
                found = replace(found, unit=unit, source=f"as {profile.name} writes") if unit else found
            known.append(found)
    return _with_parts_of_angles(cells, known)


_PART = re.compile(
    r"(?i)(.+?)[\s_.(\[]*(?:(deg|degrees?|grad|grados|gradi|degrés)|(min|minutes?|minuten|minutos|minuti)"
    r"|(sec|seconds?|sekunden|segundos|secondi))[)\]]?"
)
"""A heading of the degrees, minutes or seconds of an angle, each in a column of its own."""
_UNITS_OF_PARTS = ("°", "′", "°/3600")


def _with_parts_of_angles(cells: Sequence[str], known: list[Heading | None]) -> tuple[Heading | None, ...]:
    """Return what columns are, with the minutes and seconds of coordinates whose degrees stand beside."""
    parts: dict[str, dict[str, int]] = {}
    for place, cell in enumerate(cells):
        if found := _PART.fullmatch(cell):
            unit = next(one for one, text in zip(_UNITS_OF_PARTS, found.groups()[1:], strict=True) if text)
            parts.setdefault(found[1].lower(), {}).setdefault(unit, place)
    for stem, places in parts.items():
        whole = heading_of(stem) if {"°", "′"} <= places.keys() else None
        if whole is None or whole.quantity not in ("latitude", "longitude"):
            continue
        for unit, place in places.items():
            before = known[place]
            if before is None or before.sensor != GIVEN:
                known[place] = replace(whole, text=cells[place], unit=unit, rank=whole.rank + (unit != "°"))
    return tuple(known)


_COUNTED = re.compile(r"(.*[A-Za-z])[ _.]?\(?([1-4])\)?")


def _from_one(cells: Sequence[str]) -> dict[str, str]:
    """Return headings by axis of vectors that are counted from one, as MATLAB does: ``Acceleration_3``."""
    parts: dict[str, dict[str, str]] = {}
    for cell in cells:
        if found := _COUNTED.fullmatch(cell):
            parts.setdefault(found[1], {})[found[2]] = cell
    return {
        cell: f"{stem}_{'xyz'[int(number) - 1]}"
        for stem, numbers in parts.items()
        if numbers.keys() == {"1", "2", "3"}
        and not {f"{stem}{mark}0" for mark in ("", "_", " ", ".")} & {*cells}
        for number, cell in numbers.items()
    }


def columns_by_profile(cells: Sequence[str], profile: Profile) -> tuple[Heading | None, ...]:
    """Return what a profile alone says that columns are; the first of two counts."""
    names = [plain(cell) for cell in cells]
    return tuple(
        _of_profile(cell, profile) if name in profile.meanings and name not in names[:place] else None
        for place, (name, cell) in enumerate(zip(names, cells, strict=True))
    )


def _of_profile(cell: str, profile: Profile) -> Heading | None:
    """Return what a profile says that a column is."""
    place, text = profile.meanings[plain(cell)]
    accepted = QUANTITIES_OF_FLIGHTS if profile.simulator else QUANTITIES
    try:
        found = given_heading(text, cell, accepted)
    except MissionError as error:
        raise MissionError(f"{profile.path}: {error}") from None
    source = profile.source or f"as {profile.name} writes"
    rank = place if profile.simulator else -100
    return found and replace(found, sensor=profile.name, source=source, rank=rank)


def _correct_heading(cell: str, text: str, name: str) -> Heading | None:
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


_SAYS = re.compile(rb"[^\s,;|\"']")
"""A character of a cell that is not empty."""
_INSIDE = re.compile(r"\(([^()]*)\)")


def _with_units_above(line: bytes, layout: Layout) -> Layout:
    """Return a layout with the units of the line above the header, alone or in brackets after a name."""
    cells = cells_of(line[:MAX_LINE].decode("utf-8", "replace").strip("\r"), layout.delimiter)
    known = list(layout.known)
    for place, cell in enumerate(cells[: len(known)]):
        one = known[place]
        inside = _INSIDE.search(cell)
        written = plain(inside[1] if inside else cell)
        if one is not None and (unit := unit_of(one.kind, written)):
            known[place] = replace(one, unit=unit, source=NAMED, written=written)
    return replace(layout, known=tuple(known))


def units_below(data: bytes, layout: Layout) -> tuple[dict[int, str], int]:
    """Return units by column if the first row that is not empty holds them, and where the rows begin.

    The unit may be another one than the heading lets expect: VerticalAcc in g is no accuracy, and a latitude
    in °/s none.
    """
    if (first := _SAYS.search(data)) is None:
        return {}, 0
    start, end = data.rfind(b"\n", 0, first.start()) + 1, data.find(b"\n", first.start())
    line = data[start : end if end >= 0 else len(data)][:MAX_LINE]
    cells = cells_of(line.decode("utf-8", "replace").strip("\r"), layout.delimiter)
    start = end + 1
    units = {}
    for place, known in enumerate(layout.known[: len(cells)]):
        if known is None or not cells[place] or not known.kind:
            continue
        unit = unit_of(known.kind, cells[place])
        if not unit and known.quantity in SCALARS:
            unit = unit_of("acceleration", cells[place]) or unit_of("angular rate", cells[place])
        if unit:
            units[place] = unit
    return (units, start) if units and end >= 0 else ({}, 0)


def count_headings(headings: Sequence[str]) -> int:
    """Return how many headings there are: a logger may end its header with a delimiter, and its rows not."""
    return max(place + 1 for place, text in enumerate(headings) if text.strip())
