"""VectorNav binary messages: IMU and GPS fields of any mix of groups and fields.

Where a message has both, uncompensated rates and forces go before compensated ones: the latter have the
bias that the device's own filter believes in subtracted, which changes with time. A message without either
is read from delta angle [°] and delta velocity [m/s], divided by their own interval. Forces are specific
forces [m/s²], in axes forward, right, down: at rest and level z reads -9.8. A GPS block that is repeated
with each sample is one fix.

References
----------
VectorNav, *VN-100 User Manual* UM001 and *VN-200 User Manual* UM004, "User configurable binary output".
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence

from lab.base.parameters.units import GAUSS
from lab.data.protocols.device_time import utc_seconds
from lab.data.protocols.framing import Framing, crc16_xmodem
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
from lab.data.protocols.vectornav_layout import (
    COMMON,
    GPS,
    IMU_GROUP,
    LONGEST,
    TIME,
    Field,
    Layout,
    Layouts,
)

SYNC = 0xFA  # first byte of a message
KILOPASCAL = 1e3
"""[Pa]."""
NANOSECOND = 1e-9
"""[s]."""

FIX_TYPES = {
    0: NO_FIX, 1: NO_FIX, 2: FIX_2D, 3: FIX_3D, 4: FIX_DIFFERENTIAL, 7: FIX_RTK_FLOAT, 8: FIX_RTK,
}  # fmt: skip
"""Kinds of fixes of the device: 1 is time only."""

_FLOAT = struct.Struct("<f")
_THREE = struct.Struct("<3f")
_FOUR = struct.Struct("<4f")
_SIX = struct.Struct("<6f")
_SEVEN = struct.Struct("<7f")
_PLACE = struct.Struct("<3d")
_LONG = struct.Struct("<Q")
_TWO = struct.Struct("<2f")
_UTC = struct.Struct("<b5BH")
_WORD = struct.Struct("<H")

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


class VectorNavBinary(Framing):
    """Framing of binary messages: sync, groups, fields, little-endian payload, CRC of 16 bits."""

    first = bytes((SYNC,))
    longest = LONGEST

    def __init__(self) -> None:
        self._layouts = Layouts()
        self._fix = b""

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the message that begins at a place, `MORE` or `NONE`."""
        layout = self._layouts.of(data, at)
        return layout.size if isinstance(layout, Layout) else layout

    def passes(self, frame: bytes) -> bool:
        """Return whether the CRC over all after the sync byte, with itself, is zero."""
        return crc16_xmodem(frame[1:]) == 0

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample and the fix of a message; return whether it has any."""
        layout = self._layouts.of(frame, 0)
        if not isinstance(layout, Layout):
            return False
        at = layout.at
        time = _first(at, _STARTUP)
        seconds = NAN if time is None else _LONG.unpack_from(frame, time)[0] * NANOSECOND
        sample = not _ANY.isdisjoint(at)
        if sample:
            self._read_sample(frame, at, end, seconds, rows)
        fix = _GPS_PLACE in at or _GPS_VELOCITY in at
        if fix:
            self._read_fix(frame, layout, end, seconds, rows)
        return sample or fix

    def _read_sample(self, frame: bytes, at: Mapping[Field, int], end: int, time: float, rows: Rows) -> None:
        rate: Vector = UNKNOWN
        force: Vector = UNKNOWN
        magnetic: Vector = UNKNOWN
        temperature = pressure = NAN
        clipped = 0
        if _BOTH in at:
            values = _SIX.unpack_from(frame, at[_BOTH])
            force, rate = values[:3], values[3:]
        elif (place := _first(at, (_GYRO, *_RATES))) is not None:
            rate = _THREE.unpack_from(frame, place)
        if force is UNKNOWN and (place := _first(at, (_FORCE, *_FORCES))) is not None:
            force = _THREE.unpack_from(frame, place)
        if rate is UNKNOWN and force is UNKNOWN:
            rate, force = _divided(frame, at)
        if (place := _first(at, (_MAGNETIC, *_MAGNETICS))) is not None:
            x, y, z = _THREE.unpack_from(frame, place)
            magnetic = (x * GAUSS, y * GAUSS, z * GAUSS)
        if _MAGNETICS[0] in at:
            temperature, pressure = _TWO.unpack_from(frame, at[_MAGNETICS[0]] + 12)
        if _TEMPERATURE in at:
            (temperature,) = _FLOAT.unpack_from(frame, at[_TEMPERATURE])
        if _PRESSURE in at:
            (pressure,) = _FLOAT.unpack_from(frame, at[_PRESSURE])
        if _SATURATION in at:
            clipped = _clipped(_WORD.unpack_from(frame, at[_SATURATION])[0])
        rows.add_imu(end, time, -1, rate, force, magnetic, temperature, pressure * KILOPASCAL, clipped)

    def _read_fix(self, frame: bytes, layout: Layout, end: int, time: float, rows: Rows) -> None:
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
        latitude, longitude, height = _values(_PLACE, frame, at.get(_GPS_PLACE), UNKNOWN)
        north, east, down = _values(_THREE, frame, at.get((GPS, 9)), UNKNOWN)
        week = _first(at, _WEEK_TIMES)
        kind = FIX_3D if (GPS, 4) not in at else FIX_TYPES.get(frame[at[GPS, 4]], NO_FIX)
        rows.add_fix(
            end,
            time,
            NAN if week is None else _LONG.unpack_from(frame, week)[0] * NANOSECOND,
            _utc(frame, at.get((GPS, 0))),
            math.radians(latitude),
            math.radians(longitude),
            height,
            _values(_THREE, frame, at.get(_GPS_VELOCITY), UNKNOWN),
            math.sqrt((north * north + east * east) / 2),
            down,
            _values(_FLOAT, frame, at.get((GPS, 10)), (NAN,))[0],
            frame[at[GPS, 3]] if (GPS, 3) in at else -1,
            kind,
        )


def _first(at: Mapping[Field, int], fields: Sequence[Field]) -> int | None:
    """Return the place of the first field that is there."""
    for field in fields:
        if field in at:
            return at[field]
    return None


def _values(form: struct.Struct, frame: bytes, place: int | None, unknown: Vector) -> Vector:
    return unknown if place is None else form.unpack_from(frame, place)


def _divided(frame: bytes, at: Mapping[Field, int]) -> tuple[Vector, Vector]:
    """Return rates and forces of delta angle and delta velocity, which are integrals over an interval."""
    if _DELTAS in at:
        interval, *values = _SEVEN.unpack_from(frame, at[_DELTAS])
    else:
        interval, *values = _FOUR.unpack_from(frame, at[_DELTA_ANGLE])
        values += _values(_THREE, frame, at.get(_DELTA_VELOCITY), UNKNOWN)
    if not interval > 0:
        return UNKNOWN, UNKNOWN
    return [math.radians(value / interval) for value in values[:3]], [v / interval for v in values[3:]]


def _clipped(saturation: int) -> int:
    """Return the flags of `IMU` of the field SensSat: magnetometer, accelerometer, gyro from bit 0 on."""
    return (
        (saturation & 7) * CLIPPED_MAGNETIC
        | (saturation >> 3 & 7) * CLIPPED_FORCE
        | (saturation >> 6 & 7) * CLIPPED_RATE
    )


def _utc(frame: bytes, place: int | None) -> float:
    if place is None:
        return NAN
    year, month, day, hour, minute, second, millisecond = _UTC.unpack_from(frame, place)
    return utc_seconds(2000 + year, month, day, hour, minute, second + 1e-3 * millisecond)
