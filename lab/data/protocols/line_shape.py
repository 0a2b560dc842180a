"""Line shape: how most lines of a text are written, the headings above them, and the cells in them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.data.files.unit_names import UNITS, unit_of
from lab.data.protocols.column_map import MAX_COLUMNS, SEPARATORS
from lab.data.protocols.labelled_lines import AXES
from lab.data.protocols.text_cells import IS_CLOCK, IS_NUMBER, IS_STAMP, IS_VALUE, cells_in, value_of

_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_PREFIX = re.compile(r"[^\d+\-.,;\s]{1,16}[=:]?")


class LineShape(NamedTuple):
    """How most lines are written, and the numbers in them.

    Attributes
    ----------
    separator : str
        What stands between cells.
    prefix : str
        What each line begins with.
    comma : bool
        Whether numbers have decimal commas.
    rows : (n, m) array
        The numbers; NaN where a cell has none.
    clocks : tuple of bool
        Which columns are times of day.
    cells : list of list of str
        The cells of each line.
    others : tuple of str
        What as many lines with as many cells begin with.
    """

    separator: str
    prefix: str
    comma: bool
    rows: FloatArray
    clocks: tuple[bool, ...]
    cells: list[list[str]]
    others: tuple[str, ...]


def find_shape(lines: Sequence[str]) -> LineShape | None:
    """Return the shape of most lines; None if none has numbers."""
    best: LineShape | None = None
    best_score = (False, 0)
    for separator in SEPARATORS.values():
        headed = {len(cells) for line in lines if (cells := headings_in(line, separator))}
        for comma in (False, True) if separator != "," else (False,):
            kinds: dict[tuple[str, str, int], list[list[str]]] = {}
            for line in lines:
                prefix = find_prefix(line, separator)
                cells = split_cells(line[len(prefix) :], separator)
                if comma:
                    cells = [_DECIMAL_COMMA.sub(".", cell) for cell in cells]
                if not AXES <= len(cells) <= MAX_COLUMNS:
                    continue
                if sum(1 for cell in cells if IS_NUMBER.fullmatch(cell)) < AXES:
                    continue
                if len(cells) in headed or all(says_little(cell, separator) for cell in cells):
                    word = "" if IS_VALUE.fullmatch(cells[0]) or IS_STAMP.fullmatch(cells[0]) else cells[0]
                    key = prefix, word if len(cells) not in headed else "", len(cells)
                    kinds.setdefault(key, []).append(cells)
            several = len({word for _, word, _ in kinds}) > 1
            for (before, word, _), found in kinds.items():
                if set(before + word) & set("{}"):
                    continue  # a column map has columns in braces
                # Of lines of several kinds, the first cell is what those of one begin with.
                is_kind = several and word and len(found[0]) > AXES
                prefix, kept = (
                    (f"{word}{separator}", [row[1:] for row in found]) if is_kind else (before, found)
                )
                count = len(kept[0])
                clocks = tuple(all(IS_CLOCK.fullmatch(row[at]) for row in kept) for at in range(count))
                score = count in headed, len(kept) * count
                if best is None or score > best_score:
                    values = np.array([[value_of(cell) for cell in row] for row in kept])
                    others = [
                        before + word
                        for (before, word, size), rows in kinds.items()
                        if rows is not found and size == len(found[0]) and 2 * len(rows) > len(found)
                    ]
                    best = LineShape(separator, prefix, comma, values, clocks, kept, tuple(others))
                    best_score = score
    return best


def find_prefix(line: str, separator: str) -> str:
    """Return what stands before the first number; a first cell that is a text is no such prefix."""
    found = _PREFIX.match(line)
    if found is None or IS_VALUE.fullmatch(found[0]):
        return ""
    after = line[found.end() : found.end() + 1]
    return "" if after == separator != " " or line[found.end() :].lstrip()[:1] in tuple(",;") else found[0]


def says_little(cell: str, separator: str) -> bool:
    """Return whether a cell is a number, none, a time, or a word without a number in it."""
    if IS_VALUE.fullmatch(cell) or IS_STAMP.fullmatch(cell):
        return True
    return separator != " " and not cells_in(cell).kinds


def headings_in(line: str, separator: str) -> list[str]:
    """Return the headings in a line; none if a cell is empty or a number."""
    cells = [
        cell.strip(" \"'\ufeff") for cell in line.lstrip("#% ").split(separator if separator != " " else None)
    ]
    cells = cells[:-1] if cells and not cells[-1] else cells
    whole = len(cells) >= AXES and all(
        cell and not IS_NUMBER.fullmatch(cell.replace(",", ".")) for cell in cells
    )
    return cells if whole and not any(IS_STAMP.fullmatch(cell) for cell in cells) else []


def find_header(lines: Sequence[str], separator: str, count: int) -> list[str] | None:
    """Return the headings of the last line with the right number of cells, of which none is a number.

    Where that holds units alone, those of the line before, each with its unit.
    """
    found = [cells for line in lines if len(cells := headings_in(line, separator)) == count][-2:]
    if len(found) == 2 and all(any(unit_of(kind, cell) for kind in UNITS) for cell in found[1]):
        return [f"{heading} [{unit}]" for heading, unit in zip(*found, strict=True)]
    return found[-1] if found else None


def split_cells(line: str, separator: str) -> list[str]:
    """Return the cells of a line; one after the last separator that is empty is left out."""
    cells = line.split() if separator == " " else [cell.strip() for cell in line.split(separator)]
    return cells[:-1] if cells and not cells[-1] else cells
