"""Text cells: the numbers, clocks and dates in a line of text, the texts around, and patterns of both."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from lab.data.protocols.column_map import CLOCK as OF_DAY
from lab.data.protocols.column_map import IGNORED, SOURCE, ColumnMap
from lab.data.protocols.samples import NAN

NUMBER = r"[+-]?(?:\d{1,20}(?:\.\d{0,20})?|\.\d{1,20})(?:[eE][+-]?\d{1,3})?"
"""A plain number; nanoseconds since 1970 have 19 digits."""
NO_VALUE = r"(?:[+-]?[nN][aA][nN]|null|NULL|[nN]one|NONE|[nN]/[aA]|[+-]?[iI]nf(?:inity)?|ovf)"
"""What devices write where they have no number; ``ovf`` is the Arduino's for one that is too large."""
_DATE = r"(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{4})"
_TIME = r"\d{1,2}:\d{2}:\d{2}(?:[.,:]\d{1,9})?"
_SHORT = r"\d{1,2}:\d{1,2}:\d{1,2}(?:\.\d{1,9})?"
CLOCK = rf"(?:(?:{_DATE}[T ,]{{1,3}})?{_TIME}|{_DATE}[T ,]{{1,3}}{_SHORT})(?:Z|[+-]\d{{2}}:?\d{{2}})?"
"""A time of day, with or without a date before it; behind a date, sketches write it without zeros."""
ANY = rf"(?:{CLOCK}|{_DATE}|{NUMBER}|{NO_VALUE})"
"""What a cell that is not read holds."""

IS_NUMBER = re.compile(NUMBER)
IS_VALUE = re.compile(rf"(?:{NUMBER}|{NO_VALUE})?")
IS_CLOCK = re.compile(CLOCK)
IS_STAMP = re.compile(rf"{CLOCK}|{_DATE}")
_PARTS = re.compile(r"(\d{1,2}):(\d{1,2}):(\d{1,2})(?:[.,:](\d{1,9}))?")
IS_CELL = re.compile(
    r"(?<![\w:-])(?P<name>0[xX][\da-fA-F]+|(?:[\da-fA-F]{2}[:-]){5}[\da-fA-F]{2})(?!\w|[:-][\da-fA-F])"
    rf"|(?<![\w.])(?P<clock>{CLOCK})(?!\w)|(?<![\w.])(?P<date>{_DATE})(?!\w)"
    rf"|(?<![\w.^])(?<![A-Za-z]/)(?P<number>{NUMBER})|(?<![\w.^])(?P<none>{NO_VALUE})(?!\w)"
)
"""A digit after a letter, such as that of ``X1``, ``m/s^2`` or ``ms/2``, is part of a text, and so is the
address of a device, such as ``0x68`` or ``D4:22:CD:00:01:02``."""
SHOWN_LINES = 3
"""Last lines that are shown of text whose columns are not known."""
_COMMAS = re.compile(r"[+-]?\d+(?:, ?[+-]?\d+){3,}")
_PADDED = re.compile(r"\b0\d")
_FEWEST = 3
"""Fewest lines and columns by which numbers are seen to have decimal commas."""
_COLOUR = re.compile(r"\x1b\[[\d;?]*[A-Za-z]")


class Cells(NamedTuple):
    """A line, cut at its cells.

    Attributes
    ----------
    texts : tuple of str
        What stands before, between and after the cells; one more than cells.
    kinds : str
        A letter for each cell: n of a number, c of a clock, d of a date.
    values : tuple of float
        Numbers; of a clock the seconds of the day; NaN without one.
    """

    texts: tuple[str, ...]
    kinds: str
    values: tuple[float, ...]


def cells_in(line: str) -> Cells:
    """Return the cells of a line and the texts around them."""
    texts, kinds, values, at = [], "", [], 0
    for found in IS_CELL.finditer(line):
        kind = found.lastgroup or "none"
        if kind == "name":
            continue
        texts.append(line[at : found.start()])
        kinds += "n" if kind == "none" else kind[0]
        values.append(float(found[0]) if kind == "number" else seconds_of_day(found[0]))
        at = found.end()
    texts.append(line[at:])
    return Cells(tuple(texts), kinds, tuple(values))


