"""Fixes: the points of a recorder, with or without a position, as a track.

Points that are marked, and those at exactly 0° N 0° E, have no fix: receivers write zeros before their first.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import DAY
from lab.data.files.track import Track
from lab.data.rebuild.raw_flight import ColumnUnit, Dropped

UNKNOWN = float("nan")
"""What stands for a number that a point does not have."""
NO_FIX = "without a fix"
"""Why points without a position are left out."""

_MAX_BACK = 0.25 * DAY
"""How far a time of day may lie before the last one and be of the same day, out of order [s]: beyond it,
it is of the next day."""
_DATE_LETTERS = 10
"""Letters of a date without a time, 2026-01-31."""


@dataclass
class Fixes:
    """Points with a fix as they are read, in the order of the file; NaN where unknown.

    Attributes
    ----------
    time, latitude, longitude, height : arrays
        Time [s], position [°], height [m].
    line : array
        Line, or number of the message, of each.
    unfixed, first_unfixed : int
        How many points without a fix there were besides, and the line of the first.
    """

    time: array[float] = field(default_factory=lambda: array("d"))
    latitude: array[float] = field(default_factory=lambda: array("d"))
    longitude: array[float] = field(default_factory=lambda: array("d"))
    height: array[float] = field(default_factory=lambda: array("d"))
    line: array[int] = field(default_factory=lambda: array("q"))
    unfixed: int = 0
    first_unfixed: int = 0

    def add(self, time: float, latitude: float, longitude: float, height: float, line: int) -> bool:
        """Add a point; return whether it has a fix. Those that have none are only counted."""
        if math.isnan(latitude) or math.isnan(longitude) or latitude == longitude == 0:
            self.unfixed += 1
            self.first_unfixed = self.first_unfixed or line
            return False
        self.time.append(time)
        self.latitude.append(latitude)
        self.longitude.append(longitude)
        self.height.append(height)
        self.line.append(line)
        return True

    @property
    def count(self) -> int:
        """How many points were read, with or without a fix."""
        return len(self.line) + self.unfixed

    def track(
        self,
        path: Path,
        reader: str,
        columns: tuple[ColumnUnit, ...],
        *,
        over_ground: tuple[tuple[ColumnUnit, ...], array[float], array[float]] | None = None,
        rows: NDArray[np.bool_] | None = None,
        unread: Dropped | None = None,
        dropped: tuple[Dropped, ...] = (),
        remarks: tuple[str, ...] = (),
        vehicle: str = "",
    ) -> Track:
        """Return the points with a fix as a track.

        Parameters
        ----------
        path
            The file.
        reader
            Name of the format.
        columns
            What the file calls latitude, longitude and height, with their units.
        over_ground
            What the file calls speed and course, and their values [m/s], [°], NaN where unknown; none
            by default.
        rows : (n,) array, optional
            Which points are of this track; all by default. The others are in `dropped`.
        unread : Dropped, optional
            Points that could not be read at all.
        dropped, remarks, vehicle
            As of `RawFlight`.
        """
        dropped = (unread, *dropped) if unread is not None and unread.count else dropped
        if self.unfixed:
            dropped = (*dropped, Dropped(NO_FIX, self.unfixed, self.first_unfixed))
        kept: NDArray[np.bool_] | slice = slice(None) if rows is None or rows.all() else rows
        unknown = array("d", [UNKNOWN]) * len(self.line)
        none = (ColumnUnit("", "m/s", ""), ColumnUnit("", "°", "")), unknown, unknown
        named, speed, course = over_ground or none
        return Track(
            path=path,
            format=reader,
            time=_view(self.time)[kept],
            latitude=_view(self.latitude)[kept],
            longitude=_view(self.longitude)[kept],
            height=_view(self.height)[kept],
            speed=_view(speed)[kept],
            course=_view(course)[kept],
            lines=np.array(self.line, dtype=np.int64)[kept],
            columns=(*columns, *named),
            rows_read=self.count + (0 if unread is None else unread.count),
            dropped=dropped,
            remarks=remarks,
            vehicle=vehicle,
        )


def _view(values: array[float]) -> NDArray[np.float64]:
    """Return numbers without a copy: a long track should not be in memory twice."""
    return np.frombuffer(values, dtype=np.float64) if values else np.empty(0)


class UtcClock:
    """Seconds since the midnight, in UTC, before the first time of a file that is written with its date.

    Attributes
    ----------
    start : datetime or None
        That midnight; None before the first time.
    unzoned : int
        Times that named no zone and were taken as UTC.
    """

    def __init__(self) -> None:
        self.start: datetime | None = None
        self.unzoned = 0

    def seconds(self, text: str) -> float:
        """Return the seconds of a time as ISO 8601 writes it; NaN if it is no time of a day."""
        text = text.strip()
        try:
            time = datetime.fromisoformat(text)
        except ValueError:
            return UNKNOWN
        if len(text) <= _DATE_LETTERS:
            return UNKNOWN
        if time.tzinfo is None:
            self.unzoned += 1
            time = time.replace(tzinfo=UTC)
        try:
            if self.start is None:
                self.start = time.astimezone(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
            return (time - self.start).total_seconds()
        except OverflowError:
            return UNKNOWN

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person should know of the time."""
        if self.start is None:
            return ()
        said = f"Time counts from {self.start:%Y-%m-%d} 00:00 UTC."
        if not self.unzoned:
            return (said,)
        return (said, f"{self.unzoned} times name no time zone and are taken as UTC.")


def after(before: float, time_of_day: float) -> float:
    """Return the time of a day that follows another time, on the same day or past midnight.

    Parameters
    ----------
    before
        Time of the point before, counted over days [s].
    time_of_day
        Since midnight [s].

    Returns
    -------
    float
        At most 6 h earlier, for points that are out of order, and less than 18 h later [s].
    """
    return before + (time_of_day - before + _MAX_BACK) % DAY - _MAX_BACK


def number(text: str | bytes | None) -> float:
    """Return a number, NaN for what is none."""
    try:
        return UNKNOWN if text is None else float(text)
    except ValueError:
        return UNKNOWN
