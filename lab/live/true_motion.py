"""True motion: the truth behind a stream, where the source knows it, by the clock of the host."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.rotation import wrap
from lab.trajectory import Truth

FloatArray = NDArray[np.float64]


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
        since = time - self._begun()
        found = np.stack(
            [np.interp(since, self._truth.time, column, np.nan, np.nan) for column in self._columns.T],
            axis=-1,
        ).reshape(len(time), self._columns.shape[1])
        position, velocity_n, euler = found[:, :3], found[:, 3:6], np.asarray(wrap(found[:, 6:]))
        position[:, 1] = wrap(position[:, 1])
        return Motion(position, velocity_n, euler)
