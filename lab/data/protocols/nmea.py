"""NMEA 0183: the sentences of a receiver; those of one time of day make one fix.

Position comes from GGA, GNS, RMC or GLL, velocity from RMC or VTG, σ from GST, the date from RMC or ZDA: the
first of them that says it. Sentences are found anywhere: stamps of a logger before them, and binary frames
between them, do no harm. Sentences with a wrong or missing check are not taken; the check has 8 bits. The
velocity has no vertical part, unless the receiver sends PUBX,00: u-blox' own sentence has position, velocity
and accuracies.

A position is a fix unless a sentence says otherwise: quality 6 to 8 of GGA and the modes E, M and S stand for
one that is estimated, typed in or simulated, and the status V is a warning.

HDT and THS make headings. They have no time, and some devices send them without the other sentences, so the
time of their arrival stands for it. An estimated heading (mode E of THS) is not taken.

References
----------
NMEA 0183, *Standard for Interfacing Marine Electronic Devices*.
u-blox, *M8 Receiver Description Including Protocol Specification* (UBX-13003221): PUBX,00.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from datetime import UTC, datetime

from lab.base.parameters.units import DAY, KILOMETRE_PER_HOUR, KNOT
from lab.data.protocols.device_time import FIRST_YEAR, LAST_YEAR
from lab.data.protocols.epochs import Epoch, Epochs
from lab.data.protocols.framing import MORE, NONE, Framing, xor8
from lab.data.protocols.nmea_receivers import Receivers
from lab.data.protocols.rows import LARGEST_HEIGHT, LARGEST_SPEED, Rows
from lab.data.protocols.samples import (
    COMBINED,
    ENTERED,
    ESTIMATED,
    FIX_2D,
    FIX_3D,
    FIX_DIFFERENTIAL,
    FIX_RTK,
    FIX_RTK_FLOAT,
    NAN,
    NO_FIX,
    SIMULATED,
    UNKNOWN,
    WARNED,
    Vector,
)

SENTENCES = {
    "GGA": "time lat ns lon ew quality satellites - altitude - geoid",
    "GNS": "time lat ns lon ew modes satellites - altitude geoid",
    "RMC": "time status lat ns lon ew speed course date | - - mode",
    "GLL": "lat ns lon ew time status | mode",
    "VTG": "course - - - speed",
    "GST": "time - - - - north east up",
    "ZDA": "time day month year",
    "HDT": "heading way",
    "THS": "heading way",
    "PUBX,00": "time lat ns lon ew ellipsoid solution horizontal up kmh course down",
}
"""What the cells of each sentence are, from the one after its name; those after | may be left out."""
POSITIONS = frozenset(("GGA", "GNS", "RMC", "GLL", "PUBX,00"))
"""Sentences that make a fix."""
_DATE = "ZDA"
"""A sentence that no epoch needs: receivers without a fix send it with the time, and the others without."""
_UBLOX = "PUBX,00"
"""The sentence whose name is longer."""
_NAME = len(f"${_UBLOX},")
"""Bytes up to its first cell."""
_CELLS = {
    kind: (len(names.partition(" |")[0].split()), names.replace(" |", "").split())
    for kind, names in SENTENCES.items()
}
"""Fewest cells after the name of each sentence, and the names of all that are read."""
_SENTENCE = re.compile(rb"\$(?:[A-Z]{2}[A-Z]{3}|PUBX,00),[ -)+-~]*\*([0-9A-Fa-f]{2})")
_STOP = re.compile(rb"[^ -)+-~]")
"""What no sentence has before its check: what is no text, a star."""
_NUMBER = re.compile(rb"[+-]?\d{1,10}(?:\.\d{0,12})?")
_TURN = 360  # [°]
_SIXTY = 60  # minutes of arc in a degree, of time in an hour
_HUNDRED = 100.0
_LARGEST_ANGLES = 90, 180  # latitude, longitude [°]
_CLOCK, _YEAR = 6, 4  # digits of hhmmss or ddmmyy, and of a whole year
_HOURS, _LEAP = 24, 61
"""Hours of a day, and seconds of a minute with a leap second."""
_LAST_CENTURY = 80
"""Two digits of a year from which it is one of the last century: GPS counts from 1980."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
"""Day 0."""
_CHECK = 3
"""Bytes of the check with its star."""
_STANDSTILL = 0.5
"""Speed below which a course that is left out may be any [m/s]."""
_MIN_COURSE_SPEED = 2.0
"""Speed below which receivers leave the course out, since it is noise [m/s]: the last one stands for it."""
_ANY_COURSE = 1.25
"""σ of a velocity over its speed where north stands for an unknown course: √1.5 along it, √0.5 across."""
_SPEED_SIGMA = 0.1
"""σ of the speed of a plain receiver [m/s]: typical Doppler of its data sheet, 0.05 m/s, doubled."""
_QUALITIES = (
    NO_FIX, FIX_3D, FIX_DIFFERENTIAL, FIX_3D, FIX_RTK, FIX_RTK_FLOAT, ESTIMATED, ENTERED, SIMULATED,
    FIX_DIFFERENTIAL,
)  # fmt: skip
"""Kinds of fixes by the quality of GGA: 3 is the precise service; 9 is WAAS with receivers of NovAtel."""
_MODES = {
    "A": FIX_3D, "D": FIX_DIFFERENTIAL, "P": FIX_3D, "R": FIX_RTK, "F": FIX_RTK_FLOAT, "E": ESTIMATED,
    "M": ENTERED, "S": SIMULATED, "N": NO_FIX,
}  # fmt: skip
"""Kinds of fixes by the modes of GNS, RMC and GLL; GNS has one for each system of satellites."""
_NUMBERS = ("altitude", "geoid", "satellites", "north", "east", "up", "speed", "course")
_OF_UBLOX = ("ellipsoid", "kmh", "horizontal", "down")
_SOLUTIONS = {
    "NF": NO_FIX, "TT": NO_FIX, "DR": ESTIMATED, "G2": FIX_2D, "G3": FIX_3D, "D2": FIX_2D,
    "D3": FIX_DIFFERENTIAL, "RK": COMBINED,
}  # fmt: skip
"""Kinds of fixes by the status of PUBX,00: RK is of dead reckoning together with satellites."""
_NOT_BY_SATELLITES = (SIMULATED, ESTIMATED, ENTERED)
_TRUE_HEADINGS = b"TAS"
"""What follows a true heading that is measured or simulated; HDT has no other."""

