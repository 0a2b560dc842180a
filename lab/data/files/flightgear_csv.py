"""FlightGear csv: its logger's file, headed by titles from the user or by the paths of the properties.

Titles are read as a quantity and a unit, ``Altitude (ft)``; without a unit it is FlightGear's own. The first
column is the time since the start of the simulator, in milliseconds or, from newer versions, in seconds;
the speed that results decides which.

References
----------
FlightGear, *docs-mini/README.logging*.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lab.base.files.file_content import TextBlocks
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.files import jsbsim_csv
from lab.data.files.fields import (
    NAMED,
    OF_THE_FORMAT,
    SEA_LEVEL,
    Columns,
    Field,
    one_file,
    raw_flight,
    read_columns,
)
from lab.data.files.table import head_lines, plain
from lab.data.files.unit_names import unit_name
from lab.data.rebuild.raw_flight import RawFlight
from lab.motion.frames import ecef

NAME = "FlightGear csv"

GUESSED = "guessed"

_TITLES = {
    "time": ("time", "simtime", "elapsedtime", "timeelapsed", "elapsed"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "long"),
    "height": ("altitude", "alt", "altitudemsl", "altitudeasl", "elevationmsl", "height"),
    "roll": ("roll", "bank", "rollangle", "bankangle", "phi"),
    "pitch": ("pitch", "pitchangle", "theta"),
    "heading": ("heading", "headingtrue", "trueheading", "yaw", "hdg", "psi"),
    "north": ("speednorth", "northspeed", "velocitynorth", "northvelocity", "vnorth", "vn"),
    "east": ("speedeast", "eastspeed", "velocityeast", "eastvelocity", "veast", "ve"),
    "down": ("speeddown", "downspeed", "velocitydown", "downvelocity", "vdown", "vd"),
}
_PATHS = {
    "/sim/time/elapsed-sec": ("time", "s"),
    "/position/latitude-deg": ("latitude", "°"),
    "/position/longitude-deg": ("longitude", "°"),
    "/position/altitude-ft": ("height", "ft"),
    "/orientation/roll-deg": ("roll", "°"),
    "/orientation/pitch-deg": ("pitch", "°"),
    "/orientation/heading-deg": ("heading", "°"),
    "/velocities/speed-north-fps": ("north", "ft/s"),
    "/velocities/speed-east-fps": ("east", "ft/s"),
    "/velocities/speed-down-fps": ("down", "ft/s"),
}
_QUANTITIES = {
    "time": ("time", "s"),
    "height": ("length", "ft"),
    **dict.fromkeys(("latitude", "longitude", "roll", "pitch", "heading"), ("angle", "°")),
    **dict.fromkeys(("north", "east", "down"), ("speed", "ft/s")),
}
_HEADING = re.compile(
    r"\s*([A-Za-z][A-Za-z _]*?)\s*"
    r"(?:[(\[]([^)\]]{1,20}?)(?:\s*(?:msl|asl|amsl|true))?[)\]]|-(deg|rad|ft|m|fps|kt|s))?\s*",
    re.IGNORECASE,
)
_MILLISECOND = 1e-3
"""[s]."""
_MAX_HEADER_LINE = 20
"""Last line on which the header may stand."""
_MAX_SPEED = 400.0
"""Median speed up to which a time counts in milliseconds [m/s]: FlightGear's fastest aircraft fly faster,
but not half of a flight."""
_MIN_COLUMNS = 3
"""Fewest columns: the time and a position, without its height."""
_MIN_MILLISECONDS = 5.0
"""Median step of the time from which it may be in milliseconds: nobody logs a sample in five seconds, and no
logger 200 a second."""
_ADVICE = (
    "Accepted is a log of FlightGear with the properties /position/latitude-deg, longitude-deg, altitude-ft, "
    "and best /orientation/roll-deg, pitch-deg, heading-deg and /velocities/speed-north-fps, speed-east-fps, "
    "speed-down-fps."
)


def recognises(head: bytes) -> bool:
    """Return whether a file has a header with time, latitude and longitude in units, and then numbers."""
    # A simulator knows no accuracy, which the receivers of phones give under the same headings.
    lines = head_lines(head)
    if any("accuracy" in line.lower() for line in lines[:_MAX_HEADER_LINE]):
        return False
    return _fields(lines) is not None and not jsbsim_csv.recognises(head)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read a csv of FlightGear's logger.

    Raises
    ------
    MissionError
        For whatever is wrong with the file.
    """
    path = one_file(paths, NAME)
    with TextBlocks(path, MAX_BYTES, strict=False) as text:
        lines = [line for line, _ in zip(text.lines(), range(_MAX_HEADER_LINE), strict=False)]
    fields = _fields(lines)
    if fields is None:
        raise MissionError(f"{path}: has no header with time, latitude and longitude in units. {_ADVICE}")
    needed = [field.names for field in fields if field.key in ("time", "latitude", "longitude")]
    columns = read_columns(path, fields, units, needed)
    remarks = [SEA_LEVEL] if "height" in columns.values else []
    remarks += _clock(columns)
    return raw_flight(
        NAME,
        columns,
        velocity_n=columns.vector("north", "east", "down"),
        euler=columns.vector("roll", "pitch", "heading"),
        remarks=remarks,
    )


