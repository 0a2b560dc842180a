"""IGC: the flight recorders of gliders, paragliders and hang gliders; the fixes are B records.

Times are UTC and continue past midnight. The extensions LAD, LOD and TDS add decimals to the minutes of the
position and to the seconds. The height is that of the GPS, above the ellipsoid unless the header says
otherwise; where there is none it is the pressure altitude of the standard atmosphere.

References
----------
FAI IGC, *Technical Specification for IGC-Approved GNSS Flight Recorders*, appendix A.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lab.base.files.file_content import TextBlocks
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.base.parameters.units import DAY
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.fixes import UNKNOWN, Fixes, after
from lab.data.rebuild.raw_flight import Dropped, RawFlight

NAME = "IGC"

_RECORD = re.compile(rb"^[BHI][^\n]{0,250}", re.MULTILINE)
_FIX = re.compile(
    rb"B([01]\d|2[0-3])([0-5]\d)([0-5]\d)(\d\d)(\d{5})([NS])(\d{3})(\d{5})([EW])([AV])([-\d]\d{4})([-\d]\d{4})"
)
_IN_HEAD = re.compile(rb"^(?:" + _FIX.pattern + rb"|H[FO]DTE(?:DATE)?[: ]*\d{6})", re.MULTILINE)
_DATE = re.compile(rb"H[FOP]DTE(?:DATE)?[: ]*(\d\d)(\d\d)(\d\d)")
_ABOVE_SEA = re.compile(rb"HFALG[^:]*:\s*(?:GEO|MSL)", re.IGNORECASE)
_DATUM = re.compile(rb"HFDTM(\d{3})[^:]*:?\s*([^\r\n]*)")
_WGS84 = b"100"
_EXTENSIONS = ("LAD", "LOD", "TDS")
_MAX_DIGITS = 6
"""Most digits of an extension that are read as decimals."""
_MINUTES = 60
"""Minutes in a degree: one with more is damaged."""
_FIRST_EXTENSION = 35
"""Bytes of a B record before its extensions (of the format)."""
_FIRST_YEAR = 80
"""Two digits of a year from which it is one of the last century: flight recorders are approved since 1995."""


def recognises(head: bytes) -> bool:
    """Return whether the first bytes of a file hold a fix or the date as an IGC file writes them."""
    head = head.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return b"\0" not in head and bool(_IN_HEAD.search(head.removeprefix(b"\xef\xbb\xbf")))


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the fixes of an IGC file.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or holds too few fixes.
    """
    path = one_file(paths, NAME, fixed=units)
    records = _Records()
    with TextBlocks(path, MAX_BYTES, strict=False) as text:
        for block in text.blocks():
            records.read(block, text.next_line)
            text.next_line += block.count(b"\n") + 1
    if not records.fixes.count:
        raise MissionError(
            f"{path}: has no B record that can be read ({records.broken} are broken); accepted is an IGC "
            "file with fixes"
        )
    column, height, about_height = _heights(records)
    records.fixes.height[:] = array("d", height.tobytes())
    day = f"{records.date} 00:00 UTC" if records.date else "00:00 UTC of a day that the file does not name"
    return records.fixes.track(
        path,
        NAME,
        units_of_the_format({"latitude": "°", "longitude": "°", column: "m"}),
        unread=Dropped("B records that cannot be read", records.broken, records.first_broken),
        remarks=(f"Time counts from {day}.", *about_height, *records.remarks),
        vehicle="aircraft",
    ).flight()


