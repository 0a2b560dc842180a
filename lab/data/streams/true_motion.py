"""True motion: the truth behind a stream, where the source knows it, by the clock of the host."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.truth.growing_truth import Kinematics, interpolated
from lab.motion.truth.trajectory import Truth

__all__ = ["Kinematics", "TrueFlight", "TrueMotion"]


class TrueMotion(Protocol):
    """What knows the true motion of a source."""

    def at(self, time: FloatArray) -> Kinematics:
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

    def at(self, time: FloatArray) -> Kinematics:
        """Return the motion at times (n,) of the host's monotonic clock [s]."""
        return interpolated(time - self._begun(), self._truth.time, self._columns)
