"""Xsens MTData2: messages of an MTi, in single, double or fixed-point numbers.

A message with RateOfTurn or Acceleration is a sample. Until the first of these, messages with their
high-resolution forms (1 kHz) are samples, and messages with DeltaQ and DeltaV alone, divided by the
interval since the one before by SampleTimeFine. Only the receiver's own PVT makes a fix, not the device's
solution. The magnetic field comes in units of the field where the device was calibrated: its direction is
right, its size assumes `NOMINAL_FIELD`. The count is that of messages, without those of the receiver and
others that came between samples. The check is one byte, so a message must also be made up of whole items.

References
----------
Xsens, *MT Low-Level Communication Protocol Documentation* (MT0101P).
"""

from __future__ import annotations

import math
import struct

import numpy as np

from lab.data.protocols.device_time import WrappingCounter
from lab.data.protocols.framing import MORE, NONE, Framing, sum8
from lab.data.protocols.nmea_encoder import HeadingEncoder
from lab.data.protocols.pvt import Pvt
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import CLIPPED_FORCE, CLIPPED_MAGNETIC, CLIPPED_RATE, NAN, UNKNOWN, Vector
from lab.data.protocols.sending import microseconds

START = b"\xfa\xff\x36"
"""Preamble, bus identifier of a device by itself, MTData2."""
NOMINAL_FIELD = 5e-5
"""Field that counts as 1 in the device's units [T]: the Earth's is 2.5e-5 to 6.5e-5 T."""
TICK = 1e-4
"""Of SampleTimeFine [s]."""
# Identifiers of the items (MT Low Level Communication Protocol).
PACKET_COUNTER, SAMPLE_TIME_FINE, TEMPERATURE, PRESSURE = 0x1020, 0x1060, 0x0810, 0x3010
DELTA_VELOCITY, ACCELERATION, ACCELERATION_HR = 0x4010, 0x4020, 0x4040  # of accelerometers
# Of gyros and magnetometers.
RATE_OF_TURN, DELTA_QUATERNION, RATE_OF_TURN_HR, MAGNETIC = 0x8020, 0x8030, 0x8040, 0xC020
STATUS_WORD, GNSS_PVT = 0xE020, 0x7010  # of the device and its receiver

EXTENDED = 0xFF
"""Length that says that two bytes of length follow."""
_HEAD, _LONG_HEAD, _CHECKSUM = 4, 6, 1  # bytes before the items, of a long message, and after them
_LONGEST_DATA = 2048  # bytes of the items of a message
_ITEM_HEAD = 3  # bytes of an item before its data: kind and size
_PRECISIONS = 0x3
"""Bits of an identifier with the kind of number; the next two are of axes that none of those read depends
on."""
_KINDS = 0xFFF0  # bits of an identifier with the kind of item
_FORMS = tuple(
    {count: struct.Struct(">" + number * count) for count in (1, 3, 4)} for number in ("f", "i", "Ih", "d")
)
"""Numbers of each precision: single, 12.20, 16.32 with the 32 bits after the point first, and double."""
_COUNTS = {
    TEMPERATURE: 1, DELTA_VELOCITY: 3, ACCELERATION: 3, ACCELERATION_HR: 3, RATE_OF_TURN: 3,
    DELTA_QUATERNION: 4, RATE_OF_TURN_HR: 3, MAGNETIC: 3,
}  # fmt: skip
"""Numbers of each item that is read."""
_WHOLE = {PACKET_COUNTER: 2, SAMPLE_TIME_FINE: 4, PRESSURE: 4, STATUS_WORD: 4}
"""Bytes of each item that is a whole number."""
_CLIPPED_FROM = 8
"""First of nine bits of StatusWord for axes out of range: accelerometers, gyros, magnetometers."""
PVT = Pvt(">")
PVT_SIZE = 94
"""Bytes of GnssPvtData."""
_LONGEST_INTERVAL = 1.0
"""Longest interval that an increment is divided by [s]: after a longer one, messages are missing."""


