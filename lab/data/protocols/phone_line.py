"""Phone line: what a phone sent in one batch, as a line of JSON with a checksum.

The values are those of the phone, in its units and with its signs, so that a recording can be read anew with
a sign corrected. The checksum finds damage to a recording.
"""

from __future__ import annotations

import json
import math
import zlib
from dataclasses import dataclass, field
from typing import Any, Final

from lab.data.protocols.json_rows import number, parse_json, read_rows

HEAD: Final = b'{"phone":1,"check":"'
"""How a line begins; 8 hexadecimal digits of the CRC-32 of what follows them come next."""
_CHECK: Final = len(HEAD) + 8
"""Bytes up to the end of the check."""
LONGEST: Final = 2**16
"""Longest line [bytes]."""
MOST_SAMPLES: Final = 200
"""Most rows of each kind in a line: 20 s at 10 Hz, 2 s at 100 Hz. A batch of the page has about 6."""
MOST_FIXES: Final = 20
"""Most fixes in a line."""
DEGREES: Final = "deg/s"
RADIANS: Final = "rad/s"
_WIDTHS: Final = {"imu": 7, "rate": 4, "force": 4, "magnetic": 4, "attitude": 5, "fix": 12}
"""Numbers in a row of each kind: its time and its values."""
_UNIT_TOLERANCE: Final = 0.1
"""Most that the length of the direction up may differ from 1; it is made of rounded angles."""

Row = list[float]


@dataclass
class PhoneLine:
    """A batch of one phone; times in seconds after `origin`.

    Attributes
    ----------
    number : int
        Of the batch in its run, from 0.
    origin : float
        Time of the phone's clock since 1970 at which its other times are 0 [s].
    first : int
        Number of the first row of `imu` in its run; -1 if the samples are not counted.
    source : str
        What sent it, a short word.
    apple : bool
        Whether the phone is one of Apple's, which usually negate the acceleration.
    unit : str
        Of angular rates, `DEGREES` or `RADIANS`.
    up : list of 3 floats or None
        Direction away from the Earth in device axes, by the attitude that the phone itself estimates.
    imu : list of rows
        Time [s], angular rate x, y, z [unit], acceleration including gravity x, y, z [m/s²]; NaN is unknown.
    rate, force, magnetic : list of rows
        Time [s] and x, y, z, of devices that send each sensor by itself; the magnetic field in tesla.
    attitude : list of rows
        Time [s], and the attitude that the phone itself estimates: a quaternion, scalar first, whose rotation
        takes device axes to east, north and up. Its north may be any direction.
    fix : list of rows
        Time [s], time since 1970 [s], latitude, longitude [°], height [m], horizontal and vertical σ [m],
        velocity north, east, down [m/s], σ of the speed [m/s], 1 if the height is above the sea.
    """

    number: int
    origin: float = 0.0
    first: int = -1
    source: str = "page"
    apple: bool = False
    unit: str = DEGREES
    up: Row | None = None
    imu: list[Row] = field(default_factory=list)
    rate: list[Row] = field(default_factory=list)
    force: list[Row] = field(default_factory=list)
    magnetic: list[Row] = field(default_factory=list)
    attitude: list[Row] = field(default_factory=list)
    fix: list[Row] = field(default_factory=list)

    @property
    def samples(self) -> int:
        """Number of samples of the IMU: of angular rate where the sensors come by themselves."""
        return len(self.imu) or len(self.rate)

    def written(self) -> bytes:
        """Return the line, with its end."""
        said: dict[str, Any] = {
            "number": self.number, "origin": round(self.origin, 6), "first": self.first,
            "source": self.source, "apple": self.apple, "unit": self.unit,
        }  # fmt: skip
        if self.up is not None:
            said["up"] = self.up
        for name in _WIDTHS:
            rows: list[Row] = getattr(self, name)
            if rows:
                said[name] = [[None if math.isnan(one) else one for one in row] for row in rows]
        body = b'",' + json.dumps(said, separators=(",", ":"), allow_nan=False).encode()[1:]
        return HEAD + b"%08x" % zlib.crc32(body) + body + b"\n"


def has_valid_checksum(line: bytes) -> bool:
    """Return whether a line, with its end, has the checksum that it states."""
    return line[len(HEAD) : _CHECK] == b"%08x" % zlib.crc32(line[_CHECK:-1])


def parse_line(line: bytes) -> PhoneLine | None:
    """Return the batch of a line, or None if it holds anything else than one."""
    said = parse_json(line)
    return None if not isinstance(said, dict) else _parse_batch(said)


def direction(value: Any) -> Row | None:
    """Return a direction of length 1 out of JSON; None if it is none."""
    if type(value) is not list or len(value) != 3:
        return None
    numbers = [number(one) for one in value]
    return numbers if abs(math.hypot(*numbers) - 1) < _UNIT_TOLERANCE else None


def _parse_batch(said: dict[str, Any]) -> PhoneLine | None:
    source, unit, origin = said.get("source"), said.get("unit"), number(said.get("origin"))
    if not isinstance(source, str) or unit not in {DEGREES, RADIANS} or math.isnan(origin):
        return None
    rows = {}
    for name, width in _WIDTHS.items():
        found = read_rows(said.get(name), width, MOST_FIXES if name == "fix" else MOST_SAMPLES)
        if found is None:
            return None
        rows[name] = found
    return PhoneLine(
        parse_whole_number(said.get("number")), origin, parse_whole_number(said.get("first")), source,
        said.get("apple") is True, unit, direction(said.get("up")), **rows,
    )  # fmt: skip


def parse_whole_number(value: Any) -> int:
    """Return a whole number from 0 to 2**53 out of JSON; -1 if it is none."""
    return value if type(value) is int and 0 <= value <= 2**53 else -1
