"""Thinned samples: as few rows as a plot has room for, least and largest values kept."""

from __future__ import annotations

import threading
from typing import Final

import numpy as np
from numpy.typing import NDArray

THINNED: Final = np.dtype([("time", np.float64), ("rate", np.float64, (3,)), ("force", np.float64, (3,))])
"""A row: ``time`` [s], ``rate`` [rad/s] and ``force`` [m/s²] forward, right, down; NaN where samples are
missing."""
RATE = 50.0
"""Rows per second at most [Hz]: on a plot of 20 s, one for each pixel."""
KEPT = 12_000
"""Rows that are kept: four minutes."""


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
        edges = np.flatnonzero(np.diff(buckets, prepend=self._bucket) != 0)
        for begin, end in zip([0, *edges], [*edges, len(imu)], strict=True):
            if begin in edges:
                self._put()
            if end > begin:
                self._held.append(imu[begin:end])
        self._bucket = float(buckets[-1])

    def _put(self) -> None:
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
