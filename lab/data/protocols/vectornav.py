"""VectorNav: binary messages of any mix of groups and fields, and ASCII messages.

Where a binary message has both, uncompensated rates and forces go before compensated ones: the latter have
the bias that the device's own filter believes in subtracted, which changes with time. A message without
either is read from delta angle [°] and delta velocity [m/s], divided by their own interval. Forces are
specific forces [m/s²], in axes forward, right, down: at rest and level z reads -9.8. A GPS block that is
repeated with each sample is one fix.

The ASCII messages are ``$VNYMR``, ``$VNQMR``, ``$VNMAR``, ``$VNIMU``, ``$VNDTV``, ``$VNGPS``. Their check is
two hexadecimal digits of an exclusive or, or four of a CRC. A message that asks to be taken without (``*XX``)
is not taken.

References
----------
VectorNav, *VN-100 User Manual* UM001 and *VN-200 User Manual* UM004, "User configurable binary output" and
"Asynchronous output".
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lab.base.parameters.units import GAUSS
from lab.data.protocols.device_time import utc_seconds
from lab.data.protocols.framing import MORE, NONE, Framing, crc16_xmodem, xor8
from lab.data.protocols.nmea_encoder import HeadingEncoder
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import (
    CLIPPED_FORCE,
    CLIPPED_MAGNETIC,
    CLIPPED_RATE,
    FIX_2D,
    FIX_3D,
    FIX_DIFFERENTIAL,
    FIX_RTK,
    FIX_RTK_FLOAT,
    NAN,
    NO_FIX,
    UNKNOWN,
    Vector,
)
from lab.data.protocols.sending import known_fields, nanoseconds, sent_fix, vector

COMMON, TIME, IMU_GROUP, GPS = range(4)
"""Groups with fields that are read, by their bit in the second byte of a message."""

Field = tuple[int, int]
"""Group, and bit in the group's word."""

_VARIABLE = -1  # size of a field that states its own
_SIZES: tuple[tuple[int, ...], ...] = (
    (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8),
    (8, 8, 8, 2, 8, 8, 8, 4, 4, 1),
    (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 40),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, _VARIABLE),
    (2, 12, 16, 36, 12, 12, 12, 12, 12, 12, 28, 24),
    (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 68, 64),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, _VARIABLE),
)
"""Bytes of each field, by group and bit. Bits beyond these, and an eighth group, are in no public manual."""
_SATELLITE = 8
"""Bytes of SatInfo for each satellite, after two of which the first is their number."""
_MAX_SATELLITES = 64
"""Most satellites in SatInfo: receivers of VectorNav track 72 channels, of which a message has fewer."""
_HEADER = 2  # bytes: start and groups
_CHECK = 2  # bytes of the CRC
_KEPT = 64
"""Layouts that are kept: a device sends up to three; bytes at random ask for any number."""
_LONGEST = 2048
"""Longest message [bytes]: all fields of all groups with the most satellites have 1903."""

_SYNC = 0xFA  # first byte of a message
_KILOPASCAL = 1e3
"""[Pa]."""
_NANOSECOND = 1e-9
"""[s]."""

_FIX_TYPES = {2: FIX_2D, 3: FIX_3D, 4: FIX_DIFFERENTIAL, 7: FIX_RTK_FLOAT, 8: FIX_RTK}
"""Kinds of fixes of the device: 0 is none, 1 time only."""
_FIX_NUMBERS = {kind: number for number, kind in _FIX_TYPES.items()}
_SAMPLE = struct.Struct("<BBHQ6f3fff")
"""Common group as it is written: TimeStartup (bit 0), Imu (9), MagPres (10)."""
_FIX = struct.Struct("<BBHHQQBB3d3f3ff")
"""The same with a fix: TimeStartup; GPS group: Tow (1), NumSats (3), Fix (4), PosLla (5), VelNed (7), PosU
(9), VelU (10)."""

