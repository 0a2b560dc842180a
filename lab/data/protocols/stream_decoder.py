"""Stream decoder: finds the frames of one or several protocols in one stream of bytes.

A frame that fails its check is skipped by one byte only: its length may be what is damaged, and sound
frames may begin within it.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Sequence

from lab.data.protocols.decoder import Statistics
from lab.data.protocols.framing import MORE, NONE, Framing
from lab.data.protocols.limits import Limits
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import Samples

_PIECE = 2**16
"""Bytes taken into the buffer at a time: what is held does not depend on how much is fed at once."""


class StreamDecoder:
    """Decodes a stream of frames; a `Decoder`.

    Parameters
    ----------
    name
        The protocol.
    framings
        Kinds of frames; of those that may begin with the same byte the first that finds one is taken.
    beside
        Kinds of frames that other devices send as well, looked for after the others; they do not show which
        device this is.

    Attributes
    ----------
    longest : int
        Most bytes that are held back.
    own_frames : int
        Frames that passed their check, without those beside.
    passed : deque of bytes or None
        Where frames that passed their check are kept, if they are to be shown.
    """

    def __init__(self, name: str, framings: Sequence[Framing], beside: Sequence[Framing] = ()) -> None:
        self.name = name
        self.own_frames = 0
        self.passed: deque[bytes] | None = None
        self._own = tuple(framings)
        framings = (*framings, *beside)
        self.statistics = Statistics()
        self.longest = max(framing.longest for framing in framings)
        self.wrap_period = min(framing.wrap_period for framing in framings)
        self._rows = Rows(self.statistics, Limits())
        self._all = framings
        self._framings = {
            byte: tuple(framing for framing in framings if byte in framing.first)
            for byte in sorted(set(b"".join(framing.first for framing in framings)))
        }
        self._first = re.compile(b"[" + b"".join(b"\\x%02x" % byte for byte in self._framings) + b"]")
        self._buffer = bytearray()
        self._before = 0  # bytes of the stream before those in the buffer

    @property
    def held(self) -> int:
        """Bytes of the stream that are held back, at most `longest`."""
        return len(self._buffer)

    @property
    def evidence(self) -> str:
        """What people should know of the devices, in sentences."""
        return " ".join(framing.remark for framing in self._all if framing.remark)

    def feed(self, data: bytes) -> Samples:
        """Return the samples whose frames end in these bytes."""
        self.statistics.bytes += len(data)
        for begin in range(0, len(data), _PIECE):
            self._buffer += data[begin : begin + _PIECE]
            self._scan(last=False)
        return self._rows.taken()

    def finish(self) -> Samples:
        """Return the samples that were held back for more bytes, at the end of a stream."""
        self._scan(last=True)
        for framing in self._all:
            framing.finish(self._rows)
        return self._rows.taken()

    def _scan(self, last: bool) -> None:
        """Read all frames in the buffer; keep what may be the start of one, unless nothing follows."""
        buffer, statistics, find = self._buffer, self.statistics, self._first.search
        at = 0
        while True:
            found = find(buffer, at)
            start = len(buffer) if found is None else found.start()
            # Line ends between sentences are no loss.
            statistics.skipped += len(buffer[at:start].strip(b"\r\n")) if start > at else 0
            at = start
            if found is None:
                break
            size, framing = self._size(at)
            # What may be the start of a frame is kept until more has come.
            if size == MORE and not last:
                break
            if size > 0:
                end = at + size
                frame = bytes(buffer[at:end])
                if framing.passes(frame):
                    statistics.frames += 1
                    self.own_frames += framing in self._own
                    if self.passed is not None:
                        self.passed.append(frame)
                    if not framing.read(frame, self._before + end, self._rows):
                        statistics.unknown += 1
                    at = end
                    continue
                statistics.failed += 1
            # One byte on, not the whole frame: a sound one may begin within what looked like this one.
            at += 1
            statistics.skipped += 1
        self._before += at
        del buffer[:at]

    def _size(self, at: int) -> tuple[int, Framing]:
        """Return the size of the frame that begins at a place, and of which kind it is."""
        buffer = self._buffer
        for framing in self._framings[buffer[at]]:
            size = framing.size(buffer, at)
            if size > len(buffer) - at:
                return MORE, framing
            if size != NONE:
                return size, framing
        return NONE, framing