def _fields(lines: Sequence[str]) -> list[Field] | None:
    """Return what the columns are; None unless there are time and a position in units, over numbers."""
    for place, line in enumerate(lines[:_MAX_HEADER_LINE]):
        for delimiter in ",;\t|":
            cells = _cells(line, delimiter)
            if len(cells) < _MIN_COLUMNS:
                continue
            fields = {field.key: field for cell in reversed(cells) if (field := _field(cell)) is not None}
            sure = [fields[key].source for key in ("latitude", "longitude") if key in fields]
            if "time" not in fields or sure != [NAMED, NAMED]:
                continue
            column = [plain(cell) for cell in cells].index(fields["time"].names[0])
            first = next((row for row in lines[place + 1 :] if row.strip()), "")
            if _is_number(_cells(first, delimiter), column):
                return list(fields.values())
    return None


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter not in line:
        return []
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return line.split(delimiter)


def _is_number(cells: Sequence[str], place: int) -> bool:
    try:
        return place < len(cells) and np.isfinite(float(cells[place]))
    except ValueError:
        return False


def _field(cell: str) -> Field | None:
    """Return what a heading is: a property's path, or a title of a quantity and its unit."""
    path = "/" + cell.strip().lower().lstrip("/").removesuffix("[0]")
    if path in _PATHS:
        key, unit = _PATHS[path]
        return Field(key, (plain(cell),), _QUANTITIES[key][0], unit, NAMED)
    found = _HEADING.fullmatch(cell)
    if found is None:
        return None
    title = plain(found[1])
    # Blanks and underscores are gone: a unit may stand at the end of the title.
    said = next((title.removesuffix(tail) for tail in ("deg", "ft", "fps") if title.endswith(tail)), title)
    key = next((key for key, titles in _TITLES.items() if title in titles or said in titles), "")
    if not key:
        return None
    quantity, usual = _QUANTITIES[key]
    spelling = found[2] or found[3] or (title.removeprefix(said) if title not in _TITLES[key] else "")
    try:
        unit = unit_name(quantity, spelling) if spelling else usual
    except MissionError:
        return None
    return Field(key, (plain(cell),), quantity, unit, NAMED if spelling else OF_THE_FORMAT)


def _clock(columns: Columns) -> list[str]:
    """Read the time as milliseconds where it is in whole numbers and steps of seconds would be too long."""
    time = columns.values["time"]
    step = float(np.median(np.abs(np.diff(time))))
    if columns.units["time"].source != OF_THE_FORMAT or step < _MIN_MILLISECONDS or (time % 1).any():
        return []
    place = ecef.position(
        np.column_stack((columns.values["latitude"], columns.values["longitude"], 0 * time))
    )
    distance = float(np.median(np.linalg.norm(np.diff(place, axis=0), axis=1)))
    if distance > _MAX_SPEED * step * _MILLISECOND:
        return []
    columns.values["time"] = time * _MILLISECOND
    columns.units["time"] = replace(columns.units["time"], unit="ms", source=GUESSED)
    return ["The time is taken as milliseconds, which FlightGear's logger writes."]
