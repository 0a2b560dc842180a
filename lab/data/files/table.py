"""Table: the numbers of a delimited text file from a logger: padded, truncated, or with repeated headers.

Cells are separated by ``,`` ``;`` ``|`` or a tab. The header is in the first lines and is repeated
wherever the logger was restarted; without a header the columns are known by their order. Rows that cannot
be used are left out and counted.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.file_content import TextBlocks
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.rebuild.raw_flight import Dropped

_DELIMITERS = "|\t;,"
_MAX_HEADER_LINE = 100
"""Last line on which the header may stand."""
_MAX_NAMED = 12
"""Most headings for one need that a message names."""
_MAX_COLUMNS = 10_000
"""Most columns: X-Plane and JSBSim have some hundred."""
_MAX_RECORDINGS = 1000
"""Most headers in a file: each takes memory of its own."""
_PIECE = 2**17
"""Bytes parsed at a time: what parsing takes beside them stays small."""
_SLOW_PIECE = 2**14
"""The same where cells are not all numbers, and each takes some fifty bytes as text."""

MISSING = "cells missing or too many"
"""Why rows are dropped that have another number of cells than the header."""
NO_NUMBER = "cells empty or no numbers"
"""Why rows are dropped that have a cell without a finite number."""
OTHER_RECORDING = "of another recording in the same file"
"""Why rows are dropped under a header that is not that of the longest recording."""

Required = Sequence[Collection[str]]


@dataclass(frozen=True)
class Header:
    """Where the columns of a table stand.

    Attributes
    ----------
    delimiter : str
        What separates cells.
    cells : tuple of str
        The headings as in the file.
    """

    delimiter: str
    cells: tuple[str, ...]

    @property
    def names(self) -> list[str]:
        """The headings in the form they are compared in."""
        return [plain(cell) for cell in self.cells]

    def has_headings(self, required: Required) -> bool:
        """Return whether there is a heading for each need; any of its names meets a need."""
        names = set(self.names)
        return all(not names.isdisjoint(need) for need in required)


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of finite numbers.

    Attributes
    ----------
    columns : dict
        The numbers of each column, in the units of the file, by its name as `plain` gives it.
    headings : dict
        Each name as it is in the file.
    lines : (n,) array
        The number of each row's line, as an editor shows it.
    rows_read : int
        Rows of samples in the file.
    dropped : tuple of Dropped
        Which were left out.
    remarks : tuple of str
        Further observations.
    """

    columns: dict[str, FloatArray]
    headings: dict[str, str]
    lines: NDArray[np.int32]
    rows_read: int
    dropped: tuple[Dropped, ...]
    remarks: tuple[str, ...]


def plain(heading: str) -> str:
    """Return a heading without what loggers decorate it with: case, blanks, underscores and quotes."""
    return "".join(heading.replace("_", "").replace('"', "").replace("\ufeff", "").split()).lower()


def find_header(lines: Sequence[str], required: Required) -> tuple[int, Header] | None:
    """Return the first line with all required headings, by its place, or None.

    Parameters
    ----------
    lines
        The first lines of a file.
    required
        For each need the names, as `plain` gives them, of which one must be there.
    """
    for place, line in enumerate(lines[:_MAX_HEADER_LINE]):
        header = _header(line, required)
        if header:
            return place, header
    return None


def head_lines(head: bytes) -> list[str]:
    """Return the first bytes of a text file as lines; what is no text becomes replacement characters."""
    # Every table asks for them: what follows the last of these lines is not decoded.
    first = b"\n".join(head.split(b"\n", _MAX_HEADER_LINE)[:_MAX_HEADER_LINE])
    return first.decode("utf-8", "replace").splitlines()[:_MAX_HEADER_LINE]