def seconds_of_day(text: str) -> float:
    """Return the time of day in a text [s]; NaN if there is none."""
    found = _PARTS.search(text)
    if found is None:
        return NAN
    fraction = float(f"0.{found[4]}") if found[4] else 0.0
    return 3600.0 * int(found[1]) + 60.0 * int(found[2]) + int(found[3]) + fraction


def value_of(cell: str) -> float:
    """Return the number of a cell, or the seconds of its time of day; NaN for anything else."""
    return float(cell) if IS_NUMBER.fullmatch(cell) else seconds_of_day(cell)


def without_colours(line: str) -> str:
    """Return a line without the marks by which terminals colour it or go to its begin."""
    return _COLOUR.sub("", line)


def pattern_around(text: str) -> str:
    """Return a regular expression of a text between cells, in which any number of blanks counts as one."""
    words = re.split(r"\s+", text)
    return r"\s+" if text and not any(words) else r"\s*".join(map(re.escape, words))


def is_count(name: str) -> bool:
    """Return whether the name of a device is a number."""
    return name.isascii() and name.isdigit()


def line_patterns(columns: ColumnMap) -> list[re.Pattern[str]]:
    """Return regular expressions of the lines of a sample.

    Parameters
    ----------
    columns
        The columns.
    """
    separator = re.escape(columns.separator)
    # A tab that separates cells is no blank beside one: empty cells would be parted in any number of ways.
    blanks = rf"[^\S{separator}]*"
    between = rf"{blanks}{separator}{blanks}" if columns.separator != " " else r"\s+"
    number = NUMBER.replace(r"\.", ",") if columns.decimal_comma else NUMBER
    other = r"\S+" if columns.separator == " " else r"[^;\t]*?" if columns.decimal_comma else r"[^,;\t]*?"
    # Lines with words have no empty cells, and dashes between them.
    dash = NO_VALUE if columns.texts else "--?"
    none = "" if columns.texts or columns.separator == " " else "?"
    cells = []
    for column in columns.columns:
        if column.quantity == IGNORED:
            cells.append(f"({ANY if columns.texts else other})")
        elif column.quantity == SOURCE:
            zeros = (r"\+?0*", r"(?:\.0*)?") if is_count(column.unit) else ("", "")
            cells.append(f"({zeros[0]}{re.escape(column.unit)}{zeros[1]})")
        elif column.unit == OF_DAY:
            cells.append(f"({CLOCK})")
        elif column.quantity in ("time", "fraction"):
            cells.append(f"({number})")
        else:
            cells.append(f"((?:{number}|{NO_VALUE}|{dash}){none})")
    if not columns.texts:
        end = r"\s*" if columns.separator == " " else rf"{blanks}(?:{separator}{blanks})?"
        return [re.compile(rf"{re.escape(columns.prefix)}\s*{between.join(cells)}{end}")]
    left = iter(cells)
    return [
        re.compile(
            r"\s*"
            + "".join(f"{pattern_around(text)}{next(left)}" for text in texts[:-1])
            + rf"{pattern_around(texts[-1])}\s*"
        )
        for texts in columns.texts
    ]


def have_decimal_commas(lines: Sequence[str]) -> bool:
    """Return whether whole numbers between commas are the parts of numbers with a decimal comma.

    Whole numbers do not begin with a zero, and do not have the same number of digits in every line.
    """
    rows = [line.strip().split(",") for line in lines if _COMMAS.fullmatch(line.strip())][1:]
    if len(rows) < _FEWEST or len({len(row) for row in rows}) != 1:
        return False
    columns = [cells for cells in zip(*rows, strict=True) if len({*map(len, cells)}) == 1]
    return sum(_PADDED.search(" ".join(cells)) is not None for cells in columns) >= _FEWEST


def last_whole_lines(data: bytes) -> tuple[str, ...]:
    """Return the last whole lines in bytes from anywhere in a stream; none if they are no text."""
    lines = [line for line in re.split(rb"[\r\n]+", data)[1:-1] if line.strip()]
    shown = [line.decode("utf-8", "replace") for line in lines[-SHOWN_LINES:]]
    is_text = all(line.replace("\t", " ").isprintable() and "\ufffd" not in line for line in shown)
    return tuple(shown) if shown and is_text else ()
