"""Growing truth: the true motion of a flight that is still being flown, or played, as far as it is known."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from lab.base.arrays import FloatArray, interpolate_columns
from lab.motion.frames.rotation import wrap
from lab.motion.truth.trajectory import Truth

_ROUNDING = 1e-6
"""Largest rounding of the time of a sample [s]: some devices stamp them in microseconds."""
_COLUMNS = 9
"""Numbers of a motion: position, velocity and Euler angles."""
_ROOM = 2**14
"""Rows for which room is made at a time: three minutes at 100 Hz."""


class Kinematics(NamedTuple):
    """True motion at some times; NaN at times that the truth does not cover.

    Attributes
    ----------
    position : (n, 3) array
        Latitude, longitude [rad], height above the ellipsoid [m].
    velocity_n : (n, 3) array
        Velocity over the Earth, north, east, down [m/s].
    euler : (n, 3) array
        Roll, pitch, heading [rad].
    """

    position: FloatArray
    velocity_n: FloatArray
    euler: FloatArray


class GrowingTruth:
    """The truth of a flight that is still being flown, as far as it is known.

    It keeps the last `KEPT` samples. One thread appends, any thread reads.
    """

    KEPT = 2**18
    """Samples that are kept: 43 minutes at 100 Hz, in 20 MB."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rows = np.empty((_ROOM, 1 + _COLUMNS))
        self._first = self._end = 0  # of the rows that are kept

    def __len__(self) -> int:
        return self._end - self._first

    def append(self, time: FloatArray, truth: Truth) -> None:
        """Append samples, later than all before.

        Parameters
        ----------
        time : (n,) array
            Times of the host's monotonic clock [s].
        truth
            The motion at n times.
        """
        self._append_motion(time, np.column_stack((truth.position, truth.velocity_n, truth.euler)))

    def break_off(self, time: float) -> None:
        """Say that the motion is unknown from the last sample to the next, about a time between [s]."""
        self._append_motion(np.array([time]), np.full((1, _COLUMNS), np.nan))

    def _append_motion(self, time: FloatArray, motion: FloatArray) -> None:
        with self._lock:
            if self._end + len(time) > len(self._rows):
                kept = self._rows[max(self._first, self._end + len(time) - self.KEPT) : self._end]
                self._rows = np.concatenate((kept, np.empty((len(kept) + len(time) + _ROOM, 1 + _COLUMNS))))
                self._first, self._end = 0, len(kept)
            self._rows[self._end : self._end + len(time), 0] = time
            self._rows[self._end : self._end + len(time), 1:] = motion
            self._end += len(time)
            self._first = max(self._first, self._end - self.KEPT)

    def at(self, time: FloatArray) -> Kinematics:
        """Return the motion at times (n,) of the host's monotonic clock [s]."""
        with self._lock:
            rows = self._rows[self._first : self._end]
            if not len(time) or not len(rows):
                return interpolate_motion(time, np.zeros(1), np.full((1, _COLUMNS), np.nan))
            # One row more on each side, between which the outermost times are interpolated.
            first = max(int(np.searchsorted(rows[:, 0], np.min(time))) - 1, 0)
            last = int(np.searchsorted(rows[:, 0], np.max(time), "right")) + 1
            known, motion = rows[first:last, 0].copy(), rows[first:last, 1:].copy()
        # A sample at a knot is one, though the clock of its device was rounded.
        nearest = known[np.minimum(np.searchsorted(known, time - _ROUNDING), len(known) - 1)]
        time = np.where(np.abs(nearest - time) <= _ROUNDING, nearest, time)
        # Only within a segment: what is unknown would spread to all that follows.
        for rows_of in np.split(np.arange(len(known)), np.flatnonzero(np.isnan(motion[:, 0]))):
            segment = rows_of[np.isfinite(motion[rows_of, 0])]
            motion[segment, 1] = np.unwrap(motion[segment, 1])
            motion[segment, 6:] = np.unwrap(motion[segment, 6:], axis=0)
        return interpolate_motion(time, known, motion)


def interpolate_motion(time: FloatArray, known: FloatArray, columns: FloatArray) -> Kinematics:
    """Return the motion at times (n,), linear between known ones (m,), of columns (m, 9) without jumps."""
    found = interpolate_columns(time, known, columns, np.nan)
    position, velocity_n, euler = found[:, :3], found[:, 3:6], np.asarray(wrap(found[:, 6:]))
    position[:, 1] = wrap(position[:, 1])
    return Kinematics(position, velocity_n, euler)


class TrueMotion(Protocol):
    """What knows the true motion of a source."""

    def at(self, time: FloatArray) -> Kinematics:
        """Return the motion at times (n,) of the host's monotonic clock [s]."""


class TrueFlight:
    """The truth of a simulated flight that is played in real time; a `TrueMotion`.

    Between two samples of the truth, the motion is interpolated linearly: at 100 Hz and 30 m/s², the error
    of a position is below 0.4 mm.

    Parameters
    ----------
    truth
        The truth at all samples.
    begun
        Returns the time of the host at the start of the flight [s]; NaN before it.
    """

    def __init__(self, truth: Truth, begun: Callable[[], float]) -> None:
        self._truth = truth
        self._begun = begun
        self._columns = np.column_stack((truth.position, truth.velocity_n, np.unwrap(truth.euler, axis=0)))
        self._columns[:, 1] = np.unwrap(self._columns[:, 1])

    def at(self, time: FloatArray) -> Kinematics:
        """Return the motion at times (n,) of the host's monotonic clock [s]."""
        return interpolate_motion(time - self._begun(), self._truth.time, self._columns)