_Said = Mapping[str, bytes]


class Nmea(Framing):
    """Framing of sentences: ``$``, text, ``*``, an exclusive or of 8 bits.

    Attributes
    ----------
    broken : int
        Sentences of `SENTENCES` with a wrong or missing check.
    first_broken : bytes
        The first of them.
    has_fixes : bool
        Whether a position was seen.
    geoid : float
        Height of the geoid over the ellipsoid that the receiver gave first [m].

    Parameters
    ----------
    silent
        Says whether fixes come from elsewhere in the same stream, and none are to be made of sentences.
    waits
        As of `Epochs`.
    """

    first = b"$"
    longest = 200

    def __init__(self, silent: Callable[[], bool] = lambda: False, waits: bool = False) -> None:
        self.broken, self.first_broken, self.geoid = 0, b"", NAN
        self.has_fixes = False
        self._silent = silent
        self._epochs: Epochs[_Said] = Epochs(self._add, POSITIONS, waits=waits)
        self._day = 0  # since 1970; since the first one, where no date is known
        self._last = NAN  # time of day [s]
        self._last_geoid = self._course = NAN
        self._receivers = Receivers()

    @property
    def remark(self) -> str:
        """Which of several receivers is read, in a sentence; empty for one."""
        return self._receivers.remark

    def size(self, data: bytearray, at: int) -> int:
        """Return the bytes of the sentence that begins at a place, without its line end; `MORE` or `NONE`."""
        stop = _STOP.search(data, at + 1, at + self.longest - 2)
        dollar = data.find(b"$", at + 1, at + self.longest - 2 if stop is None else stop.start())
        if dollar >= 0:
            return NONE
        if stop is None:
            return MORE if len(data) - at < self.longest - 2 else NONE
        if data[stop.start()] == ord("*"):
            return stop.start() + _CHECK - at
        # A sentence that ends with its line has no check; it is counted as broken.
        is_line = data[stop.start()] in b"\r\n" and _name(data[at : at + _NAME]) in SENTENCES
        return stop.start() - at if is_line else NONE

    def passes(self, frame: bytes) -> bool:
        """Return whether this is a sentence with the check it says."""
        found = _SENTENCE.fullmatch(frame)
        if found is not None and int(found[1], 16) == xor8(frame[1:-_CHECK]):
            return True
        if _name(frame) in SENTENCES:
            self.broken += 1
            self.first_broken = self.first_broken or frame
        return False

    def read(self, frame: bytes, end: int, rows: Rows) -> bool:
        """Take what a sentence says, and add the fix it completes; return whether it is one that is read."""
        kind = _name(frame)
        least, names = _CELLS.get(kind, (0, []))
        # "$GPGGA," has seven bytes.
        cells = frame[_NAME if kind == _UBLOX else 7 : -_CHECK].split(b",")
        if not names or len(cells) < least or frame[1:3] == b"VN":
            return False
        said = dict(zip(names, cells, strict=False))
        clock = _time_of_day(said["time"]) if "time" in said else None
        place = _read_place(said) if kind in POSITIONS else None
        if self._receivers.is_other(kind, frame[1:3], clock, place):
            return True
        now = clock if "time" in said else self._epochs.present.now
        if "heading" in said:
            _add_heading(said, end, rows)
            return True
        if kind != _DATE:
            self._epochs.begin(kind, now, rows)
        elif now != self._epochs.present.now:
            self._epochs.finish(rows)
        if now is not None and now != self._last:
            self._pass_midnight(now)
        self._read_date(said)
        if kind != _DATE:
            self._epochs.take(kind, said, end, rows)
        return True

    def finish(self, rows: Rows) -> None:
        """Add the last fix."""
        self._epochs.finish(rows)

    def _pass_midnight(self, now: float) -> None:
        """Count the days on, or back where sentences are out of order."""
        if abs(now - self._last) > DAY / 2:
            self._day += 1 if now < self._last else -1
        self._last = now

    def _read_date(self, said: _Said) -> None:
        if "year" in said:
            parts = [said[name][:_YEAR] for name in ("day", "month", "year")]
        elif len(date := said.get("date", b"")) == _CLOCK:
            parts = [date[at : at + 2] for at in (0, 2, 4)]
        else:
            return
        if not all(part.isdigit() for part in parts):
            return
        day, month, year = map(int, parts)
        if "year" not in said:
            year += 1900 if year >= _LAST_CENTURY else 2000
        if not FIRST_YEAR <= year <= LAST_YEAR:
            return
        try:
            self._day = (datetime(year, month, day, tzinfo=UTC) - _EPOCH).days
        except ValueError:
            return  # no day of a calendar

    def _add(self, epoch: Epoch[_Said], rows: Rows) -> None:
        """Add the fix of an epoch; what several sentences say is that of the first in their table."""
        if self._silent():
            return
        said = [epoch.said[kind] for kind in SENTENCES if kind in epoch.said]
        latitude, longitude = next((place for one in said if (place := _read_place(one))), (NAN, NAN))
        # Reversed, so that the first sentence has the last word.
        cells = {name: cell for one in reversed(said) for name, cell in one.items() if cell}
        altitude, geoid, satellites, north, east, up, speed, course = (
            _number(cells.get(name, b"")) for name in _NUMBERS
        )
        self.has_fixes |= math.isfinite(latitude)
        if math.isnan(self.geoid):
            self.geoid = geoid
        self._last_geoid = self._last_geoid if math.isnan(geoid) else geoid
        # Sentences give the height above sea level, and the geoid above the ellipsoid.
        height = altitude + (0.0 if math.isnan(self._last_geoid) else self._last_geoid)
        ellipsoid, kmh, radius, down = (_number(cells.get(name, b"")) for name in _OF_UBLOX)
        if above_ellipsoid := math.isfinite(ellipsoid) and math.isnan(self._last_geoid):
            height = ellipsoid
        # σ of one horizontal axis, both alike.
        radius = math.sqrt((north * north + east * east) / 2) if math.isnan(radius) else radius
        velocity, sigma = self._velocity(
            speed * KNOT if math.isnan(kmh) else kmh * KILOMETRE_PER_HOUR, course
        )
        velocity = (*velocity[:2], down if abs(down) <= LARGEST_SPEED else NAN)
        kind = _combine_kinds([kind for one in said if (kind := _fix_kind(one)) is not None])
        rows.add_fix(
            epoch.end,
            utc=NAN if epoch.now is None else epoch.now + DAY * self._day,
            place=(latitude, longitude, height if abs(height) <= LARGEST_HEIGHT else NAN),
            velocity_n=velocity,
            sigma=(radius, up, sigma),
            satellites=-1 if math.isnan(satellites) else int(satellites),
            fix_type=NO_FIX if math.isnan(latitude) else kind,
            sea_level=math.isnan(self._last_geoid) and math.isfinite(altitude) and not above_ellipsoid,
        )

    def _velocity(self, speed: float, course: float) -> tuple[Vector, float]:
        """Return the velocity and its σ [m/s]: that of a course that is left out is as large as the speed."""
        sigma = NAN
        if math.isfinite(course):
            self._course = course
        elif speed < _MIN_COURSE_SPEED:
            sigma = max(_ANY_COURSE * speed, _SPEED_SIGMA) if speed else NAN
            course = 0.0 if speed < _STANDSTILL else self._course
        angle = math.radians(course)
        north, east = speed * math.cos(angle), speed * math.sin(angle)
        return ((north, east, NAN), sigma) if speed <= LARGEST_SPEED else (UNKNOWN, NAN)


