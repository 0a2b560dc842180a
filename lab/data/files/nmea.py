"""NMEA 0183: the sentences of a satellite receiver, as logged.

Position and height come from GGA (or GNS, or RMC without height), speed and course from RMC (or VTG).
Sentences of one time of day make one point. The height is above the ellipsoid where the receiver gives the
height of the geoid. Sentences are found anywhere in a line: time stamps of a logger before them and binary
frames (UBX, SiRF, RTCM) between them do no harm. Sentences with a wrong or missing checksum are left out.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray, IntArray
from lab.base.files.file_content import content
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.base.parameters.units import DAY, KNOT
from lab.data.clock.stamps import over_leap_second
from lab.data.files.dataflash_file import MAGIC as DATAFLASH
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.track import Track
from lab.data.files.ulog_file import MAGIC as ULOG
from lab.data.rebuild.raw_flight import Dropped, RawFlight

NAME = "NMEA 0183"

_SENTENCE = re.compile(rb"\$([A-Z]{2}(?:GGA|GNS|RMC),[ -)+-~]{5,120})\*([0-9A-Fa-f]{2})")
_TRIED = 1000
"""Most candidates for a sentence whose checksum is tried amid binary data."""
_BINARY_PART = 100
"""Bytes for each zero among them from which a file is binary: text has none."""
_PIECE = 2**20
"""Bytes read at a time, and longest line."""
_SHORTEST, _LONGEST = 7, 200
"""Length of a sentence [characters]: the standard has 82 at most, receivers of several systems exceed it."""
_MAX_CELLS = 30
"""Most cells of a sentence that is read; those read have up to 15."""
_MIN_GEOID_PART = 0.9
"""Part of the fixes that have to have the height of the geoid, for heights to be above the ellipsoid."""
_FIRST_YEAR = 80
"""Two digits of a year from which it is one of the last century: GPS counts from 1980."""
FIELDS = {  # meaning of the cells of each sentence
    "GGA": {1: "time", 2: "lat", 3: "ns", 4: "lon", 5: "ew", 6: "quality", 9: "altitude", 11: "geoid"},
    "GNS": {1: "time", 2: "lat", 3: "ns", 4: "lon", 5: "ew", 6: "mode", 9: "altitude", 10: "geoid"},
    "RMC": {1: "time", 2: "mode", 3: "lat", 4: "ns", 5: "lon", 6: "ew", 7: "speed", 8: "course", 9: "date"},
    "VTG": {1: "course", 5: "speed"},
}
"""What the cells of each sentence are, counted from its name."""
_UNITS = {"latitude": "°", "longitude": "°", "altitude": "m", "speed": "kt", "course": "°"}
_TEXTS = frozenset(("ns", "ew", "mode"))
_NUMBERS = ("time", "lat", "lon", "quality", "altitude", "geoid", "speed", "course", "date")
_ORDER = {"GGA": 0, "GNS": 1, "RMC": 2, "VTG": 3}
"""Numbers of the kinds of sentences."""
_LETTERS = 26
"""From A to Z."""
_MINUTES, _SECONDS = 60, 61
"""Minutes of an hour or a degree, and seconds of a minute, which a leap second makes longer."""
_MIDNIGHT = 240_000
"""Time of day, hhmmss, from which on it is of no day."""
_DATES = (10_100, 311_299)
"""First and last date, ddmmyy."""
_DAYS, _MONTHS = 31, 12
"""Most days of a month, and months of a year."""
_NO_DIGIT = 255
"""The value of a character that is no hexadecimal digit."""
# The value of each character as a hexadecimal digit.
_HEX = np.full(256, _NO_DIGIT, dtype=np.uint8)
for _digit in b"0123456789ABCDEFabcdef":
    _HEX[_digit] = int(chr(_digit), 16)


@dataclass(eq=False)
class _Sentences:
    """The sentences of a file: what kind each is (a value of `_ORDER`), its line, and its numbers."""

    kind: IntArray
    line: IntArray
    values: dict[str, FloatArray]

    def __getitem__(self, name: str) -> FloatArray:
        return self.values[name]


def recognises(head: bytes) -> bool:
    """Return whether the first bytes of a file hold a sentence with a position, amid binary a sound one.

    A log of an autopilot with its receiver's sentences in it is not recognised.
    """
    if head.startswith((DATAFLASH, ULOG)):
        return False
    if head.count(b"\0") * _BINARY_PART < len(head):
        return bool(_SENTENCE.search(head))
    found = itertools.islice(_SENTENCE.finditer(head), _TRIED)
    return any(reduce(xor, one[1]) == int(one[2], 16) for one in found)


def read(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the track in a log of NMEA sentences.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or holds too few positions.
    """
    path = one_file(paths, NAME, fixed=units)
    return _track(path, *_sentences(path)).flight()


