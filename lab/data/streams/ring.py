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
        self._imu = np.zeros(room[0], TIMED_IMU)
        self._fix = np.zeros(room[1], TIMED_FIX)
        self._reading = np.zeros(room[2], TIMED_READING)
        self._end = Cursor()

    @property
    def end(self) -> Cursor:
        """The cursor of someone who has read everything."""
        return self._end

    def forget(self) -> None:
        """Give the memory of all samples back; nothing more may come. `end` still says how many came."""
        with self._lock:
            self._imu, self._fix, self._reading = (
                np.zeros(0, kind) for kind in (TIMED_IMU, TIMED_FIX, TIMED_READING)
            )

    def scale_rates(self, factor: float) -> None:
        """Multiply the angular rates of all samples, whose unit was another one."""
        with self._lock:
            self._imu["rate"] *= factor

    def append(
        self, imu: NDArray[np.void], fix: NDArray[np.void], reading: NDArray[np.void] = NO_READINGS
    ) -> None:
        """Add samples; the oldest make room for them."""
        with self._lock:
            end = self._end
            _put(self._imu, end.imu, imu)
            _put(self._fix, end.fix, fix)
            _put(self._reading, end.reading, reading)
            self._end = Cursor(end.imu + len(imu), end.fix + len(fix), end.reading + len(reading))

    def since(self, cursor: Cursor | None = None) -> Read:
        """Return what was appended after a cursor; None stands for the beginning."""
        begin = cursor or Cursor()
        with self._lock:
            imu, lost_imu = _taken(self._imu, begin.imu, self._end.imu)
            fix, lost_fix = _taken(self._fix, begin.fix, self._end.fix)
            reading, lost = _taken(self._reading, begin.reading, self._end.reading)
            return Read(self._end, imu, fix, lost_imu + lost_fix + lost, reading)

    def last(self, imu: int, fix: int) -> Read:
        """Return the last samples and fixes, at most this many of each."""
        end = self._end
        return self.since(Cursor(max(0, end.imu - imu), max(0, end.fix - fix), end.reading))

    def newest(self, seconds: float) -> Read:
        """Return the samples and fixes of the last seconds, by their times."""
        with self._lock:
            end = self._end
            latest = max(
                (
                    rows["time"][(count - 1) % len(rows)]
                    for rows, count in zip((self._imu, self._fix), end[:2], strict=True)
                    if count and len(rows)
                ),
                default=0.0,
            )
            since = latest - seconds
            begin = Cursor(
                _first_after(self._imu, end.imu, since),
                _first_after(self._fix, end.fix, since),
                end.reading,
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
    at, count = begin % max(size, 1), end - begin
    if at + count <= size:  # to join records, even with none, costs more than all else here
        return room[at : at + count].copy(), lost
    return np.concatenate((room[at:], room[: at + count - size])), lost
