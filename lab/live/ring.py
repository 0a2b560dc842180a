"""Ring: the last samples of a source, read by many at their own pace."""

from __future__ import annotations

import bisect
import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.live.timed import TIMED_FIX, TIMED_IMU

ROOM = 2**17, 2**13
"""Samples of the IMU and fixes that are kept: two minutes at 1 kHz, and 13 minutes at 10 Hz; 20 MB."""


class Cursor(NamedTuple):
    """How far someone has read: numbers of samples of the IMU and of fixes since the beginning."""

    imu: int = 0
    fix: int = 0


class Read(NamedTuple):
    """What was read.

    Attributes
    ----------
    cursor : Cursor
        Where to go on.
    imu : (n,) array of `lab.live.timed.TIMED_IMU`
        Samples of the IMU, a copy.
    fix : (m,) array of `lab.live.timed.TIMED_FIX`
        Fixes, a copy.
    lost : int
        Samples and fixes that were overwritten before they were read.
    """

    cursor: Cursor
    imu: NDArray[np.void]
    fix: NDArray[np.void]
    lost: int


class Ring:
    """Keeps the last samples; one thread appends, any thread reads.

    Parameters
    ----------
    room
        Samples of the IMU and fixes that are kept.
    """

    def __init__(self, room: tuple[int, int] = ROOM) -> None:
        self._lock = threading.Lock()
        self._imu = np.zeros(room[0], TIMED_IMU)
        self._fix = np.zeros(room[1], TIMED_FIX)
        self._end = Cursor()

    @property
    def end(self) -> Cursor:
        """The cursor of someone who has read everything."""
        return self._end

    def append(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> None:
        """Add samples; the oldest make room for them."""
        with self._lock:
            _put(self._imu, self._end.imu, imu)
            _put(self._fix, self._end.fix, fix)
            self._end = Cursor(self._end.imu + len(imu), self._end.fix + len(fix))

    def since(self, cursor: Cursor | None = None) -> Read:
        """Return what was appended after a cursor; None stands for the beginning."""
        begin = cursor or Cursor()
        with self._lock:
            imu, lost_imu = _taken(self._imu, begin.imu, self._end.imu)
            fix, lost_fix = _taken(self._fix, begin.fix, self._end.fix)
            return Read(self._end, imu, fix, lost_imu + lost_fix)

    def last(self, imu: int, fix: int) -> Read:
        """Return the last samples and fixes, at most this many of each."""
        end = self._end
        return self.since(Cursor(max(0, end.imu - imu), max(0, end.fix - fix)))

    def newest(self, seconds: float) -> Read:
        """Return the samples and fixes of the last seconds, by their times."""
        with self._lock:
            end = self._end
            latest = max(
                (
                    rows["time"][(count - 1) % len(rows)]
                    for rows, count in zip((self._imu, self._fix), end, strict=True)
                    if count
                ),
                default=0.0,
            )
            begin = Cursor(
                *(
                    _first_after(rows, count, latest - seconds)
                    for rows, count in zip((self._imu, self._fix), end, strict=True)
                )
            )
        return self.since(begin)


def _first_after(room: NDArray[np.void], end: int, time: float) -> int:
    """Return the number of the first sample that is later than a time."""
    times, size = room["time"], len(room)
    return bisect.bisect_right(range(end), time, lo=max(0, end - size), key=lambda k: times[k % size])


def _put(room: NDArray[np.void], end: int, rows: NDArray[np.void]) -> None:
    size = len(room)
    if len(rows) > size:
        end, rows = end + len(rows) - size, rows[-size:]
    at = end % size
    first = min(len(rows), size - at)
    room[at : at + first] = rows[:first]
    room[: len(rows) - first] = rows[first:]


def _taken(room: NDArray[np.void], begin: int, end: int) -> tuple[NDArray[np.void], int]:
    size = len(room)
    begin = min(begin, end)
    lost = max(0, end - size - begin)
    begin += lost
    at, count = begin % size, end - begin
    if at + count <= size:  # to join records, even with none, costs more than all else here
        return room[at : at + count].copy(), lost
    return np.concatenate((room[at:], room[: at + count - size])), lost
