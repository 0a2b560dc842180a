"""UBX: the positions in a file of binary messages that a u-blox receiver sent, as u-center saves them.

Messages with one time of the week make one point. Its position is that of NAV-PVT, or else of NAV-POSLLH,
NAV-SOL or NAV-POSECEF, its velocity that of NAV-PVT, or else of NAV-VELNED, NAV-SOL or NAV-VELECEF. Other
messages, text and damage between them do no harm. Messages with a wrong checksum are left out.

References
----------
u-blox, *u-blox 8 / u-blox M8 Receiver Description Including Protocol Specification* (UBX-13003221).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from itertools import accumulate
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.file_content import whole
from lab.base.files.named_columns import MAX_BYTES
from lab.base.parameters.units import DAY, WEEK
from lab.data.files import nmea
from lab.data.files.dataflash_file import MAGIC as DATAFLASH
from lab.data.files.fields import one_file, units_of_the_format
from lab.data.files.track import Track
from lab.data.files.ulog_file import MAGIC as ULOG
from lab.data.rebuild.raw_flight import Dropped, RawFlight
from lab.motion.frames import ecef

NAME = "u-blox UBX"

POSECEF, POSLLH, STATUS, SOL, PVT, VELECEF, VELNED, TIMEGPS = 0x01, 0x02, 0x03, 0x06, 0x07, 0x11, 0x12, 0x20
"""Numbers of the messages of class NAV that are read."""


def _layout(size: int, **places: tuple[int, str]) -> np.dtype[np.void]:
    """Return the fields that are used of a payload of some bytes: their places and types."""
    return np.dtype({
        "names": ["iTOW", *places], "formats": ["<u4", *(kind for _, kind in places.values())],
        "offsets": [0, *(at for at, _ in places.values())], "itemsize": size,
    })  # fmt: skip


_LAYOUTS = {
    POSECEF: _layout(20, ecefX=(4, "<i4"), ecefY=(8, "<i4"), ecefZ=(12, "<i4"), pAcc=(16, "<u4")),
    POSLLH: _layout(28, lon=(4, "<i4"), lat=(8, "<i4"), height=(12, "<i4"), hAcc=(20, "<u4")),
    STATUS: _layout(16, fix=(4, "u1"), flags=(5, "u1")),
    SOL: _layout(
        52, week=(8, "<i2"), fix=(10, "u1"), flags=(11, "u1"), ecefX=(12, "<i4"), ecefY=(16, "<i4"),
        ecefZ=(20, "<i4"), pAcc=(24, "<u4"), ecefVX=(28, "<i4"), ecefVY=(32, "<i4"), ecefVZ=(36, "<i4"),
    ),
    PVT: _layout(
        84, year=(4, "<u2"), month=(6, "u1"), day=(7, "u1"), valid=(11, "u1"), fix=(20, "u1"),
        flags=(21, "u1"), lon=(24, "<i4"), lat=(28, "<i4"), height=(32, "<i4"), hAcc=(40, "<u4"),
        velN=(48, "<i4"), velE=(52, "<i4"), velD=(56, "<i4"),
    ),
    VELECEF: _layout(20, ecefVX=(4, "<i4"), ecefVY=(8, "<i4"), ecefVZ=(12, "<i4")),
    VELNED: _layout(36, velN=(4, "<i4"), velE=(8, "<i4"), velD=(12, "<i4")),
    TIMEGPS: _layout(16, week=(8, "<i2"), valid=(11, "u1")),
}  # fmt: skip
"""The fields that are read of each message, as the description names them."""
_LENGTHS = {PVT: (84, 92)}
"""Lengths of a payload, where receivers differ [bytes]: those of series 7 leave out the last fields."""
_POSITIONS = (PVT, POSLLH, SOL, POSECEF)
_MESSAGE = re.compile(rb"\xb5b\x01[" + re.escape(bytes(_LAYOUTS)) + rb"]")
_POSITION = re.compile(rb"\xb5b\x01[" + re.escape(bytes(_POSITIONS)) + rb"]")
_HEADER, _SUMS = 6, 2
"""Bytes before and after a payload."""
_TRIED = 1000
"""Most candidates for a message whose checksum is tried when a file is recognised."""
_MILLI = 1e-3
"""Unit of heights, speeds of NAV-PVT and times in SI."""
_CENTI = 1e-2
"""Unit of Cartesian coordinates, and of speeds elsewhere, in SI."""
_ANGLE = 1e-7
"""Unit of latitude and longitude [°]."""
_FIXES = (1, 4)
"""First and last kind of fix with a position: dead reckoning, 2D, 3D and both; 0 is none, 5 the time only."""
_WORST = 10_000.0
"""Accuracy from which a position without a state of its fix is none [m]: receivers without one state
thousands of km."""
_DATED = 1
"""Bit of a valid date in NAV-PVT."""
_WEEK_KNOWN = 2
"""Bit of a valid week in NAV-TIMEGPS."""
_GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
"""When the first week of GPS began."""
_COLUMNS = {"lat": "°", "lon": "°", "height": "m", "gSpeed": "m/s", "headMot": "°"}


def recognises(head: bytes) -> bool:
    """Return whether the first bytes of a file hold a sound message with a position, and no NMEA with one.

    A log of an autopilot with its receiver's messages in it is not recognised.
    """
    if head.startswith((DATAFLASH, ULOG)):
        return False
    for count, found in enumerate(_POSITION.finditer(head)):
        if count == _TRIED:
            return False
        if _payload(head, found.start()):
            return not nmea.recognises(head)
    return False


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the track in a file of UBX messages.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or holds too few positions.
    """
    path = one_file(paths, NAME, fixed=units)
    return _track(path, _Messages(whole(path, MAX_BYTES))).flight()


