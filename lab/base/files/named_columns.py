"""Named columns: a csv file of numbers, each column known by its name in the header.

One header line, then one row per sample, cells separated by commas, ``.csv`` or ``.csv.gz``. The columns may
stand in any order; columns with other names are ignored. Lines starting with ``#`` may precede the header.
UTF-8, with or without byte order mark; line ends LF or CRLF. Cells are not quoted.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.file_content import TextBlocks
from lab.base.files.mission_error import MissionError

MAX_BYTES = 256 * 2**20
"""Largest file accepted, as stored and as decompressed [bytes]."""

MAX_HEADER_LINE = 1000
"""Last line on which the header may stand: more remarks than anybody writes, few enough to refuse at once."""
_MAX_SHOWN = 40
"""Longest cell that a message shows whole [characters]."""
_FEW = 2**20
"""Longest rows that NumPy reads [bytes], in 15 ms; pandas takes half, but 200 ms to import."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE | re.ASCII)


@dataclass(frozen=True)
class Column:
    """A column of a csv file.

    Attributes
    ----------
    name : str
        Name in the header, which ends with the unit.
    low, high : float
        Smallest and largest value accepted, in that unit.
    decimals : int
        Number of written decimals.
    required : bool
        False for columns that may be absent.
    may_be_empty : bool
        True for columns in which an empty cell, or ``nan``, says that the value is not known.
    """

    name: str
    low: float
    high: float
    decimals: int = 9
    required: bool = True
    may_be_empty: bool = False

    @property
    def accepted(self) -> str:
        """Accepted values, as text."""
        return f"a number from {self.low:.12g} to {self.high:.12g}"


class NamedTable(NamedTuple):
    """The columns of a csv file that were asked for.

    Attributes
    ----------
    columns : list of Column
        Those of them the file has, in the order in which they were asked for.
    values : (n, columns) array
        Their values, in the units of the file; NaN for empty cells where these are accepted.
    first_line : int
        Number of the line of the first row, as an editor shows it.
    cut_line : int
        Number of the last line if it is cut and was dropped; 0 if it is whole.
    """

    columns: list[Column]
    values: FloatArray
    first_line: int
    cut_line: int


def read_columns(path: Path, accepted: tuple[Column, ...], *, may_be_cut: bool = False) -> NamedTable:
    """Read the columns of a csv file that are asked for.

    Parameters
    ----------
    path
        A ``.csv`` file, or a gzip-compressed ``.csv.gz``.
    accepted
        The columns to look for.
    may_be_cut
        Whether the last line may be cut, as by a logger that lost its power: it then has fewer cells than the
        header, or its last cell is no number. It is dropped.

    Raises
    ------
    MissionError
        Naming file, row and column: if the file cannot be read or is too large, a required column is missing,
        or a cell is not a finite number within its limits.
    """
    with TextBlocks(path, MAX_BYTES) as text:
        columns, indices, cells = _header(path, text, accepted)
        first_line = text.next_line
        parsed = [np.empty((0, len(columns)))]
        blank_line = cut_line = 0
        for block in text.blocks():
            rows = block.rstrip()
            if rows:
                if blank_line:
                    raise MissionError(_blank_line_error(path, blank_line))
                values = _parse(rows, cells, columns, indices)
                if values is None and may_be_cut and text.at_end():
                    begun, _, last = rows.rpartition(b"\n")
                    if _is_cut(last, cells, columns, indices):
                        cut_line = text.next_line + rows.count(b"\n")
                        values = _parse(begun, cells, columns, indices) if begun else parsed[0]
                if values is None:
                    lines = text.decode(rows, text.next_line).split("\n")
                    raise MissionError(
                        _first_fault(path, lines, text.next_line, first_line, cells, columns, indices)
                    )
                parsed.append(values)
            if block.count(b"\n", len(rows)) or not rows:
                blank_line = blank_line or text.next_line + (rows.count(b"\n") + 1 if rows else 0)
            text.next_line += block.count(b"\n") + 1
    return NamedTable(columns, np.concatenate(parsed), first_line, cut_line)


