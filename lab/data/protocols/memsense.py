"""MEMSense nIMU: frames of 38 bytes at 150 Hz over RS-422, 115 200 baud.

Four sync bytes, size, device, message, a timer of 16 bits, four bytes, twelve numbers of 16 bits (gyros,
accelerometers, magnetometers, their temperatures), and a sum of 8 bits. Sources disagree whether the sum is
over the frame or over the numbers: either is accepted until one was seen, then that one. A number counts
1.5 ranges / 32768; ranges are those of the model of the classic work. The timer starts again after 0.142 s,
so after a longer silence times are wrong by multiples of it.

References
----------
MEMSense, *nIMU Data Sheet*; public drivers for it.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from lab.base.parameters.units import GAUSS, STANDARD_GRAVITY
from lab.data.protocols.device_time import WrappingCounter
from lab.data.protocols.framing import MORE, NONE, Framing, sum8
from lab.data.protocols.rows import Rows
from lab.data.protocols.sending import FrameEncoder, round_to_bits, vector

SIZE = 38  # bytes of a frame
MESSAGE = 0x14  # kind of message with the samples
TICK = 2.1701e-6
"""Of the timer [s]."""

_SYNC = b"\xff" * 4  # four bytes begin a frame
_START = _SYNC + bytes((SIZE,))
_HEAD = 7  # bytes up to the kind of message
_TIMER = struct.Struct(">H")
_NUMBERS = struct.Struct(">12h")
_AT = 13
"""Where the numbers begin."""
_COUNT = 1.5 / 32768  # part of a range
_RATE, _FORCE, _MAGNETIC = _COUNT * math.radians(300), _COUNT * 2 * STANDARD_GRAVITY, _COUNT * 1.9 * GAUSS
"""One count of the model of the classic work [rad/s], [m/s²], [T]."""
_DEGREES_PER_COUNT, _MIDDLE = 1.8165e-2, 25.0
"""Temperature: per count, and at zero [°C]."""
_SWAP = 3
"""Frames in a row with only the other sum, after which that one counts: the first was chance, one in 256."""


class Memsense(Framing):
    """Framing of the nIMU."""

    first = _SYNC[:1]
    longest = SIZE
    wrap_period = 2**16 * TICK

    def __init__(self) -> None:
        self._whole: bool | None = None
        self._others = 0
        self._timer = WrappingCounter(2**16)

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the frame that begins at a place, `MORE` or `NONE`."""
        head = data[at : at + _HEAD]
        if not head.startswith(_START):
            return MORE if _START.startswith(head) else NONE
        if len(head) < _HEAD:
            return MORE
        return SIZE if head[-1] == MESSAGE else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether the last byte is the sum of those before, or of the numbers."""
        over_frame, over_numbers = sum8(frame[:-1]) == frame[-1], sum8(frame[_AT:-1]) == frame[-1]
        if self._whole is None:
            if over_frame != over_numbers:
                self._whole = over_frame
            return over_frame or over_numbers
        fine, other = (over_frame, over_numbers) if self._whole else (over_numbers, over_frame)
        self._others = self._others + 1 if other and not fine else 0
        if self._others == _SWAP:
            self._whole, self._others = not self._whole, 0
            return True
        return fine

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample of a frame."""
        counts = _NUMBERS.unpack_from(frame, _AT)
        time = self._timer.continued(_TIMER.unpack_from(frame, _HEAD)[0]) * TICK
        rate, force, magnetic = (
            [count * unit for count in counts[at : at + 3]]
            for at, unit in ((0, _RATE), (3, _FORCE), (6, _MAGNETIC))
        )
        temperature = _MIDDLE + _DEGREES_PER_COUNT * sum(counts[9:]) / 3
        rows.add_imu(end, time, -1, rate, force, magnetic, temperature)
        return True


class MemsenseEncoder(FrameEncoder):
    """Writes samples, rounded to counts that end at their range. The protocol has no fixes."""

    name = "memsense"

    def _sample(self, row: np.void) -> bytes:
        counts = [
            *vector(row, "rate", _RATE), *vector(row, "force", _FORCE), *vector(row, "magnetic", _MAGNETIC)
        ]  # fmt: skip
        temperature = float(row["temperature"]) if math.isfinite(row["temperature"]) else _MIDDLE
        counts += [(temperature - _MIDDLE) / _DEGREES_PER_COUNT] * 3
        time = float(row["time"])
        timer = round(time / TICK) % 2**16 if math.isfinite(time) else 0
        frame = _START + bytes((0xFF, MESSAGE)) + _TIMER.pack(timer) + bytes(4)
        frame += _NUMBERS.pack(*map(round_to_bits, counts))
        return frame + bytes((sum8(frame),))
