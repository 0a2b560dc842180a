"""MAVLink: the messages of one vehicle that hold its IMU and its receiver, of version 1 and 2.

Samples are made of one message: the first seen of HIGHRES_IMU (SI), SCALED_IMU and RAW_IMU (mrad/s and
thousandths of g), or else SCALED_IMU2 or 3, until one that goes before it is seen. RAW_IMU may hold counts
of any size: it is taken while it shows about one g. Ground stations and other vehicles are left out.
GPS_RAW_INT has no vertical velocity; its height is above the sea where the receiver does not send the
other. Pymavlink, an extra, knows the messages.

The yaw of GPS_RAW_INT and GPS2_RAW makes headings, as receivers with two antennas send it; beside a yaw,
`hdg_acc` is its σ, as PX4 sends it, while ArduPilot sends 0. WHEEL_DISTANCE
makes speeds: the mean over the wheels since the message before, for the time in the middle.

References
----------
MAVLink, *Packet Serialization* and *Common Message Set*, https://mavlink.io/en.
"""

from __future__ import annotations

import math
from typing import Any

from lab.base.parameters.units import GAUSS, STANDARD_GRAVITY, TO_SI
from lab.data.files.mavlink_sensors import ONE_G, UNKNOWN_SPEED
from lab.data.files.tlog_file import MAGICS, SHORTEST, SIGNATURE, SIGNED
from lab.data.log.sensor_log import SIGMAS, SINCE_1970
from lab.data.protocols.framing import MORE, NONE, Framing, crc16_mcrf4xx
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import FIX_2D, FIX_3D, FIX_RTK, NAN, NO_FIX, UNKNOWN

MISSING = "MAVLink needs pymavlink, which is not installed: pip install 'ins-lab[mavlink]'"

_ORDER = ("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU", "SCALED_IMU2", "SCALED_IMU3")
"""Messages of an IMU; an earlier one goes before a later one."""
_HECTOPASCAL = 100.0
"""[Pa]."""
_RECEIVERS = ("GPS_RAW_INT", "GPS2_RAW")
"""Messages of receivers; fixes are those of the first."""
_HEAD, _SHORT_HEAD = 10, 6
"""Bytes of a frame before its data, of version 2 and 1."""
_UNKNOWN_COUNT = 255
"""The number of satellites that says that it is not known."""
_NO_YAW = (0, 65_535)
"""Yaw of a receiver that has none, and of one that cannot say it now; 36 000 stands for north."""
_HEADING_SIGMA = math.radians(1e-5)
"""Unit of `hdg_acc` [rad]."""
_WHEELS = "WHEEL_DISTANCE"
_LONGEST_STEP = 1.0
"""Longest time over which distances of wheels make a speed [s]: a car changes its speed by 10 m/s in it."""
_TRIED = 5
"""Messages RAW_IMU that must show about one g before all are taken."""


