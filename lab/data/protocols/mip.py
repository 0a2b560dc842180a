"""MicroStrain MIP: packets of fields, of which those of the IMU and of the receiver are read and written.

Specific force comes in g, which is 9.80665 m/s². A packet with delta angle and delta velocity alone is
divided by the interval since the one before, by its reference time or its delta time.

References ---------- MicroStrain by HBK, *MIP Data Communications Protocol*, descriptor sets 0x80 (sensor)
and 0x81, 0x91, 0x92 (GNSS).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

import numpy as np

from lab.base.parameters.units import GAUSS, STANDARD_GRAVITY
from lab.data.protocols.framing import MORE, NONE, Framing, fletcher16, passes_fletcher16
from lab.data.protocols.nmea_encoder import HeadingEncoder
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import (
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
from lab.data.protocols.sending import nanoseconds, sent_fix, vector

SYNC = b"\x75\x65"
SENSOR = 0x80  # set of the inertial data
GNSS = (0x81, 0x91, 0x92)
"""Sets of the receivers: of the only one, and of the first and second."""
FORCE, RATE, MAGNETIC, DELTA_ANGLE, DELTA_VELOCITY = 0x04, 0x05, 0x06, 0x07, 0x08  # fields of `SENSOR`
GPS_TIMESTAMP, TEMPERATURE, PRESSURE = 0x12, 0x14, 0x17  # fields of `SENSOR`
REFERENCE_TIME, DELTA_TIME, SHARED_GPS_TIME = 0xD5, 0xD6, 0xD3  # times, of any set
PLACE, VELOCITY, GNSS_TIME, FIX_INFO = 0x03, 0x05, 0x09, 0x0B  # fields of `GNSS`
MILLIBAR = 100.0
"""[Pa]."""
NANOSECOND = 1e-9
"""[s]."""

_HEADER, _CHECK = 4, 2  # bytes before and after the fields
_TIMES = {REFERENCE_TIME: ">Q", DELTA_TIME: ">Q", SHARED_GPS_TIME: ">dHH"}
_SENSOR_FORMS = _TIMES | {GPS_TIMESTAMP: ">dHH", PRESSURE: ">f"} | dict.fromkeys(
    (FORCE, RATE, MAGNETIC, DELTA_ANGLE, DELTA_VELOCITY, TEMPERATURE), ">3f"
)  # fmt: skip
_GNSS_FORMS = _TIMES | {PLACE: ">4d2fH", VELOCITY: ">8fH", GNSS_TIME: ">dHH", FIX_INFO: ">BBHH"}
_FORMS = {SENSOR: _SENSOR_FORMS} | dict.fromkeys(GNSS, _GNSS_FORMS)
"""Numbers of each field that is read, by set."""
_FIX_TYPES = {0: FIX_3D, 1: FIX_2D, 5: FIX_RTK_FLOAT, 6: FIX_RTK, 7: FIX_DIFFERENTIAL}
"""Kinds of fixes of the device; 2 is time only, 4 invalid."""
_FIX_NUMBERS = {kind: number for number, kind in _FIX_TYPES.items()}
_NONE = 3  # number of a fix that is none
_ALL = 0x1F  # flags of a place of which all is valid
_LONGEST_INTERVAL = 1.0
"""Longest interval that an increment is divided by [s]: after a longer one, packets are missing."""

Fields = Mapping[int, Vector]


class Mip(Framing):
    """Framing of packets: sync, set, length, fields, sums of 16 bits."""

    first = SYNC[:1]
    longest = 255 + _HEADER + _CHECK

    def __init__(self) -> None:
        self._before = NAN

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the packet that begins at a place, `MORE` or `NONE`."""
        head = data[at : at + _HEADER]
        if not head.startswith(SYNC):
            return MORE if SYNC.startswith(head) else NONE
        return MORE if len(head) < _HEADER else _HEADER + head[3] + _CHECK

    def passes(self, frame: bytes) -> bool:
        """Return whether the sums are those said, and the fields fill the packet."""
        return passes_fletcher16(frame[:-_CHECK], frame[-_CHECK:]) and _fields(frame) is not None

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample or the fix of a packet; return whether it has one."""
        fields = _fields(frame) or {}
        if frame[2] == SENSOR:
            return self._read_sample(fields, end, rows)
        return frame[2] in GNSS and _read_fix(fields, end, rows)

    def _read_sample(self, fields: Fields, end: int, rows: Rows) -> bool:
        time = _time(fields)
        rate, force = fields.get(RATE, UNKNOWN), fields.get(FORCE, UNKNOWN)
        angle, velocity = fields.get(DELTA_ANGLE, UNKNOWN), fields.get(DELTA_VELOCITY, UNKNOWN)
        if angle is not UNKNOWN or velocity is not UNKNOWN:
            interval, self._before = time - self._before, time
            if DELTA_TIME in fields:
                interval = fields[DELTA_TIME][0] * NANOSECOND
            if rate is UNKNOWN and force is UNKNOWN and 0 < interval <= _LONGEST_INTERVAL:
                rate, force = [one / interval for one in angle], [one / interval for one in velocity]
        if rate is UNKNOWN and force is UNKNOWN:
            return False
        force = [one * STANDARD_GRAVITY for one in force]
        magnetic = [one * GAUSS for one in fields.get(MAGNETIC, UNKNOWN)]
        pressure = fields.get(PRESSURE, UNKNOWN)[0] * MILLIBAR
        # Lowest, highest and mean temperature of the period.
        temperature = fields.get(TEMPERATURE, UNKNOWN)[2]
        rows.add_imu(end, time, -1, rate, force, magnetic, temperature, pressure)
        return True


def _fields(frame: bytes) -> Fields | None:
    """Return the numbers of the fields of a packet that are read; None if its fields do not fill it."""
    at, last, forms = _HEADER, len(frame) - _CHECK, _FORMS.get(frame[2], {})
    fields = {}
    while at < last:
        size, form = frame[at], forms.get(frame[at + 1], "")
        # The size counts itself and the kind.
        if size < 2 or at + size > last:
            return None
        if form and struct.calcsize(form) == size - 2:
            fields[frame[at + 1]] = struct.unpack_from(form, frame, at + 2)
        at += size
    return fields


def _read_fix(fields: Fields, end: int, rows: Rows) -> bool:
    if PLACE not in fields:
        return False
    # Heights above the ellipsoid and above the sea. Flags: 0 place, 1 height, 3 and 4 the accuracies.
    latitude, longitude, height, _, level, vertical, flags = fields[PLACE]
    valid, satellites = int(flags), -1
    fix_type = FIX_3D if valid & 1 else NO_FIX
    if FIX_INFO in fields:
        kind, satellites, _, _ = map(int, fields[FIX_INFO])
        fix_type = _FIX_TYPES.get(kind, NO_FIX) if valid & 1 else NO_FIX
    *velocity, _, _, _, speed_sigma, _, known = fields.get(VELOCITY, (*UNKNOWN, *UNKNOWN, NAN, NAN, 0))
    velocity_n: Vector = velocity if int(known) & 1 else UNKNOWN
    place = math.radians(latitude), math.radians(longitude), height if valid & 2 else NAN
    sigma = level if valid & 8 else NAN, vertical if valid & 16 else NAN, speed_sigma
    time, week_time = _time(fields), _week_time(fields)
    rows.add_fix(end, time, week_time, NAN, place, velocity_n, sigma, satellites, fix_type)
    return True


def _time(fields: Fields) -> float:
    """Return the time of the device's clock [s]; devices without one of their own stamp by that of GPS."""
    return fields[REFERENCE_TIME][0] * NANOSECOND if REFERENCE_TIME in fields else _week_time(fields)


