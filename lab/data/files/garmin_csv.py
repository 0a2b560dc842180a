"""Garmin csv: the flight log of the G1000, Perspective, G3X Touch and GTN, one row per second.

Date and time are local, with the offset from UTC in a column. Speed, track and vertical speed are the
velocity, pitch, roll and heading the attitude. Garmin's heading is magnetic, and its track may be: the course
between the positions decides with which sign the logged variation leads from it to true north.

References
----------
Garmin, *G1000 Pilot's Guide*, section "SD Card Use, Flight Data Logging".
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lab.base.arrays import Flags, FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.file_content import TextBlocks
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.files.fields import (
    NAMED,
    SEA_LEVEL,
    Columns,
    Field,
    one_file,
    raw_flight,
    read_columns,
    recognised,
)
from lab.data.files.fixes import NO_FIX, UtcClock
from lab.data.files.table import NO_NUMBER, Header, find_header, plain
from lab.data.files.unit_names import unit_of
from lab.data.rebuild.raw_flight import Dropped, RawFlight, listed
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.rotation import wrap

NAME = "Garmin G1000 csv"

FIELDS = (
    Field("latitude", ("latitude",), "angle", "°"),
    Field("longitude", ("longitude",), "angle", "°"),
    Field("height", ("altgps", "altmsl"), "length", "ft"),
    Field("speed", ("gndspd",), "speed", "kt"),
    Field("track", ("trk",), "angle", "°"),
    Field("climb", ("vspdg", "vspd"), "speed", "ft/min"),
    Field("pitch", ("pitch",), "angle", "°"),
    Field("roll", ("roll",), "angle", "°"),
    Field("heading", ("hdg",), "angle", "°"),
    Field("variation", ("magvar",), "angle", "°"),
    Field("airspeed", ("tas",), "speed", "kt"),
)
"""Columns that are read, with the units that the line above the headings names, too."""

REQUIRED = (("lcldate",), ("lcltime",), ("latitude",), ("longitude",))
_NUMBERS = (("latitude",), ("longitude",))
_TEXTS = ("lcldate", "lcltime", "utcofst", "gpsfix")
_IN_BRACKETS = re.compile(r"\(([^()]*)\)")
_OFFSET = re.compile(r"[+-]?\d\d:\d\d")
_MAX_HEADER_LINE = 100
"""Last line on which the header may stand; Garmin's is the third."""
_MAX_LINE = 65_536
"""Characters of a line in which a header is looked for."""
_ASTRIDE = 2
"""Rows before and after each between which its course is taken: over 4 s the rounding of positions hardly
turns it."""
_MAX_LEG = 15.0
"""Longest time between these rows [s]: in a longer one the aircraft may have turned."""
_MIN_SPEED = 10.0
"""Speed from which the course between positions is compared with the track [m/s]: taxiing is slower."""
_MIN_LEGS = 10
"""Fewest rows by which the sign of the variation is decided."""
_MAX_OFF_COURSE = np.radians(3.0)
"""Median angle between track and course up to which they agree [rad]; receivers and rounding part them by
less, a wrong sign by twice the variation."""
_MIN_VARIATION = np.radians(1.0)
"""Variation from which true and magnetic north are told apart by the positions [rad]."""


@dataclass(frozen=True)
class _Heading:
    """The head of a file: its headings, and the unit that is named above each, as it is written."""

    header: Header
    units: dict[str, str]


@dataclass(frozen=True)
class _North:
    """The corrections of a file's directions to true north.

    Attributes
    ----------
    track, heading : (n,) arrays or None
        Correction to add [rad]; None if unknown.
    remark : str
        What a person should know of it.
    """

    track: FloatArray | None
    heading: FloatArray | None
    remark: str


