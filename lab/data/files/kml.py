"""KML: the tracks with times (``gx:Track``) of Google Earth, phones and flight trackers.

Each track lists times (``when``) and places (``gx:coord``: longitude, latitude, height) in the same order.
The longest of several is used. Lines and points without times are drawings, not recordings.

References
----------
Google, *KML Reference*, https://developers.google.com/kml/documentation/kmlreference#gxtrack
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.base.files.mission_error import MissionError
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.fixes import UNKNOWN, Fixes, UtcClock, number
from lab.data.files.track import pressure_copies
from lab.data.files.xml_elements import has_root, read_elements
from lab.data.rebuild.raw_flight import Dropped, RawFlight

NAME = "KML"

_OVER_GROUND = ("relativeToGround", "relativeToSeaFloor")
_DRAWN_ON_GROUND = ("", "clampToGround", "clampToSeaFloor")
_MAX_NAMES, _MAX_NAME = 10, 40
"""Most quantities that the report names as not used, and most characters of each: the file is hostile."""
_ACCEPTED = "accepted is KML with a track of times and places (gx:Track), or with points that have times"


recognises = partial(has_root, root="kml")
"""Return whether a file starts like KML."""


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the longest track in a KML file.

    Raises
    ------
    MissionError
        If the file cannot be read, is too large or no XML, declares a document type, or has no track that can
        be used.
    """
    path = one_file(paths, NAME, fixed=units)
    tracks = _Tracks()
    broken = read_elements(path, NAME, tracks)
    if not tracks.times or not tracks.latitude:
        raise MissionError(f"{path}: {_describe_nothing(tracks, broken)}; {_ACCEPTED}")
    fixes, chosen, kept = tracks.fixes()
    times, places = tracks.counts(chosen)
    if times != places and not broken:
        row = tracks.line[int(np.argmax(np.array(tracks.of_time) == chosen))]
        raise MissionError(
            f"{path}: the track from row {row} on has {times} times (when) and {places} places (gx:coord); "
            "accepted are as many of one as of the other, since they go together in order"
        )
    remarks = [*tracks.clock.remarks, *_about_height(fixes, kept, tracks.modes.get(chosen, ""))]
    remarks += tracks.copies.values()
    if tracks.unused:
        remarks.append(f"Other data of the tracks is not used: {', '.join(tracks.unused)}.")
    if broken:
        remarks.append(f"The file is broken in {broken}. The rest is not read.")
    return fixes.track(
        path,
        NAME,
        units_of_the_format({"latitude": "°", "longitude": "°", "height": "m"}),
        rows=kept,
        dropped=Dropped.of("of a shorter track", ~kept, fixes.line),
        remarks=tuple(remarks),
    ).flight()


def _describe_nothing(tracks: _Tracks, broken: str) -> str:
    what = "has no track with times"
    if tracks.drawn:
        what += f", only {tracks.drawn} drawn lines and points"
    return f"{what}. It is broken in {broken}" if broken else what


