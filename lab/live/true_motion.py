"""True motion: the truth behind a stream, where the source knows it, by the clock of the host."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.live.rolling import Rolling
from lab.rotation import wrap
from lab.trajectory import Truth

FloatArray = NDArray[np.float64]


_ROUNDING = 1e-6
"""Largest rounding of the time of a sample [s]: some devices stamp them in microseconds."""


class Motion(NamedTuple):
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


class TrueMotion(Protocol):
    """What knows the true motion of a source."""

    def at(self, time: FloatArray) -> Motion:
        """Return the motion at times (n,) of the host's monotonic clock [s]."""
        ...


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

    def at(self, time: FloatArray) -> Motion:
        """Return the motion at times (n,) of the host's monotonic clock [s]."""
        return _interpolated(time - self._begun(), self._truth.time, self._columns)


class GrowingTruth:
    """The truth of a flight that is still being flown, as far as it is known; a `TrueMotion`.

    It keeps the last `KEPT` samples. One thread appends, any thread reads.
    """

    KEPT = 2**18
    """Samples that are kept: 43 minutes at 100 Hz, in 20 MB."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rows = Rolling({"time": ((), np.float64), "motion": ((9,), np.float64)})

    def append(self, time: FloatArray, truth: Truth) -> None:
        """Append samples, later than all before.

        Parameters
        ----------
        time : (n,) array
            Times of the host's monotonic clock [s].
        truth
            The motion at n times.
        """
        self._put(time, np.column_stack((truth.position, truth.velocity_n, truth.euler)))

    def break_off(self, time: float) -> None:
        """Say that the motion is unknown from the last sample to the next, about a time between [s]."""
        self._put(np.array([time]), np.full((1, 9), np.nan))

    def _put(self, time: FloatArray, motion: FloatArray) -> None:
        with self._lock:
            rows, end = self._rows, self._rows.end
            rows.extend(len(time))
            rows.rows("time", end, rows.end)[:] = time
            rows.rows("motion", end, rows.end)[:] = motion
            rows.forget(rows.end - self.KEPT)

    def at(self, time: FloatArray) -> Motion:
        """Return the motion at times (n,) of the host's monotonic clock [s]."""
        with self._lock:
            rows = self._rows
            if not len(time) or not len(rows):
                return _interpolated(time, np.zeros(1), np.full((1, 9), np.nan))
            first = max(rows.number("time", float(np.min(time))) - 1, rows.first)
            last = min(rows.number("time", float(np.max(time)), "right") + 1, rows.end)
            known = rows.rows("time", first, last).copy()
            motion = rows.rows("motion", first, last).copy()
        # A sample at a knot is one, though the clock of its device was rounded.
        nearest = known[np.minimum(np.searchsorted(known, time - _ROUNDING), len(known) - 1)]
        time = np.where(np.abs(nearest - time) <= _ROUNDING, nearest, time)
        # Only within a segment: what is unknown would spread to all that follows.
        for rows_of in np.split(np.arange(len(known)), np.flatnonzero(np.isnan(motion[:, 0]))):
            segment = rows_of[np.isfinite(motion[rows_of, 0])]
            motion[segment, 1] = np.unwrap(motion[segment, 1])
            motion[segment, 6:] = np.unwrap(motion[segment, 6:], axis=0)
        return _interpolated(time, known, motion)


def _interpolated(time: FloatArray, known: FloatArray, columns: FloatArray) -> Motion:
    """Return the motion at times (n,), linear between known ones (m,), of columns (m, 9) without jumps."""
    found = np.stack(
        [np.interp(time, known, column, np.nan, np.nan) for column in columns.T], axis=-1
    ).reshape(len(time), columns.shape[1])
    position, velocity_n, euler = found[:, :3], found[:, 3:6], np.asarray(wrap(found[:, 6:]))
    position[:, 1] = wrap(position[:, 1])
    return Motion(position, velocity_n, euler)