def read_table(
    path: Path,
    wanted: Collection[str],
    required: Required,
    order: Header | None = None,
) -> Table:
    """Read the wanted columns of a delimited text file, gzip-compressed or not.

    The longest of several recordings in one file, each under its own header, is used. A column that is not
    required and holds numbers in less than half of the rows counts as absent.

    Parameters
    ----------
    path
        The file.
    wanted
        Names of the columns to read if they are there, as `plain` gives them.
    required
        For each need the names, among those wanted, of which one must be there.
    order
        The columns of a file that has no header.

    Raises
    ------
    MissionError
        If the file cannot be read, is too large, has no such header, or has too few rows that can be used.
    """
    with TextBlocks(path, MAX_BYTES, strict=False) as text:
        header = order or _first_header(path, text, required)
        recordings = [
            _Recording(header, wanted, {name for need in required if len(need) == 1 for name in need})
        ]
        for block in text.blocks():
            for piece in _pieces(block):
                _read_piece(path, piece, text.next_line, recordings, required if order is None else ())
                text.next_line += piece.count(b"\n") + 1
    longest = max(recordings, key=lambda recording: recording.rows)
    table = longest.table()
    others = [recording for recording in recordings if recording is not longest and recording.rows_read]
    dropped = list(table.dropped)
    if others:
        dropped.append(
            Dropped(OTHER_RECORDING, sum(other.rows_read for other in others), others[0].first_line)
        )
    rows_read = sum(recording.rows_read for recording in recordings)
    if len(table.lines) < MIN_SAMPLES:
        raise MissionError(_too_few(path, len(table.lines), rows_read, dropped))
    for need in required:
        if table.columns.keys().isdisjoint(need):
            raise MissionError(
                f"{path}: hardly a row has a number under {' or '.join(need)}; accepted are most"
            )
    return replace(table, rows_read=rows_read, dropped=tuple(dropped))


def _too_few(path: Path, usable: int, rows_read: int, dropped: Sequence[Dropped]) -> str:
    why = "; ".join(f"{drop.count} left out from row {drop.first_row} on: {drop.reason}" for drop in dropped)
    return (
        f"{path}: {usable} of {rows_read} rows of samples can be used{f' ({why})' if why else ''}; accepted "
        f"are at least {MIN_SAMPLES}"
    )


def _header(line: str, required: Required) -> Header | None:
    delimiters = [mark for mark in _DELIMITERS if mark in line and line.count(mark) < _MAX_COLUMNS]
    if not delimiters or not _names_all(line, required):
        return None
    for delimiter in delimiters:
        try:
            cells = next(csv.reader([line], delimiter=delimiter), [])
        except csv.Error:
            cells = line.split(delimiter)
        header = Header(delimiter, tuple(cell.strip() for cell in cells))
        if header.has_headings(required):
            return header
    return None


def _names_all(line: str, required: Required) -> bool:
    """Return whether a line has the letters of all needs: quicker than its cells, and most lines end here."""
    letters = plain(line)
    return all(any(name in letters for name in need) for need in required)


def _first_header(path: Path, text: TextBlocks, required: Required) -> Header:
    for line in text.lines():
        header = _header(line, required)
        if header:
            return header
        if text.next_line > _MAX_HEADER_LINE:
            break
    needs = ", ".join(
        " or ".join((*list(need)[:_MAX_NAMED], *(["others"] if len(need) > _MAX_NAMED else ())))
        for need in required
    )
    raise MissionError(
        f"{path}: no header within the first {_MAX_HEADER_LINE} lines; accepted is one with {needs} "
        f"among at most {_MAX_COLUMNS} columns"
    )


def _pieces(block: bytes) -> Iterator[bytes]:
    """Cut a block at line ends, which are left out, so that what parsing takes beside it stays small."""
    start = 0
    while start < len(block):
        end = len(block) if len(block) - start <= _PIECE else block.rfind(b"\n", start, start + _PIECE)
        if end < 0:
            end = block.find(b"\n", start)
        end = len(block) if end < 0 else end
        yield block[start:end]
        start = end + 1


