"""MAVLink, of version 1 and 2: messages in SI units, and the samples and fixes of one vehicle in a stream.

The messages that are read stand in one table, `MESSAGES`; pymavlink, an extra, knows their forms and units.
Files and streams are decoded by the same function (`Mavlink.message`).

Samples are made of one message: the first seen of HIGHRES_IMU (SI), SCALED_IMU and RAW_IMU (mrad/s and
thousandths of g), or else SCALED_IMU2 or 3, until one that goes before it is seen. RAW_IMU may hold counts
of any size: it is taken while it shows about one g. Ground stations and other vehicles are left out.
GPS_RAW_INT has no vertical velocity; its height is above the sea where the receiver does not send the
other.

The yaw of GPS_RAW_INT and GPS2_RAW makes headings, as receivers with two antennas send it; beside a yaw,
`hdg_acc` is its σ, as PX4 sends it, while ArduPilot sends 0. WHEEL_DISTANCE
makes speeds: the mean over the wheels since the message before, for the time in the middle.

References
----------
MAVLink, *Packet Serialization* and *Common Message Set*, https://mavlink.io/en.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from struct import Struct
from typing import Any, Final, NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.units import GAUSS, STANDARD_GRAVITY, TO_SI
from lab.data.log.sensor_log import SIGMAS, SINCE_1970
from lab.data.protocols.framing import MORE, NONE, Framing, crc16_mcrf4xx
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import FIX_2D, FIX_3D, FIX_RTK, NAN, NO_FIX, UNKNOWN
from lab.data.protocols.stream_decoder import StreamDecoder

MISSING = "MAVLink needs pymavlink, which is not installed: pip install 'ins-lab[mavlink]'"

GYRO, ACCELEROMETER, MAGNETOMETER = (
    ("xgyro", "ygyro", "zgyro"),
    ("xacc", "yacc", "zacc"),
    ("xmag", "ymag", "zmag"),
)
"""Fields of the messages of an IMU."""
_IMU = (*GYRO, *ACCELEROMETER, *MAGNETOMETER, "temperature")
_RECEIVER = (
    "time_usec", "fix_type", "lat", "lon", "alt", "alt_ellipsoid", "vel", "cog", "h_acc", "v_acc", "vel_acc",
    "hdg_acc", "yaw", "satellites_visible",
)  # fmt: skip
MESSAGES: Final = {
    "HIGHRES_IMU": ("time_usec", "id", *_IMU, "abs_pressure"),
    "SCALED_IMU": ("time_boot_ms", *_IMU),
    "RAW_IMU": ("time_usec", "id", *_IMU),
    "SCALED_IMU2": ("time_boot_ms", *_IMU),
    "SCALED_IMU3": ("time_boot_ms", *_IMU),
    "GPS_RAW_INT": _RECEIVER,
    "GPS2_RAW": _RECEIVER,
    "WHEEL_DISTANCE": ("time_usec", "count", *(f"distance{wheel}" for wheel in range(16))),
    "HEARTBEAT": ("type", "autopilot"),
    "SYSTEM_TIME": ("time_unix_usec", "time_boot_ms"),
    "ATTITUDE": ("time_boot_ms", "roll", "pitch", "yaw"),
    "ATTITUDE_QUATERNION": ("time_boot_ms", "q1", "q2", "q3", "q4"),
    "LOCAL_POSITION_NED": ("time_boot_ms", "vx", "vy", "vz"),
    "GLOBAL_POSITION_INT": ("time_boot_ms", "lat", "lon", "alt", "vx", "vy", "vz"),
    "PARAM_VALUE": ("param_id", "param_value"),
}
"""Messages that are read, and their fields: of the IMU (an earlier one goes before a later one), of receivers
(fixes are those of the first), of wheels, and of the autopilot's solution, which only files use."""
# Messages of the IMU, of receivers, and of wheels.
_ORDER, RECEIVERS, _WHEELS = tuple(MESSAGES)[:5], tuple(MESSAGES)[5:7], "WHEEL_DISTANCE"
_UNITS = {
    "us": 1e-6, "ms": 1e-3, "degE7": math.radians(1e-7), "degE5": math.radians(1e-5),
    "cdeg": math.tau / 36_000, "mm": 1e-3, "mm/s": 1e-3, "cm/s": 1e-2, "mG": TO_SI["mg"], "mrad/s": 1e-3,
    "gauss": GAUSS, "mgauss": 1e-3 * GAUSS, "hPa": 100.0, "cdegC": 1e-2,
}  # fmt: skip
"""Units of fields, as MAVLink writes them, in SI; of others the factor is 1."""
_RAW = (
    dict.fromkeys(GYRO, "mrad/s") | dict.fromkeys(ACCELEROMETER, "mG") | dict.fromkeys(MAGNETOMETER, "mgauss")
    | {"temperature": "cdegC"}
)  # fmt: skip
"""Units that RAW_IMU is read in, whether the definition of the message says so or not."""
_NO_FIELD: dict[str, tuple[int, ...]] = {
    "time_usec": (0,), "alt_ellipsoid": (0,), "vel": (65_535,), "cog": (65_535,), "hdg_acc": (0,),
    "yaw": (0, 65_535), "satellites_visible": (255,),
}  # fmt: skip
"""Numbers that say that a field of a receiver is not known; a yaw of 36 000 stands for north."""
_NO_TEMPERATURE: dict[str, tuple[int, ...]] = {"temperature": (0,)}  # of whole numbers
_UNKNOWN = dict.fromkeys(RECEIVERS, _NO_FIELD) | dict.fromkeys(_ORDER[1:], _NO_TEMPERATURE)
"""Numbers of fields that are not known, by message."""
_MAGICS = b"\xfd\xfe"
"""First bytes of a frame: of MAVLink 2 and of MAVLink 1."""
_SHORTEST = {0xFD: 12, 0xFE: 8}
"""Bytes of a frame without its payload, by its first byte (MAVLink, Packet Serialization)."""
_HEAD, _SHORT_HEAD = 10, 6
"""Bytes of a frame before its data, of version 2 and 1."""
_LENGTH_KNOWN = 3
"""Bytes of a frame by which its length is known: first byte, length of the payload, flags."""
_SIGNED, _SIGNATURE = 1, 13
"""Flag of a frame with a signature, and the bytes of a signature."""
LONGEST_STEP = 1.0
"""Longest time over which distances of wheels make a speed [s]: a car changes its speed by 10 m/s in it."""
_TRIED = 5
"""Messages RAW_IMU that must show about one g before all are taken."""
ONE_G = (0.5, 2.0)
"""Specific force at rest at which the numbers of an IMU are in the unit supposed [g]."""

