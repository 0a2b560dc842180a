"""TCX: activities of Garmin Training Center and compatible programs: position, height and time of each point.

The tracks of an activity's laps are joined; the longest of several activities is used. Recorded speeds are
not used: they have no direction.

References
----------
Garmin, *TrainingCenterDatabase v2*, https://www8.garmin.com/xmlschemas/TrainingCenterDatabasev2.xsd
"""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from lab.base.files.mission_error import MissionError
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.fixes import UNKNOWN, Fixes, UtcClock, number
from lab.data.files.xml_elements import has_root, read_elements
from lab.data.rebuild.raw_flight import Dropped, RawFlight

NAME = "TCX"

_OF_A_POINT = {"LatitudeDegrees", "LongitudeDegrees", "AltitudeMeters"}


recognises = partial(has_root, root="TrainingCenterDatabase")
"""Return whether a file starts like TCX."""


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the longest activity in a TCX file.

    Raises
    ------
    MissionError
        If the file cannot be read, is too large or no XML, declares a document type, or has too few points
        with time and position.
    """
    path = one_file(paths, NAME, fixed=units)
    points = _Points()
    broken = read_elements(path, NAME, points)
    if not points.fixes.count:
        what = f" It is broken in {broken}." if broken else ""
        raise MissionError(
            f"{path}: has no track points.{what} Accepted is a TCX file with an activity that was recorded "
            "with positions"
        )
    activities = np.array(points.of_activity, dtype=np.int64)
    chosen = int(np.bincount(activities, minlength=1).argmax())
    kept = activities == chosen
    remarks = list(points.clock.remarks)
    if np.isfinite(np.array(points.fixes.height)[kept]).any():
        remarks.append(SEA_LEVEL)
    if points.planned[chosen]:
        remarks.append("This is a course, not an activity: its times may be planned and not recorded.")
    if points.speeds:
        remarks.append("The speed in the file is not used: it has no direction.")
    if broken:
        remarks.append(f"The file is broken in {broken}. The rest is not read.")
    return points.fixes.track(
        path,
        NAME,
        units_of_the_format({"LatitudeDegrees": "°", "LongitudeDegrees": "°", "AltitudeMeters": "m"}),
        rows=kept,
        dropped=Dropped.of("of a shorter activity", ~kept, points.fixes.line),
        remarks=tuple(remarks),
        vehicle=points.sports[chosen],
    ).flight()


class _Points:
    """The points of a file, as its elements come; each has the number of its activity or course."""

    def __init__(self) -> None:
        self.clock = UtcClock()
        self.fixes = Fixes()
        self.of_activity = array("q")
        self.sports, self.planned = [""], [False]
        self.speeds = 0
        self._time = UNKNOWN
        self._line = 0
        self._point: dict[str, float] | None = None

    def begin(self, name: str, attributes: Mapping[str, str], line: int) -> None:
        """Take the start of an element."""
        if name in {"Activity", "Course"}:
            self.sports.append(attributes.get("Sport", "")[:40])
            self.planned.append(name == "Course")
        elif name == "Trackpoint":
            self._point, self._time, self._line = {}, UNKNOWN, line

    def end(self, name: str, text: str) -> None:
        """Take the end of an element."""
        if self._point is None:
            return
        if name == "Trackpoint":
            latitude, longitude, height = (
                self._point.get(key, UNKNOWN)
                for key in ("LatitudeDegrees", "LongitudeDegrees", "AltitudeMeters")
            )
            if self.fixes.add(self._time, latitude, longitude, height, self._line):
                self.of_activity.append(len(self.sports) - 1)
            self._point = None
        elif name == "Time":
            self._time = self.clock.seconds(text)
        elif name in _OF_A_POINT:
            self._point[name] = number(text)
        elif name == "Speed":
            self.speeds += 1