@dataclass
class _Recording:
    """The rows under one header during reading."""

    header: Header
    wanted: Collection[str]
    required: Collection[str]
    parts: dict[str, list[FloatArray]] = field(default_factory=dict)
    lines: list[NDArray[np.int32]] = field(default_factory=list)
    rows: int = 0
    rows_read: int = 0
    first_line: int = 0
    miscounted: int = 0
    first_miscounted: int = 0
    unknown: int = 0
    first_unknown: int = 0

    def __post_init__(self) -> None:
        names = self.header.names
        self.names = tuple(dict.fromkeys(name for name in names if name in self.wanted))
        self.parts = {name: [] for name in self.names}
        self.places = [names.index(name) for name in self.names]
        self.twice = [self.header.cells[names.index(name)] for name in self.names if names.count(name) > 1]
        # A logger may end each line, or the header only, with a delimiter.
        self.fewest = max((i + 1 for i, name in enumerate(names) if name), default=1)
        self.most = max(len(names), self.fewest + 1)
        # Marks a line that may be the header again; numbers do not hold it.
        self.mark = max((self.header.cells[place] for place in self.places), key=len, default="").encode()

    def add(self, rows: bytes, first_line: int) -> None:
        """Take the numbers of whole lines."""
        # A zero byte would end a number early; quotes around numbers say nothing.
        rows = rows.replace(b"\0", b"?").replace(b'"', b" ") + b"\n"
        characters = np.frombuffer(rows, dtype=np.uint8)
        ends = np.flatnonzero(characters == ord("\n"))
        starts = np.concatenate(([0], ends[:-1] + 1))
        samples = np.logical_or.reduceat(characters > ord(" "), starts) & (characters[starts] != ord("#"))
        separators = np.add.reduceat(characters == ord(self.header.delimiter), starts, dtype=np.int64)
        kept = samples & (separators + 1 >= self.fewest) & (separators + 1 <= self.most)
        if not self.rows_read and samples.any():
            self.first_line = first_line + int(np.argmax(samples))
        self.rows_read += int(samples.sum())
        bad = np.flatnonzero(samples & ~kept)
        if len(bad):
            self.first_miscounted = self.first_miscounted or first_line + int(bad[0])
            self.miscounted += len(bad)
        if kept.any():
            whole = rows if kept.all() else characters[np.repeat(kept, ends - starts + 1)].tobytes()
            self._keep(_numbers(whole, self), (first_line + np.flatnonzero(kept)).astype(np.int32))

    def _keep(self, columns: list[FloatArray], lines: NDArray[np.int32]) -> None:
        needed = np.ones(len(lines), dtype=bool)
        known = np.zeros(len(lines), dtype=bool)
        for name, numbers in zip(self.names, columns, strict=True):
            numbers[~np.isfinite(numbers)] = np.nan
            known |= ~np.isnan(numbers)
            if name in self.required:
                needed &= ~np.isnan(numbers)
        known &= needed
        if not known.all():
            self.first_unknown = self.first_unknown or int(lines[np.argmin(known)])
            self.unknown += int(len(lines) - known.sum())
            columns, lines = [numbers[known] for numbers in columns], lines[known]
        for name, numbers in zip(self.names, columns, strict=True):
            self.parts[name].append(numbers)
        self.lines.append(lines)
        self.rows += len(lines)

    def table(self) -> Table:
        """Return all rows, without those that have cells without a number; the parts are gone then."""
        lines = np.concatenate([np.empty(0, np.int32), *self.lines])
        # Column by column, so that never all numbers are in memory twice.
        columns = {name: np.concatenate([np.empty(0), *self.parts.pop(name)]) for name in self.names}
        headings = {
            name: self.header.cells[place] for name, place in zip(self.names, self.places, strict=True)
        }
        remarks = []
        unusable = np.zeros(len(lines), dtype=bool)
        for name in self.names:
            blank = np.isnan(columns[name])
            if 2 * blank.sum() <= len(blank):
                unusable |= blank
            else:
                del columns[name]
                remarks.append(
                    f"Column {headings[name]} is left out: most of its cells are empty or no numbers."
                )
        remarks += [f"Column {name} is there more than once: the first is taken." for name in self.twice]
        dropped = []
        if self.miscounted:
            dropped.append(Dropped(MISSING, self.miscounted, self.first_miscounted))
        if unusable.any():
            first = int(lines[np.argmax(unusable)])
            self.first_unknown = min(self.first_unknown or first, first)
            self.unknown += int(unusable.sum())
            lines = lines[~unusable]
            for name in columns:
                columns[name] = columns[name][~unusable]
        if self.unknown:
            dropped.append(Dropped(NO_NUMBER, self.unknown, self.first_unknown))
        return Table(columns, headings, lines, self.rows_read, tuple(dropped), tuple(remarks))


