"""Sheet cells: the numbers in cells that hold more than a number: units, hemispheres, separators.

Loggers write ``245.5 m``, ``51.477928N``, ``2,114.8``, ``12,5`` and, for a place, ``51.4779 -0.0015``.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.data.clock.stamps import offset_of
from lab.data.files.unit_names import RATIO

_THOUSANDS = r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d+)?"
_BOTH_SEPARATORS = r"[+-]?\d{1,3}(?:,\d{3})+\.\d+"
_OTHER_THOUSANDS = {
    r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+,\d+": r"\.", r"[+-]?[1-9]\d{0,2}(?:['’]\d{3})+(?:[.,]\d+)?": "['’]",
    r"[+-]?[1-9]\d{0,2}(?:[ \u00a0\u202f]\d{3})+(?:[.,]\d+)?": "[ \u00a0\u202f]",
}  # fmt: skip
"""Numbers with points, apostrophes or blanks between thousands, and these marks."""
_DECIMAL_COMMA = r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?"
_DECORATED = re.compile(r"[^\w+.-]{0,3}\s*([+-]?\d+(?:\.\d*)?)\s*([^\d\s][^\d]{0,6})?")
"""A number with an arrow or sign before it, and a unit after it."""
_SIZE = r"(\d{1,12}(?:\.\d{0,20})?)"
_MINUTES = rf"\s{{0,3}}{_SIZE}\s{{0,3}}(?:['′’]|(?=\s)|$)"
_SECONDS = rf"\s{{0,3}}{_SIZE}\s{{0,3}}(?:\"{{1,2}}|″|”|'{{2}}|(?=\s)|$)"
_HEMISPHERE = re.compile(
    rf"(?i)(?:([NSEW])\s{{0,3}})?([+-]?){_SIZE}\s{{0,3}}(?:[°º]|deg|(?=\s\d))?"
    rf"(?:{_MINUTES}(?:{_SECONDS})?)?(?:\s{{0,3}}([NSEW]))?"
)
"""Degrees, or degrees and minutes, or degrees, minutes and seconds."""
_PAIR = re.compile(r"[\s(\[]*([+-]?\d+\.\d+)\s*[,;\s]\s*([+-]?\d+\.\d+)[\s)\]]*")
_SOUTH_OR_WEST = frozenset("SWsw")
_NO_PLAIN_NUMBER = re.compile(r"(?i)\d\s*°?\s*[NSEW]|[NSEW]\s*\d|\d[,;\s]+[+-]?\d|\d\s*[°º]")
"""What a column has somewhere whose cells are looked at one by one."""
_DIGITS = re.compile(r"\d")
_PLACEHOLDERS = (-999.0, -9999.0, -99_999.0, -999_999.0)
"""Numbers that loggers write for an unknown value."""
_APART = 2.0
"""Distance of such a number from all others, over their range, from which it is none of them. The range is
taken to be 1 at least, in the unit of the column: whole numbers that hardly change are no proof."""


_ZONE = re.compile(r"[+-]?\d\d:?\d\d")
"""The offset of a zone from UTC; a file that writes it in a column of its own may leave out the plus."""
_PIECE = 2**17
"""Bytes of which the characters are looked at at a time."""
MISSING = "cells missing or too many"
"""Why rows are dropped that have another number of cells than the header."""
NO_NUMBER = "cells empty or no numbers"
"""Why rows are dropped that have a cell without a finite number."""


def numbers_of_cells(cells: Any, comma_separates: bool) -> tuple[FloatArray, str]:
    """Return the numbers of a column of texts, NaN where there is none, and the unit in its cells.

    Parameters
    ----------
    cells : pandas.Series of str
        The column.
    comma_separates
        Whether commas separate the cells of the file: in a quoted cell they then mark thousands.
    """
    import pandas as pd  # noqa: PLC0415 - slow to import, and only reading needs it

    def parse_texts(texts: Any) -> FloatArray:
        values = np.array(pd.to_numeric(texts, errors="coerce"), dtype=np.float64)
        values[~np.isfinite(values)] = np.nan
        return values

    numbers = parse_texts(cells)
    left = np.isnan(numbers) & cells.str.contains(_DIGITS).to_numpy(dtype=bool)
    if not left.any():
        return numbers, ""
    for pattern, mark in _OTHER_THOUSANDS.items():
        if (fits := cells.str.fullmatch(pattern)).any():
            cells = cells.where(~fits, cells.str.replace(mark, "", regex=True))
            numbers = parse_texts(cells)
            left = np.isnan(numbers) & cells.str.contains(_DIGITS).to_numpy(dtype=bool)
    if cells[left].str.contains(",").any():
        if comma_separates or cells[left].str.fullmatch(_BOTH_SEPARATORS).any():
            fits, mark = cells.str.fullmatch(_THOUSANDS), ""
        else:
            fits, mark = cells.str.fullmatch(_DECIMAL_COMMA), "."
        fits &= left
        numbers[fits.to_numpy(dtype=bool)] = parse_texts(cells[fits].str.replace(",", mark))
        left &= np.isnan(numbers)
    unit = ""
    for row in np.flatnonzero(left):
        if found := _DECORATED.fullmatch(cells.iloc[row]):
            numbers[row], unit = float(found[1]), unit or (found[2] or "").strip()
    return numbers, unit


def are_decimal_commas(columns: Sequence[Any]) -> bool:
    """Return whether commas in the quoted cells of a table are decimal, and do not mark thousands.

    Parameters
    ----------
    columns : sequence of pandas.Series of str
        The columns.
    """
    found = False
    for cells in columns:
        if not cells.str.contains(",", regex=False).any():
            continue
        if cells.str.fullmatch(_BOTH_SEPARATORS).any():
            return False
        found |= bool((cells.str.fullmatch(_DECIMAL_COMMA) & ~cells.str.fullmatch(_THOUSANDS)).any())
    return found


def without_placeholders(values: FloatArray, *more: float) -> tuple[FloatArray, str]:
    """Return numbers with NaN for those that stand for an unknown value, such as -9999, and a report.

    More numbers may stand for such a value than in all columns.
    """
    found = []
    for number in (*_PLACEHOLDERS, *more):
        unknown = values == number
        if not unknown.any():
            continue
        others = values[~unknown & np.isfinite(values)]
        if others.size and others.min() - number > _APART * max(float(np.ptp(others)), 1.0):
            values = np.where(unknown, np.nan, values)
            found.append(f"{number:.0f} in {int(unknown.sum())} rows")
    return values, " and ".join(found)


def angles_of_cells(cells: Any, is_longitude: bool) -> FloatArray:
    """Return latitudes or longitudes of a column of texts with a hemisphere or two numbers; NaN for others.

    Parameters
    ----------
    cells : pandas.Series of str
        The column.
    is_longitude
        Whether the second number of a cell with two is taken.
    """
    values = np.full(len(cells), np.nan)
    if not cells.str.contains(_NO_PLAIN_NUMBER).any():
        return values
    for row, text in enumerate(cells):
        if found := _PAIR.fullmatch(text):
            values[row] = float(found[2] if is_longitude else found[1])
        elif found := _HEMISPHERE.fullmatch(text):
            side = found[1] or found[6] or ""
            size = float(found[3]) + float(found[4] or 0) / 60 + float(found[5] or 0) / 3600
            values[row] = size * (-1 if (side in _SOUTH_OR_WEST and side) or found[2] == "-" else 1)
    return values


def signs_of_sides(cells: Any) -> FloatArray:
    """Return 1 for N and E, -1 for S and W, NaN for anything else, of a column of texts."""
    signs = {"N": 1.0, "E": 1.0, "S": -1.0, "W": -1.0}
    return np.array([signs.get(text.strip().upper()[:1], np.nan) for text in cells])


def are_fixes(cells: Any) -> FloatArray:
    """Return 0 for the texts of a receiver's status that begin with "no", and else 1."""
    return np.where(cells.str.lower().str.startswith("no"), 0.0, 1.0)


