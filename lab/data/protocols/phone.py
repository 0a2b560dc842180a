"""Phone: lines of JSON with the batches of a phone; see `lab.data.protocols.phone_line`.

Axes are those of the device: x to the right of the screen, y up the screen, z out of it. Browsers on Apple's
phones negate the acceleration including gravity. The sign is found by gravity: the phone also sends which
direction its own attitude calls up, and at rest the specific force points up.

References
----------
W3C, *Device Orientation and Motion*, Working Draft.
"""

from __future__ import annotations

import math
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.protocols import phone_line
from lab.data.protocols.framing import MORE, NONE, Framing
from lab.data.protocols.pairing import Pairing
from lab.data.protocols.phone_line import DEGREES, HEAD, LONGEST, RADIANS, PhoneLine, Row
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import FIX_2D, FIX_3D, NAN, NO_FIX, UNKNOWN, Vector
from lab.data.protocols.sending import FrameEncoder
from lab.data.protocols.stream_decoder import StreamDecoder

_CLEAR = 0.5 * STANDARD_GRAVITY
"""Force along the direction up from which a batch shows the sign [m/s²]: at rest it is 1 g, in a hand that
shakes the phone hard less than 0.5 g for single batches."""

_TOGETHER = 6
"""Most samples of an encoded line: those of a page in 0.1 s."""


class PhoneLines(Framing):
    """Framing of the lines."""

    first = HEAD[:1]
    longest = LONGEST

    def __init__(self) -> None:
        self._turning = Turning()
        self._found: bool | None = None
        self._apple = False
        self._seen = 0
        self._along = 0.0
        self._origin: float | None = None
        self._pairing = Pairing()
        self._end = 0

    @property
    def negates(self) -> bool:
        """Whether the forces of the phone are negated: as found, or as its maker does."""
        return self._apple if self._found is None else self._found

    @property
    def evidence(self) -> str:
        """What shows the sign and the unit, in sentences."""
        done = "the lab negates it" if self.negates else "the lab uses it unchanged"
        if not self._seen:
            maker = (
                "one of Apple's, which negate" if self._apple else "not one of Apple's, which alone negate"
            )
            why = f"The phone did not send its attitude. It is {maker} the acceleration"
        else:
            along = self._along / self._seen
            why = f"Gravity reads {along:+.1f} m/s² along the direction that the phone's attitude calls up"
        return f"{why}: {done}.{self._turning.evidence}"

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the line that begins at a place, with its end; `MORE` or `NONE`."""
        head = data[at : at + len(HEAD)]
        if not HEAD.startswith(head):
            return NONE
        if len(head) < len(HEAD):
            return MORE
        end = data.find(b"\n", at, at + self.longest)
        if end >= 0:
            return end + 1 - at
        return NONE if len(data) - at >= self.longest else MORE

    def passes(self, frame: bytes) -> bool:
        """Return whether the line has the checksum that it states."""
        return phone_line.has_valid_checksum(frame)

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the samples and fixes of a line; return whether it is one that is read."""
        line = phone_line.parse_line(frame)
        if line is None or not (line.samples or line.force or line.fix or line.attitude):
            return False
        self._end = end
        self._apple = line.apple
        if self._origin is None:
            self._origin = line.origin
        later = line.origin - self._origin
        self._weigh(line)
        sign = -1.0 if self.negates else 1.0
        unit = math.pi / 180 if line.unit == DEGREES else 1.0
        self._turning.add(line, unit)
        for number, (time, rx, ry, rz, fx, fy, fz) in enumerate(line.imu):
            count = line.first + number if line.first >= 0 else -1
            rate = (unit * rx, unit * ry, unit * rz)
            rows.add_imu(end, time + later, count, rate, (sign * fx, sign * fy, sign * fz))
        for time, *force in line.force:
            self._pairing.add_force(time + later, [sign * one for one in force])
        for time, *rate_there in line.rate:
            self._pairing.add_rate(time + later, [unit * one for one in rate_there])
        self._pair(rows)
        for time, *q_ed in line.attitude:
            rows.add_attitude(end, time + later, _in_ned(*q_ed))
        for fix in line.fix:
            _add_fix(fix, later, end, rows)
        return True

    def finish(self, rows: Rows) -> None:
        """Add what waited for further lines."""
        self._pair(rows, last=True)

    def _pair(self, rows: Rows, last: bool = False) -> None:
        for time, rate, force in self._pairing.samples(last):
            rows.add_imu(self._end, time, -1, rate, force)

    def _weigh(self, line: PhoneLine) -> None:
        """Take the evidence of a batch; the first clear one decides: no sign changes in mid-stream."""
        # Behind the time and the rate.
        forces: list[Row] = [row[4:] for row in line.imu] or [row[1:] for row in line.force]
        if line.up is None or not forces:
            return
        along = sum(_dot(force, line.up) for force in forces) / len(forces)
        if not abs(along) >= _CLEAR:
            return
        self._seen += 1
        self._along += along
        if self._found is None:
            self._found = along < 0


class PhoneDecoder(StreamDecoder):
    """Decodes the lines of a phone; a `Decoder`."""

    def __init__(self) -> None:
        self._lines = PhoneLines()
        super().__init__("phone", (self._lines,))

    @property
    def evidence(self) -> str:
        """What shows the sign of the specific force, and the unit of angular rates, in sentences."""
        return self._lines.evidence