def _payload(data: bytes, at: int) -> bytes | None:
    """Return the payload of the message that begins at a place: None if it is cut off, empty if it is broken.

    What has another length than messages of that kind is broken without a checksum.
    """
    size = int.from_bytes(data[at + 4 : at + 6], "little")
    kind = data[at + 3]
    if size not in _LENGTHS.get(kind, (_LAYOUTS[kind].itemsize,)):
        return b""
    end = at + _HEADER + size
    summed, sums = data[at + 2 : end], data[end : end + _SUMS]
    if len(sums) < _SUMS:
        return None
    is_sound = sums == bytes((sum(summed) & 0xFF, sum(accumulate(summed)) & 0xFF))
    return summed[4:] if is_sound else b""


class _Messages:
    """The messages of a file, by kind, and the points to which they belong.

    Attributes
    ----------
    points : int
        How many times of the week there are.
    first : (points,) array
        Number of the first message of each.
    bad, first_bad : int
        How many messages have a wrong checksum, and the number of the first.
    """

    def __init__(self, data: bytes) -> None:
        payloads: dict[int, list[bytes]] = {kind: [] for kind in _LAYOUTS}
        numbers: dict[int, list[int]] = {kind: [] for kind in _LAYOUTS}
        times: list[bytes] = []
        self.bad = self.first_bad = 0
        for number, found in enumerate(_MESSAGE.finditer(data), 1):
            payload = _payload(data, found.start())
            if not payload:
                self.bad += payload is not None
                self.first_bad = self.first_bad or number
                continue
            kind = data[found.start() + 3]
            payloads[kind].append(payload[: _LAYOUTS[kind].itemsize])
            numbers[kind].append(len(times))
            times.append(payload[:4])
        time = np.frombuffer(b"".join(times), dtype="<u4")
        anew = np.append(True, time[1:] != time[:-1])[: len(time)]
        point = np.cumsum(anew) - 1
        self.points, self.first = int(anew.sum()), np.flatnonzero(anew) + 1
        self.time = time[anew] * _MILLI
        self._rows = {
            kind: np.frombuffer(b"".join(payloads[kind]), dtype=layout) for kind, layout in _LAYOUTS.items()
        }
        self._point = {kind: point[np.array(found, dtype=np.int64)] for kind, found in numbers.items()}

    def of(self, kind: int, *names: str, unit: float = 1.0) -> FloatArray:
        """Return fields of a kind of message at each point, (points, fields); NaN where it has none."""
        found = np.full((self.points, len(names)), np.nan)
        for column, name in enumerate(names):
            found[self._point[kind], column] = unit * self._rows[kind][name]
        return found


def _track(path: Path, messages: _Messages) -> Track:
    place = _places(messages)
    fixed = _fixed(messages) & np.isfinite(place).all(axis=1)
    week = _weeks(messages)
    time, remark = _time(messages.time, week, fixed)
    velocity = _velocities(messages, place)
    dropped = []
    if messages.bad:
        dropped.append(Dropped("messages with a wrong checksum", messages.bad, messages.first_bad))
    if not fixed.all():
        dropped.append(Dropped("without a fix", int((~fixed).sum()), int(messages.first[np.argmin(fixed)])))
    north, east, down = velocity[fixed].T
    return Track(
        path=path,
        format=NAME,
        time=time[fixed],
        latitude=np.degrees(place[fixed, 0]),
        longitude=np.degrees(place[fixed, 1]),
        height=place[fixed, 2],
        speed=np.hypot(north, east),
        course=np.degrees(np.arctan2(east, north)) % 360,
        down=down,
        lines=messages.first[fixed],
        columns=units_of_the_format(_COLUMNS),
        rows_read=messages.points + messages.bad,
        dropped=tuple(dropped),
        remarks=(remark, "Heights are above the ellipsoid."),
    )