_WHOLE_BYTES, _END_BYTES = 6, 3
"""Bytes of a name that a number holds: all of a short one, such as the address of an aircraft; of others the
end, which a person recognises, beside a sum of all."""
_FROM = 256**_WHOLE_BYTES
"""Number from which such a sum is added."""


def codes_of_names(cells: Any) -> FloatArray:
    """Return numbers for the names of vehicles: numbers as they are, and others below zero."""
    return np.where(cells == "", np.nan, cells.map({name: _encode_name(name) for name in cells.unique()}))


def _encode_name(name: str) -> float:
    if name.isascii() and name.isdigit() and (name[0] != "0" or name == "0"):
        return float(name)  # 007 is another vehicle than 7
    data = name.encode()
    if len(data) <= _WHOLE_BYTES:
        return -float(int.from_bytes(data, "big"))
    end = int.from_bytes(data[-_END_BYTES:], "big")
    return -float(_FROM + (zlib.crc32(data) % 2**28) * 256**_END_BYTES + end)


def name_of_code(code: float) -> str:
    """Return the name of a vehicle that has this number, or its end."""
    if code >= 0:
        return f"{code:.0f}"
    is_whole = -code < _FROM
    number = int(-code) % (_FROM if is_whole else 256**_END_BYTES)
    text = number.to_bytes(_WHOLE_BYTES, "big").strip(b"\0").decode("utf-8", "replace")
    return text if is_whole else f"…{text}"


def offsets_of_zones(cells: Any) -> FloatArray:
    """Return by how much zones, such as -05:00 or 02:30, are ahead of UTC [s]; NaN for other texts."""
    known = {
        text: offset_of(text if text[0] in "+-" else f"+{text}") if _ZONE.fullmatch(text) else np.nan
        for text in set(cells)
    }
    return np.array([known[text] for text in cells])