def recognises(head: bytes) -> bool:
    """Return whether a file begins with the header of a Garmin flight log."""
    return recognised(head, REQUIRED)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read a flight log of a Garmin flight deck.

    Raises
    ------
    MissionError
        For whatever is wrong with the file.
    """
    path = one_file(paths, NAME)
    heading = _heading(path)
    columns = read_columns(path, _fields(heading), units, _NUMBERS)
    columns, time, clock = _timed(path, columns, heading.header)
    north = _north(columns, time)
    remarks = [*clock.remarks, north.remark]
    above = columns.units.get("height")
    if above is not None:
        by_gps = plain(above.column) == "altgps" and "wgs" in heading.units.get("altgps", "").lower()
        remarks.append("Heights are those of the GPS, above the ellipsoid." if by_gps else SEA_LEVEL)
    return raw_flight(
        NAME,
        columns,
        time=time,
        velocity_n=_velocity(columns, north),
        euler=_attitude(columns, north),
        remarks=remarks,
    )


def _heading(path: Path) -> _Heading:
    """Return the head of a file."""
    lines: list[str] = []
    with TextBlocks(path, MAX_BYTES, strict=False) as text:
        for line in text.lines():
            lines.append(line[:_MAX_LINE])
            found = find_header(lines[-1:], REQUIRED)
            if found is not None:
                header = found[1]
                above = lines[-2].lstrip("#").split(header.delimiter) if len(lines) > 1 else []
                return _Heading(header, _named_units(header, above))
            if len(lines) >= _MAX_HEADER_LINE:
                break
    raise MissionError(
        f"{path}: no header within the first {_MAX_HEADER_LINE} lines; accepted is one with "
        f"{', '.join(need[0] for need in REQUIRED)}"
    )


def _named_units(header: Header, above: Sequence[str]) -> dict[str, str]:
    """Return the units in the cells above the headings, or in brackets in them."""
    named = {}
    for name, cell in zip(header.names, above, strict=False):
        inside = _IN_BRACKETS.search(cell)
        named[name] = (inside[1] if inside else cell).strip()
    return named


def _fields(heading: _Heading) -> list[Field]:
    """Return what is read, in the units that the file names."""
    fields = []
    for field in FIELDS:
        # A damaged head may name a unit of something else.
        named = [unit_of(field.quantity, plain(heading.units.get(name, ""))) for name in field.names]
        unit = next(filter(None, named), "")
        fields.append(replace(field, unit=unit, source=NAMED) if unit else field)
    return fields


def _timed(path: Path, columns: Columns, header: Header) -> tuple[Columns, FloatArray, UtcClock]:
    """Return the rows that have a time and a fix, and their time [s]."""
    clock = UtcClock()
    names = header.names
    places = {name: names.index(name) for name in _TEXTS if name in names}
    time, fixed = np.full(len(columns.lines), np.nan), np.ones(len(columns.lines), dtype=bool)
    row, rows = 0, columns.lines.tolist()
    with TextBlocks(path, MAX_BYTES, strict=False) as text:
        for line in text.lines():
            if row == len(rows):
                break
            if text.next_line - 1 != rows[row]:
                continue
            cells = line.split(header.delimiter)
            said = {name: cells[at].strip(' "') for name, at in places.items() if at < len(cells)}
            time[row] = clock.seconds(_iso(said))
            fixed[row] = not said.get("gpsfix", "").lower().startswith("no")
            row += 1
    place = columns.vector("latitude", "longitude")
    assert place is not None  # both are required
    fixed &= (place != 0).any(axis=1)
    dropped = [
        Dropped(f"{NO_FIX}, or another cell empty or no number", one.count, one.first_row)
        if one.reason == NO_NUMBER
        else one
        for one in columns.dropped
    ]
    kept = fixed & np.isfinite(time)
    for lost, reason in ((~fixed, NO_FIX), (fixed & ~kept, "without a date and time that can be read")):
        dropped += Dropped.of(reason, lost, columns.lines)
    if kept.sum() < MIN_SAMPLES:
        raise MissionError(
            f"{path}: {kept.sum()} of {columns.rows_read} rows can be used ({listed(dropped)}); accepted are "
            f"at least {MIN_SAMPLES}"
        )
    values = {key: value[kept] for key, value in columns.values.items()}
    left = replace(columns, values=values, lines=columns.lines[kept], dropped=tuple(dropped))
    return left, time[kept], clock


def _iso(said: Mapping[str, str]) -> str:
    """Return date, time and offset as ISO 8601 writes them."""
    offset = said.get("utcofst", "")
    if not _OFFSET.fullmatch(offset):
        offset = ""
    elif offset[0] not in "+-":
        offset = f"+{offset}"
    return f"{said.get('lcldate', '')}T{said.get('lcltime', '')}{offset}"


def _north(columns: Columns, time: FloatArray) -> _North:
    """Return the corrections to true north, decided by the course between the positions."""
    track, speed = columns.get("track"), columns.get("speed")
    if track is None or speed is None:
        return _North(
            None, None, "There is no track over ground. The heading, which is magnetic, is not used."
        )
    legs = _legs(time, speed)
    if legs.sum() < _MIN_LEGS:
        return _North(None, None, "The aircraft hardly moves. Its track and its heading are not used.")
    off = wrap(_course(columns)[legs] - track[legs])
    variation = columns.get("variation")
    usual = _middle(off)
    if variation is None:
        turn = np.full_like(time, usual)
        return _North(
            turn,
            turn,
            "The file has no magnetic variation. Its directions are turned by the angle between its track "
            f"and the course from position to position, {np.degrees(usual):+.1f}°.",
        )
    # East positive, west positive, or a track from true north: whichever the positions bear out.
    signs = (1.0, -1.0, 0.0)
    residual = [abs(_middle(wrap(off - sign * variation[legs]))) for sign in signs]
    sign = signs[int(np.argmin(residual))]
    if min(residual) > _MAX_OFF_COURSE:
        return _North(
            None,
            None,
            f"The track is {np.degrees(usual):+.0f}° off the course from position to position, with the "
            "magnetic variation or without. Track and heading are not used.",
        )
    if sign == 0 and np.median(np.abs(variation)) > _MIN_VARIATION:
        return _North(
            np.zeros_like(time),
            None,
            "The track is from true north, as the positions show. The reference of the heading is unknown, "
            "so the attitude is not used.",
        )
    return _North(
        sign * variation,
        sign * variation,
        "Track and heading are magnetic, as the positions show; the variation of "
        f"{np.degrees(sign * np.median(variation)):+.1f}° (east positive) is added.",
    )


def _legs(time: FloatArray, speed: FloatArray) -> Flags:
    """Return the rows at which the course between the rows around them can be told."""
    span = np.full_like(time, np.inf)
    span[_ASTRIDE:-_ASTRIDE] = time[2 * _ASTRIDE :] - time[: -2 * _ASTRIDE]
    return np.asarray((span > 0) & (span < _MAX_LEG) & (speed > _MIN_SPEED))


def _course(columns: Columns) -> FloatArray:
    """Return the direction from the row two before to the row two after each [rad]; zero at the ends."""
    latitude, longitude = columns.values["latitude"], columns.values["longitude"]
    per_latitude, per_longitude = metres_per_radian(latitude, 0.0)
    course = np.zeros_like(latitude)
    before, after = slice(None, -2 * _ASTRIDE), slice(2 * _ASTRIDE, None)
    middle = slice(_ASTRIDE, -_ASTRIDE)
    north = (latitude[after] - latitude[before]) * per_latitude[middle]
    east = wrap(longitude[after] - longitude[before]) * per_longitude[middle]
    course[middle] = np.arctan2(east, north)
    return course


def _middle(angles: FloatArray) -> float:
    """Return the median of angles about their mean direction [rad]."""
    mean = np.angle(np.mean(np.exp(1j * angles)))
    return float(wrap(mean + np.median(wrap(angles - mean))))


def _velocity(columns: Columns, north: _North) -> FloatArray | None:
    speed, track, climb = (columns.get(key) for key in ("speed", "track", "climb"))
    if speed is None or track is None or climb is None or north.track is None:
        return None
    course = track + north.track
    return np.column_stack((speed * np.cos(course), speed * np.sin(course), -climb))


def _attitude(columns: Columns, north: _North) -> FloatArray | None:
    euler = columns.vector("roll", "pitch", "heading")
    if euler is None or north.heading is None:
        return None
    euler[:, 2] += north.heading
    return euler