MAX_VEHICLES = 32
"""Most vehicles, restarts counted, whose messages are kept."""

STAMP = 8
"""Bytes of the ground station's time before each frame."""
_RESTART = 10.0
"""How far the time since switching on has to fall back for a restart [s]: frames of a slow link come out
of order by less."""
ARMS = (("GPS1_POS_", "INS_POS1_"), ("GPS_POS1_", "INS_POS1_"), ("EKF2_GPS_POS_", "EKF2_IMU_POS_"))
"""Beginnings of parameters with the places of antenna and IMU [m], of ArduPilot, new and old, and PX4."""
DELAYS = ("GPS1_DELAY_MS", "GPS_DELAY_MS", "EKF2_GPS_DELAY")
"""Parameters that say how late fixes are [ms]."""
PARAMETERS = frozenset(DELAYS) | {f"{name}{axis}" for pair in ARMS for name in pair for axis in "XYZ"}
"""Parameters that are kept."""


class Message(NamedTuple):
    """A message of `MESSAGES`.

    Attributes
    ----------
    name : str
        Its name.
    sender : tuple of int
        System and component.
    values : dict
        Its fields [SI]; NaN for what is not known, text for names.
    """

    name: str
    sender: tuple[int, int]
    values: dict[str, Any]


class Mavlink(Framing):
    """Framing of MAVLink: magic, length, sender, number, payload, CRC of 16 bits.

    Of several vehicles, the first whose IMU or receiver is seen is read.

    Raises
    ------
    ImportError
        If pymavlink is not installed.
    """

    first = _MAGICS
    longest = 255 + _SHORTEST[_MAGICS[0]] + _SIGNATURE

    def __init__(self) -> None:
        try:
            from pymavlink.dialects.v20 import ardupilotmega as dialect  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise ImportError(MISSING) from error
        self._known: dict[int, Any] = dialect.mavlink_map
        self._forms = {
            message.id: (message.msgname, message.unpacker, _field_places(message))
            for message in self._known.values()
            if message.msgname in MESSAGES
        }
        self._system: int | None = None
        self._imu = len(_ORDER)
        self._raw_seen = 0
        self._wheels: tuple[float, float] | None = None  # time [s] and mean distance [m] of the last message

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the frame that begins at a place, `MORE` or `NONE`."""
        head = data[at : at + _HEAD]
        if len(head) < _SHORTEST[_MAGICS[1]] or (head[0] == _MAGICS[0] and len(head) < _HEAD):
            return MORE
        return frame_size(head) if _number(head) in self._known else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether the CRC, which includes a byte of the message's definition, is the one said."""
        end = len(frame) - 2
        if frame[0] == _MAGICS[0] and frame[2] & _SIGNED:
            end -= _SIGNATURE
        extra = self._known[_number(frame)].crc_extra
        return crc16_mcrf4xx(frame[1:end] + bytes((extra,))) == int.from_bytes(frame[end : end + 2], "little")

    def message(self, frame: bytes) -> Message | None:
        """Return what a frame says; None for a message that is not in `MESSAGES`."""
        form = self._forms.get(_number(frame))
        if form is None:
            return None
        name, unpacker, places = form
        begin, system = (_HEAD, 5) if frame[0] == _MAGICS[0] else (_SHORT_HEAD, 3)
        # Zeros at the end of a payload are not sent.
        numbers = _numbers(unpacker, frame[begin : begin + frame[1]])
        values: dict[str, Any] = {}
        for key, place, unit, unknown in places:
            number = numbers[place]
            values[key] = NAN if number in unknown else number * unit if unit else _text(number)
        return Message(name, (frame[system], frame[system + 1]), values)

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the sample or the fix of a frame; return whether it is one of the vehicle's."""
        message = self.message(frame)
        if message is None or message.name not in (*_ORDER, *RECEIVERS, _WHEELS):
            return False
        if self._system is None:
            self._system = message.sender[0]
        if message.sender[0] != self._system:
            return False
        values = message.values
        if message.name == _WHEELS:
            return self._read_wheels(values, end, rows)
        if message.name in _ORDER:
            return self._read_sample(message.name, values, end, rows)
        if math.isfinite(values["yaw"]):
            time, utc = _clock(values["time_usec"])
            rows.add_reading(end, time, utc=utc, heading=values["yaw"], heading_sigma=values["hdg_acc"])
        if message.name == RECEIVERS[0]:
            _add_fix(values, end, rows)
        return True

    def _read_sample(self, name: str, values: dict[str, float], end: int, rows: Rows) -> bool:
        rank = _ORDER.index(name)
        if rank > self._imu or values.get("id", 0):
            return False
        rate, force, magnetic = (
            [values[axis] for axis in axes] for axes in (GYRO, ACCELEROMETER, MAGNETOMETER)
        )
        if name == "RAW_IMU" and self._raw_seen < _TRIED:
            if not ONE_G[0] < math.hypot(*force) / STANDARD_GRAVITY < ONE_G[1]:
                return False
            self._raw_seen += 1
        self._imu = rank
        time = values["time_usec"] if "time_usec" in values else values["time_boot_ms"]
        field, pressure = magnetic if any(magnetic) else UNKNOWN, values.get("abs_pressure", NAN)
        rows.add_imu(end, time, -1, rate, force, field, values["temperature"], pressure)
        return True

    def _read_wheels(self, values: dict[str, float], end: int, rows: Rows) -> bool:
        count = int(values["count"])
        if not 1 <= count <= len(MESSAGES[_WHEELS]) - 2:
            return False
        now = values["time_usec"], sum(values[f"distance{wheel}"] for wheel in range(count)) / count
        before, self._wheels = self._wheels, now
        if before is not None and 0 < now[0] - before[0] < LONGEST_STEP:
            speed = (now[1] - before[1]) / (now[0] - before[0])
            rows.add_reading(end, (now[0] + before[0]) / 2, speed=speed)
        return True