# Fields, each as its group and its bit in the word of the group. First the time since switching on.
_STARTUP: tuple[Field, ...] = ((COMMON, 0), (TIME, 0))
_WEEK_TIMES: tuple[Field, ...] = ((GPS, 1), (TIME, 2))  # GPS time
# IMU fields: uncompensated.
_BOTH, _GYRO, _FORCE, _MAGNETIC = (COMMON, 9), (IMU_GROUP, 3), (IMU_GROUP, 2), (IMU_GROUP, 1)
_RATES, _FORCES = ((COMMON, 5), (IMU_GROUP, 10)), ((COMMON, 8), (IMU_GROUP, 9))  # compensated
_MAGNETICS = ((COMMON, 10), (IMU_GROUP, 8))  # compensated
# Deltas: both, of the angle, of the velocity.
_DELTAS, _DELTA_ANGLE, _DELTA_VELOCITY = (COMMON, 11), (IMU_GROUP, 6), (IMU_GROUP, 7)
_TEMPERATURE, _PRESSURE, _SATURATION = (IMU_GROUP, 4), (IMU_GROUP, 5), (IMU_GROUP, 11)  # beside the axes
_ANY = {_BOTH, _GYRO, _FORCE, *_RATES, *_FORCES, _DELTAS, _DELTA_ANGLE}
_GPS_PLACE, _GPS_VELOCITY = (GPS, 5), (GPS, 7)  # of the receiver


class _Layout(NamedTuple):
    """One kind of message: the bytes of all of it, and the place of each field in it."""

    size: int
    at: Mapping[Field, int]


class VectorNavBinary(Framing):
    """Framing of binary messages: sync, groups, fields, little-endian payload, CRC of 16 bits."""

    first = bytes((_SYNC,))
    longest = _LONGEST

    def __init__(self) -> None:
        self._kept: dict[bytes, _Layout] = {}
        self._fix = b""

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the message that begins at a place, `MORE` or `NONE`."""
        layout = self._layout(data, at)
        return layout.size if isinstance(layout, _Layout) else layout

    def passes(self, frame: bytes) -> bool:
        """Return whether the CRC over all after the sync byte, with itself, is zero."""
        return crc16_xmodem(frame[1:]) == 0

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample and the fix of a message; return whether it has any."""
        layout = self._layout(frame, 0)
        if not isinstance(layout, _Layout):
            return False
        at = layout.at
        seconds = _find_field(frame, at, _STARTUP, "<Q", (NAN,))[0] * _NANOSECOND
        sample = not _ANY.isdisjoint(at)
        if sample:
            self._read_sample(frame, at, end, seconds, rows)
        fix = _GPS_PLACE in at or _GPS_VELOCITY in at
        if fix:
            self._read_fix(frame, layout, end, seconds, rows)
        return sample or fix

    def _layout(self, data: bytes | bytearray, begin: int) -> _Layout | int:
        """Return the layout of the message that begins at a place, `MORE` or `NONE`."""
        if len(data) - begin < _HEADER:
            return MORE
        groups = data[begin + 1]
        if not groups or groups >> len(_SIZES):
            return NONE
        # A word of 16 bits for each group says which of its fields follow.
        first = _HEADER + 2 * groups.bit_count()
        if len(data) - begin < first:
            return MORE
        header = bytes(data[begin + 1 : begin + first])
        kept = self._kept.get(header)
        if kept is not None:
            return kept
        return self._read_layout(data, begin, header, first)

    def _read_layout(self, data: bytes | bytearray, begin: int, header: bytes, first: int) -> _Layout | int:
        at: dict[Field, int] = {}
        place, word, fixed = first, 1, True
        for group, sizes in enumerate(_SIZES):
            if not header[0] >> group & 1:
                continue
            fields = header[word] | header[word + 1] << 8
            word += 2
            if fields >> len(sizes):
                return NONE
            for bit, size in enumerate(sizes):
                if not fields >> bit & 1:
                    continue
                at[group, bit] = place
                if size != _VARIABLE:
                    place += size
                    continue
                fixed = False
                if begin + place >= len(data):
                    return MORE
                if data[begin + place] > _MAX_SATELLITES:
                    return NONE
                place += 2 + _SATELLITE * data[begin + place]
        layout = _Layout(place + _CHECK, at)
        if not at or layout.size > _LONGEST:
            return NONE
        if fixed:
            if len(self._kept) == _KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[header] = layout
        return layout

    def _read_sample(self, frame: bytes, at: Mapping[Field, int], end: int, time: float, rows: Rows) -> None:
        if _BOTH in at:
            # This field has the force before the rate.
            values = _find_field(frame, at, (_BOTH,), "<6f", ())
            force, rate = values[:3], values[3:]
        else:
            force = _find_field(frame, at, (_FORCE, *_FORCES), "<3f", UNKNOWN)
            rate = _find_field(frame, at, (_GYRO, *_RATES), "<3f", UNKNOWN)
        if rate is UNKNOWN and force is UNKNOWN:
            rate, force = _divide_by_time(frame, at)
        x, y, z = _find_field(frame, at, (_MAGNETIC, *_MAGNETICS), "<3f", UNKNOWN)
        # The magnetic field of the common group has temperature and pressure behind it.
        beside = _find_field(frame, at, _MAGNETICS[:1], "<12x2f", (NAN, NAN))
        (temperature,) = _find_field(frame, at, (_TEMPERATURE,), "<f", beside[:1])
        (pressure,) = _find_field(frame, at, (_PRESSURE,), "<f", beside[1:])
        clipped = _clipping_flags(int(_find_field(frame, at, (_SATURATION,), "<H", (0,))[0]))
        magnetic = (x * GAUSS, y * GAUSS, z * GAUSS)
        rows.add_imu(end, time, -1, rate, force, magnetic, temperature, pressure * _KILOPASCAL, clipped)

    def _read_fix(self, frame: bytes, layout: _Layout, end: int, time: float, rows: Rows) -> None:
        at = layout.at
        # What the receiver measured comes again with each sample until it measures anew.
        now = b"".join(
            frame[at[field] : at[field] + size]
            for field, size in (((GPS, 1), 8), ((GPS, 0), 8), (_GPS_PLACE, 24), (_GPS_VELOCITY, 12))
            if field in at
        )
        if now == self._fix:
            return
        self._fix = now
        latitude, longitude, height = _find_field(frame, at, (_GPS_PLACE,), "<3d", UNKNOWN)
        north, east, down = _find_field(frame, at, ((GPS, 9),), "<3f", UNKNOWN)
        kind = FIX_3D if (GPS, 4) not in at else _FIX_TYPES.get(frame[at[GPS, 4]], NO_FIX)
        week_time = _find_field(frame, at, _WEEK_TIMES, "<Q", (NAN,))[0] * _NANOSECOND
        utc = _utc(_find_field(frame, at, ((GPS, 0),), "<b5BH", ()))
        place = math.radians(latitude), math.radians(longitude), height
        velocity = _find_field(frame, at, (_GPS_VELOCITY,), "<3f", UNKNOWN)
        (speed_sigma,) = _find_field(frame, at, ((GPS, 10),), "<f", (NAN,))
        sigma = math.sqrt((north * north + east * east) / 2), down, speed_sigma
        satellites = frame[at[GPS, 3]] if (GPS, 3) in at else -1
        rows.add_fix(end, time, week_time, utc, place, velocity, sigma, satellites, kind)


