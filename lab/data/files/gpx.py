"""GPX: the track of a satellite receiver, a phone or a watch: position, height and time of each point.

Versions 1.0 and 1.1 (https://www.topografix.com/GPX/1/1). The longest of several segments is used,
together with the adjacent ones that it continues: loggers begin a new segment at each pause; speed and
course are read where a file has them (version 1.0, or Garmin's track point extension).
"""

from __future__ import annotations

import itertools
from array import array
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.base.files.bounds import LATITUDES, LONGITUDES
from lab.base.files.mission_error import MissionError
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.fixes import UNKNOWN, UtcClock, number
from lab.data.files.track import Track, pressure_copies
from lab.data.files.xml_elements import has_root, read_elements
from lab.data.rebuild.raw_flight import Dropped, RawFlight
from lab.motion.frames import ecef

NAME = "GPX"

_MAX_VEHICLE = 64
"""Letters kept of the type of a track."""
_OF_A_POINT = frozenset(("ele", "time", "speed", "course"))
_UNITS = {"lat": "°", "lon": "°", "ele": "m", "speed": "m/s", "course": "°"}
_MAX_APART, _MAX_PAUSE_SPEED = 300.0, 100.0
"""How far away a segment may begin to continue one [m], and by how much more for each second between them
[m/s]. As in `lab.data.rebuild.row_repair`, what is further away is a jump."""
_MAX_PAUSE = 3600.0
"""Longest pause between segments of one track [s]."""


recognises = partial(has_root, root="gpx")
"""Return whether a file starts like GPX."""


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the longest segment of the tracks in a GPX file, and those it continues.

    Raises
    ------
    MissionError
        If the file cannot be read, is too large or no XML, declares a document type, or has too few points
        with time and position.
    """
    path = one_file(paths, NAME, fixed=units)
    points = _Points(path)
    broken = read_elements(path, NAME, points)
    return points.track(broken).flight()


class _Points:
    """The points of a file, as its elements come."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._columns = {name: array("d") for name in ("lat", "lon", *sorted(_OF_A_POINT))}
        self._lines, self._segments = array("q"), array("q")
        self._segment = self._line = 0
        self._point: dict[str, float] | None = None
        self._title, self._titles = "", dict[int, str]()
        self._copies: dict[int, str] = {}
        self._clock = UtcClock()
        self._vehicle = ""

    def track(self, broken: str) -> Track:
        """Return the points of the longest segment and of those it continues.

        Parameters
        ----------
        broken
            Where the file is broken and how; empty if it is whole.

        Raises
        ------
        MissionError
            If there are none.
        """
        segments = self._without_copies()
        if not len(segments):
            what = f" It is broken in {broken}." if broken else ""
            raise MissionError(
                f"{self._path}: has no track points.{what} Accepted is a GPX file with a track (trk); "
                "routes and waypoints have no times"
            )
        kept = self._find_longest_segment(segments)
        lines = np.array(self._lines, dtype=np.int64)
        values = {name: np.array(column)[kept] for name, column in self._columns.items()}
        timed = np.isfinite(values["time"])
        if not timed.any():
            raise MissionError(
                f"{self._path}: none of the {len(timed)} points of the track from row {lines[kept][0]} on "
                "has a time; accepted are recorded tracks, not planned routes"
            )
        return Track(
            path=self._path,
            format=NAME,
            time=values["time"],
            latitude=values["lat"],
            longitude=values["lon"],
            height=values["ele"],
            speed=values["speed"],
            course=values["course"],
            lines=lines[kept],
            columns=units_of_the_format(_UNITS),
            rows_read=len(segments),
            dropped=Dropped.of("of a shorter track or segment", ~kept, lines),
            remarks=self._remarks(values["ele"], broken),
            vehicle=self._vehicle,
        )

    def _without_copies(self) -> NDArray[np.int64]:
        """Leave out tracks that are copies with pressure altitudes; return the segment of each point."""
        segments = np.array(self._segments, dtype=np.int64)
        self._copies = pressure_copies(self._titles, segments, np.array(self._columns["time"]))
        kept = ~np.isin(segments, list(self._copies))
        if not kept.all():
            self._columns = {name: array("d", np.array(one)[kept]) for name, one in self._columns.items()}
            self._lines = array("q", np.array(self._lines)[kept])
        return segments[kept]

    def _find_longest_segment(self, segments: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which points belong to the longest segment, or to an adjacent one on the same path."""
        time, latitude, longitude = (np.array(self._columns[name]) for name in ("time", "lat", "lon"))
        on_earth = (np.abs(latitude) <= LATITUDES[1]) & (np.abs(longitude) <= LONGITUDES[1])
        usable = np.flatnonzero(np.isfinite(time) & on_earth)
        longest = int(np.bincount(segments).argmax())
        kept: NDArray[np.bool_] = segments == longest
        edges = np.flatnonzero(np.diff(segments[usable])) + 1
        parts = [part for part in np.split(usable, edges) if len(part)]
        at = next((i for i, part in enumerate(parts) if segments[part[0]] == longest), None)
        if at is None:
            return kept
        for follows in (parts[at:], parts[at::-1]):
            for one, other in itertools.pairwise(follows):
                first, then = (one, other) if one[0] < other[0] else (other, one)
                pause = time[then[0]] - time[first[-1]]
                ends = np.array((first[-1], then[0]))
                distance = np.linalg.norm(np.diff(_place_in_ecef(latitude[ends], longitude[ends]), axis=0))
                if not (0 <= pause <= _MAX_PAUSE and distance <= _MAX_APART + _MAX_PAUSE_SPEED * pause):
                    break
                kept |= segments == segments[other[0]]
        return kept

    def _remarks(self, height: NDArray[np.float64], broken: str) -> tuple[str, ...]:
        remarks = list(self._clock.remarks)
        if np.isfinite(height).any():
            remarks.append(SEA_LEVEL)
        remarks += self._copies.values()
        if broken:
            remarks.append(f"The file is broken in {broken}. The rest is not read.")
        return tuple(remarks)

    def begin(self, name: str, attributes: Mapping[str, str], line: int) -> None:
        """Take the start of an element."""
        if name == "trk":
            self._title = ""
        elif name == "trkseg":
            self._segment += 1
            self._titles[self._segment] = self._title
        elif name == "trkpt":
            self._point = {key: number(attributes.get(key)) for key in ("lat", "lon")}
            self._line = line

    def end(self, name: str, text: str) -> None:
        """Take the end of an element."""
        if self._point is not None:
            if name == "trkpt":
                for key, column in self._columns.items():
                    column.append(self._point.get(key, UNKNOWN))
                self._segments.append(self._segment)
                self._lines.append(self._line)
                self._point = None
            elif name in _OF_A_POINT:
                self._point[name] = self._clock.seconds(text) if name == "time" else number(text)
        elif name == "name":
            self._title = text.strip()
        elif name == "type" and not self._vehicle:
            self._vehicle = text.strip()[:_MAX_VEHICLE]


def _place_in_ecef(latitude: NDArray[np.float64], longitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places on the ellipsoid (n, 3) [m]."""
    angles = np.radians((latitude, longitude))
    return ecef.position(np.column_stack((*angles, np.zeros_like(latitude))))