def _sentences(path: Path) -> tuple[_Sentences, int, int, int]:
    """Return all sentences; how many have a wrong checksum, and the line of the first; bytes of binary."""
    parts: list[_Sentences] = []
    line, bad, first_bad, binary = 1, 0, 0, 0
    for piece in _lines(path):
        characters = np.frombuffer(piece, dtype=np.uint8).copy()
        ends = np.flatnonzero(characters == ord("\n"))
        starts, stars = _bounds(characters, ends)
        fine = _checked(characters, starts, stars)
        binary += _binary(characters, ends, starts[fine], stars[fine])
        named = fine | _named(characters, starts)
        starts, stars, fine = starts[named], stars[named], fine[named]
        lines = line + np.searchsorted(ends, starts)
        broken = ~fine & np.isin(_names(characters, starts), [name.encode() for name in FIELDS])
        if broken.any():
            bad += int(broken.sum())
            first_bad = first_bad or int(lines[np.argmax(broken)])
        parts += _decoded(characters, starts[fine], stars[fine], lines[fine])
        line += len(ends)
    if not parts:
        raise MissionError(
            f"{path}: none of its sentences can be used ({bad} with a wrong or no checksum); accepted are "
            "GGA, GNS and RMC"
        )
    values = {name: np.concatenate([part[name] for part in parts]) for name in (*_NUMBERS, "valid")}
    kind = np.concatenate([part.kind for part in parts])
    made = _Sentences(kind, np.concatenate([part.line for part in parts]), values)
    return made, bad, first_bad, binary


def _lines(path: Path) -> Iterator[bytes]:
    """Iterate over whole lines, a piece at a time, each with a line feed at its end."""
    rest = b""
    for piece in content(path, MAX_BYTES, _PIECE):
        data = rest + piece.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        end = data.rfind(b"\n") + 1
        # A longer text without a line end is not a sentence.
        rest = data[end:][-_PIECE:]
        if end:
            yield data[:end]
    if rest:
        yield rest + b"\n"


def _bounds(characters: NDArray[np.uint8], ends: IntArray) -> tuple[IntArray, IntArray]:
    """Return where the last ``$`` of each line stands, and the ``*`` after it, or else the line's end."""
    dollars = np.flatnonzero(characters == ord("$"))
    line = np.searchsorted(ends, dollars)
    last = np.append(line[1:] != line[:-1], True)[: len(dollars)]
    starts, line = dollars[last], line[last]
    stars = np.append(np.flatnonzero(characters == ord("*")), len(characters))
    return starts, np.minimum(stars[np.searchsorted(stars, starts)], ends[line])


def _checked(characters: NDArray[np.uint8], starts: IntArray, stars: IntArray) -> NDArray[np.bool_]:
    """Return which sentences have the checksum they say: the exclusive or of all between ``$`` and ``*``."""
    if not len(starts):
        return np.ones(0, dtype=bool)
    running = np.bitwise_xor.accumulate(characters)
    computed = running[stars - 1] ^ running[starts]
    padded = np.concatenate((characters, np.zeros(2, dtype=np.uint8)))
    high, low = _HEX[padded[stars + 1]], _HEX[padded[stars + 2]]
    said = (high.astype(int) << 4) | low
    return np.asarray(
        (padded[stars] == ord("*")) & (high != _NO_DIGIT) & (low != _NO_DIGIT) & (said == computed)
    )


def _named(characters: NDArray[np.uint8], starts: IntArray) -> NDArray[np.bool_]:
    """Return which of the ``$`` begin what looks like a sentence: the sign is in binary data too."""
    if not len(starts):
        return np.ones(0, dtype=bool)
    places = starts[:, None] + np.arange(1, 6)
    after = characters[np.minimum(places, len(characters) - 1)]
    return np.asarray((after - ord("A") < _LETTERS).all(axis=1))


def _binary(characters: NDArray[np.uint8], ends: IntArray, starts: IntArray, stars: IntArray) -> int:
    """Return how many bytes are in lines that are no text, without those of the sentences there."""
    strange = (characters > ord("~")) | ((characters < ord(" ")) & (characters != ord("\n")))
    strange &= characters != ord("\t")
    if not strange.any():
        return 0
    begins = np.concatenate(([0], ends[:-1] + 1))
    no_text = np.logical_or.reduceat(strange, begins)
    own = no_text[np.searchsorted(ends, starts)]
    return int((ends - begins + 1)[no_text].sum() - (stars - starts + 3)[own].sum())