class Xsens(Framing):
    """Framing of MTData2: preamble, length, items, sum of 8 bits."""

    first = START[:1]
    longest = _LONGEST_DATA + _LONG_HEAD + _CHECKSUM
    wrap_period = 2**32 * TICK

    def __init__(self) -> None:
        self._clock = WrappingCounter(2**32)
        self._counter = WrappingCounter(2**16)
        self._others = 0  # messages with a number that are no samples
        self._before = NAN
        self._plain = False

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the message that begins at a place, `MORE` or `NONE`."""
        head = data[at : at + _LONG_HEAD]
        if not head.startswith(START):
            return MORE if START.startswith(head) else NONE
        if len(head) < _HEAD:
            return MORE
        if head[3] != EXTENDED:
            return head[3] + _HEAD + _CHECKSUM
        if len(head) < _LONG_HEAD:
            return MORE
        size = (head[4] << 8 | head[5]) + _LONG_HEAD + _CHECKSUM
        return size if size <= self.longest else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether all bytes but the preamble sum to zero, and the items fill the message."""
        # All bytes behind the preamble sum to zero, so with it they sum to the preamble.
        return sum8(frame) == START[0] and _items(frame) is not None

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample and the fix of a message; return whether it has any."""
        items = _items(frame) or {}
        numbers = {kind: value for kind in _COUNTS if (value := _numbers(items, kind)) is not None}
        whole = {
            kind: int.from_bytes(items[kind][1], "big")
            for kind, size in _WHOLE.items()
            if kind in items and len(items[kind][1]) == size
        }
        time, count = NAN, -1
        if SAMPLE_TIME_FINE in whole:
            time = self._clock.continued(whole[SAMPLE_TIME_FINE]) * TICK
        if PACKET_COUNTER in whole:
            count = self._counter.continued(whole[PACKET_COUNTER]) - self._others
        interval = NAN
        if DELTA_QUATERNION in numbers or DELTA_VELOCITY in numbers:
            interval, self._before = time - self._before, time
        self._plain |= RATE_OF_TURN in numbers or ACCELERATION in numbers
        rate, force = _rate_and_force(numbers, interval, self._plain)
        known = rate is not UNKNOWN or force is not UNKNOWN
        if known:
            magnetic = [value * NOMINAL_FIELD for value in numbers.get(MAGNETIC, UNKNOWN)]
            temperature, pressure = numbers.get(TEMPERATURE, (NAN,))[0], whole.get(PRESSURE, NAN)
            clipped = _clipping_flags(whole.get(STATUS_WORD, 0))
            rows.add_imu(end, time, count, rate, force, magnetic, temperature, pressure, clipped)
        else:
            self._others += PACKET_COUNTER in whole
        if GNSS_PVT in items and len(items[GNSS_PVT][1]) == PVT_SIZE:
            PVT.read(items[GNSS_PVT][1], time, end, rows)
            known = True
        return known


Items = dict[int, tuple[int, bytes]]


def _items(frame: bytes) -> Items | None:
    """Return precision and bytes of the items of a message, by kind; None if they do not fill it."""
    at = _LONG_HEAD if frame[3] == EXTENDED else _HEAD
    last = len(frame) - _CHECKSUM
    items: Items = {}
    while at + _ITEM_HEAD <= last:
        kind, size = frame[at] << 8 | frame[at + 1], frame[at + 2]
        at += _ITEM_HEAD + size
        if at > last:
            return None
        items[kind & _KINDS] = kind & _PRECISIONS, frame[at - size : at]
    return items if at == last else None


def _numbers(items: Items, kind: int) -> Vector | None:
    if kind not in items:
        return None
    precision, data = items[kind]
    form = _FORMS[precision][_COUNTS[kind]]
    if len(data) != form.size:
        return None
    values = form.unpack(data)
    if precision == 1:
        return tuple(value / 2**20 for value in values)
    if precision == 2:
        return tuple(whole + part / 2**32 for part, whole in zip(values[::2], values[1::2], strict=True))
    return values


def _rate_and_force(numbers: dict[int, Vector], interval: float, plain: bool) -> tuple[Vector, Vector]:
    """Return angular rate and specific force of a message; with `plain`, from their usual items alone."""
    fast = () if plain else ((RATE_OF_TURN_HR, ACCELERATION_HR),)
    for rate, force in ((RATE_OF_TURN, ACCELERATION), *fast):
        if rate in numbers or force in numbers:
            return numbers.get(rate, UNKNOWN), numbers.get(force, UNKNOWN)
    if plain or not 0 < interval <= _LONGEST_INTERVAL:
        return UNKNOWN, UNKNOWN
    rate_found: Vector = UNKNOWN
    force_found: Vector = UNKNOWN
    if DELTA_QUATERNION in numbers:
        scalar, *vector = numbers[DELTA_QUATERNION]
        length = math.hypot(*vector)
        # The rotation vector has the angle 2 atan2(|v|, s); its limit for small angles is 2 v.
        factor = 2 * math.atan2(length, scalar) / length if length > 0 else 2.0
        rate_found = tuple(factor * value / interval for value in vector)
    if DELTA_VELOCITY in numbers:
        force_found = tuple(value / interval for value in numbers[DELTA_VELOCITY])
    return rate_found, force_found


def _clipping_flags(status: int) -> int:
    bits = status >> _CLIPPED_FROM
    return (bits & 7) * CLIPPED_FORCE | (bits >> 3 & 7) * CLIPPED_RATE | (bits >> 6 & 7) * CLIPPED_MAGNETIC


class XsensEncoder(HeadingEncoder):
    """Writes samples and fixes in single precision; NaN is left out."""

    name = "xsens"

    def __init__(self) -> None:
        self._count = 0

    def _sample(self, row: np.void) -> bytes:
        items = self._head(row["time"])
        for kind, values in (
            (TEMPERATURE, [row["temperature"]]),
            (ACCELERATION, row["force"]),
            (RATE_OF_TURN, row["rate"]),
            (MAGNETIC, row["magnetic"] / NOMINAL_FIELD),
        ):
            if np.isfinite(values).all():
                items.append((kind, struct.pack(f">{len(values)}f", *values)))
        if math.isfinite(row["pressure"]):
            items.append((PRESSURE, round(float(row["pressure"])).to_bytes(4, "big")))
        clipped = int(row["clipped"])
        # `7 << 6` is a mask: Python shifts before it masks. Forces first, as in the status word.
        bits = clipped >> 3 & 7 | (clipped & 7) << 3 | clipped & 7 << 6
        # Bit 19: some axis is clipped; bits 0 and 1: the self-test passed, the filter is valid.
        items.append((STATUS_WORD, (bits << 8 | bool(bits) << 19 | 3).to_bytes(4, "big")))
        return _message(items)

    def _fix(self, row: np.void) -> bytes:
        data = PVT.written(row).ljust(PVT_SIZE, b"\0")
        return _message([*self._head(row["time"]), (GNSS_PVT, data)])

    def _head(self, time: float) -> list[tuple[int, bytes]]:
        count, self._count = self._count, (self._count + 1) % 2**16
        ticks = round(microseconds(time) * 1e-6 / TICK) % 2**32
        return [(PACKET_COUNTER, count.to_bytes(2, "big")), (SAMPLE_TIME_FINE, ticks.to_bytes(4, "big"))]


def _message(items: list[tuple[int, bytes]]) -> bytes:
    payload = b"".join(kind.to_bytes(2, "big") + bytes((len(data),)) + data for kind, data in items)
    is_long = len(payload) >= EXTENDED
    size = bytes((EXTENDED,)) + len(payload).to_bytes(2, "big") if is_long else bytes((len(payload),))
    message = START + size + payload
    return message + bytes(((START[0] - sum(message)) & 0xFF,))
