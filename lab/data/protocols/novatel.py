"""NovAtel OEM and SPAN: raw data of the IMU, positions and velocities, in ASCII and in binary.

RAWIMU has counts of increments, whose unit depends on the IMU: RAWIMUX names it; of RAWIMU alone it is the
one whose increments show about 1 g, where that is one only. Increments are divided by the interval between
samples, so the first gives none; after a gap it is the usual interval. Axes are those of the IMU, as the
receiver sends them: on most of them z points up. BESTPOS and the BESTVEL of the same time make a fix. INSPVA
is the device's own solution, which holds the IMU already: it makes fixes only until a BESTPOS is seen. The
time is that of GPS, counted from 1980.

References
----------
NovAtel, *OEM7 Commands and Logs Reference Manual*: message headers, 32-bit CRC, BESTPOS, BESTVEL, INSPVA,
RAWIMUSX with the scale factors of IMUs.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from collections import deque
from typing import NamedTuple

import numpy as np

from lab.base.parameters.units import DEGREE, FOOT, STANDARD_GRAVITY, TO_SI, WEEK
from lab.data.protocols.framing import MORE, NONE, Framing
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import (
    FIX_3D,
    FIX_DIFFERENTIAL,
    FIX_RTK,
    FIX_RTK_FLOAT,
    NAN,
    NO_FIX,
    UNKNOWN,
    Vector,
)
from lab.data.protocols.sending import (
    MOST_SATELLITES,
    FrameEncoder,
    known_fields,
    round_to_bits,
    sent_fix,
    vector,
)

_LONG, _SHORT = b"\xaaD\x12", b"\xaaD\x13"
"""Sync of binary messages."""
_LONG_HEAD, _SHORT_HEAD, _CHECK = 28, 12, 4
"""Bytes of a header, and of the check."""
_LONG_HEADER = struct.Struct("<3sBHBBHHBBHIIHH")
_LINE = re.compile(rb"[#%]([A-Z0-9_]{2,24})A,([^*;]{1,160});([^*]{1,800})\*([0-9a-fA-F]{8})\r?\n")
_KNOWN = 10
"""Bytes of a message by which its size is known, with either header."""
_LONG_CELLS = 5  # of a long header, up to the week
_LONGEST_LINE = 1024  # bytes; messages that are read have 300


class _Form(NamedTuple):
    """A message: its numbers in binary, with long and short header, its leading fields and their number."""

    numbers: tuple[int, ...]
    fields: struct.Struct
    cells: int


_MESSAGES = {
    "BESTPOS": _Form((42, 1429), struct.Struct("<2I3dfI3f4s2f2B"), 15),
    "BESTVEL": _Form((99, 1430), struct.Struct("<2I2f3d"), 7),
    "INSPVA": _Form((507, 508), struct.Struct("<Id9dI"), 12),
    "RAWIMU": _Form((268, 325), struct.Struct("<IdI6i"), 9),
    "RAWIMUX": _Form((1461, 1462), struct.Struct("<2BHdI6i"), 11),
}
"""Messages that are read, by their names without the S of a short header."""
_NAMES = {name: name for name in _MESSAGES} | {
    "BESTGNSSPOS": "BESTPOS", "BESTGNSSVEL": "BESTVEL", "INSPVAS": "INSPVA", "RAWIMUS": "RAWIMU",
    "RAWIMUSX": "RAWIMUX",
}  # fmt: skip
_NUMBERS = {number: name for name, form in _MESSAGES.items() for number in form.numbers}
_SOLUTIONS = {"SOL_COMPUTED": 0, "INS_SOLUTION_GOOD": 3, "INS_SOLUTION_FREE": 6, "INS_ALIGNMENT_COMPLETE": 7}
"""States of a solution that is one."""
_TYPES = {
    "NONE": 0, "PSRDIFF": 17, "WAAS": 18, "SBAS": 18, "L1_FLOAT": 32, "NARROW_FLOAT": 34, "L1_INT": 48,
    "WIDE_INT": 49, "NARROW_INT": 50, "INS_SBAS": 52, "INS_PSRDIFF": 54, "INS_RTKFLOAT": 55,
    "INS_RTKFIXED": 56, "PPP_CONVERGING": 68, "PPP": 69,
}  # fmt: skip
"""Types of positions; others are positions without corrections."""
_KINDS: dict[float, int] = {
    0: NO_FIX, **dict.fromkeys((17, 18, 52, 54, 68, 69), FIX_DIFFERENTIAL),
    **dict.fromkeys((32, 34, 55), FIX_RTK_FLOAT), **dict.fromkeys((48, 49, 50, 56), FIX_RTK),
}  # fmt: skip
"""Kinds of fixes, by the type of a position."""

# Increments of one count of angle [rad] and velocity [m/s], by the maker of the IMU.
_HG1700 = (2.0**-33, 2.0**-27 * FOOT)  # Honeywell
_HG4930 = (2.0**-33, 2.0**-29)  # Honeywell
_ADIS16488 = (720 * DEGREE / 2**31, 200 / 2**31)  # Analog Devices
_STIM300 = (DEGREE / 2**21, 2.0**-22)  # Sensonor
_KVH = (0.1 / (3600 * 256), 0.05 / 2**15)  # KVH 1750 and CNS-5000
_NANO = (1e-9, 2e-8)  # ISA-100C and Litef µIMU
_SCALES: dict[float, tuple[float, float]] = {
    **dict.fromkeys((1, 5, 11, 20, 27, 28), _HG1700), **dict.fromkeys((4, 12), (2.0**-33, 2.0**-26 * FOOT)),
    13: (0.1 / 2**8 / 3600 * DEGREE, 0.05 / 2**15), **dict.fromkeys((16, 33), _KVH),
    **dict.fromkeys((26, 52), _NANO), 31: _ADIS16488, **dict.fromkeys((32, 56), _STIM300),
    **dict.fromkeys((58, 68, 69), _HG4930), 8: (2.0**-19, 2.0**-14),
}  # fmt: skip
"""Increments of one count [rad], [m/s], by the type of the IMU."""
_EPSON_G320 = (0.008 * DEGREE / 2**16, 0.2 * TO_SI["mg"] / 2**16)  # Epson
_RATES: dict[float, tuple[float, float]] = {
    41: _EPSON_G320, 62: _EPSON_G320, 61: (0.0151515 * DEGREE / 2**16, 0.4 * TO_SI["mg"] / 2**16),
}  # fmt: skip
"""Rates and forces of one count [rad/s], [m/s²], of IMUs that send no increments, by their type."""
_ADIS = 31
"""Type of the IMU that the encoder sends."""
_WEEKS = 2**16
"""Weeks that a header has room for."""
_LOOKED_AT = 8
"""Samples whose median shows 1 g."""
_ONE_G = (0.92, 1.08)
"""Specific force by which an increment counts as 1 g [g]: the nearest units differ by 22 %."""
_GAP = 1.5
"""Interval between samples, in usual ones, from which samples are missing."""


class NovAtel(Framing):
    """Framing of all four kinds of messages, with a CRC of 32 bits."""

    first = b"\xaa#%"
    longest = 4096

    def __init__(self) -> None:
        self._last = self._interval = NAN
        self._scale: tuple[float, float] | None = None
        self._rates: tuple[float, float] | None = None
        self._sizes: deque[float] = deque(maxlen=_LOOKED_AT)
        self._place: tuple[float, list[float], int] | None = None  # that waits: time, BESTPOS, end
        self._velocity: tuple[float, Vector] = NAN, UNKNOWN
        self._has_places = self._has_velocities = False

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the message that begins at a place, `MORE` or `NONE`."""
        if data[at] != _LONG[0]:
            if not data[at + 1 : at + 2].decode("latin-1").isupper():
                return NONE if len(data) - at > 1 else MORE
            end = data.find(b"\n", at, at + _LONGEST_LINE)
            return end + 1 - at if end >= 0 else MORE if len(data) - at < _LONGEST_LINE else NONE
        head = data[at : at + _KNOWN]
        if not head.startswith((_LONG, _SHORT)):
            return MORE if _LONG.startswith(head) or _SHORT.startswith(head) else NONE
        if len(head) < _KNOWN:
            return MORE
        long = head.startswith(_LONG)
        # A long header has its own length in byte 3, and the message's in bytes 8 and 9; a short one has the
        # message's in byte 3.
        size = head[3] + (head[8] | head[9] << 8) + _CHECK if long else _SHORT_HEAD + head[3] + _CHECK
        return NONE if size > self.longest or (long and head[3] < _LONG_HEAD) else size

    def passes(self, frame: bytes) -> bool:
        """Return whether the CRC is the one said."""
        if frame[0] == _LONG[0]:
            return _crc(frame[:-_CHECK]) == int.from_bytes(frame[-_CHECK:], "little")
        found = _LINE.fullmatch(frame)
        return found is not None and _crc(frame[1 : found.start(4) - 1]) == int(found[4], 16)

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample or the fix of a message; return whether it is one that is read."""
        name, time, values = _binary(frame) if frame[0] == _LONG[0] else _line(frame)
        if not values:
            return False
        if name.startswith("RAWIMU"):
            return self._read_sample(values, end, rows)
        if name == "INSPVA":
            return self._read_solution(values, end, rows)
        if name == "BESTVEL":
            self._has_velocities = True
            course, speed = math.radians(values[5]), values[4] if values[0] == 0 else NAN
            self._velocity = time, (speed * math.cos(course), speed * math.sin(course), -values[6])
        else:
            self.finish(rows)
            self._has_places = True
            self._place = time, values, end
        if not self._has_velocities or (self._place is not None and self._place[0] == self._velocity[0]):
            self.finish(rows)
        return True

    def finish(self, rows: Rows) -> None:
        """Add a position that waits for its velocity."""
        if self._place is None:
            return
        time, values, end = self._place
        solved, kind, latitude, longitude, height, undulation, _, north, east, up, _, _, _, _, used = values
        # A height above the sea and the undulation make one above the ellipsoid.
        place = math.radians(latitude), math.radians(longitude), height + undulation
        velocity = self._velocity[1] if self._velocity[0] == time else UNKNOWN
        sigma = math.sqrt((north * north + east * east) / 2), up, NAN
        count = int(used) if 0 <= used <= MOST_SATELLITES else -1
        fix_type = _KINDS.get(kind, FIX_3D) if solved == 0 else NO_FIX
        rows.add_fix(end, time, time % WEEK, NAN, place, velocity, sigma, count, fix_type)
        self._place = None

    def _read_solution(self, values: list[float], end: int, rows: Rows) -> bool:
        if self._has_places:
            return False
        week, seconds, latitude, longitude, height, north, east, up, _, _, _, state = values
        place = math.radians(latitude), math.radians(longitude), height
        kind = FIX_3D if state in _SOLUTIONS.values() and state > 0 else NO_FIX
        time, week_time = _time(week, seconds), _time(0, seconds)
        rows.add_fix(end, time, week_time, NAN, place, (north, east, -up), fix_type=kind)
        return True

    def _read_sample(self, values: list[float], end: int, rows: Rows) -> bool:
        if len(values) == _MESSAGES["RAWIMUX"].cells:
            self._scale, self._rates = _SCALES.get(values[1]), _RATES.get(values[1])
            values = values[2:]
        week, seconds, _, *counts = values
        time = _time(week, seconds)
        interval, self._last = time - self._last, time
        if not interval > 0:
            return True
        if not interval > _GAP * self._interval:  # also for the first one
            self._interval = interval
        # Forces before rates, each as z, −y, x.
        z, y, x = counts[:3]
        if self._scale is None and self._rates is None:
            self._look(math.hypot(x, y, z) / self._interval)
        if self._scale is not None or self._rates is not None:
            turn, push = self._rates or (unit / self._interval for unit in self._scale or ())
            rate = (counts[5] * turn, -counts[4] * turn, counts[3] * turn)
            rows.add_imu(end, time, -1, rate, (x * push, -y * push, z * push))
        return True

    def _look(self, size: float) -> None:
        """Find out the IMU from the size of its increments [counts/s] at rest."""
        self._sizes.append(size)
        if len(self._sizes) < _LOOKED_AT:
            return
        force = float(np.median(self._sizes)) / STANDARD_GRAVITY
        found = {scale for scale in _SCALES.values() if _ONE_G[0] < force * scale[1] < _ONE_G[1]}
        if len(found) == 1:
            (self._scale,) = found


def _crc(data: bytes) -> int:
    """Return the CRC of polynomial 0x04C11DB7, reflected, started with 0 and not inverted."""
    # zlib inverts before and after: both are undone.
    return zlib.crc32(data, 0xFFFF_FFFF) ^ 0xFFFF_FFFF


def _binary(frame: bytes) -> tuple[str, float, list[float]]:
    """Return name, time of GPS [s] and values of a binary message; none of one that is not read."""
    long = frame.startswith(_LONG)
    # The number is at 4; the week at 14 of a long header, and at 6 of a short one.
    number, week, milliseconds = struct.unpack_from("<H8xHI" if long else "<HHI", frame, 4)
    name = _NUMBERS.get(number, "")
    begin = frame[3] if long else _SHORT_HEAD
    if not name or len(frame) - begin - _CHECK < _MESSAGES[name].fields.size:
        return "", NAN, []
    values = _MESSAGES[name].fields.unpack_from(frame, begin)
    finite = [NAN if isinstance(one, bytes) or not math.isfinite(one) else one for one in values]
    return name, _time(week, 1e-3 * milliseconds), finite


def _line(frame: bytes) -> tuple[str, float, list[float]]:
    """Return the same of a line."""
    found = _LINE.fullmatch(frame)
    assert found is not None  # it has passed its check
    name = _NAMES.get(found[1].decode(), "")
    head, cells = (part.decode("latin-1").split(",") for part in found.group(2, 3))
    count = _MESSAGES[name].cells if name else math.inf
    if len(cells) < count or len(head) < 2:
        return "", NAN, []
    # Port, sequence, idle time and the state of the clock stand before the week of a long header.
    place = _LONG_CELLS - 1 if frame[:1] == b"#" and len(head) > _LONG_CELLS else 0
    time = _time(_number(head[place]), _number(head[place + 1]))
    return name, time, [_number(cell) for cell in cells[: int(count)]]


def _number(cell: str) -> float:
    code = _SOLUTIONS.get(cell, _TYPES.get(cell))
    if code is not None:
        return code
    try:
        value = float(cell)
    except ValueError:
        return NAN
    return value if math.isfinite(value) else NAN


def _time(week: float, seconds: float) -> float:
    """Return the time of GPS [s]; NaN for what is no week, or no time in it."""
    return week * WEEK + seconds if 0 <= week < _WEEKS and 0 <= seconds <= WEEK else NAN


class NovAtelEncoder(FrameEncoder):
    """Writes samples in RAWIMUSX, and fixes in BESTPOS and BESTVEL; NaN is sent as zero."""

    name = "novatel"

    def __init__(self) -> None:
        self._last = NAN

    def _sample(self, row: np.void) -> bytes:
        time = float(row["time"])
        interval, self._last = time - self._last, time
        turn, push = (unit / interval if interval > 0 else math.inf for unit in _SCALES[_ADIS])
        (gx, gy, gz), (ax, ay, az) = vector(row, "rate", turn), vector(row, "force", push)
        counts = (round_to_bits(one, 32) for one in (az, -ay, ax, gz, -gy, gx))
        week, seconds = divmod(time, WEEK)
        body = _MESSAGES["RAWIMUX"].fields.pack(0, _ADIS, int(week), seconds, 0, *counts)
        head = struct.pack("<BHHI", len(body), 1462, int(week), round(1e3 * seconds))
        return _append_crc(_SHORT + head + body)

    def _fix(self, row: np.void) -> bytes:
        fix = sent_fix(row)
        kind = next((number for number, one in _KINDS.items() if one == fix.kind), 16)
        state, kind = (0, int(kind)) if fix.kind > NO_FIX else (1, 0)
        week, seconds = divmod(max(known_fields(row, "time")[0], 0.0), WEEK)
        # 61 is the datum WGS 84.
        place = (fix.latitude, fix.longitude, fix.height, 0.0, 61)
        sigma = (fix.horizontal_sigma, fix.horizontal_sigma, fix.vertical_sigma)
        bodies = {
            42: _MESSAGES["BESTPOS"].fields.pack(
                state, kind, *place, *sigma, b"", 0.0, 0.0, fix.satellites, fix.satellites
            ).ljust(72, b"\0"),
            99: _MESSAGES["BESTVEL"].fields.pack(
                state, kind, 0.0, 0.0, fix.speed, fix.course, -fix.velocity_n[2]
            ).ljust(44, b"\0"),
        }  # fmt: skip
        frames, stamp = b"", (int(week), round(1e3 * seconds))
        for number, body in bodies.items():
            size = len(body)
            # From the port COM1 (32), with a clock that is steered (180).
            head = _LONG_HEADER.pack(_LONG, _LONG_HEAD, number, 0, 32, size, 0, 0, 180, *stamp, 0, 0, 0)
            frames += _append_crc(head + body)
        return frames


def _append_crc(message: bytes) -> bytes:
    return message + _crc(message).to_bytes(_CHECK, "little")