def _week_time(fields: Fields) -> float:
    found = (fields[kind][0] for kind in (GNSS_TIME, SHARED_GPS_TIME, GPS_TIMESTAMP) if kind in fields)
    return next(found, NAN)


class MipEncoder(HeadingEncoder):
    """Writes samples and fixes; NaN is left out. The device's single precision rounds them."""

    name = "mip"

    def _sample(self, row: np.void) -> bytes:
        fields = [(REFERENCE_TIME, struct.pack(">Q", nanoseconds(row["time"])))]
        for kind, name, unit in (
            (FORCE, "force", STANDARD_GRAVITY), (RATE, "rate", 1.0), (MAGNETIC, "magnetic", GAUSS),
        ):  # fmt: skip
            if np.isfinite(row[name]).all():
                fields.append((kind, struct.pack(">3f", *vector(row, name, unit))))
        if math.isfinite(row["pressure"]):
            fields.append((PRESSURE, struct.pack(">f", row["pressure"] / MILLIBAR)))
        return _packet(SENSOR, fields)

    def _fix(self, row: np.void) -> bytes:
        fix = sent_fix(row)
        valid = _ALL if fix.kind > NO_FIX else 0
        place = (fix.latitude, fix.longitude, fix.height, fix.height)
        sigma = (fix.horizontal_sigma, fix.vertical_sigma)
        speeds = (math.hypot(*fix.velocity_n), fix.speed, fix.course, fix.speed_sigma, 0.0)
        return _packet(
            GNSS[0],
            [
                (REFERENCE_TIME, struct.pack(">Q", nanoseconds(row["time"]))),
                (GNSS_TIME, struct.pack(">dHH", fix.week_time, 0, 1)),
                (FIX_INFO, struct.pack(">BBHH", _FIX_NUMBERS.get(fix.kind, _NONE), fix.satellites, 0, 7)),
                (PLACE, struct.pack(">4d2fH", *place, *sigma, valid)),
                (VELOCITY, struct.pack(">8fH", *fix.velocity_n, *speeds, valid)),
            ],
        )


def _packet(descriptors: int, fields: list[tuple[int, bytes]]) -> bytes:
    payload = b"".join(bytes((len(data) + 2, kind)) + data for kind, data in fields)
    packet = SYNC + bytes((descriptors, len(payload))) + payload
    return packet + fletcher16(packet)
