"""Rolling: the last rows of a stream, as contiguous arrays by their number, or thinned for a plot."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

THINNED: Final = np.dtype([("time", np.float64), ("rate", np.float64, (3,)), ("force", np.float64, (3,))])
"""A row: ``time`` [s], ``rate`` [rad/s] and ``force`` [m/s²] forward, right, down; NaN where samples are
missing."""
RATE = 50.0
"""Rows per second at most [Hz]: on a plot of 20 s, one for each pixel."""
KEPT = 12_000
"""Rows that are kept: four minutes."""
_ROOM: Final = 1024
"""Rows that the arrays hold at first."""
_LEAST_SPARE: Final = 1 / 8
"""Part of the kept rows that must fit behind them after a move: fewer would have to be moved too often."""
_SPARE: Final = 1 / 4
"""Part of the kept rows that new arrays have behind them: a row is moved four times on the average. Doubled
arrays would take up to four times the memory of the kept rows."""

NO_TYPES: Final[Mapping[str, DTypeLike]] = {}
"""Of columns that are all float64."""


class Rolling:
    """Columns of a stream, of which the oldest rows are forgotten.

    A row keeps its number while others are forgotten. The rows are contiguous, as kernels need them.

    Parameters
    ----------
    columns
        Shape of a row, by the name of the column.
    types
        Type of the numbers of some columns; of the others it is float64.
    """

    def __init__(
        self, columns: Mapping[str, tuple[int, ...]], types: Mapping[str, DTypeLike] = NO_TYPES
    ) -> None:
        self._arrays: dict[str, NDArray[Any]] = {
            name: np.zeros((_ROOM, *shape), types.get(name, np.float64)) for name, shape in columns.items()
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

    def append(self, **columns: NDArray[Any]) -> None:
        """Append rows (n,) of some columns; the others are zero."""
        start = self.end
        self.extend(len(next(iter(columns.values()))))
        for name, values in columns.items():
            self.rows(name, start, self.end)[:] = values

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


class ThinnedSamples:
    """Thins a stream; one thread adds, any thread reads.

    Parameters
    ----------
    kept
        Rows that are kept.
    """

    def __init__(self, kept: int = KEPT) -> None:
        self._rows = np.zeros(kept, THINNED)
        self._end = 0
        self._held: list[NDArray[np.void]] = []
        self._bucket = np.nan
        self._lock = threading.Lock()

    def add(self, imu: NDArray[np.void]) -> None:
        """Take samples, rows of `lab.data.clock.timed_samples.TIMED_IMU` in the order of their times."""
        if not len(imu):
            return
        buckets = np.floor(imu["time"] * (RATE / 2))
        # Before the first sample the bucket is NaN, and NaN differs from every number: it begins a bucket.
        edges = np.flatnonzero(np.diff(buckets, prepend=self._bucket) != 0)
        for begin, end in zip([0, *edges], [*edges, len(imu)], strict=True):
            if begin in edges:
                self._close_bucket()
            if end > begin:
                self._held.append(imu[begin:end])
        self._bucket = float(buckets[-1])

    def _close_bucket(self) -> None:
        """Close a bucket: two rows, of the least and the largest values, or what it has if it has no more."""
        if not self._held:
            return
        rows = np.concatenate(self._held)
        self._held.clear()
        made = np.zeros(min(len(rows), 2), THINNED)
        if len(rows) <= 2:
            for name in ("time", "rate", "force"):
                made[name] = rows[name]
        else:
            made["time"] = rows["time"][[0, -1]]
            for name in ("rate", "force"):
                made[name] = rows[name].min(axis=0), rows[name].max(axis=0)
        if rows["gap"].any() and self._end:
            # A row of NaN interrupts the curve: the plot draws no line across a gap.
            broken = np.zeros(1, THINNED)
            broken["time"] = rows["time"][0]
            broken["rate"] = broken["force"] = np.nan
            made = np.concatenate((broken, made))
        with self._lock:
            self._rows[(self._end + np.arange(len(made))) % len(self._rows)] = made
            self._end += len(made)

    def since(self, cursor: int = 0) -> tuple[int, NDArray[np.void]]:
        """Return the new cursor, and the rows after a cursor that are still kept."""
        with self._lock:
            begin = max(cursor, self._end - len(self._rows))
            return self._end, self._rows[np.arange(begin, self._end) % len(self._rows)]