def read_duration(
    path: Path, accepted: tuple[Column, ...], fewest: int, *, may_be_cut: bool = False
) -> float:
    """Return the time from the first row to the last of a csv file [s]; the rows between are not checked.

    Parameters
    ----------
    path
        A ``.csv`` file, or a gzip-compressed ``.csv.gz``.
    accepted
        The columns to look for; the first is the time, and increases.
    fewest
        Fewest accepted rows.
    may_be_cut
        Whether the last line may be cut, as for `read_columns`.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, a required column is missing, there are too few rows, or
        the time in the first or the last row is not a number within its limits.
    """
    with TextBlocks(path, MAX_BYTES) as text:
        columns, indices, cells = _header(path, text, accepted)
        begin, first, last, count = text.next_line, b"", b"", 0
        for block in text.blocks():
            rows = block.rstrip()
            if rows:
                first, before, last = first or rows.partition(b"\n")[0], last, rows.rpartition(b"\n")[2]
                count += rows.count(b"\n") + 1
                if may_be_cut and text.at_end() and _is_cut(last, cells, columns, indices):
                    last, count = rows.rpartition(b"\n")[0].rpartition(b"\n")[2] or before, count - 1
        ends = {begin: text.decode(first, begin), begin + count - 1: text.decode(last, begin + count - 1)}
    if count < fewest:
        raise MissionError(f"{path}: the file ends after {count} rows; accepted are at least {fewest}")
    for line, row in ends.items():
        if fault := _fault(path, row, line, cells, columns[:1], indices[:1]):
            raise MissionError(fault)
    start, end = (float(row.split(",")[indices[0]]) for row in ends.values())
    return end - start


def _header(
    path: Path, text: TextBlocks, accepted: tuple[Column, ...]
) -> tuple[list[Column], list[int], int]:
    """Read up to the header; return our columns, their places in it, and how many cells it has."""
    for line in itertools.islice(text.lines(), MAX_HEADER_LINE):
        if line.strip() and not line.startswith("#"):
            header = [cell.strip() for cell in line.split(",")]
            return *_find_columns(path, header, text.next_line - 1, accepted), len(header)
    if text.next_line > MAX_HEADER_LINE:
        raise MissionError(f"{path}: no header; accepted is one within the first {MAX_HEADER_LINE} lines")
    raise MissionError(
        f"{path}: the file is empty; accepted is a header line and rows. {_all_columns(accepted)}"
    )


def _find_columns(
    path: Path, header: list[str], line: int, accepted: tuple[Column, ...]
) -> tuple[list[Column], list[int]]:
    missing = [column.name for column in accepted if column.required and column.name not in header]
    if missing:
        hint = _layout_hint(",".join(header))
        noun = "column" if len(missing) == 1 else "columns"
        raise MissionError(
            f"{path}, row {line}: {noun} {', '.join(missing)} missing in the header.{hint} "
            f"{_all_columns(accepted)}"
        )
    columns = [column for column in accepted if column.name in header]
    for column in columns:
        if header.count(column.name) > 1:
            raise MissionError(f"{path}, row {line}: column {column.name} occurs twice; accepted once")
    return columns, [header.index(column.name) for column in columns]


def _layout_hint(header: str) -> str:
    """Return what is wrong with the layout of a header; empty if nothing is known."""
    for mark, word in ((";", "semicolons"), ("\t", "tabs")):
        if mark in header:
            return f" Cells are separated by commas, not {word}."
    return " Names and cells stand without quotation marks." if '"' in header else ""


def _parse(rows: bytes, cells: int, columns: list[Column], indices: list[int]) -> FloatArray | None:
    """Return the values of whole rows, or None if there is anything wrong in them."""
    if not _have_cells(rows, cells):
        return None
    values = _parse_few(rows, indices)
    values = _parse_many(rows, columns, indices) if values is None else values
    if values is None:
        return None
    low, high = np.array([(column.low, column.high) for column in columns]).T
    unknown = np.isnan(values) & [column.may_be_empty for column in columns]
    return values if (((values >= low) & (values <= high)) | unknown).all() else None


def _parse_few(rows: bytes, indices: list[int]) -> FloatArray | None:
    """Return the numbers in few rows; None if there are many rows, or anything but numbers in them."""
    if len(rows) > _FEW or not rows.isascii():
        return None
    try:
        text = io.StringIO(rows.decode("ascii"), newline="\n")
        values = np.loadtxt(text, delimiter=",", comments=None, usecols=indices, ndmin=2)
    except ValueError:
        return None
    # NumPy skips blank lines, and reads some words as numbers.
    return values if len(values) == rows.count(b"\n") + 1 and np.isfinite(values).all() else None