def _find_field(
    frame: bytes, at: Mapping[Field, int], fields: Sequence[Field], form: str, unknown: Vector
) -> Vector:
    """Return the numbers of the first field that is there."""
    for field in fields:
        if field in at:
            return struct.unpack_from(form, frame, at[field])
    return unknown


def _divide_by_time(frame: bytes, at: Mapping[Field, int]) -> tuple[Vector, Vector]:
    """Return rates and forces of delta angle and delta velocity, which are integrals over an interval."""
    if _DELTAS in at:
        interval, *values = _find_field(frame, at, (_DELTAS,), "<7f", ())
    else:
        interval, *values = _find_field(frame, at, (_DELTA_ANGLE,), "<4f", ())
        values += _find_field(frame, at, (_DELTA_VELOCITY,), "<3f", UNKNOWN)
    if not interval > 0:
        return UNKNOWN, UNKNOWN
    return [math.radians(value / interval) for value in values[:3]], [v / interval for v in values[3:]]


def _clipping_flags(saturation: int) -> int:
    """Return the flags of `IMU` of the field SensSat: magnetometer, accelerometer, gyro from bit 0 on."""
    magnetic, force, rate = (saturation >> first & 7 for first in (0, 3, 6))
    return magnetic * CLIPPED_MAGNETIC | force * CLIPPED_FORCE | rate * CLIPPED_RATE


def _utc(calendar: Vector) -> float:
    if not calendar:
        return NAN
    year, month, day, hour, minute, second, millisecond = map(int, calendar)
    return utc_seconds(2000 + year, month, day, hour, minute, second + 1e-3 * millisecond)


_DOLLAR = b"$VN"
_NUMBERS = re.compile(rb"VN([A-Z]{3})((?:,[+-]?\d{1,12}(?:\.\d{0,12})?)+)")
_TEXT = re.compile(rb"\$VN[A-Z]{3},[ -)+-~]*\*([0-9A-FX]{2}(?:[0-9A-F]{2})?)\r?\n")
_OTHER = re.compile(rb"[^ -~\r\n]")
_CELLS = {"IMU": 11, "YMR": 12, "QMR": 13, "MAR": 9, "DTV": 7, "GPS": 15}
"""Fewest cells of each message that is read; a device may be told to append a time or a status."""


