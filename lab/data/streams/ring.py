"""Ring: the last samples of a source, read by many at their own pace."""

from __future__ import annotations

import bisect
import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.data.clock.timed_samples import NO_READINGS, TIMED_FIX, TIMED_IMU, TIMED_READING

ROOM = 2**17, 2**13, 2**15
"""Samples of the IMU, fixes, headings and speeds that are kept: two minutes at 1 kHz, 13 minutes at 10 Hz,
and two minutes at 250 Hz; 21 MB."""
_KINDS = TIMED_IMU, TIMED_FIX, TIMED_READING


class Cursor(NamedTuple):
    """How far someone has read: numbers of samples, of fixes and of readings since the beginning."""

    imu: int = 0
    fix: int = 0
    reading: int = 0


class Read(NamedTuple):
    """What was read.

    Attributes
    ----------
    cursor : Cursor
        Where to go on.
    imu : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
        Samples of the IMU, a copy.
    fix : (m,) array of `lab.data.clock.timed_samples.TIMED_FIX`
        Fixes, a copy.
    lost : int
        Samples, fixes and readings that were overwritten before they were read.
    reading : (k,) array of `lab.data.clock.timed_samples.TIMED_READING`
        Headings and speeds, a copy.
    """

    cursor: Cursor
    imu: NDArray[np.void]
    fix: NDArray[np.void]
    lost: int
    reading: NDArray[np.void] = NO_READINGS


class Ring:
    """Keeps the last samples; one thread appends, any thread reads.

    Parameters
    ----------
    room
        Samples of the IMU, fixes and readings that are kept.
    """

    def __init__(self, room: tuple[int, int, int] = ROOM) -> None:
        self._lock = threading.Lock()
        self._rooms = tuple(map(np.zeros, room, _KINDS))
        self._end = Cursor()

    @property
    def end(self) -> Cursor:
        """The cursor of someone who has read everything."""
        return self._end

    def forget(self) -> None:
        """Give the memory of all samples back; nothing more may come. `end` still says how many came."""
        with self._lock:
            self._rooms = tuple(np.zeros(0, kind) for kind in _KINDS)

    def scale_rates(self, factor: float) -> None:
        """Multiply the angular rates of all samples, whose unit was another one."""
        with self._lock:
            self._rooms[0]["rate"] *= factor

    def append(
        self, imu: NDArray[np.void], fix: NDArray[np.void], reading: NDArray[np.void] = NO_READINGS
    ) -> None:
        """Add samples; the oldest make room for them."""
        with self._lock:
            new = imu, fix, reading
            for room, at, rows in zip(self._rooms, self._end, new, strict=True):
                _append_rows(room, at, rows)
            # Replaced as a whole, since `end` is read without the lock.
            self._end = Cursor(*(at + len(rows) for at, rows in zip(self._end, new, strict=True)))

    def since(self, cursor: Cursor | None = None) -> Read:
        """Return what was appended after a cursor; None stands for the beginning."""
        with self._lock:
            taken = map(_take_rows, self._rooms, cursor or Cursor(), self._end)
            (imu, fix, reading), lost = zip(*taken, strict=True)
            return Read(self._end, imu, fix, sum(lost), reading)

    def last(self, imu: int, fix: int) -> Read:
        """Return the last samples and fixes, at most this many of each."""
        end = self._end
        return self.since(Cursor(max(0, end.imu - imu), max(0, end.fix - fix), end.reading))

    def newest(self, seconds: float) -> Read:
        """Return the samples and fixes of the last seconds, by their times."""
        with self._lock:
            end = self._end
            known = zip(self._rooms[:2], end[:2], strict=True)
            ends = [rows["time"][(count - 1) % len(rows)] for rows, count in known if count and len(rows)]
            since = max(ends, default=0.0) - seconds
            imu, fix = (_first_after(*one, since) for one in zip(self._rooms[:2], end[:2], strict=True))
            begin = Cursor(imu, fix, end.reading)
        return self.since(begin)


def _first_after(room: NDArray[np.void], end: int, time: float) -> int:
    """Return the number of the first sample that is later than a time."""
    times, size = room["time"], len(room)
    # By the numbers of the samples, which increase: in the ring, the oldest follows the newest.
    return bisect.bisect_right(range(end), time, lo=max(0, end - size), key=lambda k: times[k % size])


def _append_rows(room: NDArray[np.void], end: int, rows: NDArray[np.void]) -> None:
    if not len(rows):
        return
    size = len(room)
    if len(rows) > size:
        # More than there is room for: only the last ones stay, at the places that they would have had.
        end, rows = end + len(rows) - size, rows[-size:]
    at = end % size
    first = min(len(rows), size - at)
    room[at : at + first] = rows[:first]
    room[: len(rows) - first] = rows[first:]


def _take_rows(room: NDArray[np.void], begin: int, end: int) -> tuple[NDArray[np.void], int]:
    if begin >= end:
        return room[:0], 0
    size = len(room)
    lost = max(0, end - size - begin)
    begin += lost
    at, count = begin % max(size, 1), end - begin
    if at + count <= size:  # to join records, even with none, costs more than all else here
        return room[at : at + count].copy(), lost
    return np.concatenate((room[at:], room[: at + count - size])), lost