class _Tracks:
    """The tracks of a file, as its elements come; each time and each place has the number of its track."""

    def __init__(self) -> None:
        self.clock = UtcClock()
        self.times, self.of_time, self.line = array("d"), array("q"), array("q")
        self.latitude, self.longitude, self.height = array("d"), array("d"), array("d")
        self.of_place = array("q")
        self.modes: dict[int, str] = {}
        self.names: dict[int, str] = {}
        self.copies: dict[int, str] = {}
        self.unused: list[str] = []
        self.drawn = self._tracks = self._line = 0
        self._inside = self._point = False
        self._when = UNKNOWN
        self._name = ""

    def begin(self, name: str, attributes: Mapping[str, str], line: int) -> None:
        """Take the start of an element."""
        if name == "Track":
            self._inside = True
            self._tracks += 1
            self.names[self._tracks] = self._name
        elif name == "when":
            self._line = line
        elif name == "Placemark":
            self._when, self._name = UNKNOWN, ""
        elif name in {"LineString", "Point"}:
            self.drawn += 1
            self._point = name == "Point"
        elif self._inside and name in {"angles", "SimpleArrayData"}:
            what = attributes.get("name", name)[:_MAX_NAME]
            if what not in self.unused and len(self.unused) < _MAX_NAMES:
                self.unused.append(what)

    def end(self, name: str, text: str) -> None:
        """Take the end of an element."""
        if not self._inside:
            self._end_outside(name, text)
        elif name == "Track":
            self._inside = False
        elif name == "when":
            self._time(self.clock.seconds(text))
        elif name == "coord":
            self._place(text)
        elif name == "altitudeMode" and self._tracks not in self.modes:
            self.modes[self._tracks] = text.strip()

    def _end_outside(self, name: str, text: str) -> None:
        """Take the end of an element of a placemark: points with a time are a track, number 0."""
        if name == "name":
            self._name = text.strip()
        if self._tracks:
            return
        if name == "when":
            self._when = self.clock.seconds(text)
        elif name == "coordinates" and self._point and np.isfinite(self._when):
            self._time(self._when)
            self._place(text)
            self.drawn -= 1
            self._when = UNKNOWN
        elif name == "altitudeMode" and self._point:
            self.modes.setdefault(0, text.strip())

    def _time(self, seconds: float) -> None:
        self.times.append(seconds)
        self.of_time.append(self._tracks)
        self.line.append(self._line)

    def _place(self, text: str) -> None:
        cells = text.replace(",", " ").split()
        longitude, latitude, height = ([number(cell) for cell in cells] + [UNKNOWN] * 3)[:3]
        self.longitude.append(longitude)
        self.latitude.append(latitude)
        self.height.append(height)
        self.of_place.append(self._tracks)

    def counts(self, track: int) -> tuple[int, int]:
        """Return how many times and how many places a track has."""
        return self.of_time.count(track), self.of_place.count(track)

    def fixes(self) -> tuple[Fixes, int, NDArray[np.bool_]]:
        """Return times with their places, the number of the longest track, and which are of it."""
        of_time, of_place = np.array(self.of_time), np.array(self.of_place)
        size = self._tracks + 1
        both = np.minimum(np.bincount(of_time, minlength=size), np.bincount(of_place, minlength=size))
        self.copies = pressure_copies(self.names, of_time, np.array(self.times))
        both[list(self.copies)] = 0
        # The n-th time of a track goes with its n-th place.
        placed, timed = (np.flatnonzero(_before_in_track(of) < both[of]) for of in (of_time, of_place))
        fixes, of_fix = Fixes(), array("q")
        for at, place in zip(placed.tolist(), timed.tolist(), strict=True):
            where = self.latitude[place], self.longitude[place], self.height[place]
            if fixes.add(self.times[at], *where, self.line[at]):
                of_fix.append(self.of_time[at])
        chosen = int(both.argmax())
        return fixes, chosen, np.array(of_fix, dtype=np.int64) == chosen


def _before_in_track(track: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how many of the same track come before each; tracks follow one another."""
    first = np.searchsorted(track, track)
    return np.asarray(np.arange(len(track)) - first)


def _about_height(fixes: Fixes, kept: NDArray[np.bool_], mode: str) -> tuple[str, ...]:
    """Return what a person should know of the heights; those that are none become NaN."""
    height = np.array(fixes.height)
    known = height[kept & np.isfinite(height)]
    if not known.size or not known.any():
        fixes.height[:] = array("d", [UNKNOWN]) * len(height)
        return ("The track has no heights.",)
    if mode in _OVER_GROUND:
        fixes.height[:] = array("d", [UNKNOWN]) * len(height)
        return (f"Heights are not used: the file has them above the ground ({mode}).",)
    if mode in _DRAWN_ON_GROUND:
        return (SEA_LEVEL, "The file has its track drawn on the ground; its heights are read all the same.")
    return (SEA_LEVEL,)