class _Records:
    """The fixes of a file, and what its header says, as its lines come."""

    def __init__(self) -> None:
        self.fixes = Fixes()
        self.pressure = array("d")
        self.broken = self.first_broken = 0
        self.above_sea = False
        self.date: date | None = None
        self.remarks: tuple[str, ...] = ()
        self._extensions: dict[str, slice] = {}
        self._now = UNKNOWN
        self._day = 0.0

    def read(self, block: bytes, line: int) -> None:
        """Read whole lines, the first of which has a number."""
        at = 0
        for found in _RECORD.finditer(block):
            record = found[0]
            if record.startswith(b"B"):
                line += block.count(b"\n", at, found.start())
                at = found.start()
                self._fix(record, line)
            elif record.startswith(b"I"):
                self._extensions = _extensions(record)
            else:
                self._header(record)

    def _fix(self, record: bytes, line: int) -> None:
        found = _FIX.match(record)
        cells = {name: record[where].strip() for name, where in self._extensions.items()}
        if found is None or not all(cell.isdigit() for cell in cells.values()):
            self._count_unreadable(line)
            return
        hour, minute, second, *place, valid, pressure, height = found.groups()
        fixed = valid == b"A"
        latitude = _degrees(place[:3], cells.get("LAD", b""))
        longitude = _degrees(place[3:], cells.get("LOD", b""))
        if np.isnan(latitude + longitude):
            self._count_unreadable(line)
            return
        self._now = self._continue_day(
            3600.0 * int(hour) + 60.0 * int(minute) + float(second + b"." + cells.get("TDS", b"0"))
        )
        if self.fixes.add(self._now, latitude if fixed else UNKNOWN, longitude, _metres(height), line):
            self.pressure.append(_metres(pressure))

    def _count_unreadable(self, line: int) -> None:
        self.broken += 1
        self.first_broken = self.first_broken or line

    def _continue_day(self, time_of_day: float) -> float:
        """Return seconds since the first day began."""
        if np.isnan(self._now):
            return time_of_day
        # A later date in the file says how many days have passed; else it is less than one.
        return max(after(self._now, time_of_day), self._day + time_of_day)

    def _header(self, record: bytes) -> None:
        dated = _DATE.match(record)
        if dated is not None:
            day = _date(*map(int, dated.groups()))
            if self.date is None and not self.fixes.count:
                self.date = day
            elif self.date is not None and day is not None:
                self._day = max(0.0, DAY * (day - self.date).days)
        self.above_sea |= bool(_ABOVE_SEA.match(record))
        datum = _DATUM.match(record)
        if datum is not None and datum[1] != _WGS84 and b"WGS" not in datum[2].upper():
            name = datum[2].decode("ascii", "replace")[:40] or datum[1].decode()
            self.remarks = (f"The file names the datum {name}. Its positions are used as WGS-84.",)


def _extensions(record: bytes) -> dict[str, slice]:
    """Return where the extensions that are read stand in each B record, as an I record says."""
    found = {}
    for at in range(3, len(record) - 6, 7):
        first, last = record[at : at + 2], record[at + 2 : at + 4]
        name = record[at + 4 : at + 7].decode("latin-1")
        if name in _EXTENSIONS and first.isdigit() and last.isdigit():
            where = slice(int(first) - 1, int(last))
            if _FIRST_EXTENSION <= where.start < where.stop <= where.start + _MAX_DIGITS:
                found[name] = where
    return found


def _degrees(cells: Sequence[bytes], more: bytes) -> float:
    """Return an angle of whole degrees, thousandths of a minute and a side, with more decimals."""
    degrees, thousandths, side = cells
    minutes = (int(thousandths) + float(b"0." + more + b"0")) / 1000
    angle = int(degrees) + minutes / _MINUTES if minutes < _MINUTES else UNKNOWN
    return -angle if side in b"SW" else angle


def _metres(text: bytes) -> float:
    return float(text) if text[1:].isdigit() else UNKNOWN


def _date(day: int, month: int, year: int) -> date | None:
    try:
        return date(year + (1900 if year >= _FIRST_YEAR else 2000), month, day)
    except ValueError:
        return None


def _heights(records: _Records) -> tuple[str, NDArray[np.float64], tuple[str, ...]]:
    """Return the name of the height, the height [m] of each fix, and what a person should know of it."""
    by_gps, by_pressure = np.array(records.fixes.height), np.array(records.pressure)
    has_gps, has_pressure = (bool((np.nan_to_num(height) != 0).any()) for height in (by_gps, by_pressure))
    if not has_gps:
        if not has_pressure:
            return "GNSS altitude", np.full_like(by_gps, np.nan), ("The file has no heights.",)
        return (
            "pressure altitude",
            by_pressure,
            (
                "The recorder gives no height of the GPS. Heights are pressure altitudes of the standard "
                "atmosphere, which the weather moves by up to some hundred metres.",
            ),
        )
    about = [
        SEA_LEVEL
        if records.above_sea
        else "Heights are those of the GPS, above the ellipsoid, as the format has them; recorders that "
        "write heights above sea level and do not say so are wrong by the geoid's separation (at most "
        "107 m)."
    ]
    if has_pressure:
        apart = float(np.nanmedian(by_pressure - by_gps))
        about.append(f"Pressure altitudes are not used; they are {apart:+.0f} m from the heights of the GPS.")
    return "GNSS altitude", by_gps, tuple(about)
