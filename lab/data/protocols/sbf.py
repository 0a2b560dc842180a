"""Septentrio SBF: positions and velocities of a receiver, in geodetic or Cartesian form, and its IMU.

PVTGeodetic makes a fix; PVTCartesian makes one until a PVTGeodetic is seen. HAccuracy is twice the rms of the
horizontal distance and VAccuracy twice σ of the height, in cm. The time is that of GPS, counted from 1980.
ExtSensorMeas makes a sample of the IMU, of the accelerations [m/s²], rates [°/s] and temperature in its sets.
Other blocks, among them those of attitudes, are not read. ExtSensorMeas is built from its published layout;
no capture of it with known values was at hand.

References
----------
Septentrio, *mosaic-X5 Reference Guide*: SBF outline, PVTGeodetic (4007), PVTCartesian (4006).
Septentrio, *AsteRx-i3 Reference Guide*: ExtSensorMeas (4050).
"""

from __future__ import annotations

import math
import struct

import numpy as np

from lab.base.parameters.units import DEGREE, WEEK
from lab.data.protocols.framing import MORE, NONE, Framing, crc16_xmodem
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
from lab.data.protocols.sending import FrameEncoder, sent_fix
from lab.motion.frames import ecef

SYNC = b"$@"
_HEAD, _STEP = 8, 4  # bytes of a header, and of which the length of a block is a multiple
_GEODETIC, _CARTESIAN, _SENSORS = 4007, 4006, 4050  # numbers of blocks
_NUMBER = 0x1FFF  # bits of a number; the others are the revision
_PVT = struct.Struct("<IH2B3d5fdf4B2HI")
_SETS = struct.Struct("<IH2B")
_SET = struct.Struct("<2x2B3d")
_TEMPERATURE = struct.Struct("<4xf")
_FORCE, _RATE, _INFO = 0, 1, 3
"""Types of a set of measurements: acceleration, angular rate, temperature of the sensor."""
_QUALITY = struct.Struct("<2BH3HB")
_UNKNOWN = -2e10
"""What stands for a number that is not known, exact in four bytes, too."""
_NO_TIME, _NO_WEEK, _NO_COUNT, _NO_ACCURACY = 2**32 - 1, 2**16 - 1, 2**8 - 1, 2**16 - 1
"""What stands for a time, a week, a number of satellites and an accuracy that are not known."""
_MILLISECOND, _CENTIMETRE = 1e-3, 1e-2
"""Units of times [s] and of accuracies [m]."""
_TWO_SIGMA = 2.0
"""σ in an accuracy."""
_MODE, _IS_2D = 0x0F, 0x80  # bits of the kind of a solution, and of one without a height
_KINDS = {
    1: FIX_3D, 2: FIX_DIFFERENTIAL, 3: FIX_3D, 4: FIX_RTK, 5: FIX_RTK_FLOAT, 6: FIX_DIFFERENTIAL, 7: FIX_RTK,
    8: FIX_RTK_FLOAT, 10: FIX_DIFFERENTIAL,
}  # fmt: skip
"""Kinds of fixes, by the kind of a solution."""


