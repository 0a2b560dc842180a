"""Filter csv: the innovations of any filter with their σ, and its states, as a csv with named columns.

The headings are those of ``innovations.csv``, which `Result.to_csv` writes: a time that ends with ``[s]``,
then innovations ``NAME AXIS [UNIT]`` and their σ ``NAME_sigma AXIS [UNIT]``, such as ``position east [m]``
and ``position_sigma east [m]``; columns with one name are components of one measurement, and one without
components has no axis: ``heading [rad]``. ``NAME_ratio``, where there is one, is the filter's own test
ratio: ν² over the gate squared times the variance. ``latitude [°]``, ``longitude [°]`` and ``height [m]``
with the σ ``latitude_sigma [m]``, ``longitude_sigma [m]`` and ``height_sigma [m]`` are states. A cell is
empty where nothing was fused.
"""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.file_content import TextBlocks
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES, MAX_HEADER_LINE, Column, read_columns
from lab.base.numbers import format_number
from lab.data.log.filter_log import (
    FilterLog,
    Innovations,
    Lane,
    Measured,
    Track,
    innovations_of,
    rejections,
    track_of,
)

NAME = "csv of innovations"

_HEADING = re.compile(
    r"(?P<name>[A-Za-z][\w-]*?)(?P<kind>_sigma|_ratio)?(?: (?P<axis>[A-Za-z]\w*))?(?: \[(?P<unit>[^\]]*)\])?"
)
_SIGMA_HEADING = re.compile(rb"(?:^|,)\s*\w+_sigma(?: \w+)? \[[^\]]*\]")
_TIME = re.compile(r"time\w* \[s\]")
_PLACE = ("latitude [°]", "longitude [°]", "height [m]")
_PLACE_SIGMA = ("latitude_sigma [m]", "longitude_sigma [m]", "height_sigma [m]")
_MAX_VALUE = 1e10
"""Largest time, innovation or state accepted: larger numbers are damaged, in whatever unit."""
_MAX_COLUMNS = 200
"""Most columns: a filter has some dozen measurements."""
_MOST_BACK = 0.1
"""Largest part of the rows that may be earlier than one before: damaged bytes make a few."""
HEADINGS = "time [s], position north [m], position_sigma north [m]"
"""Headings of an accepted file."""


class _Part(NamedTuple):
    """A column of innovations: the name of the measurement, the axis and the unit."""

    name: str
    axis: str
    unit: str


def recognises(head: bytes) -> bool:
    """Return whether a file has a header with the σ of an innovation."""
    lines = head.split(b"\n", MAX_HEADER_LINE)[:MAX_HEADER_LINE]
    header = next((line for line in lines if line.strip() and not line.startswith(b"#")), b"")
    return header.lower().startswith(b"time") and _SIGMA_HEADING.search(header) is not None


def is_table(head: bytes) -> bool:
    """Return whether a file begins with headings in columns, whatever they say."""
    line = next((line for line in head.splitlines() if line.strip() and not line.startswith(b"#")), b"")
    cells = line.decode("utf-8", "replace").split(",")
    return len(cells) > 1 and all(cell.strip()[:1].isalpha() and cell.isprintable() for cell in cells)


