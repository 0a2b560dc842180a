"""Line sources: of which of several devices each line of a text is, such as those of two IMUs on one cable.

A column says so whose few values take turns, if the readings of the lines with one value stand apart from
those with another: two sensors differ in bias and mounting by more than their noise. Flags, states and
numbers of samples change as often, but the readings do not change with them. Less is enough where the heading
of the column, or the word before it, names a device.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.data.protocols.column_map import IGNORED, Column
from lab.data.protocols.text_cells import IS_NUMBER, is_count

_MOST = 16
"""Most devices on one cable: a multiplexer of I2C has 8 branches of two addresses."""
_LONGEST = 32
"""Longest name of a device that is told apart; the hardware address of a network card has 17 signs."""
_WRITTEN = re.compile(r"[^,;\[\]{}]+")
"""What can stand in a column map."""
_RARE = 0.25
"""Part of the lines that each device would have from which a value counts: damage makes others, each once."""
_TURNS = 0.25
"""Least part of the lines with another value than the line before: devices take turns, and send at most four
lines at once. States of a device last longer."""
_EACH = 10
"""Fewest lines of each value by which readings are compared."""
_APART = 8.0
"""Difference of readings, in standard deviations of its mean, from which they are those of two sensors. With
the 10 lines of `_EACH` noise alone exceeds it once in 50,000 (Student, 9 degrees of freedom)."""
_NAMED_APART = 5.0
"""The same where the column is named so: noise alone exceeds it once in 1,400."""
_ENOUGH = 12
"""Lines for each value from which those that take turns without a difference are of one device."""
_NAMES = re.compile(
    r"(?i)(?:^|[^a-z])(?:imu|id|sensor|sens|device|dev|node|unit|board|module|source|src|addr|address|mac|"
    r"chan|channel|port|mpu|receiver|instance)(?:s?[ _-]?(?:id|no|nr|num|number|index|name|address|#))?$"
)
"""Headings and words before a number that name a device."""


class Sources(NamedTuple):
    """A column that may tell devices apart.

    Attributes
    ----------
    place : int
        Its place.
    names : list of str
        Its values in their order, those that no column map can hold last.
    """

    place: int
    names: list[str]

    @property
    def is_written(self) -> bool:
        """Whether the first name can stand in a column map."""
        return _WRITTEN.fullmatch(self.names[0]) is not None


def names_a_device(heading: str) -> bool:
    """Return whether a heading, or what stands before a number, names a device: ``IMU``, ``sensor_id``."""
    return _NAMES.search(heading.strip(" :=#_-")) is not None


def is_source(cell: str, name: str) -> bool:
    """Return whether a cell says the name of a device; a number may be written in several ways."""
    if cell == name or not is_count(name):
        return cell == name
    return IS_NUMBER.fullmatch(cell) is not None and float(cell) == float(name)


def find_alternating_sources(cells: Sequence[Sequence[str]], columns: Sequence[Column]) -> Iterator[Sources]:
    """Yield the columns, of those that are not known, whose few values take turns from line to line.

    Parameters
    ----------
    cells
        The texts of the lines.
    columns
        What their headings say.
    """
    for place, column in enumerate(columns):
        if column.quantity != IGNORED:
            continue
        values = [line[place].strip() for line in cells]
        counts = Counter(value for value in values if value and len(value) <= _LONGEST)
        least = max(_RARE * len(values) / max(len(counts), 1), 2)
        names = [name for name, count in counts.items() if count >= least]
        turns = sum(one != other for one, other in pairwise(values))
        is_measured = any("." in name and IS_NUMBER.fullmatch(name) for name in names)
        if 2 <= len(names) <= _MOST and turns >= _TURNS * len(values) and not is_measured:
            yield Sources(
                place, sorted(names, key=lambda name: (not _WRITTEN.fullmatch(name), len(name), name))
            )


def are_devices(
    sources: Sources,
    cells: Sequence[Sequence[str]],
    headings: Sequence[str],
    readings: FloatArray,
) -> bool | None:
    """Return whether the values of a column are those of devices; None if more lines have to show it.

    Parameters
    ----------
    sources
        The column.
    cells
        The texts of the lines.
    headings
        Of the columns; empty where there are none.
    readings : (n, k) array
        Rates and forces of all lines.
    """
    # Numbers behind one word have its name all.
    heading = headings[sources.place]
    own = sum(one.startswith(heading) for one in headings) == 1
    limit = _NAMED_APART if own and names_a_device(heading) else _APART
    values = np.array([line[sources.place].strip() for line in cells])
    if _differ_clearly(values, sources.names, readings, limit):
        return True
    return False if len(values) >= _ENOUGH * len(sources.names) else None


def _differ_clearly(
    values: NDArray[np.str_], names: Sequence[str], readings: FloatArray, limit: float
) -> bool:
    """Return whether the readings (n, k) of lines with one value differ from those of the lines around."""
    away = readings[1:-1] - (readings[:-2] + readings[2:]) / 2
    known = np.isfinite(away).all(axis=1)
    for name in names:
        mine = away[known & (values[1:-1] == name)]
        if len(mine) < _EACH:
            continue
        error = np.std(mine, axis=0, ddof=1) / np.sqrt(len(mine))
        resolved = 1e-6 * np.abs(readings[1:-1][known]).max(axis=0)
        if (np.abs(mine.mean(axis=0)) > limit * np.maximum(error, resolved)).any():
            return True
    return False