def _decoded(
    characters: NDArray[np.uint8], starts: IntArray, stars: IntArray, lines: IntArray
) -> list[_Sentences]:
    """Return the sentences between their bounds, in the order of the file."""
    short = (stars - starts >= _SHORTEST) & (stars - starts <= _LONGEST)
    starts, stars, lines = starts[short], stars[short], lines[short]
    if not len(starts):
        return []
    names = _names(characters, starts)
    commas = np.flatnonzero(characters == ord(","))
    cells = np.searchsorted(commas, stars) - np.searchsorted(commas, starts) + 1
    characters[stars] = ord("\n")
    made = []
    for name, fields in FIELDS.items():
        rows = (names == name.encode()) & (cells > max(fields)) & (cells <= _MAX_CELLS)
        if rows.any():
            made.append(_parsed(_cut(characters, starts[rows], stars[rows]), name, lines[rows]))
    if not made:
        return []
    line = np.concatenate([one.line for one in made])
    order = np.argsort(line, kind="stable")
    values = {key: np.concatenate([one[key] for one in made])[order] for key in made[0].values}
    return [_Sentences(np.concatenate([one.kind for one in made])[order], line[order], values)]


def _names(characters: NDArray[np.uint8], starts: IntArray) -> NDArray[np.bytes_]:
    """Return which sentence begins at each ``$``: in $ppGGA, two letters tell the system, three the kind."""
    places = np.minimum(starts[:, None] + np.arange(3, 6), len(characters) - 1)
    return np.asarray(characters[places].reshape(-1, 3).copy().view("S3")[:, 0])


def _cut(characters: NDArray[np.uint8], starts: IntArray, stars: IntArray) -> bytes:
    """Return the characters from each start to its end, the end included."""
    marks = np.zeros(len(characters) + 1, dtype=np.int8)
    marks[starts] = 1
    marks[stars + 1] -= 1
    return bytes(characters[np.cumsum(marks[:-1], dtype=np.int8).astype(bool)])


def _parsed(rows: bytes, name: str, lines: IntArray) -> _Sentences:
    import pandas as pd  # noqa: PLC0415 - slow to import, and only reading needs it

    # Sentences differ in length; pandas takes the number of cells from the first row.
    first = b"," * (_MAX_CELLS - 1) + b"\n"
    frame = pd.read_csv(
        io.BytesIO(first + rows), header=None, index_col=False, usecols=list(FIELDS[name]), dtype=object,
        na_filter=False, quoting=csv.QUOTE_NONE, skip_blank_lines=False, engine="c", encoding="latin-1",
        low_memory=False,
    ).iloc[1:]  # fmt: skip
    values: dict[str, FloatArray] = {key: np.full(len(lines), np.nan) for key in _NUMBERS}
    texts: dict[str, Any] = {}
    for place, key in FIELDS[name].items():
        if key in _TEXTS:
            texts[key] = frame[place].to_numpy()
        else:
            values[key] = np.asarray(pd.to_numeric(frame[place], errors="coerce"), dtype=np.float64)
    if "ns" in texts:
        values["lat"] = _angle(values["lat"], texts["ns"], "N", "S")
        values["lon"] = _angle(values["lon"], texts["ew"], "E", "W")
    values["valid"] = _valid(name, values, texts)
    return _Sentences(np.full(len(lines), _ORDER[name]), lines, values)


def _angle(value: FloatArray, side: Any, positive: str, negative: str) -> FloatArray:
    """Return degrees of degrees and minutes written as one number, dddmm.mmmm."""
    degrees = np.floor(value / 100)
    minutes = value - 100 * degrees
    sign = np.where(side == positive, 1.0, np.where(side == negative, -1.0, np.nan))
    return np.asarray(np.where(minutes < _MINUTES, sign * (degrees + minutes / _MINUTES), np.nan))


def _valid(name: str, values: Mapping[str, FloatArray], texts: Mapping[str, Any]) -> FloatArray:
    """Return 1 if the receiver has a fix, otherwise 0."""
    if name == "GGA":
        return np.asarray(values["quality"] > 0, dtype=np.float64)
    if name == "RMC":
        return np.asarray(texts["mode"] == "A", dtype=np.float64)
    if name == "GNS":
        return np.array([bool(set(mode) - set("N")) for mode in texts["mode"]], dtype=np.float64)
    return np.ones(len(values["speed"]))