def _parse_many(rows: bytes, columns: list[Column], indices: list[int]) -> FloatArray | None:
    """Return the values of rows, or None if there is anything but numbers in them."""
    import pandas as pd  # noqa: PLC0415 - takes longer to import than NumPy to read few rows

    try:
        frame = pd.read_csv(
            io.BytesIO(rows), header=None, index_col=False, usecols=indices, dtype=np.float64, engine="c",
            na_filter=any(column.may_be_empty for column in columns), na_values=["", "nan", "NaN"],
            keep_default_na=False, quoting=csv.QUOTE_NONE, skip_blank_lines=False, low_memory=False,
        )  # fmt: skip
    except (ValueError, OverflowError):
        return None
    return np.ascontiguousarray(frame[indices].to_numpy())


def _is_cut(row: bytes, cells: int, columns: list[Column], indices: list[int]) -> bool:
    """Return whether the last row of a file ends early: it lacks cells, or its last cell is no number."""
    text = row.decode("utf-8", "replace")
    given = text.count(",") + 1
    if given != cells:
        return given < cells
    last = text.rpartition(",")[2].strip()
    at_end = [column for column, index in zip(columns, indices, strict=True) if index == cells - 1]
    # A whole number beyond its limits is a wrong number, and no part of one.
    return bool(at_end and not _NUMBER.fullmatch(last) and _cell_fault(at_end[0], last))


def _have_cells(rows: bytes, cells: int) -> bool:
    characters = np.frombuffer(rows, dtype=np.uint8)
    ends = np.append(np.flatnonzero(characters == ord("\n")), len(characters))
    commas = np.searchsorted(np.flatnonzero(characters == ord(",")), ends)
    # A zero byte would end a number early.
    return bool(characters.all() and (np.diff(commas, prepend=0) == cells - 1).all())


def _first_fault(
    path: Path,
    rows: list[str],
    line: int,
    first_line: int,
    cells: int,
    columns: list[Column],
    indices: list[int],
) -> str:
    """Return the message for the first row with something wrong; slow, and only called when there is one."""
    for number, row in enumerate(rows, line):
        if fault := _fault(path, row, number, cells, columns, indices):
            return fault + (_units_hint(row, cells) if number == first_line else "")
    return f"{path}, from row {line}: the rows cannot be read as numbers"


def _units_hint(row: str, cells: int) -> str:
    """Return advice about the row below the header if it has no number, as one with units has none."""
    texts = [text.strip() for text in row.split(",")]
    if len(texts) != cells or not any(texts) or any(_NUMBER.fullmatch(text) for text in texts):
        return ""
    return ". This row seems to contain units: delete it, for the names of the columns state the units"


def _fault(path: Path, row: str, number: int, cells: int, columns: list[Column], indices: list[int]) -> str:
    """Return the message for a row; empty if nothing is wrong in it."""
    texts = row.split(",")
    if not row.strip():
        return _blank_line_error(path, number)
    if len(texts) != cells:
        return f"{path}, row {number}: {len(texts)} cells; accepted are {cells}, as many as in the header"
    for column, index in zip(columns, indices, strict=True):
        if what := _cell_fault(column, texts[index].strip()):
            return f"{path}, row {number}, column {column.name}: {what}; accepted is {column.accepted}"
    return ""


def _cell_fault(column: Column, text: str) -> str:
    """Return what is wrong with a cell; empty if nothing is."""
    if column.may_be_empty and text in {"", "nan", "NaN"}:
        return ""
    if _NUMBER.fullmatch(text) and column.low <= float(text) <= column.high:
        return ""
    shown = text if len(text) <= _MAX_SHOWN else text[: _MAX_SHOWN - 3] + "..."
    return f"{shown!r} is not accepted" if shown else "the cell is empty"


def _blank_line_error(path: Path, line: int) -> str:
    return f"{path}, row {line}: the row is empty; accepted is one sample per row"


def _all_columns(accepted: tuple[Column, ...]) -> str:
    required = ", ".join(column.name for column in accepted if column.required)
    optional = ", ".join(column.name for column in accepted if not column.required)
    return f"Columns: {required}; optional: {optional}." if optional else f"Columns: {required}."