class VectorNavAscii(Framing):
    """Framing of lines that begin with ``$VN``."""

    first = b"$"
    longest = 256

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the line that begins at a place, with its end; `MORE` or `NONE`."""
        head = data[at : at + len(_DOLLAR)]
        if not _DOLLAR.startswith(head) and head != _DOLLAR:
            return NONE
        end = data.find(b"\n", at, at + self.longest)
        if end >= 0:
            return end + 1 - at
        if len(data) - at >= self.longest or _OTHER.search(data, at):
            return NONE
        return MORE

    def passes(self, frame: bytes) -> bool:
        """Return whether the line is a message with the check it says."""
        found = _TEXT.fullmatch(frame)
        if found is None or b"X" in found[1]:
            return False
        body = frame[1 : found.start(1) - 1]
        check = xor8(body) if len(found[1]) == 2 else crc16_xmodem(body)
        return int(found[1], 16) == check

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample or the fix of a line; return whether it is one that is read."""
        found = _NUMBERS.fullmatch(frame[1 : frame.rindex(b"*")])
        if found is None:
            return False
        kind = found[1].decode()
        cells = [float(cell) for cell in found[2].split(b",")[1:]]
        if kind not in _CELLS or len(cells) < _CELLS[kind]:
            return False
        if kind == "GPS":
            _add_fix(cells, end, rows)
        elif kind == "DTV":
            if cells[0] <= 0:
                return False
            rate = [math.radians(cell / cells[0]) for cell in cells[1:4]]
            rows.add_imu(end, rate=rate, force=[cell / cells[0] for cell in cells[4:7]])
        else:
            # Nine cells: field, force and rate; an attitude stands before, temperature and pressure behind.
            at = _CELLS[kind] - 9 if kind != "IMU" else 0
            magnetic = [cell * GAUSS for cell in cells[at : at + 3]]
            force, rate = cells[at + 3 : at + 6], cells[at + 6 : at + 9]
            temperature, pressure = (cells[9], cells[10] * _KILOPASCAL) if kind == "IMU" else (NAN, NAN)
            rows.add_imu(end, NAN, -1, rate, force, magnetic, temperature, pressure)
        return True


def _add_fix(cells: list[float], end: int, rows: Rows) -> None:
    week_time, _, kind, satellites, latitude, longitude, height = cells[:7]
    north, east, down, speed_sigma = cells[10:14]
    place = math.radians(latitude), math.radians(longitude), height
    sigma = math.sqrt((north * north + east * east) / 2), down, speed_sigma
    kind = _FIX_TYPES.get(int(kind), NO_FIX)
    rows.add_fix(end, NAN, week_time, NAN, place, cells[7:10], sigma, int(satellites), kind)


class VectorNavEncoder(HeadingEncoder):
    """Writes binary messages; NaN is sent as zero. The device's single precision rounds samples."""

    name = "vectornav"

    def _sample(self, row: np.void) -> bytes:
        temperature, pressure = known_fields(row, "temperature", "pressure")
        sensed = (*vector(row, "force"), *vector(row, "rate"), *vector(row, "magnetic", GAUSS))
        fields = 1 << 0 | 1 << 9 | 1 << 10
        time = nanoseconds(row["time"])
        return _append_checksum(
            _SAMPLE.pack(_SYNC, 1, fields, time, *sensed, temperature, pressure / _KILOPASCAL)
        )

    def _fix(self, row: np.void) -> bytes:
        fix = sent_fix(row)
        place = (fix.latitude, fix.longitude, fix.height)
        sigma = (fix.horizontal_sigma, fix.horizontal_sigma, fix.vertical_sigma, fix.speed_sigma)
        fields = 1 << 1 | 1 << 3 | 1 << 4 | 1 << 5 | 1 << 7 | 1 << 9 | 1 << 10
        head = (_SYNC, 1 | 1 << 3, 1, fields, nanoseconds(row["time"]), nanoseconds(row["week_time"]))
        kind = _FIX_NUMBERS.get(fix.kind, 0)
        return _append_checksum(_FIX.pack(*head, fix.satellites, kind, *place, *fix.velocity_n, *sigma))


def _append_checksum(message: bytes) -> bytes:
    return message + crc16_xmodem(message[1:]).to_bytes(2, "big")
