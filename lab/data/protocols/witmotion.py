"""WitMotion: messages of 11 bytes with a sum of 8 bits, and the combined message of devices with Bluetooth.

A device sends the messages that it is told to, always in the order of their kinds: time (0x50), acceleration
(0x51), angular velocity (0x52), pressure (0x56). An acceleration and the angular velocity after it are one
sample; of a device that sends one kind alone each message is one. The time is that of the device's calendar,
in whole milliseconds; without it the samples are timed by their arrival. The combined message (0x55 0x61) has
no check: it counts if another message follows it. A count of specific force is 16 g / 32768, one of angular
rate 2000 °/s / 32768. The unit of the magnetic field (0x54) depends on the model, so it is left out, as are
angles. Axes are those printed on the device: at rest, z up reads +1 g.

References
----------
WitMotion, *HWT905-TTL Protocol*, https://docs.wit-motion.com; *WT901BLECL Manual*, 6.1.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

import numpy as np

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.protocols.device_time import utc_seconds
from lab.data.protocols.framing import MORE, NONE, Framing, sum8
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import NAN, UNKNOWN, Vector
from lab.data.protocols.sending import FrameEncoder, round_to_bits, vector

_SYNC = 0x55  # first byte of a message
_TIME, _FORCE, _RATE, _PRESSURE = 0x50, 0x51, 0x52, 0x56  # kinds that are read
_KINDS = range(0x50, 0x60)
"""Messages of 11 bytes."""
_COMBINED, _ANSWER = 0x61, 0x71
"""Messages of 20 bytes without a check: of samples, and of other values that were asked for."""
_SIZE, _LONG_SIZE = 11, 20  # bytes of a message, and of a combined one
_COUNTS = struct.Struct("<4h")
_SIX = struct.Struct("<6h")
_CALENDAR = struct.Struct("<6BH")
_FORCE_COUNT = 16 * STANDARD_GRAVITY / 32_768
"""[m/s²]."""
_RATE_COUNT = math.radians(2000) / 32_768
"""[rad/s]."""
_TEMPERATURE_COUNT = 0.01
"""[°C]."""
_CENTURY = 2000  # in which the years of the calendar count


class WitMotion(Framing):
    """Framing of both kinds of messages."""

    first = bytes((_SYNC,))
    longest = _LONG_SIZE + 2

    def __init__(self) -> None:
        self._time = self._pressure = NAN
        self._force: tuple[Vector, float, int] | None = None  # that waits: force, temperature, end
        self._has_both = False

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the message that begins at a place, `MORE` or `NONE`."""
        if len(data) - at < 2:
            return MORE
        kind = data[at + 1]
        if kind in _KINDS:
            return _SIZE
        if kind not in {_COMBINED, _ANSWER}:
            return NONE
        follows = data[at + _LONG_SIZE : at + _LONG_SIZE + 2]
        if len(follows) < 2:
            return MORE
        return _LONG_SIZE if follows[0] == _SYNC and follows[1] in {_COMBINED, _ANSWER} else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether the last byte is the sum of the others; combined messages have none."""
        return len(frame) == _LONG_SIZE or sum8(frame[:-1]) == frame[-1]

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample that a message completes; return whether it is one that is read."""
        kind = frame[1]
        if kind == _COMBINED:
            counts = _SIX.unpack_from(frame, 2)
            rows.add_imu(
                end,
                rate=_scale_counts(counts[3:], _RATE_COUNT),
                force=_scale_counts(counts[:3], _FORCE_COUNT),
            )
        elif kind == _TIME:
            self.finish(rows)
            year, month, day, hour, minute, second, milli = _CALENDAR.unpack_from(frame, 2)
            self._time = utc_seconds(_CENTURY + year, month, day, hour, minute, second + 1e-3 * milli)
        elif kind == _FORCE:
            self.finish(rows)
            *values, heat = _COUNTS.unpack_from(frame, 2)
            self._force = _scale_counts(values, _FORCE_COUNT), heat * _TEMPERATURE_COUNT, end
        elif kind == _RATE:
            *values, _ = _COUNTS.unpack_from(frame, 2)
            force, temperature, _ = self._force or (UNKNOWN, NAN, 0)
            self._has_both |= self._force is not None
            self._add(end, _scale_counts(values, _RATE_COUNT), force, temperature, rows)
        elif kind == _PRESSURE:
            self._pressure = struct.unpack_from("<i", frame, 2)[0]
        return kind in {_COMBINED, _TIME, _FORCE, _RATE, _PRESSURE}

    def finish(self, rows: Rows) -> None:
        """Add a force that no angular rate followed, unless one was damaged."""
        if self._force is not None:
            force, temperature, end = self._force
            self._add(end, UNKNOWN, force, temperature, rows)

    def _add(self, end: int, rate: Vector, force: Vector, temperature: float, rows: Rows) -> None:
        # Of a device that sends both, a sample with one of them has lost a message.
        if not self._has_both or (rate is not UNKNOWN and force is not UNKNOWN):
            rows.add_imu(end, self._time, -1, rate, force, UNKNOWN, temperature, self._pressure)
        self._force, self._time, self._pressure = None, NAN, NAN


def _scale_counts(counts: Sequence[int], unit: float) -> Vector:
    return [count * unit for count in counts]


class WitMotionEncoder(FrameEncoder):
    """Writes samples, rounded to counts that end at their range. The protocol has no fixes."""

    name = "witmotion"

    def _sample(self, row: np.void) -> bytes:
        temperature = float(row["temperature"]) if math.isfinite(row["temperature"]) else 0.0
        heat = temperature / _TEMPERATURE_COUNT
        return b"".join(
            _message(kind, [*vector(row, name, unit), heat])
            for kind, name, unit in ((_FORCE, "force", _FORCE_COUNT), (_RATE, "rate", _RATE_COUNT))
        )


def _message(kind: int, values: list[float]) -> bytes:
    message = bytes((_SYNC, kind)) + _COUNTS.pack(*map(round_to_bits, values))
    return message + bytes((sum8(message),))
