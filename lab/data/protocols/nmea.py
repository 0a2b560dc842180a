"""NMEA 0183: the sentences of a receiver; those of one time of day make one fix.

Position comes from GGA, GNS or RMC, velocity from RMC or VTG, σ from GST, the date from RMC or ZDA. A fix
is complete with the last kind of sentence that the time of day before had, so it does not wait for the next
one; the first does. Sentences with a wrong or missing check are not taken; the check has 8 bits. The
velocity has no vertical part.

HDT and THS make headings. They have no time, and some devices send them without the other sentences, so the
time of their arrival stands for it. An estimated heading (mode E of THS) is not taken.

References
----------
NMEA 0183, *Standard for Interfacing Marine Electronic Devices*.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence

from lab.base.parameters.units import KNOT
from lab.data.files.nmea import FIELDS
from lab.data.protocols.device_time import utc_seconds
from lab.data.protocols.framing import MORE, NONE, Framing, xor8
from lab.data.protocols.rows import Rows
from lab.data.protocols.samples import FIX_3D, FIX_DIFFERENTIAL, FIX_RTK, FIX_RTK_FLOAT, NAN, NO_FIX

_SENTENCE = re.compile(rb"\$([A-Z]{2})([A-Z]{3}),([ -)+-~]*)\*([0-9A-Fa-f]{2})")
_STOP = re.compile(rb"[^ -)+-~]")
"""What no sentence has before its check: what is no text, a star."""
_NUMBER = re.compile(rb"[+-]?\d{1,10}(?:\.\d{0,12})?")
_HEADING_CELLS = 3  # name, heading, true north or status
_TURN = 360  # [°]
_DEGREE = 60  # minutes of arc
_CLOCK = 6  # digits of hhmmss
_CHECK = 3
"""Bytes of the check with its star."""
_SATELLITES = {"GGA": 7, "GNS": 7}  # cell with the number of satellites
# Cells of the sentences that no log reader takes.
_OTHERS = {
    "GST": {1: "time", 6: "north", 7: "east", 8: "up"},
    "ZDA": {1: "time", 2: "day", 3: "month", 4: "year"},
}
_QUALITIES = {
    b"1": FIX_3D, b"2": FIX_DIFFERENTIAL, b"3": FIX_3D, b"4": FIX_RTK, b"5": FIX_RTK_FLOAT, b"8": FIX_3D,
}  # fmt: skip
"""Kinds of fixes of GGA: 3 is the precise service, 8 a simulator; 6 (estimated) and 7 (typed in) are none."""
_MODES = {
    b"A": FIX_3D,
    b"D": FIX_DIFFERENTIAL,
    b"P": FIX_3D,
    b"R": FIX_RTK,
    b"F": FIX_RTK_FLOAT,
    b"S": FIX_3D,
}
"""The same of a system in GNS."""
_POSITIONS = frozenset(("GGA", "GNS", "RMC"))
_HEADINGS = {"HDT": b"T", "THS": b"AS"}
"""Sentences of a true heading, and what their second cell says of one that is measured or simulated."""


class Nmea(Framing):
    """Framing of sentences: ``$``, text, ``*``, an exclusive or of 8 bits.

    Parameters
    ----------
    silent
        Says whether fixes come from elsewhere in the same stream, and none are to be made of sentences.
    """

    first = b"$"
    longest = 200

    def __init__(self, silent: Callable[[], bool] = lambda: False) -> None:
        self._silent = silent
        self._epoch = _Epoch()
        self._usual: frozenset[str] = frozenset()
        self._date: tuple[int, int, int] | None = None

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the sentence that begins at a place, without its line end; `MORE` or `NONE`."""
        stop = _STOP.search(data, at + 1, at + self.longest - 2)
        dollar = data.find(b"$", at + 1, at + self.longest - 2 if stop is None else stop.start())
        if dollar >= 0:
            return NONE
        if stop is not None:
            return stop.start() + _CHECK - at if data[stop.start()] == ord("*") else NONE
        return MORE if len(data) - at < self.longest - 2 else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether this is a sentence with the check it says."""
        found = _SENTENCE.fullmatch(frame)
        return found is not None and int(found[4], 16) == xor8(frame[1:-_CHECK])

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Take what a sentence says, and add the fix it completes; return whether it is one that is read."""
        kind = frame[3:6].decode()
        if kind in _HEADINGS:
            return _add_heading(kind, frame, end, rows)
        places = FIELDS.get(kind) or _OTHERS.get(kind)
        cells = frame[:-_CHECK].split(b",")
        if places is None or len(cells) <= max(places) or frame[1:3] == b"VN":
            return False
        said = {name: cells[place] for place, name in places.items()}
        if "time" in said:
            now = _time(said["time"])
            if now is None:
                return True
            if now != self._epoch.now:
                self._complete(rows)
                self._epoch = _Epoch(now)
        self._accept(kind, said, cells)
        self._epoch.kinds.add(kind)
        self._epoch.end = end
        if self._usual and self._usual <= self._epoch.kinds:
            self._add(rows)
        return True

    def finish(self, rows: Rows) -> None:
        """Add the last fix."""
        self._complete(rows)

    def _complete(self, rows: Rows) -> None:
        if self._epoch.kinds & _POSITIONS:
            self._add(rows)
            self._usual = frozenset(self._epoch.kinds)

    def _accept(self, kind: str, said: dict[str, bytes], cells: Sequence[bytes]) -> None:
        epoch = self._epoch
        if "lat" in said:
            place = _angle(said["lat"], said["ns"], b"NS"), _angle(said["lon"], said["ew"], b"EW")
            if kind == "RMC" and said["mode"] != b"A":
                epoch.kind = epoch.kind or NO_FIX
            elif kind != "RMC" or math.isnan(epoch.place[0]):
                epoch.place = place
        if kind == "GGA":
            epoch.kind = _QUALITIES.get(said["quality"], NO_FIX)
        elif kind == "GNS":
            epoch.kind = max((_MODES.get(bytes((mode,)), NO_FIX) for mode in said["mode"]), default=NO_FIX)
        elif kind == "RMC" and not epoch.kind:
            epoch.kind = FIX_3D
        if kind in _SATELLITES:
            epoch.altitude, epoch.geoid = _number(said["altitude"]), _number(said["geoid"])
            satellites = _number(cells[_SATELLITES[kind]])
            epoch.satellites = -1 if math.isnan(satellites) else int(satellites)
        if "speed" in said and not (kind == "VTG" and math.isfinite(epoch.speed)):
            epoch.speed, epoch.course = _number(said["speed"]) * KNOT, _number(said["course"])
        if kind == "GST":
            epoch.sigma = tuple(_number(said[name]) for name in ("north", "east", "up"))
        if "date" in said and len(said["date"]) == 6 and said["date"].isdigit():
            day, month, year = (int(said["date"][at : at + 2]) for at in (0, 2, 4))
            self._date = 2000 + year, month, day
        if kind == "ZDA" and all(said[name].isdigit() for name in ("year", "month", "day")):
            self._date = int(said["year"][:4]), int(said["month"][:2]), int(said["day"][:2])

    def _add(self, rows: Rows) -> None:
        epoch = self._epoch
        if epoch.added or epoch.now is None:
            return
        epoch.added = True
        if self._silent():
            return
        hours, minutes, seconds = epoch.now
        utc = NAN if self._date is None else utc_seconds(*self._date, hours, minutes, seconds)
        north, east, up = epoch.sigma
        level = math.sqrt((north * north + east * east) / 2)
        kind = epoch.kind if math.isfinite(epoch.place[0]) and math.isfinite(epoch.place[1]) else NO_FIX
        # At rest a receiver may leave out the course, and any course will do.
        course = math.radians(0.0 if math.isnan(epoch.course) and epoch.speed == 0 else epoch.course)
        rows.add_fix(
            epoch.end,
            utc=utc,
            latitude=epoch.place[0],
            longitude=epoch.place[1],
            height=epoch.altitude + (0.0 if math.isnan(epoch.geoid) else epoch.geoid),
            velocity_n=(epoch.speed * math.cos(course), epoch.speed * math.sin(course), NAN),
            horizontal_sigma=level,
            vertical_sigma=up,
            satellites=epoch.satellites,
            fix_type=kind or NO_FIX,
            sea_level=math.isnan(epoch.geoid) and math.isfinite(epoch.altitude),
        )


