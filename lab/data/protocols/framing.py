"""Framing: how frames of one protocol are found in a stream, checked and read."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

from lab.data.protocols.rows import Rows

MORE = 0
"""Size of a frame of which too few bytes are there to tell."""
NONE = -1
"""Size where no frame begins."""


class Framing(ABC):
    """One kind of frames.

    Attributes
    ----------
    first : bytes
        Bytes a frame may begin with.
    longest : int
        Bytes of the longest frame that is accepted; more are never held back.
    wrap_period : float
        As of `lab.data.protocols.decoder.Decoder` [s].
    """

    first: bytes
    longest: int
    wrap_period: float = math.inf

    @abstractmethod
    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the frame that begins at a place, at most `longest`; or `MORE`, or `NONE`."""

    @abstractmethod
    def passes(self, frame: bytes) -> bool:
        """Return whether a frame passes its check."""

    @abstractmethod
    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the samples of a frame that passed its check; return whether it holds anything that is read.

        Parameters
        ----------
        frame
            The whole frame.
        end
            Number of bytes of the stream up to its end.
        rows
            Takes the samples.
        """

    def finish(self, rows: Rows) -> None:  # noqa: B027 - most have nothing to add
        """Add what waited for further frames, at the end of a stream."""
