"""UBX messages of u-blox: those of class NAV make fixes, ESF-RAW and ESF-MEAS of an IMU make samples.

NAV-PVT is a fix by itself, and makes all fixes once it came. Of older receivers, the messages with one time
of the week make one: its position is that of NAV-POSLLH, or else of NAV-SOL or NAV-POSECEF, its velocity that
of NAV-VELNED, or else of NAV-SOL or NAV-VELECEF, its kind that of NAV-STATUS or NAV-SOL, its week that of
NAV-TIMEGPS or NAV-SOL.

NAV-RELPOSNED of a moving base makes headings: those of the line from the base's antenna to the rover's, which
is taken to point forward. ESF-MEAS with the type of data for speeds makes speeds of an odometer; ticks of
wheels say no speed, since their length is unknown.

ESF-RAW holds several samples, each with a tag of the sensor's clock. ESF-MEAS holds a triad at a time, at
another time than the other, so its samples have one triad and NaN for the other. Where both are sent,
ESF-RAW alone makes samples: it is the same sensor, at ten times the rate. The clock of the tags is not that
of NAV-PVT.

References
----------
u-blox, *u-blox 8 / u-blox M8 Receiver Description Including Protocol Specification* (UBX-13003221).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import LEAP_SECONDS, WEEK
from lab.data.protocols.device_time import GPS_EPOCH, WrappingCounter
from lab.data.protocols.epochs import Epoch, Epochs
from lab.data.protocols.framing import MORE, NONE, Framing, fletcher16, passes_fletcher16
from lab.data.protocols.pvt import WORST, Pvt, fix_type
from lab.data.protocols.rows import LARGEST_HEIGHT, Rows
from lab.data.protocols.samples import FIX_3D, NAN, NO_FIX, UNKNOWN, UNMEASURED, Vector
from lab.data.protocols.sending import FrameEncoder, known_fields, vector
from lab.motion.frames import ecef

SYNC = b"\xb5\x62"
NAV_PVT, NAV_RELPOSNED, ESF_MEAS, ESF_RAW = b"\x01\x07", b"\x01\x3c", b"\x10\x02", b"\x10\x03"
PVT = Pvt("<")
POSITIONS = {"PVT": NAV_PVT, "POSLLH": b"\x01\x02", "SOL": b"\x01\x06", "POSECEF": b"\x01\x01"}
"""Messages that make a fix."""
_NAV = {
    POSITIONS["POSLLH"]: ("POSLLH", "I i i i 4x I I", "tow lon lat height level vertical"),
    POSITIONS["SOL"]: (
        "SOL", "I 4x h B B i i i I i i i I 3x B 4x",
        "tow week fix flags x y z accuracy vx vy vz speed_accuracy satellites",
    ),
    POSITIONS["POSECEF"]: ("POSECEF", "I i i i I", "tow x y z accuracy"),
    b"\x01\x12": ("VELNED", "I i i i 12x I 4x", "tow north east down speed_accuracy"),
    b"\x01\x11": ("VELECEF", "I i i i I", "tow vx vy vz speed_accuracy"),
    b"\x01\x03": ("STATUS", "I B B 10x", "tow fix flags"),
    b"\x01\x20": ("TIMEGPS", "I 4x h b B 4x", "tow week leaps valid"),
}  # fmt: skip
"""Name, form and fields of the messages of older receivers; a payload has exactly this size."""
_MESSAGES = {
    kind: (name, struct.Struct("<" + form), fields.split()) for kind, (name, form, fields) in _NAV.items()
}
_MILLI, _CENTI, _ANGLE = 1e-3, 1e-2, math.radians(1e-7)
"""Units of times, heights and accuracies; of Cartesian coordinates and speeds; of angles; in SI."""
_FIXED_OR_DIFFERENTIAL = 3
"""Bits of the flags of NAV-STATUS and NAV-SOL for a valid fix, and for corrections."""
_WEEK_VALID, _LEAPS_VALID = 2, 4
"""Bits of a valid week and of valid leap seconds in NAV-TIMEGPS."""
RAW_TICK = 1 / 25600
"""Of the tags in ESF-RAW [s]: not in the manual; 256 a sample at 100 Hz. A NEO-M8U ran 0.3 % slow."""
MEAS_TICK = 1e-3
"""Of the tag in ESF-MEAS [s]."""
Z_GYRO, TEMPERATURE, Y_GYRO, X_GYRO, X_FORCE, Y_FORCE, Z_FORCE = 5, 12, 13, 14, 16, 17, 18
"""Types of data of the IMU; the others are of wheels."""
SPEED = 11
"""Type of data of an odometer's speed."""
SPEED_UNIT = 1e-3
"""[m/s]."""
RELPOSNED = struct.Struct("<B3xI16xi24xI4xI")
"""Version, time of the week [ms], heading and its σ [1e-5 °], flags; other fields are left out."""
HEADING_UNIT = math.radians(1e-5)
"""[rad]."""
LINE_FORWARD = 1 << 0 | 1 << 5 | 1 << 8
"""Flags of a heading that is used: a fix, of a moving base, with a valid heading."""
GYRO_UNIT = math.radians(2**-12)
"""[rad/s]."""
FORCE_UNIT = 2**-10
"""[m/s²]."""
TEMPERATURE_UNIT = 1e-2
"""[°C]."""

