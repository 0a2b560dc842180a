"""Flight piece: some samples of a long flight, for the compiled code, which writes float64 histories only.

A long flight keeps many of its histories in float32, or does not keep them (`lab.base.histories`). The
compiled code writes such a history into a buffer that is as long as the piece, and the buffer is copied into
the history.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from lab.navigation.solution import HISTORIES, Imu, Solution


class FlightPiece(NamedTuple):
    """Samples of a flight.

    Attributes
    ----------
    imu : Imu
        The increments of the piece.
    out : Solution
        The solution with the histories of the piece in float64, and all fixes.
    first : int
        The increment of the piece with which it begins: 1, so that the compiled code writes the first sample
        only at the start of a flight, or 0 there.
    before : int
        Number of the first sample of the piece in the flight.
    """

    imu: Imu
    out: Solution
    first: int
    before: int

    @classmethod
    def of(cls, imu: Imu, out: Solution, first: int) -> Self:
        """Return the increments from number `first` on as a piece.

        Parameters
        ----------
        imu
            Increments up to the end of the piece.
        out
            The solution of the whole flight. A history of one row stands for one that is not kept.
        first
            Number of the first increment.
        """
        before = max(first - 1, 0)
        end = imu.time.size
        room = out.room(end - before)
        here = {
            name: getattr(room, name) if _is_buffered(out, name) else getattr(out, name)[before:end]
            for name in HISTORIES
        }
        dtheta, dvelocity = (
            values[before:].astype(np.float64, copy=False) for values in (imu.dtheta, imu.dvelocity)
        )
        increments = Imu(imu.time[before:], dtheta, dvelocity, imu.rest[before:])
        return cls(increments, out._replace(**here), first - before, before)

    def written(self, stopped: int) -> slice:
        """Return the samples of the piece that were written, if `stopped` were with those before."""
        return slice(self.first + 1 if self.first else 0, stopped)

    def keep(self, out: Solution, stopped: int, fixes: slice, aids: slice) -> None:
        """Copy what was written into the solution of the whole flight.

        Parameters
        ----------
        out
            The solution.
        stopped
            Number of samples of the piece that were written, with those before.
        fixes, aids
            The fixes, and the other measurements, whose sample was written.
        """
        written = self.written(stopped)
        for name in HISTORIES:
            if not _is_buffered(out, name):
                continue
            whole, values = getattr(out, name), getattr(self.out, name)
            if whole.shape[0] == out.rest.shape[0]:
                whole[self.before + written.start : self.before + stopped] = values[written]
            elif not self.before and not self.first:
                whole[:] = values[:1]
        for samples in (out.fix_sample[fixes], out.aid_sample[aids]):
            samples[samples >= 0] += self.before


def _is_buffered(out: Solution, name: str) -> bool:
    """Return whether a history is one that the compiled code cannot write."""
    values = getattr(out, name)
    return bool(values.shape[0] != out.rest.shape[0] or values.dtype == np.float32)