def _dot(force: Vector, up: Vector) -> float:
    return sum(one * other for one, other in zip(force, up, strict=True))


def _in_ned(w: float, x: float, y: float, z: float) -> Vector:
    """Return an attitude whose rotation ends in east, north, up as one that ends in north, east, down.

    The two frames are half a turn about northeast apart: a product with the quaternion (0, 1, 1, 0)/√2.
    """
    half = math.sqrt(0.5)
    return (half * (-x - y), half * (w + z), half * (w - z), half * (y - x))


def _add_fix(fix: Row, later: float, end: int, rows: Rows) -> None:
    time, utc, latitude, longitude, height, level, vertical, north, east, down, speed, sea = fix
    place = math.radians(latitude), math.radians(longitude), height
    velocity = (north, east, down) if not math.isnan(north) else UNKNOWN
    kind = FIX_2D if math.isnan(height) else FIX_3D
    sigma = level, vertical, speed
    rows.add_fix(end, time + later, NAN, utc, place, velocity, sigma, fix_type=kind, sea_level=sea == 1)


_ENOUGH = 0.02
"""Sum of the squared turns of the attitude from which they say something [rad²]: a turn of the hand by 30° in
ten batches has 0.03. What is rounded to 0.1° at rest reaches it after ten minutes, uncorrelated."""
_CORRELATED = 0.5
"""Least square of the correlation between attitude and rates: half of what moves the one moves the other."""
_LONGEST = 0.5
"""Longest time between batches that are compared [s]: in longer ones the direction is not known."""
_TOLERANCE = 0.2
"""Largest deviation of the factor from 1 that counts as agreement: attitude and rates of a browser come up to
20 ms apart, and a wrong unit makes a factor of 57."""


class Turning:
    """Compares how the direction up moves in device axes with what the angular rates say.

    For a direction u that is fixed to the Earth, du/dt = u × ω in device axes. The factor between the two is
    that of least squares.
    """

    def __init__(self) -> None:
        self._up: Row | None = None
        self._time = NAN
        self._both = 0.0
        self._squares = 0.0
        self._turned = 0.0

    @property
    def factor(self) -> float:
        """Turns of the attitude by those of the angular rates; NaN if it turned too little, or at odds."""
        if self._turned < _ENOUGH or self._both**2 <= _CORRELATED * self._squares * self._turned:
            return NAN
        return self._both / self._squares

    @property
    def evidence(self) -> str:
        """What it shows, in a sentence that begins with a space; empty if it turned too little."""
        factor = self.factor
        if not isfinite(factor):
            return ""
        if abs(factor - 1) < _TOLERANCE:
            return f" The angular rates fit the phone's attitude (factor {factor:.2f})."
        return f" The attitude turns {factor:.2f} times as fast as the angular rates say: check their unit."

    def add(self, line: PhoneLine, unit: float) -> None:
        """Take a batch; `unit` is that of its angular rates [rad/s]."""
        before, self._up = self._up, line.up
        if not line.imu:
            return
        last, self._time = self._time, line.origin + line.imu[-1][0]
        begun = last - line.origin
        if before is None or line.up is None or not 0 < line.imu[-1][0] - begun < _LONGEST:
            return
        x, y, z = 0.0, 0.0, 0.0
        for time, rx, ry, rz, *_ in line.imu:
            step = unit * (time - begun)
            begun = time
            x, y, z = x + step * rx, y + step * ry, z + step * rz
        # The mean of both directions halves the error of a turn that is not small.
        ux, uy, uz = ((one + two) / 2 for one, two in zip(before, line.up, strict=True))
        # A direction that is fixed in space moves in the body by u × ω Δt.
        said = (uy * z - uz * y, uz * x - ux * z, ux * y - uy * x)
        if not all(map(isfinite, said)):
            return
        turned = [one - two for one, two in zip(line.up, before, strict=True)]
        self._squares += sum(one * one for one in said)
        self._turned += sum(one * one for one in turned)
        self._both += sum(one * two for one, two in zip(said, turned, strict=True))


class PhoneEncoder(FrameEncoder):
    """Writes samples and fixes; an `Encoder`. Numbers are exact; satellites and kinds of fixes are left out.

    The lab's phone lines have no temperature and pressure, and a fix without a position is left out.
    """

    name = "phone"

    def __init__(self) -> None:
        self._number = 0
        self._first = 0

    def _samples(self, imu: NDArray[np.void]) -> bytes:
        data = b""
        for begin in range(0, len(imu), _TOGETHER):
            line = PhoneLine(self._number, first=self._first, source="simulated", unit=RADIANS)
            rows = imu[begin : begin + _TOGETHER]
            line.imu = np.column_stack((rows["time"], rows["rate"], rows["force"])).tolist()
            self._first += len(rows)
            data += self._write_line(line)
        return data

    def _fix(self, row: np.void) -> bytes:
        if row["fix_type"] <= NO_FIX:
            return b""
        line = PhoneLine(self._number, source="simulated", unit=RADIANS)
        place = (np.degrees(row["latitude"]), np.degrees(row["longitude"]), row["height"])
        sigma = (row["horizontal_sigma"], row["vertical_sigma"])
        rest = (*row["velocity_n"], row["speed_sigma"], row["sea_level"])
        line.fix = [[float(one) for one in (row["time"], row["utc"], *place, *sigma, *rest)]]
        return self._write_line(line)

    def _write_line(self, line: PhoneLine) -> bytes:
        self._number += 1
        return line.written()