_HEADER, _CHECK = 6, 2  # bytes before and after the payload
COUNT_FROM = 11
"""First bit of the number of measurements in the flags of ESF-MEAS."""
_MOVING_BASE = 1 << 5  # a bit of the flags of NAV-RELPOSNED
_MEAS = struct.Struct("<IHH")
_PAIR = struct.Struct("<II")
_WORD = struct.Struct("<I")
_SHORT_TAG = 2**24
"""Tags of the sensors seen have 24 bits; a larger one says that they have 32."""
_Fields = Mapping[str, Any]
"""Numbers of a message by name; the payload itself of NAV-PVT."""
_GYROS = (X_GYRO, Y_GYRO, Z_GYRO)
_FORCES = (X_FORCE, Y_FORCE, Z_FORCE)
_LARGEST = 2**23 - 1  # the data of ESF-RAW have 24 bits with sign
_PVT_SIZE = 92
"""Bytes of NAV-PVT from protocol 15 on."""


class Ubx(Framing):
    """Framing of UBX: two sync bytes, class, number, length, payload, sums of 16 bits.

    Attributes
    ----------
    broken : int
        Messages with a fix, or a part of it, and wrong sums or a wrong size.
    first_broken : bytes
        The first of them.
    has_fixes : bool
        Whether fixes with a velocity were seen: sentences of the same receiver then say nothing new.
    yields : callable
        Says whether fixes come from elsewhere in the same stream, and none without a velocity are to be made.

    Parameters
    ----------
    imu
        Message that samples are made of; with ``"auto"`` ESF-MEAS until the first ESF-RAW.
    waits
        As of `Epochs`.
    """

    first = SYNC[:1]
    longest = 4096
    wrap_period = _SHORT_TAG * RAW_TICK

    def __init__(self, imu: Literal["auto", "raw", "meas"] = "auto", waits: bool = False) -> None:
        self.broken, self.first_broken = 0, b""
        self._imu = imu
        self._epochs: Epochs[_Fields] = Epochs(self._add, frozenset(POSITIONS), frozenset(("PVT",)), waits)
        self._tags = WrappingCounter(_SHORT_TAG)
        self._long = False
        self._times = WrappingCounter(2**32)
        self.has_fixes = self._has_pvt = False
        self.yields: Callable[[], bool] = lambda: False

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the message that begins at a place, `MORE` or `NONE`."""
        head = data[at : at + _HEADER]
        if not head.startswith(SYNC):
            return MORE if SYNC.startswith(head) else NONE
        if len(head) < _HEADER:
            return MORE
        # The length of the payload follows class and number, low byte first.
        size = _HEADER + (head[4] | head[5] << 8) + _CHECK
        return size if size <= self.longest else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether the sums are those said."""
        # The sums begin behind the two sync bytes.
        passes = passes_fletcher16(frame[2:-_CHECK], frame[-_CHECK:])
        if not passes and (frame[2:4] == NAV_PVT or frame[2:4] in _MESSAGES):
            self.broken += 1
            self.first_broken = self.first_broken or frame
        return passes

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Add the samples or the fix of a message; return whether it is one of those."""
        kind, payload = frame[2:4], frame[_HEADER:-_CHECK]
        if kind == NAV_PVT and len(payload) >= PVT.size:
            self._has_pvt = True
            self._take("PVT", {"tow": int.from_bytes(payload[:4], "little"), "pvt": payload}, end, rows)
            return True
        if kind in _MESSAGES:
            name, form, fields = _MESSAGES[kind]
            is_whole = len(payload) == form.size
            if is_whole and not self._has_pvt:
                self._take(name, dict(zip(fields, form.unpack(payload), strict=True)), end, rows)
            return is_whole
        # Four reserved bytes, then pairs of a word of data and its tag.
        if kind == ESF_RAW and len(payload) % 8 == 4 and self._imu != "meas":
            self._imu = "raw"
            return self._add_raw(payload, end, rows)
        if kind == NAV_RELPOSNED and len(payload) == RELPOSNED.size:
            return _add_heading(payload, end, rows)
        if kind == ESF_MEAS and len(payload) >= _MEAS.size:
            return self._add_measured(payload, end, rows)
        return False

    def finish(self, rows: Rows) -> None:
        """Add the last fix."""
        self._epochs.finish(rows)

    def _take(self, name: str, fields: _Fields, end: int, rows: Rows) -> None:
        self._epochs.begin(name, fields["tow"] * _MILLI, rows)
        self._epochs.take(name, fields, end, rows)

    def _add(self, epoch: Epoch[_Fields], rows: Rows) -> None:
        """Add the fix of the messages of one time."""
        said = epoch.said
        if "PVT" in said:
            self.has_fixes = True
            PVT.read(said["PVT"]["pvt"], NAN, epoch.end, rows)
            return
        assert epoch.now is not None
        sol = said.get("SOL", {})
        *place, level, vertical = _read_place(said)
        *velocity, speed_sigma = _velocity(said, *place[:2])
        self.has_fixes |= math.isfinite(velocity[0])
        if math.isnan(velocity[0]) and self.yields():
            return
        kinds = [
            fix_type(one["fix"], one["flags"] & _FIXED_OR_DIFFERENTIAL)
            for one in (said.get("STATUS"), sol)
            if one
        ]
        unmeasured = [kind for kind in kinds if kind in UNMEASURED]
        kind = NO_FIX if NO_FIX in kinds else unmeasured[0] if unmeasured else max(kinds, default=FIX_3D)
        kind = NO_FIX if math.isnan(place[0]) else kind
        utc, satellites = _utc(epoch.now, said.get("TIMEGPS", {}), sol), int(sol.get("satellites", -1))
        sigma = level, vertical, speed_sigma
        rows.add_fix(epoch.end, NAN, epoch.now, utc, place, velocity, sigma, satellites, kind)

    def _add_raw(self, payload: bytes, end: int, rows: Rows) -> bool:
        values: dict[int, int] = {}
        before: int | None = None
        found = False
        for data, tag in _PAIR.iter_unpack(payload[4:]):
            if tag != before and before is not None:
                found |= self._add_tagged(before, values, end, rows)
                values = {}
            before = tag
            # The upper byte is the type of the datum, the other three its value.
            values[data >> 24] = data & 0xFFFFFF
        return (before is not None and self._add_tagged(before, values, end, rows)) or found

    def _add_tagged(self, tag: int, values: dict[int, int], end: int, rows: Rows) -> bool:
        if tag >= _SHORT_TAG and not self._long:
            self._long, self._tags = True, WrappingCounter(2**32)
        return _add_sample(self._tags.continued(tag) * RAW_TICK, values, end, rows)

    def _add_measured(self, payload: bytes, end: int, rows: Rows) -> bool:
        tag, flags, _ = _MEAS.unpack_from(payload)
        count = min(flags >> COUNT_FROM, (len(payload) - _MEAS.size) // _WORD.size)
        words = [_WORD.unpack_from(payload, _MEAS.size + _WORD.size * number)[0] for number in range(count)]
        # Six bits of type here; the two bits above them say something else.
        values = {word >> 24 & 0x3F: word & 0xFFFFFF for word in words}
        time = self._times.continued(tag) * MEAS_TICK
        if SPEED in values:  # beside ESF-RAW, the clock of the tags is another one
            rows.add_reading(
                end, NAN if self._imu == "raw" else time, speed=_to_signed(values[SPEED]) * SPEED_UNIT
            )
        sample = self._imu != "raw" and _add_sample(time, values, end, rows)
        return sample or SPEED in values


def _read_place(said: Mapping[str, _Fields]) -> tuple[float, float, float, float, float]:
    """Return latitude, longitude [rad], height, and σ horizontally and vertically [m]; NaN where unknown."""
    if "POSLLH" in said:
        one = said["POSLLH"]
        level, vertical = one["level"] * _MILLI, one["vertical"] * _MILLI
        latitude, longitude = one["lat"] * _ANGLE, one["lon"] * _ANGLE
        if level <= WORST and abs(latitude) <= math.pi / 2:
            return latitude, longitude, one["height"] * _MILLI, level, vertical
    for kind in ("SOL", "POSECEF"):
        if kind in said and said[kind]["accuracy"] * _CENTI <= WORST:
            one = said[kind]
            place = ecef.geodetic(_CENTI * np.array([[one["x"], one["y"], one["z"]]], dtype=np.float64))[0]
            sigma = one["accuracy"] * _CENTI / math.sqrt(3)  # taken as equal along the three axes
            if abs(place[2]) <= LARGEST_HEIGHT:
                return float(place[0]), float(place[1]), float(place[2]), sigma, sigma
    return NAN, NAN, NAN, NAN, NAN


def _velocity(
    said: Mapping[str, _Fields], latitude: float, longitude: float
) -> tuple[float, float, float, float]:
    """Return the velocity north, east, down, and its σ [m/s]; NaN where unknown."""
    for kind in ("VELNED", "SOL", "VELECEF"):
        if kind not in said:
            continue
        one = said[kind]
        sigma = one["speed_accuracy"] * _CENTI
        if kind == "VELNED":
            return one["north"] * _CENTI, one["east"] * _CENTI, one["down"] * _CENTI, sigma
        v_e = _CENTI * np.array([one["vx"], one["vy"], one["vz"]], dtype=np.float64)
        north, east, down = v_e @ ecef.axes(np.array([latitude]), np.array([longitude]))[0]
        return float(north), float(east), float(down), sigma
    return NAN, NAN, NAN, NAN


def _utc(now: float, timegps: _Fields, sol: _Fields) -> float:
    """Return seconds since 1970 of a time of the week; NaN if the week is unknown."""
    week = timegps["week"] if timegps.get("valid", 0) & _WEEK_VALID else sol.get("week", 0)
    leaps = timegps["leaps"] if timegps.get("valid", 0) & _LEAPS_VALID else LEAP_SECONDS
    return GPS_EPOCH + WEEK * week + now - leaps if week > 0 else NAN


def _add_heading(payload: bytes, end: int, rows: Rows) -> bool:
    """Add the heading of a moving base, if it is one and valid; return whether this is a message of one."""
    version, week_time, heading, sigma, flags = RELPOSNED.unpack(payload)
    if version != 1 or not flags & _MOVING_BASE:
        return False
    if flags & LINE_FORWARD == LINE_FORWARD:
        angle, spread = heading * HEADING_UNIT, sigma * HEADING_UNIT
        rows.add_reading(end, week_time=1e-3 * week_time, heading=angle, heading_sigma=spread)
    return True


def _add_sample(time: float, values: dict[int, int], end: int, rows: Rows) -> bool:
    """Add a sample of data by type; return whether it has any of the IMU."""
    rate, force = _triad(values, _GYROS, GYRO_UNIT), _triad(values, _FORCES, FORCE_UNIT)
    if rate is UNKNOWN and force is UNKNOWN:
        return False
    temperature = _to_signed(values[TEMPERATURE]) * TEMPERATURE_UNIT if TEMPERATURE in values else NAN
    rows.add_imu(end, time, -1, rate, force, UNKNOWN, temperature)
    return True


def _triad(values: dict[int, int], kinds: tuple[int, int, int], unit: float) -> Vector:
    if not all(kind in values for kind in kinds):
        return UNKNOWN
    return [_to_signed(values[kind]) * unit for kind in kinds]


def _to_signed(value: int) -> int:
    return value - 0x1000000 if value & 0x800000 else value


class UbloxEncoder(FrameEncoder):
    """Writes samples in ESF-RAW, rounded to the device's units, and fixes."""

    name = "ublox"

    def encode_readings(self, reading: NDArray[np.void]) -> bytes:
        """Return the messages of headings and speeds."""
        return b"".join(map(_reading, reading))

    def _sample(self, row: np.void) -> bytes:
        tag = _ticks(row["time"], RAW_TICK, 2**24)
        pairs = b"".join(struct.pack("<II", kind << 24 | one, tag) for kind, one in _counts(row).items())
        return _message(ESF_RAW, bytes(4) + pairs)

    def _fix(self, row: np.void) -> bytes:
        return _message(NAV_PVT, PVT.written(row).ljust(_PVT_SIZE, b"\0"))