class Mavlink(Framing):
    """Framing of MAVLink: magic, length, sender, number, payload, CRC of 16 bits.

    Of several vehicles, the first whose IMU or receiver is seen is read.

    Raises
    ------
    ImportError
        If pymavlink is not installed.
    """

    first = MAGICS
    longest = 255 + SHORTEST[MAGICS[0]] + SIGNATURE

    def __init__(self) -> None:
        try:
            from pymavlink.dialects.v20 import ardupilotmega as dialect  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise ImportError(MISSING) from error
        self._known: dict[int, Any] = dialect.mavlink_map
        self._system: int | None = None
        self._imu = len(_ORDER)
        self._raw_seen = 0
        self._wheels: tuple[float, float] | None = None  # time [s] and mean distance [m] of the last message

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the frame that begins at a place, `MORE` or `NONE`."""
        head = data[at : at + _HEAD]
        if len(head) < SHORTEST[MAGICS[1]] or (head[0] == MAGICS[0] and len(head) < _HEAD):
            return MORE
        if _number(head) not in self._known:
            return NONE
        size = head[1] + SHORTEST[head[0]]
        return size + SIGNATURE if head[0] == MAGICS[0] and head[2] & SIGNED else size

    def passes(self, frame: bytes) -> bool:
        """Return whether the CRC, which includes a byte of the message's definition, is the one said."""
        end = len(frame) - 2
        if frame[0] == MAGICS[0] and frame[2] & SIGNED:
            end -= SIGNATURE
        extra = self._known[_number(frame)].crc_extra
        return crc16_mcrf4xx(frame[1:end] + bytes((extra,))) == int.from_bytes(frame[end : end + 2], "little")

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample or the fix of a frame; return whether it is one of the vehicle's."""
        message = self._known[_number(frame)]
        if message.msgname not in (*_ORDER, *_RECEIVERS, _WHEELS):
            return False
        system = frame[5] if frame[0] == MAGICS[0] else frame[3]
        if self._system is None:
            self._system = system
        if system != self._system:
            return False
        begin = _HEAD if frame[0] == MAGICS[0] else _SHORT_HEAD
        form = message.unpacker
        # Zeros at the end of a payload are not sent.
        payload = frame[begin : begin + frame[1]][: form.size].ljust(form.size, b"\0")
        if message.msgname == _WHEELS:
            return self._read_wheels(form.unpack(payload), end, rows)
        fields = dict(zip(message.ordered_fieldnames, form.unpack(payload), strict=True))
        if message.msgname in _RECEIVERS:
            if fields["yaw"] not in _NO_YAW:
                time, utc = _clock(fields)
                heading, spread = math.radians(1e-2 * fields["yaw"]), _HEADING_SIGMA * fields["hdg_acc"]
                rows.add_reading(end, time, utc=utc, heading=heading, heading_sigma=spread or NAN)
            if message.msgname == _RECEIVERS[0]:
                _add_fix(fields, end, rows)
            return True
        return self._read_sample(message.msgname, fields, end, rows)

    def _read_sample(self, name: str, fields: dict[str, Any], end: int, rows: Rows) -> bool:
        rank = _ORDER.index(name)
        if rank > self._imu or fields.get("id", 0):
            return False
        rate = [fields[axis] for axis in ("xgyro", "ygyro", "zgyro")]
        force = [fields[axis] for axis in ("xacc", "yacc", "zacc")]
        magnetic = [fields[axis] for axis in ("xmag", "ymag", "zmag")]
        if name == "HIGHRES_IMU":
            unit, temperature, pressure = 1e-4, fields["temperature"], fields["abs_pressure"] * _HECTOPASCAL
        else:
            rate = [1e-3 * value for value in rate]
            force = [TO_SI["mg"] * value for value in force]
            unit, pressure = 1e-3 * GAUSS, NAN
            temperature = fields.get("temperature", 0) * 1e-2 or NAN  # 0 says that it is not known
        if name == "RAW_IMU" and self._raw_seen < _TRIED:
            if not ONE_G[0] < math.hypot(*force) / STANDARD_GRAVITY < ONE_G[1]:
                return False
            self._raw_seen += 1
        self._imu = rank
        rows.add_imu(
            end,
            fields["time_usec"] * 1e-6 if "time_usec" in fields else fields["time_boot_ms"] * 1e-3,
            -1,
            rate,
            force,
            [value * unit for value in magnetic] if any(magnetic) else UNKNOWN,
            temperature,
            pressure,
        )
        return True

    def _read_wheels(self, values: tuple[float, ...], end: int, rows: Rows) -> bool:
        microseconds, *distances, number = values
        count = int(number)
        if not 1 <= count <= len(distances):
            return False
        now = microseconds * 1e-6, sum(distances[:count]) / count
        before, self._wheels = self._wheels, now
        if before is not None and 0 < now[0] - before[0] < _LONGEST_STEP:
            speed = (now[1] - before[1]) / (now[0] - before[0])
            rows.add_reading(end, (now[0] + before[0]) / 2, speed=speed)
        return True


def _number(frame: bytes | bytearray) -> int:
    return int.from_bytes(frame[7:10], "little") if frame[0] == MAGICS[0] else frame[5]


def _add_fix(fields: dict[str, Any], end: int, rows: Rows) -> None:
    time, utc = _clock(fields)
    speed = 1e-2 * fields["vel"] if fields["vel"] != UNKNOWN_SPEED else NAN
    course = math.radians(1e-2 * fields["cog"]) if fields["cog"] != UNKNOWN_SPEED else NAN
    level, vertical, speed_sigma = (_sigma(fields[name]) for name in ("h_acc", "v_acc", "vel_acc"))
    height = fields["alt_ellipsoid"] or fields["alt"]
    kind = fields["fix_type"]
    rows.add_fix(
        end,
        time,
        NAN,
        utc,
        math.radians(1e-7 * fields["lat"]),
        math.radians(1e-7 * fields["lon"]),
        1e-3 * height,
        (speed * math.cos(course), speed * math.sin(course), NAN),
        level,
        vertical,
        speed_sigma,
        fields["satellites_visible"] if fields["satellites_visible"] < _UNKNOWN_COUNT else -1,
        kind if FIX_2D <= kind <= FIX_RTK else FIX_3D if kind > FIX_RTK else NO_FIX,
        not fields["alt_ellipsoid"],
    )


def _clock(fields: dict[str, Any]) -> tuple[float, float]:
    """Return the time of the vehicle's clock and that since 1970 [s]; NaN for the one that is not sent."""
    time = float(fields["time_usec"] * 1e-6)
    return (NAN, time) if time > SINCE_1970 else (time, NAN)


def _sigma(value: int) -> float:
    """Return σ of one in thousandths; NaN for one that says that it is not known."""
    sigma = 1e-3 * value
    return sigma if SIGMAS[0] < sigma < SIGMAS[1] else NAN
