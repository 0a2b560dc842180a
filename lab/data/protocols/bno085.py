"""BNO085 (BNO080, BNO086) in the mode UART-RVC: frames of 19 bytes at 100 Hz, 115 200 baud.

Two sync bytes, a number of 8 bits, yaw, pitch and roll in hundredths of a degree, specific force in
thousandths of g, three bytes, and a sum of 8 bits. Axes are those printed on the chip, z up: pitch turns
about x, roll about y, yaw about z, each to the right hand. The maker's example shows it of pitch and roll:
rolled by 20.85° it feels -0.371 g along x. The device sends no angular rates: they are the rotations from
frame to frame, divided by the time between them, so they do not drift from its attitude, and a single one is
rounded to 1 °/s. The yaw begins at zero when the device is switched on, so it is no heading. There is no
clock: the number counts the samples.

References
----------
CEVA, *BNO08X Data Sheet* (1000-3927), UART-RVC.
"""

from __future__ import annotations

import math
import struct

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.parameters.units import TO_SI
from lab.data.protocols.device_time import WrappingCounter
from lab.data.protocols.framing import MORE, NONE, Framing, sum8
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import UNKNOWN, Vector
from lab.data.protocols.sending import FrameEncoder, round_to_bits, vector

_SYNC = b"\xaa\xaa"
_SIZE = 19  # bytes of a frame
_NUMBERS_OF_FRAMES = 256  # before they begin again
_NUMBERS = struct.Struct("<6h")
_AT = 3
"""Where the numbers begin."""
INTERVAL = 0.01
"""Between frames [s]."""
_LONGEST = 25
"""Most intervals over which a rotation is an angular rate: 0.25 s, as two triads are paired."""
_ANGLE = math.radians(0.01)
"""Unit of angles [rad]."""


class Bno085(Framing):
    """Framing of UART-RVC."""

    first = _SYNC[:1]
    longest = _SIZE

    def __init__(self) -> None:
        self._number = WrappingCounter(_NUMBERS_OF_FRAMES)
        self._last: tuple[int, tuple[float, ...]] | None = None

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the frame that begins at a place, `MORE` or `NONE`."""
        head = data[at : at + 2]
        return _SIZE if head == _SYNC else MORE if len(head) < 2 else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether the last byte is the sum of those after the sync bytes."""
        return sum8(frame[2:-1]) == frame[-1]

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample of a frame."""
        *angles, x, y, z = _NUMBERS.unpack_from(frame, _AT)
        number = self._number.continued(frame[2])
        attitude = _quaternion(*(angle * _ANGLE / 2 for angle in angles))
        rate: Vector = UNKNOWN
        if self._last is not None and 0 < number - self._last[0] <= _LONGEST:
            rate = _rate_between(self._last[1], attitude, (number - self._last[0]) * INTERVAL)
        self._last = number, attitude
        unit = TO_SI["mg"]
        rows.add_imu(end, count=number, rate=rate, force=(x * unit, y * unit, z * unit))
        return True


def _quaternion(yaw: float, pitch: float, roll: float) -> tuple[float, ...]:
    """Return the quaternion, scalar first, of halves of three angles [rad]."""
    # q_z ⊗ q_x ⊗ q_y, written out: yaw, then pitch about x, then roll about y.
    cz, sz, cx, sx = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(roll), math.sin(roll)
    return (
        cz * cx * cy - sz * sx * sy,
        cz * sx * cy - sz * cx * sy,
        cz * cx * sy + sz * sx * cy,
        cz * sx * sy + sz * cx * cy,
    )


def _rate_between(before: tuple[float, ...], after: tuple[float, ...], seconds: float) -> Vector:
    """Return the angular rate that turns one attitude into another [rad/s]."""
    a, b, c, d = before
    w, x, y, z = after
    # conj(before) ⊗ after: the turn, resolved in the axes of the device.
    scalar = a * w + b * x + c * y + d * z
    turn = (
        a * x - b * w - c * z + d * y,
        a * y + b * z - c * w - d * x,
        a * z - b * y + c * x - d * w,
    )
    length = math.hypot(*turn)
    # The rotation vector has the angle 2 atan2(|v|, s), the short way round; its limit is 2 v.
    sign = math.copysign(1.0, scalar)
    factor = 2 * sign * math.atan2(length, abs(scalar)) / length if length > 0 else 2.0
    return [factor * value / seconds for value in turn]


class Bno085Encoder(FrameEncoder):
    """Writes samples, at most 100 a second, with integrated rates. The protocol has no fixes."""

    name = "bno085"

    def __init__(self) -> None:
        self._attitude = Rotation.identity()
        self._time = self._sent = math.nan

    def _sample(self, row: np.void) -> bytes:
        time = float(row["time"])
        if math.isnan(self._time):
            self._time = time - INTERVAL
            self._sent = -1.0
        self._attitude *= Rotation.from_rotvec(np.array(vector(row, "rate")) * (time - self._time))
        self._time = time
        number = round(time / INTERVAL)
        if number == self._sent:
            return b""
        self._sent = number
        angles = self._attitude.as_euler("ZXY")
        counts = [*(angles / _ANGLE), *vector(row, "force", TO_SI["mg"])]
        frame = bytes((number % _NUMBERS_OF_FRAMES,)) + _NUMBERS.pack(*map(round_to_bits, counts))
        frame += bytes(3)
        return _SYNC + frame + bytes((sum8(frame),))
