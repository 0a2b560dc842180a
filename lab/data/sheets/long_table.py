"""Long table: rows that are each of one sensor, whose name stands in a column, as a table for each sensor.

Recorders of phones write all sensors into one file so: ``time,sensor,x,y,z``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from lab.data.sheets.column_words import SENSORS, in_english
from lab.data.sheets.sheet_layout import cells_of

_KIND = re.compile(r"(?i)(?:sensor|sensor[ _]?(?:name|type)|type|name|kind|message|source)")
_AXIS = re.compile(r"(?i)(?:[vd]|value|values|val|data|axis)?[ _.]?\[?([xyz0-3])\]?(?:[ _]?(?:axis|value))?")
"""Headings of the sensor of a row, and of what it measured along an axis."""
_WORD = re.compile(r"[a-z]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_HEAD = 2**16
"""First bytes that show the format."""
_MAX_SENSORS = 64
"""Most sensors in a file."""
_ROWS = 200
"""Rows at the start that show it."""


class _Form(NamedTuple):
    """What separates cells, the place of the sensor's name, and the headings of each of its tables."""

    delimiter: bytes
    kind: int
    headings: bytes


def is_long(head: bytes) -> bool:
    """Return whether the first bytes of a text, in UTF-8, are of such a table."""
    return _form_of(head) is not None


def long_tables(data: bytes) -> list[tuple[str, bytes]]:
    """Return the name of each sensor and its table; nothing for a text of another form.

    Parameters
    ----------
    data
        The text, in UTF-8.
    """
    form = _form_of(data)
    if form is None:
        return []
    found: dict[bytes, list[bytes]] = {}
    for line in data[data.find(b"\n") + 1 :].split(b"\n"):
        row = line.split(form.delimiter, form.kind + 1)
        if len(row) > form.kind and (row[form.kind] in found or len(found) < _MAX_SENSORS):
            found.setdefault(row[form.kind], []).append(line)
    return [
        (sensor.decode("utf-8", "replace").strip("\"' \r"), b"\n".join((form.headings, *lines, b"")))
        for sensor, lines in found.items()
    ]


def _form_of(data: bytes) -> _Form | None:
    """Return the form of a long table by its header and first rows; None for another text."""
    head, _, rest = data[:_HEAD].partition(b"\n")
    header = head.decode("utf-8", "replace").strip("\r")
    delimiter = max(",;\t|", key=header.count)
    names = cells_of(header, delimiter)
    kinds = [place for place, name in enumerate(names) if _KIND.fullmatch(name)]
    axes = {place: found[1].lower() for place, name in enumerate(names) if (found := _AXIS.fullmatch(name))}
    parts = "".join(axes.values())
    if len(kinds) != 1 or parts not in ("xyz", "012", "123"):
        return None
    kind, mark = kinds[0], delimiter.encode()
    cells = [line.split(mark) for line in rest.split(b"\n", _ROWS)[:_ROWS]]
    if not _are_sensors([row[kind] for row in cells if len(row) == len(names)]):
        return None
    headings = [
        "xyz"[parts.index(axes[place])] if place in axes else name for place, name in enumerate(names)
    ]
    return _Form(mark, kind, delimiter.join(headings).encode())


def _are_sensors(cells: Sequence[bytes]) -> bool:
    """Return whether names are of a gyro and of an accelerometer, among others."""
    texts = {_CAMEL.sub(" ", in_english(cell.decode("utf-8", "replace"))) for cell in set(cells)}
    words = {word for text in texts for word in _WORD.findall(text.lower())}
    return len(texts) <= _MAX_SENSORS and all(words & SENSORS[one] for one in ("gyro", "accelerometer"))
