"""JSON tables: objects of JSON as tables, one for each kind: lines of gpsd, a recording of Sensor Logger.

Objects stand one in a line, after each other or in lists, at any place of a document. A key such as
``sensor`` or ``class`` names their kind. Of an object in an object, the keys are put together: ``values.x``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from typing import Any

_BEGIN = re.compile(rb"(?:[#/][^\n]*\n|\s){0,20}(?:\[\s{0,20})?(?:\{\s*\"|[^\n{]{0,200}\t\{\s*\")")
"""How such a text begins, below remarks: OwnTracks writes the time and a tabulator before each object."""
_KINDS = ("sensor", "class", "_type", "name", "type", "topic")
"""Keys that name the kind of an object."""
_PLACE = ("longitude", "latitude", "altitude")
"""What a position in GeoJSON is (RFC 7946, 3.1.1)."""
_DEEPEST = 4
"""Objects in objects that are looked at: a batch of Sensor Logger has two."""
_MOST_BYTES = 4
"""Most bytes of tables over those of the text."""
_MAX_KINDS, _MAX_KEYS = 200, 1000
"""Most kinds of objects, and keys of one kind: exports of phones have some twenty of each."""
_MOST_BROKEN, _DEEP = 20, 10_000
"""How often the text may be read in vain, and the characters that an object nested too deep counts for."""
_NO_CELL = str.maketrans(dict.fromkeys(",;|\t\r\n\"'", " "))
"""What ends a cell of a table."""


def is_json(data: bytes) -> bool:
    """Return whether a text begins as objects of JSON do."""
    return _BEGIN.match(data) is not None


def json_tables(data: bytes) -> list[tuple[str, bytes]]:
    """Return kind and csv of the objects in a text, in the order in which the kinds appear.

    Parameters
    ----------
    data
        The text, in UTF-8. What is no JSON ends the line, or the list in which it stands.
    """
    text = data.decode("utf-8", "replace")
    return write_tables((pair for one in _objects(text) for pair in _rows(one, "", _DEEPEST)), len(text))


def write_tables(rows: Iterable[tuple[str, dict[str, str]]], size: int) -> list[tuple[str, bytes]]:
    """Return kind and csv of rows, whose cells are named; those at the end of a row may be left out.

    Parameters
    ----------
    rows
        The kind of each, and its cells by name.
    size
        Bytes of the text that they are from: rows that need many times of that are left out.
    """
    names: dict[str, dict[str, int]] = {}
    lines: dict[str, list[str]] = {}
    left = _MOST_BYTES * size + _DEEP
    for kind, row in rows:
        if left < 0 or (kind not in lines and len(lines) == _MAX_KINDS):
            continue
        places, cells = names.setdefault(kind, {}), {}
        for name, cell in row.items():
            word = name.translate(_NO_CELL)
            if len(places) < _MAX_KEYS:
                places.setdefault(word, len(places))
            if word in places:
                cells[places[word]] = cell.translate(_NO_CELL)
        # A row ends with its last cell: of a thousand names, most rows may have few.
        line = ",".join(cells.get(place, "") for place in range(max(cells, default=-1) + 1))
        lines.setdefault(kind, []).append(line.rstrip(","))
        left -= len(lines[kind][-1])
    made = []
    for kind, (first, *others) in lines.items():
        whole = first + "," * (len(names[kind]) - 1 - first.count(","))  # shows how many cells a row has
        made.append((kind, "\n".join((",".join(names[kind]), whole, *others, "")).encode()))
    return made


def _objects(text: str) -> Iterator[dict[str, Any]]:
    """Iterate over the objects in a text that stand in no other one."""
    decoder = json.JSONDecoder()
    at, left = text.find("{"), _MOST_BROKEN * len(text) + _DEEP
    while at >= 0 and left > 0:
        try:
            one, end = decoder.raw_decode(text, at)
            yield one
        except (ValueError, RecursionError) as error:
            left -= getattr(error, "pos", at + _DEEP) - at
            end = text.find("\n", at)
            if end < 0:
                return
        at = text.find("{", end)


def _rows(one: dict[str, Any], name: str, depth: int) -> Iterator[tuple[str, dict[str, str]]]:
    """Iterate over kind and cells of the objects in an object, and of itself."""
    cells = _cells(one, "", depth)
    kind = next((str(one[key]) for key in _KINDS if isinstance(one.get(key), str) and one[key]), name)
    for key, value in one.items():
        if not isinstance(value, list) or not value or depth < 1:
            continue
        if isinstance(value[0], dict):
            for inner in value:
                if isinstance(inner, dict):
                    yield from _rows(inner, key, depth - 1)
    if cells:
        yield kind, cells


def _cells(one: dict[str, Any], before: str, depth: int) -> dict[str, str]:
    """Return the cells of an object by key; those of the coordinates of GeoJSON are a place."""
    found: dict[str, str] = {}
    for key, value in one.items():
        name = f"{before}{key}"
        if isinstance(value, dict) and depth:
            found |= _cells(value, f"{name}.", depth - 1)
        elif key == "coordinates" and isinstance(value, list):
            found |= {part: _cell(number) for part, number in zip(_PLACE, value, strict=False)}
        elif value is not None and not isinstance(value, dict | list):
            found[name] = _cell(value)
    return found


def _cell(value: Any) -> str:
    if isinstance(value, bool):
        return str(int(value))
    return str(value) if isinstance(value, str | int | float) else ""