@dataclass(eq=False)
class Vehicle:
    """What one vehicle sent between two starts of its autopilot.

    Attributes
    ----------
    first : int
        Number of its first message, among those that are read, counted from 1.
    count : int
        How many of its messages are read.
    parameters : dict
        Those of `PARAMETERS` that it sent.
    """

    first: int
    count: int = 0
    parameters: dict[str, float] = field(default_factory=dict)
    _rows: dict[str, array[float]] = field(default_factory=dict)

    def add(self, message: Message) -> None:
        """Take a message."""
        self.count += 1
        if message.name != "PARAM_VALUE":
            self._rows.setdefault(message.name, array("d")).extend(message.values.values())
        elif message.values["param_id"] in PARAMETERS:
            self.parameters[message.values["param_id"]] = message.values["param_value"]

    @property
    def counts(self) -> dict[str, int]:
        """How many messages there are, by name."""
        return {name: len(rows) // len(MESSAGES[name]) for name, rows in sorted(self._rows.items())}

    def numbers(self, name: str) -> dict[str, FloatArray] | None:
        """Return the fields of the messages of a name [SI]; None without any."""
        if name not in self._rows:
            return None
        table = np.frombuffer(self._rows[name], dtype=np.float64).reshape(-1, len(MESSAGES[name]))
        return dict(zip(MESSAGES[name], table.T, strict=True))


class Telemetry(Mavlink):
    """Collects the messages of a telemetry log by their senders.

    Attributes
    ----------
    vehicles : dict
        What each vehicle sent, by its system, its component and the number of its restarts.
    others : int
        Messages beyond those of `MAX_VEHICLES`.
    lost : int
        Bytes of no sound frame.
    started : float
        Time of the ground station at the first frame [s since 1970].
    """

    def __init__(self) -> None:
        super().__init__()
        self.vehicles: dict[tuple[int, int, int], Vehicle] = {}
        self.others = self.lost = 0
        self.started = 0.0
        self._boots: dict[tuple[int, int], tuple[int, float]] = {}
        self._number = self._end = 0

    @classmethod
    def of(cls, data: bytes) -> Telemetry:
        """Return the content of the bytes of a file."""
        log = cls()
        log.started = int.from_bytes(data[:STAMP], "big") * 1e-6
        decoder = StreamDecoder("mavlink", (log,))
        decoder.feed(data)
        decoder.finish()
        log.lost += len(data) - log._end
        return log

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Keep the message of a frame; return whether it is one that is read."""
        self.lost += max(end - len(frame) - STAMP - self._end, 0)
        self._end = end
        message = self.message(frame)
        if message is not None:
            self._accept(message)
        return message is not None

    def _accept(self, message: Message) -> None:
        self._number += 1
        boots, latest = self._boots.get(message.sender, (0, 0.0))
        if "time_boot_ms" in message.values:
            now = message.values["time_boot_ms"]
            boots += now < latest - _RESTART
            latest = now if now < latest - _RESTART else max(now, latest)
        key = (*message.sender, boots)
        if key not in self.vehicles and len(self.vehicles) == MAX_VEHICLES:
            self.others += 1
            return
        self._boots[message.sender] = boots, latest
        self.vehicles.setdefault(key, Vehicle(self._number)).add(message)


def frame_size(head: bytes | bytearray) -> int:
    """Return the bytes of the frame that begins with these, `MORE` for too few of them, or `NONE`."""
    if len(head) < _LENGTH_KNOWN:
        return MORE
    if head[0] not in _MAGICS:
        return NONE
    size = head[1] + _SHORTEST[head[0]]
    return size + _SIGNATURE if head[0] == _MAGICS[0] and head[2] & _SIGNED else size


def _number(frame: bytes | bytearray) -> int:
    # The number of a message has three bytes in version 2, and one in version 1.
    return int.from_bytes(frame[7:10], "little") if frame[0] == _MAGICS[0] else frame[5]


def _field_places(message: Any) -> list[tuple[str, int, float, tuple[int, ...]]]:
    """Return name, place, unit (0 for text) and numbers for what is unknown, of the fields of a message."""
    # The order on the wire is that of the fields' sizes; an array of n numbers takes n places.
    names: list[str] = []
    for name, count in zip(message.ordered_fieldnames, message.lengths, strict=True):
        names += [name] if count == 1 else [f"{name}{index}" for index in range(count)]
    units, unknown = message.fieldunits_by_name, _UNKNOWN.get(message.msgname, {})
    if message.msgname == "RAW_IMU":
        units = units | _RAW
    return [
        (
            name,
            names.index(name),
            0.0 if name == "param_id" else _UNITS.get(units.get(name.rstrip("0123456789"), ""), 1.0),
            unknown.get(name, ()),
        )
        for name in MESSAGES[message.msgname]
    ]


def _numbers(unpacker: Struct, payload: bytes) -> tuple[Any, ...]:
    return unpacker.unpack(payload[: unpacker.size].ljust(unpacker.size, b"\0"))


def _text(name: bytes) -> str:
    return name.split(b"\0")[0].decode("ascii", "replace")


def _add_fix(values: dict[str, float], end: int, rows: Rows) -> None:
    time, utc = _clock(values["time_usec"])
    speed, course, over_sea = values["vel"], values["cog"], math.isnan(values["alt_ellipsoid"])
    place = values["lat"], values["lon"], values["alt" if over_sea else "alt_ellipsoid"]
    velocity = speed * math.cos(course), speed * math.sin(course), NAN
    sigmas = (values[name] for name in ("h_acc", "v_acc", "vel_acc"))
    sigma = [one if SIGMAS[0] < one < SIGMAS[1] else NAN for one in sigmas]
    satellites, kind = values["satellites_visible"], int(values["fix_type"])
    count = -1 if math.isnan(satellites) else int(satellites)
    kind = kind if FIX_2D <= kind <= FIX_RTK else FIX_3D if kind > FIX_RTK else NO_FIX
    rows.add_fix(end, time, NAN, utc, place, velocity, sigma, count, kind, over_sea)


def _clock(time: float) -> tuple[float, float]:
    """Return the time of the vehicle's clock and that since 1970 [s]; NaN for the one that is not sent."""
    return (NAN, time) if time > SINCE_1970 else (time, NAN)
