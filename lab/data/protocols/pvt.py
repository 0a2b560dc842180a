"""PVT: position, velocity and time as receivers of u-blox report them, in UBX and inside messages of Xsens.

References
----------
u-blox, *u-blox 8 / u-blox M8 Receiver Description Including Protocol Specification* (UBX-13003221), NAV-PVT.
Xsens, *MT Low-Level Communication Protocol Documentation* (MT0101P), GnssPvtData.
"""

from __future__ import annotations

import math
import struct
from datetime import UTC, datetime

import numpy as np

from lab.base.parameters.units import WEEK
from lab.data.protocols.device_time import utc_seconds
from lab.data.protocols.rows import LARGEST_HEIGHT, Rows
from lab.data.protocols.samples import (
    COMBINED,
    ESTIMATED,
    FIX_2D,
    FIX_3D,
    FIX_DIFFERENTIAL,
    FIX_RTK,
    FIX_RTK_FLOAT,
    NAN,
    NO_FIX,
    WARNED,
)
from lab.data.protocols.sending import sent_fix

_FIELDS = "IHBBBBBBIiBBBBiiiiIIiiiiiI"
"""Up to the accuracy of the speed."""
_VALID_TIME = 3
"""Bits of a valid date and a valid time of day."""
_ALL_VALID = 7  # the same, and its seconds resolved
_TIME_SIGMA = 20
"""Accuracy of the time that the encoder states [ns]."""
_FIX_TYPES = {1: ESTIMATED, 2: FIX_2D, 3: FIX_3D, 4: COMBINED}
"""Kinds of fixes of the receiver; 1 is dead reckoning alone, 4 is GNSS with it, 5 is time only."""
WORST = 10_000.0
"""Accuracy from which a position is none, whatever is said of its fix [m]: receivers without a fix state
thousands of km."""
_CARRIER = 6
"""First of two bits of the flags for a solution of the carrier: 1 float, 2 fixed."""
_WORST = round(1e3 * WORST)
"""[mm]."""
_POLE = 900_000_000
"""Largest latitude [1e-7 °]."""
_WEEK = round(1e3 * WEEK)
"""[ms]."""


class Pvt:
    """Reads and writes the message.

    Parameters
    ----------
    order
        Of the bytes: ``"<"`` in UBX, ``">"`` in messages of Xsens.
    """

    def __init__(self, order: str) -> None:
        self._form = struct.Struct(order + _FIELDS)

    @property
    def size(self) -> int:
        """Fewest bytes of a message."""
        return self._form.size

    def read(self, payload: bytes, time: float, end: int, rows: Rows) -> None:
        """Add the fix of a message of at least `size` bytes.

        Parameters
        ----------
        payload
            The message.
        time, end
            As of `lab.data.protocols.samples.FIX`.
        rows
            Takes the fix.
        """
        (
            week_time, year, month, day, hour, minute, second, valid, _, nano, kind, flags, _, satellites,
            longitude, latitude, height, _, level, vertical, north, east, down, _, _, speed_sigma,
        ) = self._order_fields(self._form.unpack_from(payload))  # fmt: skip
        utc = utc_seconds(year, month, day, hour, minute, second + 1e-9 * nano)
        utc = utc if valid & _VALID_TIME == _VALID_TIME else NAN
        metres = 1e-3 * height if abs(1e-3 * height) <= LARGEST_HEIGHT else NAN
        place = math.radians(1e-7 * latitude), math.radians(1e-7 * longitude), metres
        velocity = 1e-3 * north, 1e-3 * east, 1e-3 * down
        sigma = 1e-3 * level, 1e-3 * vertical, 1e-3 * speed_sigma
        kind = fix_type(kind, flags) if level <= _WORST and abs(latitude) <= _POLE else NO_FIX
        rows.add_fix(end, time, 1e-3 * week_time, utc, place, velocity, sigma, satellites, kind)

    def written(self, row: np.void) -> bytes:
        """Return the message of a fix, without what follows the accuracy of the speed."""
        fix = sent_fix(row)
        dated = math.isfinite(fix.utc)
        second = math.floor(fix.utc) if dated else 0
        day = datetime.fromtimestamp(second, UTC)
        flags = int(fix.kind > NO_FIX) | int(fix.kind >= FIX_DIFFERENTIAL) << 1
        flags |= {FIX_RTK_FLOAT: 1, FIX_RTK: 2}.get(fix.kind, 0) << _CARRIER
        nano = round((fix.utc - second) * 1e9) if dated else 0
        kind = 0 if fix.kind <= NO_FIX else 2 if fix.kind == FIX_2D else 3
        height = round(1e3 * fix.height)
        north, east, down = (round(1e3 * speed) for speed in fix.velocity_n)
        values = (
            round(1e3 * fix.week_time) % _WEEK, day.year, day.month, day.day, day.hour, day.minute,
            day.second, _ALL_VALID if dated else 0, _TIME_SIGMA, nano, kind, flags, 0, fix.satellites,
            round(1e7 * fix.longitude), round(1e7 * fix.latitude), height, height,
            round(1e3 * fix.horizontal_sigma), round(1e3 * fix.vertical_sigma), north, east, down,
            round(1e3 * fix.speed), round(1e5 * fix.course), round(1e3 * fix.speed_sigma),
        )  # fmt: skip
        return self._form.pack(*self._order_fields(values))

    def _order_fields(self, values: tuple[int, ...]) -> tuple[int, ...]:
        """Return the fields with flags and satellites where UBX has them, or back."""
        if self._form.format.startswith("<"):
            return values
        # Xsens has one byte of flags, then the satellites, then a reserved byte.
        return (*values[:12], values[13], values[12], *values[14:])


def fix_type(kind: int, flags: int) -> int:
    """Return the kind of a fix, a ``fix_type`` of `lab.data.protocols.samples.FIX`.

    Parameters
    ----------
    kind
        Number of the receiver: 1 dead reckoning, 2 and 3 dimensions, 4 both.
    flags
        The lowest bit for a valid fix, the next one for corrections, and two bits of a carrier's solution.
    """
    found = _FIX_TYPES.get(kind, NO_FIX)
    if not flags & 1 and found > NO_FIX:
        return WARNED
    carrier = flags >> _CARRIER
    if found != FIX_3D or not flags & (2 | 3 << _CARRIER):
        return found
    return FIX_DIFFERENTIAL if not carrier else FIX_RTK if carrier == 2 else FIX_RTK_FLOAT
