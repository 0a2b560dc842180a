"""UBX messages of u-blox: NAV-PVT makes fixes, ESF-RAW and ESF-MEAS of receivers with an IMU make samples.

NAV-RELPOSNED of a moving base makes headings: those of the line from the base's antenna to the rover's, which
is taken to point forward. ESF-MEAS with the type of data for speeds makes speeds of an odometer; ticks of
wheels say no speed, since their length is unknown.

ESF-RAW holds several samples, each with a tag of the sensor's clock. ESF-MEAS holds a triad at a time, at
another time than the other, so its samples have one triad and NaN for the other. Where both are sent,
ESF-RAW alone makes samples: it is the same sensor, at ten times the rate. The clock of the tags is not that
of NAV-PVT.

References ---------- u-blox, *u-blox 8 / u-blox M8 Receiver Description Including Protocol Specification*
(UBX-13003221), sections NAV-PVT, ESF-MEAS, ESF-RAW.
"""

from __future__ import annotations

import math
import struct
from typing import Literal

from lab.data.protocols.device_time import WrappingCounter
from lab.data.protocols.framing import MORE, NONE, Framing, passes_fletcher16
from lab.data.protocols.pvt import Pvt
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import NAN, UNKNOWN, Vector

SYNC = b"\xb5\x62"
NAV_PVT, NAV_RELPOSNED, ESF_MEAS, ESF_RAW = b"\x01\x07", b"\x01\x3c", b"\x10\x02", b"\x10\x03"
PVT = Pvt("<")
RAW_TICK = 1 / 25600
"""Of the tags in ESF-RAW [s]: not in the manual; 256 a sample at 100 Hz. A NEO-M8U ran 0.3 % slow."""
MEAS_TICK = 1e-3
"""Of the tag in ESF-MEAS [s]."""
Z_GYRO, TEMPERATURE, Y_GYRO, X_GYRO, X_FORCE, Y_FORCE, Z_FORCE = 5, 12, 13, 14, 16, 17, 18
"""Types of data of the IMU; the others are of wheels."""
SPEED = 11
"""Type of data of an odometer's speed."""
SPEED_UNIT = 1e-3
"""[m/s]."""
RELPOSNED = struct.Struct("<B3xI16xi24xI4xI")
"""Version, time of the week [ms], heading and its σ [1e-5 °], flags; other fields are left out."""
HEADING_UNIT = math.radians(1e-5)
"""[rad]."""
LINE_FORWARD = 1 << 0 | 1 << 5 | 1 << 8
"""Flags of a heading that is used: a fix, of a moving base, with a valid heading."""
GYRO_UNIT = math.radians(2**-12)
"""[rad/s]."""
FORCE_UNIT = 2**-10
"""[m/s²]."""
TEMPERATURE_UNIT = 1e-2
"""[°C]."""

_HEADER, _CHECK = 6, 2  # bytes before and after the payload
COUNT_FROM = 11
"""First bit of the number of measurements in the flags of ESF-MEAS."""
_MOVING_BASE = 1 << 5  # a bit of the flags of NAV-RELPOSNED
_MEAS = struct.Struct("<IHH")
_PAIR = struct.Struct("<II")
_WORD = struct.Struct("<I")
_SHORT_TAG = 2**24
"""Tags of the sensors seen have 24 bits; a larger one says that they have 32."""
_GYROS = (X_GYRO, Y_GYRO, Z_GYRO)
_FORCES = (X_FORCE, Y_FORCE, Z_FORCE)