def _add_heading(said: _Said, end: int, rows: Rows) -> None:
    """Add the heading of a sentence, if it is valid."""
    heading = _number(said["heading"])
    if 0 <= heading <= _TURN and len(said["way"]) == 1 and said["way"] in _TRUE_HEADINGS:
        rows.add_reading(end, heading=math.radians(heading))


def _name(frame: bytes | bytearray) -> str:
    """Return the name of a sentence by its first bytes."""
    text = frame[:_NAME].decode("latin-1")
    return _UBLOX if text == f"${_UBLOX}," else text[3:6]


def _fix_kind(said: _Said) -> int | None:
    """Return the kind of fix that a sentence says; None for one of other things."""
    if "solution" in said:
        return _SOLUTIONS.get(said["solution"].decode("latin-1"), NO_FIX)
    if "quality" in said:
        quality = _number(said["quality"])
        return _QUALITIES[int(quality)] if 0 <= quality < len(_QUALITIES) else NO_FIX
    if "modes" in said:
        modes = [_MODES.get(mode, NO_FIX) for mode in said["modes"].decode("latin-1")]
        best = max(modes, default=NO_FIX)
        return best if NO_FIX < best != SIMULATED else _combine_kinds(modes)
    if "status" not in said:
        return None
    kind = _MODES.get(said.get("mode", b"").decode("latin-1"), FIX_3D)
    return kind if kind in _NOT_BY_SATELLITES or said["status"] == b"A" else WARNED


