"""FIT: activities of the watches, bicycle computers and cameras of Garmin and others, with their positions.

Points are the messages ``record`` or, of cameras, ``gps_metadata``, which has a course too, or a velocity
with its vertical part. The messages are decoded by fitdecode, which is an extra. What comes before a place at
which the file is broken is read. `lab.data.files.fit_imu` reads the IMU of cameras and watches.

References
----------
Garmin, *FIT Protocol*, https://developer.garmin.com/fit/protocol/
"""

from __future__ import annotations

import math
import struct
from array import array
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import DAY
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.fixes import UNKNOWN, Fixes
from lab.data.files.streams import MAX_LOG_BYTES
from lab.data.rebuild.raw_flight import RawFlight

NAME = "FIT"

_MAGIC = b".FIT"
_HEADER_SIZES = (12, 14)
"""Lengths of the header of a file, without and with its checksum [bytes]."""
_FILE, _RECORD, _GPS, _SESSION, _SPORT = 0, 20, 160, 18, 12
"""Numbers of the messages that are read (FIT profile)."""
_SEMICIRCLE = 180 / 2**31
"""[°]: the unit of positions (FIT protocol)."""
_SHORTEST = 6
"""Length of the shortest message that has a position [bytes]."""
_MAX_EMPTY_MESSAGES = 10_000
"""Messages accepted beyond those that could have positions. A plain choice: so many are decoded at once."""
_EPOCH = datetime(1989, 12, 31, tzinfo=UTC)
"""Time from which time stamps count (FIT protocol)."""
_MIN_SINCE_EPOCH = 2**28
"""Time stamp from which it counts from the epoch and not from switching on [s] (FIT protocol, date_time)."""
_VEHICLES = {"driving": "car", "motorcycling": "car", "boating": "boat", "sailing": "boat", "rowing": "boat"}
_NO_SPORTS = {"transition", "generic"}
"""What is between the parts of a triathlon, and what was not chosen."""
_FULL_TURN = 360.0
"""[°]."""
_MISSING = "is a FIT file. Reading it needs fitdecode, which is not installed: pip install 'ins-lab[fit]'"


