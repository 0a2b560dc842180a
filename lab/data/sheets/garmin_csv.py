"""Garmin csv: the flight log of the G1000, Perspective, G3X Touch and GTN, one row per second.

Date and time are local, with the offset from UTC in a column. Speed, track and vertical speed are the
velocity, pitch, roll and heading the attitude. Garmin's heading is magnetic, and its track may be: the course
between the positions decides with which sign the logged variation leads from it to true north.

References
----------
Garmin, *G1000 Pilot's Guide*, section "SD Card Use, Flight Data Logging".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from lab.base.arrays import Flags, FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import DAY
from lab.data.files.fields import SEA_LEVEL, one_file
from lab.data.files.fixes import NO_FIX
from lab.data.files.profile import Profile, plain
from lab.data.rebuild.raw_flight import Dropped, RawFlight, list_dropped
from lab.data.sheets.flight_columns import Columns, raw_flight, read_columns
from lab.data.sheets.sheet_cells import NO_NUMBER
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.rotation import wrap

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
class _North:
    """The corrections of a file's directions to true north.

    Attributes
    ----------
    remark : str
        What a person should know of it.
    track, heading : (n,) arrays or None
        Correction to add [rad]; None if unknown.
    """

    remark: str
    track: FloatArray | None = None
    heading: FloatArray | None = None


def read(profile: Profile, paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read a flight log of a Garmin flight deck.

    Raises
    ------
    MissionError
        For whatever is wrong with the file.
    """
    path = one_file(paths, profile.name)
    columns, time, clock = _keep_timed_rows(path, read_columns(path, profile, units))
    north = _north(columns, time)
    remarks = [*clock, north.remark]
    above = columns.units.get("height")
    if above is not None:
        by_gps = plain(above.column) == "altgps" and columns.written["height"].endswith("wgs")
        remarks.append("Heights are those of the GPS, above the ellipsoid." if by_gps else SEA_LEVEL)
    return raw_flight(
        profile.name,
        columns,
        time=time,
        velocity_n=_velocity(columns, north),
        euler=_attitude(columns, north),
        remarks=remarks,
    )


def _keep_timed_rows(path: Path, columns: Columns) -> tuple[Columns, FloatArray, list[str]]:
    """Return the rows with a time and a fix, their time since the first midnight in UTC [s], and a report."""
    unknown = np.full(len(columns.lines), np.nan)
    date, clock, offset = (columns.values.pop(key, unknown) for key in ("date", "clock", "zone"))
    time = date + clock % DAY - np.nan_to_num(offset)
    place = columns.vector("latitude", "longitude")
    assert place is not None  # both are required
    fixed = (columns.values.pop("fix", np.ones_like(unknown)) != 0) & (place != 0).any(axis=1)
    reasons = {NO_NUMBER: f"{NO_FIX}, or another cell empty or no number"}
    dropped = [replace(one, reason=reasons.get(one.reason, one.reason)) for one in columns.dropped]
    kept = fixed & np.isfinite(time)
    for lost, reason in ((~fixed, NO_FIX), (fixed & ~kept, "without a date and time that can be read")):
        dropped += Dropped.of(reason, lost, columns.lines)
    if kept.sum() < MIN_SAMPLES:
        raise MissionError(
            f"{path}: {kept.sum()} of {columns.rows_read} rows can be used ({list_dropped(dropped)}); "
            "accepted are "
            f"at least {MIN_SAMPLES}"
        )
    values = {key: value[kept] for key, value in columns.values.items()}
    left = replace(columns, values=values, lines=columns.lines[kept], dropped=tuple(dropped))
    midnight = float(time[kept][0] // DAY * DAY)
    said = [f"Time counts from {datetime.fromtimestamp(midnight, UTC):%Y-%m-%d} 00:00 UTC."]
    if unzoned := int(np.isnan(offset[kept]).sum()):
        said.append(f"{unzoned} times name no time zone and are taken as UTC.")
    return left, time[kept] - midnight, said


def _north(columns: Columns, time: FloatArray) -> _North:
    """Return the corrections to true north, decided by the course between the positions."""
    track, speed = columns.get("course"), columns.get("speed")
    if track is None or speed is None:
        return _North("There is no track over ground. The heading, which is magnetic, is not used.")
    legs = _legs(time, speed)
    if legs.sum() < _MIN_LEGS:
        return _North("The aircraft hardly moves. Its track and its heading are not used.")
    off = wrap(_course(columns)[legs] - track[legs])
    variation = columns.get("variation")
    usual = _median_angle(off)
    if variation is None:
        turn = np.full_like(time, usual)
        remark = (
            "The file has no magnetic variation. Its directions are turned by the angle between its track "
            f"and the course from position to position, {np.degrees(usual):+.1f}°."
        )
        return _North(remark, turn, turn)
    # East positive, west positive, or a track from true north: whichever the positions bear out.
    signs = (1.0, -1.0, 0.0)
    residual = [abs(_median_angle(wrap(off - sign * variation[legs]))) for sign in signs]
    sign = signs[int(np.argmin(residual))]
    if min(residual) > _MAX_OFF_COURSE:
        return _North(
            f"The track is {np.degrees(usual):+.0f}° off the course from position to position, with the "
            "magnetic variation or without. Track and heading are not used."
        )
    if sign == 0 and np.median(np.abs(variation)) > _MIN_VARIATION:
        remark = (
            "The track is from true north, as the positions show. The reference of the heading is unknown, "
            "so the attitude is not used."
        )
        return _North(remark, np.zeros_like(time))
    added = f"{np.degrees(sign * np.median(variation)):+.1f}° (east positive) is added"
    remark = f"Track and heading are magnetic, as the positions show; the variation of {added}."
    return _North(remark, sign * variation, sign * variation)


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


def _median_angle(angles: FloatArray) -> float:
    """Return the median of angles about their mean direction [rad]."""
    mean = np.angle(np.mean(np.exp(1j * angles)))
    return float(wrap(mean + np.median(wrap(angles - mean))))


def _velocity(columns: Columns, north: _North) -> FloatArray | None:
    speed, track, climb = (columns.get(key) for key in ("speed", "course", "up"))
    if speed is None or track is None or climb is None or north.track is None:
        return None
    course = track + north.track
    return np.column_stack((speed * np.cos(course), speed * np.sin(course), -climb))


def _attitude(columns: Columns, north: _North) -> FloatArray | None:
    euler = columns.vector("roll", "pitch", "yaw")
    if euler is None or north.heading is None:
        return None
    euler[:, 2] += north.heading
    return euler