def _read_piece(
    path: Path, piece: bytes, line: int, recordings: list[_Recording], required: Required
) -> None:
    """Add a piece to the last recording, and begin a new one at each header in it."""
    begin = search = 0
    while required:
        found = piece.find(recordings[-1].mark, search)
        if found < 0:
            break
        start = piece.rfind(b"\n", 0, found) + 1
        end = piece.find(b"\n", found)
        end = len(piece) if end < 0 else end
        search = end + 1
        header = _header(piece[start:end].decode("utf-8", "replace"), required)
        if header:
            if start > begin:
                recordings[-1].add(piece[begin : start - 1], line + piece.count(b"\n", 0, begin))
            if len(recordings) == _MAX_RECORDINGS:
                raise MissionError(f"{path}: more than {_MAX_RECORDINGS} headers; accepted is one flight")
            recordings.append(_Recording(header, recordings[-1].wanted, recordings[-1].required))
            begin = end + 1
    if begin < len(piece):
        recordings[-1].add(piece[begin:], line + piece.count(b"\n", 0, begin))


def _numbers(rows: bytes, recording: _Recording) -> list[FloatArray]:
    """Return the wanted columns of lines with the right number of cells; NaN where there is no number."""
    import pandas as pd  # noqa: PLC0415 - slow to import, and only reading needs it

    places, delimiter = recording.places, recording.header.delimiter
    how: dict[str, Any] = {
        "header": None, "index_col": False, "usecols": places, "sep": delimiter, "engine": "c",
        "quoting": csv.QUOTE_NONE, "skip_blank_lines": False, "skipinitialspace": True, "low_memory": False,
        "encoding": "latin-1",
    }  # fmt: skip
    # Rows may differ by a last delimiter: pandas takes the number of cells from the first row.
    first = delimiter.encode() * (recording.most - 1) + b"\n"
    try:
        frame = pd.read_csv(io.BytesIO(first + rows), dtype=np.float64, **how)
        return [frame[place].to_numpy()[1:].copy() for place in places]
    except (ValueError, OverflowError):
        pass
    parts: list[list[FloatArray]] = [[] for _ in places]
    # As text a cell takes some fifty bytes, so only a part of the rows is text at a time.
    for start, end in _line_bounds(rows, _SLOW_PIECE):
        cells = pd.read_csv(io.BytesIO(first + rows[start:end]), dtype=object, na_filter=False, **how)
        for part, place in zip(parts, places, strict=True):
            numbers = pd.to_numeric(cells[place].str.strip(), errors="coerce")
            part.append(np.array(numbers, dtype=np.float64)[1:])
    return [np.concatenate(part) for part in parts]


def _line_bounds(rows: bytes, size: int) -> Iterator[tuple[int, int]]:
    start = 0
    while start < len(rows):
        end = rows.find(b"\n", min(start + size, len(rows) - 1)) + 1
        yield start, end
        start = end