def _track(path: Path, sentences: _Sentences, bad: int, first_bad: int, binary: int) -> Track:
    timed = sentences.kind < _ORDER["VTG"]
    if not timed.any():
        raise MissionError(f"{path}: no sentence has a time; accepted are GGA, GNS and RMC")
    # A sentence of the time of day of the one before, or without a time, belongs to the same point.
    now = sentences["time"][timed]
    same = np.equal(now[1:], now[:-1]) | np.isnan(now[1:]) & np.isnan(now[:-1])
    point_of_timed = np.cumsum(np.append(False, ~same))
    point = np.maximum(np.cumsum(timed) - 1, 0)
    point = point_of_timed[point]
    points = int(point[-1]) + 1
    first = np.searchsorted(point, np.arange(points))
    picked = {
        name: _first_of(sentences, point, points, name, kinds)
        for name, kinds in (
            ("lat", (0, 1, 2)), ("lon", (0, 1, 2)), ("altitude", (0, 1)), ("geoid", (0, 1)),
            ("speed", (2, 3)), ("course", (2, 3)), ("date", (2,)), ("time", (0, 1, 2)),
        )
    }  # fmt: skip
    fixed = np.zeros(points, dtype=bool)
    fixed[point[timed & (sentences["valid"] > 0)]] = True
    lines = sentences.line[first]
    dropped = [Dropped("sentences with a wrong or no checksum", bad, first_bad)] if bad else []
    if not fixed.all():
        dropped.append(Dropped("without a fix", int((~fixed).sum()), int(lines[np.argmin(fixed)])))
    geoid = picked["geoid"]
    above_ellipsoid = bool(np.isfinite(geoid[fixed]).mean() >= _MIN_GEOID_PART) if fixed.any() else False
    height = picked["altitude"] + geoid if above_ellipsoid else picked["altitude"]
    time, started = _time(picked["time"], picked["date"])
    remarks = [f"Time counts from {started} UTC."]
    if binary:
        remarks.append(
            f"{binary} bytes between the sentences are binary data, such as UBX frames, and are left out."
        )
    if np.isfinite(height[fixed]).any():
        remarks.append(
            "Heights are above the ellipsoid: altitude plus the geoid's separation, both of the receiver."
            if above_ellipsoid
            else SEA_LEVEL
        )
    return Track(
        path=path,
        format=NAME,
        time=time[fixed],
        latitude=picked["lat"][fixed],
        longitude=picked["lon"][fixed],
        height=height[fixed],
        speed=picked["speed"][fixed] * KNOT,
        course=picked["course"][fixed],
        lines=lines[fixed],
        columns=units_of_the_format(_UNITS),
        rows_read=points + bad,
        dropped=tuple(dropped),
        remarks=tuple(remarks),
    )


def _first_of(
    sentences: _Sentences, point: IntArray, points: int, name: str, kinds: tuple[int, ...]
) -> FloatArray:
    """Return a quantity of each point, from the first kind of sentence that has it there."""
    values = np.full(points, np.nan)
    for kind in kinds[::-1]:
        rows = np.flatnonzero((sentences.kind == kind) & np.isfinite(sentences[name]))[::-1]
        values[point[rows]] = sentences[name][rows]
    return values


def _time(clock: FloatArray, date: FloatArray) -> tuple[FloatArray, str]:
    """Return seconds since midnight, going on over the next ones, and when the first day was."""
    clock = np.where((clock >= 0) & (clock < _MIDNIGHT), clock, np.nan)
    hours, minutes = np.floor(clock / 10_000), np.floor(clock / 100) % 100
    seconds = np.round(clock - 10_000 * hours - 100 * minutes, 6)
    fine = (minutes < _MINUTES) & (seconds < _SECONDS)
    time = np.where(fine, 3600 * hours + 60 * minutes + seconds, np.nan)
    of_day = time.copy()
    known = np.isfinite(time)
    time[known] = np.unwrap(time[known], period=DAY)
    days = _days(date)
    dated = np.flatnonzero(known & np.isfinite(days))
    if not dated.size:
        return over_leap_second(time, of_day=True)[0], "midnight of a day that the file does not name,"
    # Where a date is known, the days counted are those of the calendar.
    counted = np.round((DAY * days[dated] + of_day[dated] - time[dated]) / DAY)
    nearest = counted[np.maximum(np.searchsorted(dated, np.arange(len(time)), side="right") - 1, 0)]
    first = counted[0]
    since_1970 = time + DAY * nearest
    leaps = np.round(over_leap_second(since_1970, of_day=False)[0] - since_1970)
    return time + DAY * (nearest - first) + leaps, f"{np.datetime64(int(first), 'D')} 00:00"


def _days(date: FloatArray) -> FloatArray:
    """Return days since 1970 of dates written ddmmyy; NaN if there is none."""
    known = np.isfinite(date) & (date >= _DATES[0]) & (date <= _DATES[1])
    number = np.where(known, date, _DATES[0]).astype(np.int64)
    day, month, year = number // 10_000, number // 100 % 100, number % 100
    fine = known & (day >= 1) & (day <= _DAYS) & (month >= 1) & (month <= _MONTHS)
    years = np.where(year < _FIRST_YEAR, year + 2000, year + 1900) - 1970
    months = years * _MONTHS + np.clip(month, 1, _MONTHS) - 1
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64) + day - 1
    return np.where(fine, days.astype(np.float64), np.nan)