class Sbf(Framing):
    """Framing of blocks, with a CRC of 16 bits."""

    first = SYNC[:1]
    longest = 8192

    def __init__(self) -> None:
        self._is_geodetic = False

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the block that begins at a place, `MORE` or `NONE`."""
        head = data[at : at + _HEAD]
        if not head.startswith(SYNC[: len(head)]):
            return NONE
        if len(head) < _HEAD:
            return MORE
        size = head[6] | head[7] << 8
        return size if _HEAD <= size <= self.longest and size % _STEP == 0 else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether the CRC is the one said."""
        # From the number of the block on: the sync bytes and the CRC itself stand before.
        return crc16_xmodem(frame[_STEP:]) == frame[2] | frame[3] << 8

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the fix or the sample of a block; return whether it is one that is read."""
        number = (frame[4] | frame[5] << 8) & _NUMBER
        if number == _SENSORS and len(frame) >= _HEAD + _SETS.size:
            return _read_sensors(frame, end, rows)
        if number not in {_GEODETIC, _CARTESIAN} or len(frame) < _HEAD + _PVT.size:
            return False
        self._is_geodetic |= number == _GEODETIC
        if number == _CARTESIAN and self._is_geodetic:
            return True
        stamp, week, mode, error, *numbers = _PVT.unpack_from(frame, _HEAD)
        # Number 3 is the undulation, 7 the course; of the four bytes behind the clock, 12 counts satellites.
        place, velocity = (
            [_known_value(one) for one in numbers[:3]],
            [_known_value(one) for one in numbers[4:7]],
        )
        # The block has up; a Cartesian velocity is resolved in n below.
        velocity_n: Vector = (velocity[0], velocity[1], -velocity[2])
        if number == _CARTESIAN and all(map(math.isfinite, place)):
            place = ecef.geodetic(np.array([place]))[0].tolist()
            axes = ecef.axes(np.array(place[:1]), np.array(place[1:2]))[0]
            velocity_n = (np.array(velocity) @ axes).tolist()
        kind = _KINDS.get(mode & _MODE, NO_FIX) if error == 0 else NO_FIX
        time, week_time = _times(stamp, week)
        satellites = numbers[12] if numbers[12] != _NO_COUNT else -1
        sigma: Vector = UNKNOWN
        if len(frame) >= _HEAD + _PVT.size + _QUALITY.size:
            *_, h_accuracy, v_accuracy, _ = _QUALITY.unpack_from(frame, _HEAD + _PVT.size)
            # The rms of a horizontal distance is √2 σ of each axis.
            sigma = _accuracy(h_accuracy) / math.sqrt(2), _accuracy(v_accuracy), NAN
        kind = FIX_2D if kind != NO_FIX and mode & _IS_2D else kind
        rows.add_fix(end, time, week_time, NAN, place, velocity_n, sigma, satellites, kind)
        return True


def _times(stamp: int, week: int) -> tuple[float, float]:
    """Return the time since 1980 and that of the week [s]; NaN if it is not known."""
    week_time = stamp * _MILLISECOND if stamp != _NO_TIME else NAN
    return week * WEEK + week_time if week != _NO_WEEK else NAN, week_time


def _read_sensors(frame: bytes, end: int, rows: Rows) -> bool:
    """Add the sample of an ExtSensorMeas; return whether it has measurements of an IMU."""
    stamp, week, count, size = _SETS.unpack_from(frame, _HEAD)
    found: dict[int, Vector] = {}
    temperature = NAN
    # A size of zero, which cannot be a step, ends the loop at its first set.
    for at in range(_HEAD + _SETS.size, _HEAD + _SETS.size + count * size, size or 1):
        if size < _SET.size or at + size > len(frame):
            break
        kind, _, *values = _SET.unpack_from(frame, at)
        if kind == _INFO:
            temperature = _known_value(_TEMPERATURE.unpack_from(frame, at)[0])
        found[kind] = [_known_value(one) for one in values]
    rate = [one * DEGREE for one in found.get(_RATE, UNKNOWN)]
    if not {_RATE, _FORCE} & set(found):
        return False
    rows.add_imu(
        end, _times(stamp, week)[0], rate=rate, force=found.get(_FORCE, UNKNOWN), temperature=temperature
    )
    return True


def _known_value(value: float) -> float:
    return value if math.isfinite(value) and value != _UNKNOWN else NAN


def _accuracy(count: int) -> float:
    """Return σ [m]; NaN for an accuracy that is not known."""
    return count * _CENTIMETRE / _TWO_SIGMA if count != _NO_ACCURACY else NAN


class SbfEncoder(FrameEncoder):
    """Writes fixes as PVTGeodetic; what is not known is sent as the protocol says. It has no samples."""

    name = "septentrio"

    def _fix(self, row: np.void) -> bytes:
        fix = sent_fix(row)
        modes = {kind: mode for mode, kind in reversed(_KINDS.items())}
        mode = modes.get(fix.kind, 0 if fix.kind <= NO_FIX else 1) | (_IS_2D if fix.kind == FIX_2D else 0)
        week, seconds = divmod(float(row["time"]), WEEK) if math.isfinite(row["time"]) else (0.0, 0.0)
        place = [row[name] for name in ("latitude", "longitude", "height")]
        numbers = [
            float(one) if math.isfinite(one) else _UNKNOWN for one in (*place, 0.0, *row["velocity_n"])
        ]
        if numbers[-1] != _UNKNOWN:
            numbers[-1] = -numbers[-1]
        body = _PVT.pack(
            round(seconds / _MILLISECOND), int(week) % _NO_WEEK, mode, 0 if mode else 1, *numbers, _UNKNOWN,
            0.0, 0.0, 0, 0, fix.satellites, 0, 0, 0, 0,
        )  # fmt: skip
        horizontal, vertical = (
            min(round(_TWO_SIGMA * one / _CENTIMETRE), _NO_ACCURACY - 1) if one > 0 else _NO_ACCURACY
            for one in (fix.horizontal_sigma * math.sqrt(2), fix.vertical_sigma)
        )
        body += _QUALITY.pack(0, 0, 0, 0, horizontal, vertical, 0)
        size = -(-(_HEAD + len(body)) // _STEP) * _STEP
        # The three bits above the number are the revision.
        rest = struct.pack("<2H", _GEODETIC | 2 << 13, size) + body.ljust(size - _HEAD, b"\0")
        return SYNC + crc16_xmodem(rest).to_bytes(2, "little") + rest