def _add_heading(kind: str, frame: bytes, end: int, rows: Rows) -> bool:
    """Add the heading of a sentence, if it is valid; return whether it has the cells of one."""
    cells = frame[:-_CHECK].split(b",")
    if len(cells) < _HEADING_CELLS:
        return False
    heading = _number(cells[1])
    if 0 <= heading <= _TURN and len(cells[2]) == 1 and cells[2] in _HEADINGS[kind]:
        rows.add_reading(end, heading=math.radians(heading))
    return True


class _Epoch:
    """What the sentences of one time of day say."""

    def __init__(self, now: tuple[int, int, float] | None = None) -> None:
        self.now = now
        self.kinds: set[str] = set()
        self.added = False
        self.end = 0
        self.kind = 0
        self.place = (NAN, NAN)
        self.altitude = self.geoid = self.speed = self.course = NAN
        self.satellites = -1
        self.sigma: tuple[float, ...] = (NAN, NAN, NAN)


def _number(cell: bytes) -> float:
    return float(cell) if _NUMBER.fullmatch(cell) else NAN


def _time(cell: bytes) -> tuple[int, int, float] | None:
    """Return hour, minute and second of a time of day, hhmmss.ss."""
    if _NUMBER.fullmatch(cell) is None or not cell[:_CLOCK].isdigit() or len(cell) < _CLOCK:
        return None
    return int(cell[:2]), int(cell[2:4]), float(cell[4:])


def _angle(cell: bytes, side: bytes, sides: bytes) -> float:
    """Return radians of degrees and minutes written as one number, dddmm.mmmm."""
    value = _number(cell)
    if math.isnan(value) or len(side) != 1 or side not in sides:
        return NAN
    degrees, minutes = divmod(value, 100.0)
    if minutes >= _DEGREE:
        return NAN
    return math.radians(degrees + minutes / _DEGREE) * (1 if side == sides[:1] else -1)
