"""JSON rows: text that anybody may have sent becomes rows of numbers, or is refused."""

from __future__ import annotations

import json
from math import isnan
from typing import Any

from lab.data.protocols.samples import NAN

LARGEST = 1e15
"""Largest number that is accepted: nanoseconds since 1970 become seconds before they come here."""


def parse_json(text: bytes) -> Any:
    """Return what JSON says; None if it is no JSON or is nested too deep.

    Parameters
    ----------
    text
        Any bytes; whoever calls bounds their number.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return None


def number(value: Any) -> float:
    """Return a number; NaN if it is none, not finite, or larger than `LARGEST`."""
    # Booleans are whole numbers to Python, and whole numbers may be too long for a float.
    if type(value) not in {float, int} or not -LARGEST <= value <= LARGEST:
        return NAN
    return float(value)


def read_rows(value: Any, width: int, most: int) -> list[list[float]] | None:
    """Return rows of numbers; null becomes NaN, except for the time in the first column.

    Parameters
    ----------
    value
        Out of JSON; None stands for no rows.
    width
        Numbers of a row.
    most
        Most rows.

    Returns
    -------
    list of lists of floats, or None
        None if it is anything else than such rows.
    """
    if value is None:
        return []
    if type(value) is not list or len(value) > most:
        return None
    rows = []
    for row in value:
        if type(row) is not list or len(row) != width:
            return None
        numbers = [number(cell) for cell in row]
        unknown = [isnan(one) for one in numbers]
        if unknown[0] or any(none and cell is not None for none, cell in zip(unknown, row, strict=True)):
            return None
        rows.append(numbers)
    return rows
