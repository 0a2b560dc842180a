"""VectorNav ASCII messages: ``$VNYMR``, ``$VNQMR``, ``$VNMAR``, ``$VNIMU``, ``$VNDTV``, ``$VNGPS``.

The check is two hexadecimal digits of an exclusive or, or four of a CRC. A message that asks to be taken
without (``*XX``) is not taken. Delta angle [°] and delta velocity of ``$VNDTV`` are divided by their own
interval.

References
----------
VectorNav, *VN-100 User Manual* UM001 and *VN-200 User Manual* UM004, "Asynchronous output".
"""

from __future__ import annotations

import math
import re

from lab.base.parameters.units import GAUSS
from lab.data.protocols.framing import MORE, NONE, Framing, crc16_xmodem, xor8
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import NAN, NO_FIX
from lab.data.protocols.vectornav_binary import FIX_TYPES, KILOPASCAL

_START = b"$VN"
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
        head = data[at : at + len(_START)]
        if not _START.startswith(head) and head != _START:
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
            at = _CELLS[kind] - 9 if kind != "IMU" else 0
            x, y, z = cells[at : at + 3]
            rows.add_imu(
                end,
                force=cells[at + 3 : at + 6],
                rate=cells[at + 6 : at + 9],
                magnetic=(x * GAUSS, y * GAUSS, z * GAUSS),
                temperature=cells[9] if kind == "IMU" else NAN,
                pressure=cells[10] * KILOPASCAL if kind == "IMU" else NAN,
            )
        return True


def _add_fix(cells: list[float], end: int, rows: Rows) -> None:
    week_time, _, kind, satellites, latitude, longitude, height = cells[:7]
    north, east, down, speed_sigma = cells[10:14]
    rows.add_fix(
        end,
        week_time=week_time,
        latitude=math.radians(latitude),
        longitude=math.radians(longitude),
        height=height,
        velocity_n=cells[7:10],
        horizontal_sigma=math.sqrt((north * north + east * east) / 2),
        vertical_sigma=down,
        speed_sigma=speed_sigma,
        satellites=int(satellites),
        fix_type=FIX_TYPES.get(int(kind), NO_FIX),
    )