def recognises(head: bytes) -> bool:
    """Return whether a file starts like FIT."""
    return len(head) >= _HEADER_SIZES[0] and head[0] in _HEADER_SIZES and head[8:12] == _MAGIC


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the positions in a FIT file.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, holds too few positions, or fitdecode is not installed.
    """
    path = one_file(paths, NAME, fixed=units)
    data = read_whole(path, MAX_LOG_BYTES)
    if not recognises(data):
        raise MissionError(f"{path}: is no {NAME} file")
    points = Points()
    for number, values in messages(path, data, points):
        points.accept(number, values)
    kind = points.best(path)
    began = kind.from_midnight()
    directed = bool(np.isfinite(kind.heading).any())
    down, named = np.array(kind.down), {"speed": "m/s", "heading": "°"}
    if np.isfinite(down).any():
        named = {"velocity[1]": "m/s", "velocity[0]": "m/s"}
    track = kind.fixes.track(
        path,
        NAME,
        units_of_the_format({"position_lat": "°", "position_long": "°", "altitude": "m"}),
        over_ground=(units_of_the_format(named), kind.speed, kind.heading) if directed else None,
        remarks=_remarks(points, kind, began),
        vehicle=points.vehicle,
    )
    return replace(track, down=down).flight()


def time_of(values: Mapping[str, Any]) -> float:
    """Return the time of a message [s]."""
    whole_seconds = _first(values, "timestamp")
    return (
        whole_seconds + 1e-3 * _first(values, "timestamp_ms") if "timestamp_ms" in values else whole_seconds
    )


class _Kind:
    """The points of one kind of message."""

    def __init__(self) -> None:
        self.fixes = Fixes()
        self.speed, self.heading, self.down = array("d"), array("d"), array("d")

    def add(self, values: Mapping[str, Any]) -> None:
        """Take a message."""
        fixed = self.fixes.add(
            time_of(values),
            _SEMICIRCLE * _first(values, "position_lat"),
            _SEMICIRCLE * _first(values, "position_long"),
            _first(values, "enhanced_altitude", "altitude"),
            self.fixes.count + 1,
        )
        if not fixed:
            return
        velocity = values.get("velocity")
        east, north, up = velocity if _is_vector(velocity) else (UNKNOWN,) * 3
        known = math.isfinite(north + east)
        self.speed.append(math.hypot(north, east) if known else _first(values, "enhanced_speed", "speed"))
        self.heading.append(
            math.degrees(math.atan2(east, north)) % _FULL_TURN if known else _first(values, "heading")
        )
        self.down.append(-up)

    def from_midnight(self) -> datetime | None:
        """Count time from the midnight before the first point; return that, or None if no date is known."""
        time = np.array(self.fixes.time)
        first = time[np.isfinite(time)][:1]
        # Cameras count from when they were switched on.
        if not first.size or first[0] < _MIN_SINCE_EPOCH:
            return None
        began = DAY * float(first[0] // DAY)
        self.fixes.time[:] = array("d", (time - began).tobytes())
        return _EPOCH + timedelta(seconds=began)


def _is_vector(value: object) -> TypeGuard[tuple[float, float, float]]:
    """Return whether a field is three numbers: of a velocity those along longitude, latitude and altitude."""
    three = value if isinstance(value, tuple) and len(value) == len("xyz") else (None,)
    return all(isinstance(one, int | float) for one in three)


class Points:
    """What is read of a file.

    Attributes
    ----------
    kinds : tuple of _Kind
        Points of ``record``, and of ``gps_metadata``.
    sports : list of str
        What the activity was: several of a triathlon.
    planned : bool
        Whether the file is a course to follow.
    broken : str
        Where and how the file is broken; empty if it is whole.
    """

    def __init__(self) -> None:
        self.kinds = (_Kind(), _Kind())
        self.sports: list[str] = []
        self.planned = False
        self.broken = ""

    def accept(self, number: int, values: Mapping[str, Any]) -> None:
        """Take a message of a number."""
        if number == _RECORD:
            self.kinds[0].add(values)
        elif number == _GPS:
            self.kinds[1].add(values)
        elif number == _FILE:
            self.planned = values.get("type") == "course"
        elif isinstance(sport := values.get("sport"), str) and sport not in {*self.sports, *_NO_SPORTS}:
            self.sports.append(sport)

    def best(self, path: Path) -> _Kind:
        """Return the points of the kind with more positions; raise a `MissionError` if there are none."""
        kind = max(self.kinds, key=lambda one: (len(one.fixes.line), one.fixes.count))
        if len(kind.fixes.line):
            return kind
        said = "has no positions (messages record or gps_metadata)."
        if kind.fixes.count:
            said = f"none of its {kind.fixes.count} points has a position, as of what is recorded indoors."
        broken = f" It is broken: {self.broken}." if self.broken else ""
        raise MissionError(f"{path}: {said}{broken} Accepted is an activity that was recorded with positions")

    @property
    def vehicle(self) -> str:
        """The vehicle of all sports; empty if they differ."""
        vehicles = {_VEHICLES.get(sport, sport) for sport in self.sports}
        return vehicles.pop() if len(vehicles) == 1 else ""


def messages(
    path: Path, data: bytes, points: Points, further: Collection[int] = ()
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Iterate over the messages that are read, each with its number and its fields by name.

    Parameters
    ----------
    path, data
        The file, for messages, and its bytes.
    points
        Takes where the file is broken.
    further
        Numbers of messages beside those with positions and sports.
    """
    try:
        import fitdecode  # noqa: PLC0415 - an extra
    except ImportError:
        raise MissionError(f"{path}: {_MISSING}") from None
    wanted = {_FILE, _RECORD, _GPS, _SESSION, _SPORT, *further}
    how = {
        "processor": None,
        "check_crc": fitdecode.CrcCheck.DISABLED,
        "error_handling": fitdecode.ErrorHandling.IGNORE,
    }
    try:
        with fitdecode.FitReader(data, **how) as frames:
            for count, frame in enumerate(frames):
                _refuse_emptiness(path, count, len(data))
                if frame.frame_type == fitdecode.FIT_FRAME_DATA and frame.global_mesg_num in wanted:
                    yield frame.global_mesg_num, _fields(frame.fields)
    except MissionError:
        raise
    except (
        # Errors of a decoder that trusts the lengths and types in a damaged file.
        fitdecode.FitError, ArithmeticError, AssertionError, LookupError, TypeError, ValueError, struct.error,
    ) as error:  # fmt: skip
        points.broken = str(error) or "a message is longer than the file says"
        return
    # Length of the header, then that of the content; the checksum stands behind and covers both.
    size = data[0] + int.from_bytes(data[4:8], "little")
    if fitdecode.utils.compute_crc(data[:size]) != int.from_bytes(data[size : size + 2], "little"):
        points.broken = "its checksum is wrong, so some of its numbers may be"


def _fields(fields: Sequence[Any]) -> dict[str, Any]:
    """Return values by name, without fields of apps: these have any name and unit."""
    return {one.name: one.value for one in fields if one.field_type != "devfield"}


def _refuse_emptiness(path: Path, count: int, size: int) -> None:
    """Raise if there are more messages than those with positions could be: they would take long to decode."""
    if count > _MAX_EMPTY_MESSAGES + size / _SHORTEST:
        raise MissionError(
            f"{path}: more than {count} messages in {size} bytes; accepted are messages with positions, of "
            f"{_SHORTEST} bytes and more"
        )


def _first(values: Mapping[str, Any], *names: str) -> float:
    """Return the first of several fields that is a number; NaN if none is."""
    for name in names:
        value = values.get(name)
        if isinstance(value, int | float):
            return float(value)
    return UNKNOWN


def _remarks(points: Points, kind: _Kind, began: datetime | None) -> tuple[str, ...]:
    start = "when the device was switched on" if began is None else f"{began:%Y-%m-%d} 00:00 UTC"
    remarks = [f"Time counts from {start}."]
    if np.isfinite(kind.fixes.height).any():
        remarks.append(SEA_LEVEL)
    if np.isfinite(kind.speed).any() and not np.isfinite(kind.heading).any():
        remarks.append("The speed in the file is not used: it has no direction.")
    if points.planned:
        remarks.append("This is a course, not an activity: its times may be planned and not recorded.")
    if len(points.sports) > 1:
        remarks.append(f"The activity has several sports: {', '.join(points.sports)}.")
    if points.broken:
        remarks.append(f"The file is broken: {points.broken}.")
    return tuple(remarks)