def read(path: Path) -> FilterLog:
    """Read the innovations of any filter.

    Raises
    ------
    MissionError
        If the file cannot be read, has no innovation with its σ, or its rows are not in the order of time.
    """
    header = _header(path)
    time = next((cell for cell in header if _TIME.fullmatch(cell)), None)
    states = set(_PLACE) <= set(header)
    parts = {} if len(header) > _MAX_COLUMNS else _parts(header, {*_PLACE} if states else set())
    if time is None or not parts:
        raise MissionError(
            f"{path}: no time [s] and no innovation with its σ in a header of {len(header)} columns; "
            f"accepted are headings such as {HEADINGS}, at most {_MAX_COLUMNS}"
        )
    columns = [Column(time, -_MAX_VALUE, _MAX_VALUE)]
    for cell, part in parts.items():
        columns.append(Column(cell, -_MAX_VALUE, _MAX_VALUE, may_be_empty=True))
        columns.append(Column(_sigma_in_cell(cell), 0.0, _MAX_VALUE, may_be_empty=True))
        columns.append(Column(f"{part.name}_ratio", 0.0, _MAX_VALUE, required=False, may_be_empty=True))
    columns += [
        Column(cell, -_MAX_VALUE, _MAX_VALUE, required=False, may_be_empty=True)
        for cell in ((*_PLACE, *_PLACE_SIGMA) if states else ())
    ]
    table = read_columns(path, tuple(dict.fromkeys(columns)), may_be_cut=True)
    values = {column.name: table.values[:, at] for at, column in enumerate(table.columns)}
    back = int(np.sum(values[time] < np.maximum.accumulate(values[time])))
    if back > _MOST_BACK * len(table.values):
        raise MissionError(
            f"{path}: {back} of {len(table.values)} rows are earlier than one before; accepted are rows in "
            "the order of time"
        )
    found = []
    for name in dict.fromkeys(part.name for part in parts.values()):
        own = {cell: part for cell, part in parts.items() if part.name == name}
        one = _innovations(own, values[time], values)
        found += [] if one is None else [one]
    if not found:
        raise MissionError(
            f"{path}: no row has innovations and σ above 0; accepted are rows with both, where something "
            "was fused"
        )
    lane = Lane("filter", tuple(found), _track(values[time], values))
    events = [event for one in found for event in rejections(one, "The filter")]
    flags = "The csv has no test ratios of the filter."
    tested = np.concatenate([one.ratio[np.isfinite(one.ratio)] for one in found])
    if tested.size:
        flags = (
            f"Test ratios above 1 in {format_number(100 * float(np.mean(tested > 1)))} % of the innovations."
        )
    start = float(values[time][0])
    return FilterLog.of(path, "a filter", (lane,), 0, events, flags, start)


def _header(path: Path) -> list[str]:
    with TextBlocks(path, MAX_BYTES) as text:
        for line in islice(text.lines(), MAX_HEADER_LINE):
            if line.strip() and not line.startswith("#"):
                return [cell.strip() for cell in line.split(",")]
    raise MissionError(f"{path}: the file is empty; accepted is a header line and rows")


def _parts(header: list[str], states: set[str]) -> dict[str, _Part]:
    """Return the columns of innovations whose σ is there too."""
    parts = {}
    for cell in header:
        found = _HEADING.fullmatch(cell)
        if found and not found["kind"] and cell not in states and _sigma_in_cell(cell) in header:
            parts[cell] = _Part(found["name"], found["axis"] or "", found["unit"] or "")
    return parts


def _sigma_in_cell(cell: str) -> str:
    name, space, rest = cell.partition(" ")
    return f"{name}_sigma{space}{rest}"


def _innovations(
    parts: dict[str, _Part], time: FloatArray, values: dict[str, FloatArray]
) -> Innovations | None:
    first, part = next(iter(parts.items()))
    axes = tuple(one.axis for one in parts.values())
    return innovations_of(
        Measured(part.name.replace("_", " "), axes, part.unit),
        time,
        np.column_stack([values[cell] for cell in parts]),
        first,
        variance=np.column_stack([values[_sigma_in_cell(cell)] for cell in parts]) ** 2,
        ratio=values.get(f"{part.name}_ratio"),
    )


def _track(time: FloatArray, values: dict[str, FloatArray]) -> Track | None:
    if not set(_PLACE) <= set(values):
        return None
    latitude, longitude, height = (values[cell] for cell in _PLACE)
    unknown = np.full(time.shape, np.nan)
    sigma = np.column_stack([values.get(cell, unknown) for cell in _PLACE_SIGMA])
    place = np.column_stack((np.radians(latitude), np.radians(longitude), height))
    return track_of(time, place, sigma, f"{_PLACE[0]}, {_PLACE_SIGMA[0]}")