def _message(kind: bytes, payload: bytes) -> bytes:
    body = kind + len(payload).to_bytes(2, "little") + payload
    return SYNC + body + fletcher16(body)


def _counts(row: np.void) -> dict[int, int]:
    """Return the data of a sample by type, as 24 bits."""
    values: dict[int, float] = {}
    if np.isfinite(row["rate"]).all():
        values |= dict(zip(_GYROS, vector(row, "rate", GYRO_UNIT), strict=True))
    if np.isfinite(row["force"]).all():
        values |= dict(zip(_FORCES, vector(row, "force", FORCE_UNIT), strict=True))
    if math.isfinite(row["temperature"]):
        values[TEMPERATURE] = float(row["temperature"]) / TEMPERATURE_UNIT
    return {kind: round(min(max(one, -_LARGEST), _LARGEST)) & 0xFFFFFF for kind, one in values.items()}


def _ticks(time: float, tick: float, modulus: int) -> int:
    return round(float(time) / tick) % modulus if math.isfinite(time) else 0


def _reading(row: np.void) -> bytes:
    messages = b""
    if math.isfinite(row["heading"]):
        week_time = _ticks(row["week_time"], _MILLI, round(WEEK / _MILLI))
        angle = round(float(row["heading"]) % (2 * math.pi) / HEADING_UNIT)
        spread = round(known_fields(row, "heading_sigma")[0] / HEADING_UNIT)
        messages += _message(NAV_RELPOSNED, RELPOSNED.pack(1, week_time, angle, spread, LINE_FORWARD))
    if math.isfinite(row["speed"]):
        word = SPEED << 24 | round(float(row["speed"]) / SPEED_UNIT) & 0xFFFFFF
        tag = _ticks(row["time"], MEAS_TICK, 2**32)
        messages += _message(ESF_MEAS, struct.pack("<IHHI", tag, 1 << COUNT_FROM, 0, word))
    return messages
