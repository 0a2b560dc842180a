r"""Tacview ACMI 2.x: the flights of many objects, as simulators of air combat and recorders write them.

A line is a time since the reference, ``#47.13``, or an object with what has changed,
``104,T=longitude|latitude|altitude|roll|pitch|yaw``, or the end of one, ``-104``. Places count from a
reference longitude and latitude, heights from the sea; what is left out has not changed. One object makes the
flight: of those in the air that with most positions. Files may be zipped.

References
----------
Raia Software, *Technical Reference, ACMI flight recordings 2.2*, https://www.tacview.net/documentation/acmi/en/
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lab.base.files.file_content import ZIP, read_whole, unzip_files
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.fixes import UNKNOWN, number
from lab.data.files.track import Track
from lab.data.rebuild.raw_flight import Dropped, RawFlight

NAME = "Tacview ACMI"

_HEAD = re.compile(rb"(?:\xef\xbb\xbf)?\s*FileType=text/acmi/tacview")
_VERSION = re.compile(rb"FileVersion=\s*([0-9.]{1,10})")
_ENDING = b".acmi"
_ZIP_NAME = 400
"""Bytes at the start of a zip file in which the name of its first file stands."""
_VERSIONS = "2."
_PART = re.compile(rb"(?<!\\),")
"""A comma that is not part of a text."""
_LINE = re.compile(rb"(?:[^\n\\]+|\\\r?\n|\\.)+", re.DOTALL)
"""A line with those that go on after a backslash."""
_FIELDS = {3: (0, 1, 2), 5: (0, 1, 2), 6: (0, 1, 2, 3, 4, 5), 9: (0, 1, 2, 3, 4, 5)}
"""Which components of T are read, by how many there are: a native flat world has two or three more."""
_VEHICLES = (
    ("Rotorcraft", "copter"), ("Air", "aircraft"), ("Watercraft", "boat"), ("Sea", "boat"),
    ("Human", "pedestrian"), ("Missile", "rocket"), ("Rocket", "rocket"), ("Ground", "car"),
)  # fmt: skip
"""Vehicles by the words of a type."""
_COLUMNS = {"Longitude": "°", "Latitude": "°", "Altitude": "m", "": "m/s", " ": "°"}
"""Columns with their units; there is neither speed nor course."""
_ROW = 8
"""Numbers of a row: time, line, and the six of a place."""
_FEW_OBJECTS, _OBJECT_BYTES = 1000, 150
"""Objects that are read of any file, and bytes of it for each further one: what is said of one has some."""
_MAX_NAMED = 5
"""Most of them that are named in the report."""
_MAX_TEXT = 40
"""Most characters of a name in the report: the file is hostile."""
_READ = {"T", "Type", "Name", "Pilot", "CallSign"}
"""Properties of an object that are used; the others are listed."""
_OF_ALL = (b"ReferenceTime", b"ReferenceLongitude", b"ReferenceLatitude")
"""Properties of a recording that are used."""
_TEXTS = {
    "Color", "Coalition", "Country", "Group", "Registration", "Squawk", "Importance", "Slot", "Parent",
    "Next", "ShortName", "LongName", "FullName", "Label", "Comments", "Debug", "Shape", "Visible", "Disabled",
}  # fmt: skip
"""Properties that are no measurement."""


@dataclass(slots=True)
class _Object:
    """An object from its first line to its end.

    Attributes
    ----------
    key : bytes
        Its number.
    texts : dict
        Name, type and pilot.
    now : array
        The latest longitude, latitude [°], height [m], roll, pitch and yaw [°].
    rows : array
        All of them, each after its time [s] and line.
    """

    key: bytes
    texts: dict[str, str] = field(default_factory=dict)
    now: array[float] = field(default_factory=lambda: array("d", [UNKNOWN] * 6))
    rows: array[float] = field(default_factory=lambda: array("d"))

    @property
    def count(self) -> int:
        """How many positions it has."""
        return len(self.rows) // _ROW

    @property
    def vehicle(self) -> str:
        words = self.texts.get("Type", "").split("+")
        return next((vehicle for word, vehicle in _VEHICLES if word in words), "")

    @property
    def label(self) -> str:
        """What it is called."""
        named = [self.texts[one][:_MAX_TEXT] for one in ("Name", "Pilot", "CallSign") if self.texts.get(one)]
        return f"{', '.join(named) or 'an object'} ({self.key.decode('ascii', 'replace')[:_MAX_TEXT]})"


def recognises(head: bytes) -> bool:
    """Return whether a file starts like ACMI, or is a zip file of one."""
    return _HEAD.match(head) is not None or (head.startswith(ZIP) and _ENDING in head[:_ZIP_NAME])


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the flight of the object in the air that has most positions.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, is of another version, or has too few positions.
    """
    path = one_file(paths, NAME, fixed=units)
    data = _text(path, read_whole(path, MAX_BYTES))
    version = _VERSION.search(data[:1000])
    if _HEAD.match(data) is None or version is None or not version[1].startswith(_VERSIONS.encode()):
        said = version[1].decode() if version else "none"
        raise MissionError(f"{path}: {NAME} of version {said}; accepted is {_VERSIONS}x")
    objects = _Objects(_FEW_OBJECTS + len(data) // _OBJECT_BYTES)
    for line, text in _lines(data):
        objects.accept(text, line)
    return _flight(path, objects)


def _text(path: Path, data: bytes) -> bytes:
    """Return the text of a file, or of the first recording in a zip file."""
    if not data.startswith(ZIP):
        return data
    ending = _ENDING.decode()
    found = unzip_files(
        path, data, lambda names: [one for one in names if one.lower().endswith(ending)][:1], MAX_BYTES
    )
    if not found:
        raise MissionError(f"{path}: the zip file has no {ending} file in it; accepted is one")
    return found[0][1]


def _lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Iterate over lines with their numbers; one that goes on in the next counts once."""
    line, at = 1, 0
    for found in _LINE.finditer(data):
        line += data.count(b"\n", at, found.start())
        at = found.start()
        yield line, found[0].rstrip(b"\r")


class _Objects:
    """The objects of a file, as its lines come, up to a number of them."""

    def __init__(self, most: int) -> None:
        self._most = most
        self.all: list[_Object] = []
        self.texts: dict[str, str] = {}
        self.unused: dict[str, None] = {}
        self.broken = self.first_broken = self.left = 0
        self._now = UNKNOWN
        self._alive: dict[bytes, _Object] = {}

    def accept(self, text: bytes, line: int) -> None:
        """Take a line."""
        if text.startswith(b"#"):
            self._now = number(text[1:].strip())
        elif text.startswith(b"-"):
            self._alive.pop(text[1:].strip(), None)
        elif not text.startswith(b"//") and b"," in text:
            key, *parts = _PART.split(text)
            self._change(key.strip(), parts, line)

    def _change(self, key: bytes, parts: Sequence[bytes], line: int) -> None:
        """Take what has changed of an object, or of all: number 0."""
        if key == b"0":
            for part in parts:
                name, _, value = part.partition(b"=")
                if name in _OF_ALL:
                    self.texts[name.decode()] = value.decode("utf-8", "replace").strip()
            return
        one = self._alive.get(key)
        if one is None:
            if len(self.all) >= self._most:
                self.left += 1
                return
            one = self._alive[key] = _Object(key)
            self.all.append(one)
        for part in parts:
            name, _, value = part.partition(b"=")
            if name == b"T":
                self._move(one, value, line)
                continue
            word = name.decode("utf-8", "replace")[:_MAX_TEXT]
            if word in _READ:
                one.texts[word] = value.decode("utf-8", "replace").replace("\\,", ",")
            elif len(self.unused) < _FEW_OBJECTS:
                self.unused[word] = None

    def _move(self, one: _Object, value: bytes, line: int) -> None:
        cells = value.split(b"|")
        known = _FIELDS.get(len(cells))
        if known is None:
            self.broken += 1
            self.first_broken = self.first_broken or line
            return
        changed = False
        for at in known:
            if cells[at].strip():
                one.now[at] = number(cells[at])
                changed = True
        if changed:
            one.rows.extend((self._now, line, *one.now))


def _flight(path: Path, objects: _Objects) -> RawFlight:
    """Return the flight of the object that is read."""
    moving = [one for one in objects.all if one.rows]
    if not moving:
        raise MissionError(
            f"{path}: none of its {len(objects.all)} objects has a position; accepted is a recording with T="
        )
    flown = [one for one in moving if "Air" in one.texts.get("Type", "").split("+")]
    best = max(flown or moving, key=lambda one: one.count)
    east, north = (number(objects.texts.get(f"Reference{name}", "0")) for name in ("Longitude", "Latitude"))
    time, line, longitude, latitude, height, *euler = np.array(best.rows).reshape(-1, _ROW).T
    unread = Dropped("with a T of another number of components", objects.broken, objects.first_broken)
    unknown = np.full(len(time), np.nan)
    return Track(
        path=path, format=NAME, time=time, latitude=latitude + np.nan_to_num(north),
        longitude=longitude + np.nan_to_num(east), height=height, speed=unknown, course=unknown,
        lines=line.astype(np.int64), rows_read=len(time) + objects.broken,
        columns=units_of_the_format(_COLUMNS),
        dropped=(unread,) if objects.broken else (), remarks=_remarks(objects, best, len(moving)),
        vehicle=best.vehicle, euler=np.radians(np.column_stack(euler)),
    ).flight()  # fmt: skip


def _remarks(objects: _Objects, best: _Object, moving: int) -> tuple[str, ...]:
    began = objects.texts.get("ReferenceTime", "")[:_MAX_TEXT]
    remarks = [f"Time counts from {began or 'a reference that the file does not name'}.", SEA_LEVEL]
    if moving > 1:
        remarks.append(
            f"The flight is that of {best.label}, which of {moving} objects has most positions of those in "
            "the air."
        )
    if objects.left:
        remarks.append(f"{objects.left} lines of further objects are not read, since there are so many.")
    unused = [name for name in objects.unused if name not in _TEXTS]
    if unused:
        more = f" and {len(unused) - _MAX_NAMED} more" if len(unused) > _MAX_NAMED else ""
        remarks.append(f"Not read: {', '.join(unused[:_MAX_NAMED])}{more}.")
    return tuple(remarks)