class Ublox(Framing):
    """Framing of UBX: two sync bytes, class, number, length, payload, sums of 16 bits.

    Parameters
    ----------
    imu
        Message that samples are made of; with ``"auto"`` ESF-MEAS until the first ESF-RAW.
    """

    first = SYNC[:1]
    longest = 4096
    wrap_period = _SHORT_TAG * RAW_TICK

    def __init__(self, imu: Literal["auto", "raw", "meas"] = "auto") -> None:
        self._imu = imu
        self._tags = WrappingCounter(_SHORT_TAG)
        self._long = False
        self._times = WrappingCounter(2**32)
        self._fixes = False

    @property
    def has_fixes(self) -> bool:
        """Whether NAV-PVT was seen: sentences of the same receiver then say nothing new."""
        return self._fixes

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the message that begins at a place, `MORE` or `NONE`."""
        head = data[at : at + _HEADER]
        if not head.startswith(SYNC):
            return MORE if SYNC.startswith(head) else NONE
        if len(head) < _HEADER:
            return MORE
        size = _HEADER + (head[4] | head[5] << 8) + _CHECK
        return size if size <= self.longest else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether the sums are those said."""
        return passes_fletcher16(frame[2:-_CHECK], frame[-_CHECK:])

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the samples or the fix of a message; return whether it is one of those."""
        kind, payload = frame[2:4], frame[_HEADER:-_CHECK]
        if kind == NAV_PVT and len(payload) >= PVT.size:
            self._fixes = True
            PVT.read(payload, NAN, end, rows)
            return True
        if kind == ESF_RAW and len(payload) % 8 == 4 and self._imu != "meas":
            self._imu = "raw"
            return self._add_raw(payload, end, rows)
        if kind == NAV_RELPOSNED and len(payload) == RELPOSNED.size:
            return _add_heading(payload, end, rows)
        if kind == ESF_MEAS and len(payload) >= _MEAS.size:
            return self._add_measured(payload, end, rows)
        return False

    def _add_raw(self, payload: bytes, end: int, rows: Rows) -> bool:
        values: dict[int, int] = {}
        before: int | None = None
        found = False
        for data, tag in _PAIR.iter_unpack(payload[4:]):
            if tag != before and before is not None:
                found |= self._add_tagged(before, values, end, rows)
                values = {}
            before = tag
            values[data >> 24] = data & 0xFFFFFF
        return (before is not None and self._add_tagged(before, values, end, rows)) or found

    def _add_tagged(self, tag: int, values: dict[int, int], end: int, rows: Rows) -> bool:
        if tag >= _SHORT_TAG and not self._long:
            self._long, self._tags = True, WrappingCounter(2**32)
        return _add_sample(self._tags.continued(tag) * RAW_TICK, values, end, rows)

    def _add_measured(self, payload: bytes, end: int, rows: Rows) -> bool:
        tag, flags, _ = _MEAS.unpack_from(payload)
        count = min(flags >> COUNT_FROM, (len(payload) - _MEAS.size) // _WORD.size)
        words = [_WORD.unpack_from(payload, _MEAS.size + _WORD.size * number)[0] for number in range(count)]
        values = {word >> 24 & 0x3F: word & 0xFFFFFF for word in words}
        time = self._times.continued(tag) * MEAS_TICK
        if SPEED in values:  # beside ESF-RAW, the clock of the tags is another one
            rows.add_reading(
                end, NAN if self._imu == "raw" else time, speed=_signed(values[SPEED]) * SPEED_UNIT
            )
        sample = self._imu != "raw" and _add_sample(time, values, end, rows)
        return sample or SPEED in values


def _add_heading(payload: bytes, end: int, rows: Rows) -> bool:
    """Add the heading of a moving base, if it is one and valid; return whether this is a message of one."""
    version, week_time, heading, sigma, flags = RELPOSNED.unpack(payload)
    if version != 1 or not flags & _MOVING_BASE:
        return False
    if flags & LINE_FORWARD == LINE_FORWARD:
        angle, spread = heading * HEADING_UNIT, sigma * HEADING_UNIT
        rows.add_reading(end, week_time=1e-3 * week_time, heading=angle, heading_sigma=spread)
    return True


def _add_sample(time: float, values: dict[int, int], end: int, rows: Rows) -> bool:
    """Add a sample of data by type; return whether it has any of the IMU."""
    rate, force = _triad(values, _GYROS, GYRO_UNIT), _triad(values, _FORCES, FORCE_UNIT)
    if rate is UNKNOWN and force is UNKNOWN:
        return False
    temperature = _signed(values[TEMPERATURE]) * TEMPERATURE_UNIT if TEMPERATURE in values else NAN
    rows.add_imu(end, time, -1, rate, force, UNKNOWN, temperature)
    return True


def _triad(values: dict[int, int], kinds: tuple[int, int, int], unit: float) -> Vector:
    if not all(kind in values for kind in kinds):
        return UNKNOWN
    return [_signed(values[kind]) * unit for kind in kinds]


def _signed(value: int) -> int:
    return value - 0x1000000 if value & 0x800000 else value