def _places(messages: _Messages) -> FloatArray:
    """Return latitude, longitude [rad] and height [m] of each point."""
    place = np.full((messages.points, 3), np.nan)
    for kind in (PVT, POSLLH):
        angles = np.radians(messages.of(kind, "lat", "lon", unit=_ANGLE))
        found = np.hstack((angles, messages.of(kind, "height", unit=_MILLI)))
        found[(messages.of(kind, "hAcc", unit=_MILLI) > _WORST)[:, 0]] = np.nan
        place = _filled(place, found)
    for kind in (SOL, POSECEF):
        r_e = messages.of(kind, "ecefX", "ecefY", "ecefZ", unit=_CENTI)
        r_e[(messages.of(kind, "pAcc", unit=_CENTI) > _WORST)[:, 0]] = np.nan
        place = _filled(place, ecef.geodetic(r_e))
    return place


def _velocities(messages: _Messages, place: FloatArray) -> FloatArray:
    """Return the velocity of each point, north, east, down [m/s]."""
    velocity = messages.of(PVT, "velN", "velE", "velD", unit=_MILLI)
    velocity = _filled(velocity, messages.of(VELNED, "velN", "velE", "velD", unit=_CENTI))
    axes = ecef.axes(place[:, 0], place[:, 1])
    for kind in (SOL, VELECEF):
        v_e = messages.of(kind, "ecefVX", "ecefVY", "ecefVZ", unit=_CENTI)
        velocity = _filled(velocity, np.einsum("nji,nj->ni", axes, v_e))
    return velocity


def _filled(values: FloatArray, others: FloatArray) -> FloatArray:
    """Return vectors, or others where they are unknown."""
    known = np.isfinite(values).all(axis=1, keepdims=True)
    return np.where(known, values, others)


def _fixed(messages: _Messages) -> NDArray[np.bool_]:
    """Return at which points no message says that the receiver has no fix."""
    fixed = np.ones(messages.points, dtype=bool)
    for kind in (PVT, SOL, STATUS):
        fix, flags = messages.of(kind, "fix", "flags").T
        is_fix = (fix >= _FIXES[0]) & (fix <= _FIXES[1]) & (flags % 2 == 1)
        fixed &= np.isnan(fix) | is_fix
    return fixed


def _weeks(messages: _Messages) -> FloatArray:
    """Return the week of GPS of each point; NaN where it is unknown."""
    week, valid = messages.of(TIMEGPS, "week", "valid").T
    week = np.where(np.nan_to_num(valid).astype(np.int64) & _WEEK_KNOWN > 0, week, np.nan)
    week = np.where(np.isnan(week), messages.of(SOL, "week")[:, 0], week)
    *date, valid = messages.of(PVT, "year", "month", "day", "valid").T
    dated = np.isnan(week) & (np.nan_to_num(valid).astype(np.int64) & _DATED > 0)
    for point in np.flatnonzero(dated):
        try:
            year, month, day = (int(part[point]) for part in date)
            since = datetime(year, month, day, tzinfo=UTC) - _GPS_EPOCH
        except ValueError:
            continue
        # The day is right but for the seconds between UTC and GPS, so the week is that of its noon.
        noon = since.total_seconds() + 0.5 * DAY
        week[point] = np.round((noon - messages.time[point]) / WEEK)
    return week


def _time(of_week: FloatArray, week: FloatArray, fixed: NDArray[np.bool_]) -> tuple[FloatArray, str]:
    """Return the time since the start of the first week, and what it is in words."""
    known = fixed & np.isfinite(week) & (week > 0)
    if fixed.any() and known[fixed].all():
        first = int(week[np.argmax(known)])
        start = np.datetime64(_GPS_EPOCH.replace(tzinfo=None), "D") + 7 * first
        return of_week + WEEK * (week - first), f"Time is that of GPS, from the start of its week on {start}."
    time = of_week.copy()
    time[fixed] = np.unwrap(time[fixed], period=WEEK)
    return time, "Time is that of GPS, from the start of a week that the file does not name."
