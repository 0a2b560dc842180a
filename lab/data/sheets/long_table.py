"""Long table: rows that are each of one sensor, or of one quantity, as a table with columns for each.

Recorders of phones write all sensors into one file so, ``time,sensor,x,y,z``, and exports of telemetry a row
for each number, ``time,name,value``. A header may be missing, and remarks may stand above and between rows.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from lab.data.sheets.column_names import heading_of
from lab.data.sheets.column_words import SENSORS, in_english
from lab.data.sheets.sheet_layout import cells_of

_KIND = re.compile(r"(?i)(?:sensor|sensor[ _]?(?:name|type)|type|name|kind|message|source)")
_AXIS = re.compile(r"(?i)(?:[vd]|value|values|val|data|axis)?[ _.]?\[?([xyz0-3])\]?(?:[ _]?(?:axis|value))?")
"""Headings of the sensor of a row, and of what it measured along an axis."""
_WORD = re.compile(r"[a-z]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
_REMARK = (b"#", b"%", b"//")
_HEAD = 2**16
"""First bytes that show the format."""
_MAX_SENSORS = 64
"""Most sensors in a file, and most quantities."""
_MAX_COLUMNS = 12
"""Most columns: those of wide tables are not looked at."""
_ROWS = 200
"""Rows at the start that show it."""
_MOSTLY = 0.9
"""Part of these that must have one form."""
_PLACES = ("latitude", "longitude", "altitude")
"""What three numbers of a receiver are."""
_POLE, _HALF_TURN = 90.0, 180.0
"""Largest latitude and longitude [°]: a first number that is larger is a longitude."""
_WHOLE = ({"rate_x", "rate_y", "rate_z", "force_x", "force_y", "force_z"}, {"latitude", "longitude"})
"""Quantities, one of a row, that are worth reading: those of an IMU, or of a receiver."""


class _Form(NamedTuple):
    """What separates cells, the place of the name in a row, and the headings; where the values are."""

    delimiter: str
    kind: int
    names: tuple[str, ...]
    values: tuple[int, ...]
    time: int


def is_long(head: bytes) -> bool:
    """Return whether the first bytes of a text, in UTF-8, are of such a table."""
    return _recognise_form(head) is not None


def long_tables(data: bytes) -> list[tuple[str, bytes]]:
    """Return the name of each sensor and its table; nothing for a text of another form.

    Of a table with a row for each number the one table has an empty name.

    Parameters
    ----------
    data
        The text, in UTF-8.
    """
    form = _recognise_form(data)
    if form is None:
        return []
    if len(form.values) == 1:
        return [("", _widen_table(data, form))]
    found: dict[str, list[str]] = {}
    for row in _rows(data.split(b"\n"), form.delimiter):
        if len(row) == len(form.names) and (row[form.kind] in found or len(found) < _MAX_SENSORS):
            found.setdefault(row[form.kind], []).append(form.delimiter.join(row))
    return [
        (
            sensor.strip("\"' "),
            "\n".join((form.delimiter.join(_headings(form, sensor, rows)), *rows, "")).encode(),
        )
        for sensor, rows in found.items()
        if sensor != form.names[form.kind]
    ]


def _headings(form: _Form, sensor: str, rows: Sequence[str]) -> list[str]:
    """Return the headings of the table of a sensor; three numbers of a receiver are a place on the Earth."""
    axes: Sequence[str] = "xyz"
    if set(_WORD.findall(sensor.lower())) & SENSORS["receiver"] | {"gnss"} & {sensor.lower()}:
        first = [row.split(form.delimiter) for row in rows[:_ROWS]]
        sizes = [max(_size(row[place]) for row in first) for place in form.values]
        axes = (
            _PLACES if sizes[0] <= _POLE and sizes[1] <= _HALF_TURN else (_PLACES[1], _PLACES[0], _PLACES[2])
        )
    names = list(form.names)
    for place, axis in zip(form.values, axes, strict=True):
        names[place] = axis
    return names


def _size(cell: str) -> float:
    return abs(float(cell.replace(",", "."))) if _NUMBER.fullmatch(cell) else 0.0


def _widen_table(data: bytes, form: _Form) -> bytes:
    """Return rows of one number each as a table with a column for each name and a row for each time."""
    names: dict[str, int] = {}
    rows: dict[str, dict[int, str]] = {}
    (value,) = form.values
    for row in _rows(data.split(b"\n"), form.delimiter):
        if len(row) != len(form.names) or not (row[form.kind] in names or len(names) < _MAX_SENSORS):
            continue
        if _NUMBER.fullmatch(row[value]):
            place = names.setdefault(row[form.kind], len(names))
            rows.setdefault(row[form.time], {})[place] = row[value]
    mark = form.delimiter
    lines = [mark.join((form.names[form.time], *names))]
    lines += [
        mark.join((time, *(one.get(place, "") for place in range(len(names))))) for time, one in rows.items()
    ]
    return "\n".join((*lines, "")).encode()


def _rows(lines: Sequence[bytes], delimiter: str) -> Iterator[list[str]]:
    """Yield the cells of lines that are no remarks."""
    for line in lines:
        if line.strip() and not line.startswith(_REMARK):
            yield [
                cell.strip(" \"'") for cell in line.decode("utf-8", "replace").strip("\r").split(delimiter)
            ]


def _recognise_form(data: bytes) -> _Form | None:
    """Return the form of a long table by its header, if it has one, and first rows; None for another text."""
    head = data[:_HEAD]
    lines = [line for line in head.split(b"\n")[: 2 * _ROWS] if line.strip() and not line.startswith(_REMARK)]
    lines = lines[:-1] if len(head) == _HEAD else lines
    text = b"\n".join(lines).decode("utf-8", "replace")
    delimiter = max(",;\t|", key=text.count)
    rows = list(_rows(lines, delimiter))
    if not (counts := Counter(len(row) for row in rows if 2 < len(row) <= _MAX_COLUMNS)):
        return None
    width = counts.most_common(1)[0][0]
    at = [place for place, row in enumerate(rows) if len(row) == width]
    is_header = not any(_NUMBER.fullmatch(cell) for cell in rows[at[0]])
    header = cells_of(lines[at[0]].decode("utf-8", "replace").strip("\r"), delimiter) if is_header else ()
    rows = [rows[place] for place in at[is_header:]][:_ROWS]
    if header and len(header) != width:
        return None
    return _of_rows(rows, header, delimiter) if rows else None


def _of_rows(rows: list[list[str]], header: Sequence[str], delimiter: str) -> _Form | None:
    """Return the form of rows of one length; None if no column of them names sensors or quantities."""
    columns = list(zip(*rows, strict=True))
    numbers = [
        place for place, cells in enumerate(columns)
        if np.mean([_NUMBER.fullmatch(cell) is not None for cell in cells]) > _MOSTLY
    ]  # fmt: skip
    words = [place for place in range(len(columns)) if place not in numbers and len(set(columns[place])) > 1]
    if header:
        kinds = [place for place, name in enumerate(header) if _KIND.fullmatch(name)]
        axes = {p: found[1].lower() for p, name in enumerate(header) if (found := _AXIS.fullmatch(name))}
        if len(kinds) == 1 and "".join(axes.values()) in ("xyz", "012", "123"):
            return (
                _Form(delimiter, kinds[0], tuple(header), tuple(axes), -1)
                if _are_sensors(columns[kinds[0]])
                else None
            )
    kinds = [place for place in words if _are_sensors(columns[place]) or _are_quantities(columns[place])]
    times = [
        place
        for place in range(len(columns))
        if place not in kinds and _goes_on(columns[place], place in numbers)
    ]
    if len(kinds) != 1 or not times:
        return None
    (kind,), time = kinds, times[0]
    values = tuple(place for place in numbers if place != time and len(set(columns[place])) > 1)
    one_each = _are_quantities(columns[kind])
    if len(values) != (1 if one_each else len(_PLACES)):
        return None
    named = header[time] if header and heading_of(header[time]) else "time"
    names = [header[place] if header else f"column {place + 1}" for place in range(len(columns))]
    names[time] = named
    return _Form(delimiter, kind, tuple(names), values, time)


def _goes_on(cells: Sequence[str], is_number: bool) -> bool:
    """Return whether a column may be a time: it never falls much, and rises."""
    if not is_number:
        return all(":" in cell for cell in cells) and len(set(cells)) > 1
    steps = np.diff([float(cell.replace(",", ".")) if _NUMBER.fullmatch(cell) else np.nan for cell in cells])
    steps = steps[np.isfinite(steps)]
    return bool(steps.size and (steps >= 0).mean() > _MOSTLY and (steps > 0).any())


def _are_sensors(cells: Sequence[str]) -> bool:
    """Return whether names are of a gyro and of an accelerometer, among others."""
    texts = {_CAMEL.sub(" ", in_english(cell)) for cell in set(cells)}
    words = {word for text in texts for word in _WORD.findall(text.lower())}
    return len(texts) <= _MAX_SENSORS and all(words & SENSORS[one] for one in ("gyro", "accelerometer"))


def _are_quantities(cells: Sequence[str]) -> bool:
    """Return whether names are of all axes of an IMU, or of latitude and longitude."""
    texts = set(cells)
    if len(texts) > _MAX_SENSORS:
        return False
    keys = {found.key for text in texts if (found := heading_of(text)) is not None}
    return any(keys >= one for one in _WHOLE)