def _combine_kinds(kinds: list[int]) -> int:
    """Return the kind of a fix of which sentences say several: what is said to be no measurement is none."""
    for kind in _NOT_BY_SATELLITES:
        if kind in kinds:
            return kind
    best = max(kinds, default=NO_FIX)
    return WARNED if WARNED in kinds and best != NO_FIX else best


def _number(cell: bytes) -> float:
    return float(cell) if _NUMBER.fullmatch(cell) else NAN


def _time_of_day(cell: bytes) -> float | None:
    """Return seconds since midnight of a time of day, hhmmss.ss."""
    if _NUMBER.fullmatch(cell) is None or not cell[:_CLOCK].isdigit() or len(cell) < _CLOCK:
        return None
    hours, minutes, seconds = int(cell[:2]), int(cell[2:4]), float(cell[4:])
    if hours >= _HOURS or minutes >= _SIXTY or seconds >= _LEAP:
        return None
    return 3600 * hours + 60 * minutes + seconds


def _read_place(said: _Said) -> tuple[float, float] | None:
    """Return latitude and longitude of a sentence [rad]; None if it has none."""
    if "lat" not in said:
        return None
    latitude = _angle(said["lat"], said["ns"], b"NS", _LARGEST_ANGLES[0])
    longitude = _angle(said["lon"], said["ew"], b"EW", _LARGEST_ANGLES[1])
    return None if math.isnan(latitude + longitude) else (latitude, longitude)


def _angle(cell: bytes, side: bytes, sides: bytes, largest: float) -> float:
    """Return radians of degrees and minutes written as one number, dddmm.mmmm."""
    value = _number(cell)
    if math.isnan(value) or len(side) != 1 or side not in sides:
        return NAN
    degrees, minutes = divmod(value, _HUNDRED)
    angle = degrees + minutes / _SIXTY
    if minutes >= _SIXTY or not 0 <= angle <= largest:
        return NAN
    return math.radians(angle) * (1 if side == sides[:1] else -1)
