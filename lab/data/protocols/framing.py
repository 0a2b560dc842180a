"""Framing: how frames of one protocol are found in a stream, checked and read; and their checksums.

References
----------
G. Cook, *Catalogue of parametrised CRC algorithms* (XMODEM, MCRF4XX).
RFC 1145 for the sums of Fletcher; here of bytes modulo 256, as u-blox and MicroStrain take them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from binascii import crc_hqx
from functools import reduce
from itertools import accumulate
from operator import xor

from lab.data.protocols.rows import Rows

# Each byte with its bits in reverse order.
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
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
    remark : str
        What people should know of the device, in a sentence.
    """

    first: bytes
    longest: int
    wrap_period: float = math.inf

    @property
    def remark(self) -> str:
        """As above."""
        return ""

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


def xor8(data: bytes) -> int:
    """Return the exclusive or of all bytes."""
    return reduce(xor, data, 0)


def sum8(data: bytes) -> int:
    """Return the sum of all bytes modulo 256."""
    return sum(data) & 0xFF


def fletcher16(data: bytes) -> bytes:
    """Return the sum of bytes and the sum of these sums, each modulo 256, as two bytes in this order."""
    return bytes((sum(data) & 0xFF, sum(accumulate(data)) & 0xFF))


def passes_fletcher16(data: bytes, check: bytes) -> bool:
    """Return whether two bytes are the sums of others; most that are not are found out by the first sum."""
    return sum(data) & 0xFF == check[0] and sum(accumulate(data)) & 0xFF == check[1]


def crc16_xmodem(data: bytes) -> int:
    """Return the CRC of polynomial 0x1021, started with 0: zero over data with its CRC, high byte first."""
    return crc_hqx(data, 0)


def crc16_mcrf4xx(data: bytes) -> int:
    """Return the CRC of MAVLink: polynomial 0x1021 with all bits reversed, started with 0xFFFF."""
    # The reversed CRC of bytes is that of the reversed bytes, which the standard library has in C.
    crc = crc_hqx(data.translate(_REVERSED), 0xFFFF)
    return _REVERSED[crc >> 8] | _REVERSED[crc & 0xFF] << 8