class Rows(NamedTuple):
    """Whole lines with the right number of cells, and what was left out.

    Attributes
    ----------
    data : bytes
        The lines, after one of as many cells as accepted, all empty.
    lines : (n,) array
        Their numbers, as an editor shows them.
    read : int
        How many rows of samples there are in all.
    first : int
        The line of the first; 0 without one.
    lost : dict of (int, int)
        How many were left out, and the line of the first, by the reason.
    """

    data: bytes
    lines: NDArray[np.int32]
    read: int
    first: int
    lost: dict[str, tuple[int, int]]


def find_rows(data: bytes, first_line: int, delimiter: str, fewest: int, most: int) -> Rows:
    """Return the lines of samples in a text; blank ones and remarks are none.

    Parameters
    ----------
    data
        The text in UTF-8. Quotes in it say nothing.
    first_line
        Number of its first line.
    delimiter
        What separates cells.
    fewest, most
        Numbers of cells that are accepted.
    """
    kept = [delimiter.encode() * (most - 1) + b"\n"]
    numbers, count, first = [np.empty(0, np.int32)], 0, 0
    lost = {MISSING: (0, 0), NO_NUMBER: (0, 0)}
    for piece in _cut_pieces(data):
        # A zero byte would end a number early: no number has these letters.
        rows = piece.replace(b"\0", b"x0x").replace(b'"', b" ").replace(b"\r", b" ") + b"\n"
        characters = np.frombuffer(rows, dtype=np.uint8)
        ends = np.flatnonzero(characters == ord("\n"))
        starts = np.concatenate(([0], ends[:-1] + 1))
        samples = np.logical_or.reduceat(characters > ord(" "), starts) & (characters[starts] != ord("#"))
        cells = np.add.reduceat(characters == ord(delimiter), starts, dtype=np.int64) + 1
        whole = samples & (cells >= fewest) & (cells <= most)
        is_digit = (characters >= ord("0")) & (characters <= ord("9"))
        numbered = whole & np.logical_or.reduceat(is_digit, starts)
        for reason, bad in ((MISSING, samples & ~whole), (NO_NUMBER, whole & ~numbered)):
            before, line = lost[reason]
            if bad.any():
                lost[reason] = (before + int(bad.sum()), line or first_line + int(np.argmax(bad)))
        if samples.any():
            first = first or first_line + int(np.argmax(samples))
        count += int(samples.sum())
        kept.append(characters[np.repeat(numbered, ends - starts + 1)].tobytes())
        numbers.append((first_line + np.flatnonzero(numbered)).astype(np.int32))
        first_line += len(ends)
    return Rows(b"".join(kept), np.concatenate(numbers), count, first, lost)


_LONG, _LONGER = 8, 4096
"""Length of a line, over the usual one and beside it [bytes], from which its cells are those of damage. The
parser gives every line behind it as many cells."""


def without_long_lines(data: bytes) -> tuple[bytes, int]:
    """Return rows without the lines that are many times as long as the others, and how many these are."""
    ends = np.flatnonzero(np.frombuffer(data, dtype=np.uint8) == ord("\n"))
    bounds = np.concatenate(([0], ends + 1, [len(data)] if not ends.size or ends[-1] + 1 < len(data) else []))
    bounds = bounds.astype(np.int64)
    lengths = np.diff(bounds)
    bad = lengths > _LONG * float(np.median(lengths)) + _LONGER if lengths.size else np.zeros(0, bool)
    if not bad.any():
        return data, 0
    starts = np.concatenate(([0], bounds[1:][bad]))
    stops = np.concatenate((bounds[:-1][bad], [len(data)]))
    return b"".join(data[a:b] for a, b in zip(starts, stops, strict=True)), int(bad.sum())


def _cut_pieces(data: bytes) -> Iterator[bytes]:
    """Cut a text at ends of lines, which are left out: the numbers of all characters would not be small."""
    start = 0
    while start < len(data):
        end = len(data) if len(data) - start <= _PIECE else data.rfind(b"\n", start, start + _PIECE)
        if end < 0:
            end = data.find(b"\n", start)
        end = len(data) if end < 0 else end
        yield data[start:end]
        start = end + 1


UNIT = re.compile(
    rf"(?i)[\s_.-]({RATIO}|rads|degs|rps|dps|degps|mdps|dph|fps2?|fpm|mps2|kph|kts|knots|knot|kt|kn|mph|"
    r"gs?|m_?gs?|milli_?g|gauss|mgauss|microt|[uµμ]t|hpa|kpa|mbar|"
    r"(?:deg_?)?1?e[67]|c?deg|degrees|m?rad|meters|metres|mtrs|m(?:a?ms|as)l|km|m|feet|ft|mm|cm|"
    r"seconds|secs|sec|s|millis|msec|ms|micros|usec|us|nanos|nsec|ns)$"
)
"""A unit at the end of a heading, without brackets."""
