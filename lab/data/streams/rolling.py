"""Rolling: the last rows of a stream, as contiguous arrays by the absolute number of the row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

_ROOM: Final = 1024
"""Rows that the arrays hold at first."""
_LEAST_SPARE: Final = 1 / 8
"""Part of the kept rows that must fit behind them after a move: fewer would have to be moved too often."""
_SPARE: Final = 1 / 4
"""Part of the kept rows that new arrays have behind them: a row is moved four times on the average. Doubled
arrays would take up to four times the memory of the kept rows."""


class Rolling:
    """Columns of a stream, of which the oldest rows are forgotten.

    A row keeps its number while others are forgotten. The rows are contiguous, as kernels need them.

    Parameters
    ----------
    columns
        Shape of a row and type of its numbers, by the name of the column.
    """

    def __init__(self, columns: Mapping[str, tuple[tuple[int, ...], DTypeLike]]) -> None:
        self._arrays: dict[str, NDArray[Any]] = {
            name: np.zeros((_ROOM, *shape), dtype) for name, (shape, dtype) in columns.items()
        }
        self._room = _ROOM
        self._offset = 0  # number of the first row of the arrays
        self.first = 0
        """Number of the oldest row that is kept."""
        self.end = 0
        """Number of the next row."""

    def __len__(self) -> int:
        return self.end - self.first

    def extend(self, count: int) -> None:
        """Append rows of zeros.

        Parameters
        ----------
        count
            Number of rows.
        """
        if self.end + count - self._offset > self._room:
            self._move(count)
        self.end += count
        for values in self._arrays.values():
            values[self.end - count - self._offset : self.end - self._offset] = 0

    def forget(self, before: int) -> None:
        """Forget the rows before a number; a row that was forgotten stays so."""
        self.first = min(max(self.first, before), self.end)

    def rows(self, name: str, start: int, end: int) -> NDArray[Any]:
        """Return a column between two numbers as a view that may be written to."""
        assert self.first <= start <= end <= self.end, (self.first, start, end, self.end)
        return self._arrays[name][start - self._offset : end - self._offset]

    def column(self, name: str) -> NDArray[Any]:
        """Return all rows of a column that are kept, as a view."""
        return self.rows(name, self.first, self.end)

    def number(self, name: str, value: float, side: str = "left") -> int:
        """Return the number of the row at which a value belongs into an increasing column."""
        column = self.column(name)
        return self.first + int(np.searchsorted(column, value, "right" if side == "right" else "left"))

    def _move(self, count: int) -> None:
        """Make room for more rows: over the forgotten ones if these are the most, else in larger arrays."""
        kept = len(self)
        if (1 + _LEAST_SPARE) * (kept + count) > self._room:
            self._room = int((1 + _SPARE) * (kept + count)) + 1
        shift = self.first - self._offset
        for name, values in self._arrays.items():
            if self._room > values.shape[0]:
                larger = np.zeros((self._room, *values.shape[1:]), values.dtype)
                larger[:kept] = values[shift : shift + kept]
                self._arrays[name] = larger
            else:
                # In parts that do not overlap: numpy would copy the whole column twice.
                for at in range(0, kept, shift):
                    end = min(at + shift, kept)
                    values[at:end] = values[at + shift : end + shift]
        self._offset = self.first
