"""Receiver file: the track in the bytes that a satellite receiver sent, as saved to a file.

The decoders of streams read them. The height is above the ellipsoid where the receiver gives the height of
the geoid. Positions that the receiver itself calls no measurement are marked.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray, IntArray
from lab.base.files.file_content import read_whole
from lab.base.files.mission_error import MissionError
from lab.base.files.named_columns import MAX_BYTES
from lab.base.parameters.units import DAY, WEEK
from lab.data.clock.stamps import over_leap_second
from lab.data.files.dataflash_file import MAGIC as DATAFLASH
from lab.data.files.fields import SEA_LEVEL, one_file, units_of_the_format
from lab.data.files.track import Track
from lab.data.files.ulog_file import MAGIC as ULOG
from lab.data.protocols.device_time import GPS_EPOCH
from lab.data.protocols.framing import Framing
from lab.data.protocols.nmea import POSITIONS as SENTENCES
from lab.data.protocols.nmea import Nmea
from lab.data.protocols.novatel import NovAtel
from lab.data.protocols.samples import NAMED, NO_FIX, SIMULATED, UNMEASURED
from lab.data.protocols.sbf import Sbf
from lab.data.protocols.stream_decoder import StreamDecoder
from lab.data.protocols.ubx import POSITIONS as MESSAGES
from lab.data.protocols.ubx import Ubx
from lab.data.rebuild.raw_flight import Dropped, RawFlight

NMEA, UBX, NOVATEL, SBF = "NMEA 0183", "u-blox UBX", "NovAtel OEM", "Septentrio SBF"
"""Names of the formats."""
_SENTENCE = re.compile(
    rb"\$(?:"
    + "|".join(one if "," in one else f"[A-Z]{{2}}{one}" for one in sorted(SENTENCES)).encode()
    + rb"),[ -)+-~]{5,120}\*[0-9A-Fa-f]{2}"
)
_MESSAGE = re.compile(b"|".join(re.escape(b"\xb5b" + kind) for kind in sorted(MESSAGES.values())))


class _Receiver(NamedTuple):
    """A receiver: its protocol and framing, how messages with positions begin, and what they are called.

    Then how all messages begin, and those with an attitude, which is not read.
    """

    protocol: str
    framing: Callable[[], Framing]
    begin: re.Pattern[bytes]
    messages: str
    mark: bytes
    attitude: re.Pattern[bytes] | None = None


_RECEIVERS = {
    NMEA: _Receiver("nmea", Nmea, _SENTENCE, ", ".join(sorted(SENTENCES)), b"\n"),
    UBX: _Receiver("ublox", Ubx, _MESSAGE, ", ".join(sorted(MESSAGES)), b"\xb5b"),
    NOVATEL: _Receiver(
        "novatel",
        NovAtel,
        re.compile(
            rb"[#%](?:BESTPOS|BESTGNSSPOS|INSPVAS?)A,|\xaaD\x12[\x1c-\x7f](?:\x2a\x00|\x95\x05|\xfb\x01)"
            rb"|\xaaD\x13[\s\S]\xfc\x01"
        ),
        "BESTPOS, BESTGNSSPOS and INSPVA",
        b"\xaaD",
        re.compile(rb"[#%]INSPVAS?A,|\xaaD\x12[\x1c-\x7f]\xfb\x01|\xaaD\x13[\s\S]\xfc\x01"),
    ),
    SBF: _Receiver(
        "septentrio",
        Sbf,
        re.compile(rb"\$@[\s\S]{2}[\xa6\xa7][\x0f\x2f\x4f\x6f\x8f]"),
        "PVTGeodetic and PVTCartesian",
        b"$@",
    ),
}
"""Receivers, by the name of the format."""
_TRIED = 1000
"""Most candidates for a sentence or a message whose check is tried when a file is recognised."""
_BINARY_PART = 100
"""Bytes for each zero among them from which a file is binary: text has none."""
_TEXT = bytes((9, 10, 13, *range(32, 127)))
"""Characters of text."""
_DATED = 1e8
"""Time since 1970 from which it is one with a date [s]: GPS counts from 1980, days without a date from 0."""
_BLOCK = 2**20
"""Bytes that are decoded at a time."""
_COLUMNS = {
    NMEA: {"latitude": "°", "longitude": "°", "altitude": "m", "speed": "kt", "course": "°"},
    UBX: {"lat": "°", "lon": "°", "height": "m", "gSpeed": "m/s", "headMot": "°"},
    NOVATEL: {"lat": "°", "lon": "°", "hgt": "m", "hor spd": "m/s", "trk gnd": "°"},
    SBF: {"Latitude": "rad", "Longitude": "rad", "Height": "m", "Vn": "m/s", "Ve": "m/s"},
}


def recognises(name: str, head: bytes) -> bool:
    """Return whether the first bytes of a file hold a sound message of a receiver with a position.

    A log of an autopilot with its receiver's messages in it is not recognised; what holds sentences of NMEA
    is a file of these. In a text, a sentence need not be sound.
    """
    receiver = _RECEIVERS[name]
    if head.startswith((DATAFLASH, ULOG)) or receiver.begin.search(head) is None:
        return False
    if name == NMEA and head.count(b"\0") * _BINARY_PART < len(head):
        return True
    data, framing = bytearray(head), receiver.framing()
    for found in itertools.islice(receiver.begin.finditer(head), _TRIED):
        at = found.start()
        size = framing.size(data, at)
        if 0 < size <= len(head) - at and framing.passes(head[at : at + size]):
            return name == NMEA or not recognises(NMEA, head)
    return False


def read_nmea(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the track in a log of NMEA sentences.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or holds too few positions.
    """
    path = one_file(paths, NMEA, fixed=units)
    data, framing = read_whole(path, MAX_BYTES), Nmea(waits=True)
    decoder = StreamDecoder("nmea", (framing,))
    fixes = _decode_file(decoder, data)
    if not len(fixes):
        raise MissionError(
            f"{path}: none of its sentences can be used ({framing.broken} with a wrong or no checksum); "
            f"accepted are {', '.join(sorted(SENTENCES))}"
        )
    on_sea = fixes["sea_level"] == 1
    height = np.where(on_sea, fixes["height"] + np.nan_to_num(framing.geoid), fixes["height"])
    time, start = _utc(fixes["utc"])
    remarks = [f"Time counts from {start} UTC.", *filter(None, (framing.remark,))]
    if data.translate(None, _TEXT):
        remarks.append(
            f"{decoder.statistics.skipped} bytes between the sentences are binary data, such as UBX frames, "
            "or other text, and are left out."
        )
    if np.isfinite(height[fixes["fix_type"] != NO_FIX]).any():
        plus = "altitude plus the geoid's separation, both of the receiver"
        said = "as PUBX,00 has them" if np.isnan(framing.geoid) else plus
        is_of_sea = np.isnan(framing.geoid) and on_sea.any()
        remarks.append(SEA_LEVEL if is_of_sea else f"Heights are above the ellipsoid: {said}.")
    places = _Places(data, b"\n" if b"\n" in data else b"\r", 1)
    dropped = _report_broken("sentences with a wrong or no checksum", framing, places)
    return _track(path, NMEA, fixes, time, height, places, dropped, remarks)


def read_ubx(paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the track in a file of UBX messages.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or holds too few positions.
    """
    path = one_file(paths, UBX, fixed=units)
    data, framing = read_whole(path, MAX_BYTES), Ubx(waits=True)
    fixes = _decode_file(StreamDecoder("ublox", (framing,)), data)
    time, start = _gps_time(fixes)
    remarks = [f"Time is that of GPS, from the start of {start}.", "Heights are above the ellipsoid."]
    places = _Places(data, b"\xb5b", 0)
    dropped = _report_broken("messages with a wrong checksum", framing, places)
    return _track(path, UBX, fixes, time, fixes["height"], places, dropped, remarks)


def read(name: str, paths: Sequence[Path], units: Mapping[str, str]) -> RawFlight:
    """Read the track in a file of a further receiver.

    Parameters
    ----------
    name
        A key of `_RECEIVERS`.
    paths, units
        As of readers.

    Raises
    ------
    MissionError
        If the file cannot be read or is too large, or holds too few positions.
    """
    path, receiver = one_file(paths, name, fixed=units), _RECEIVERS[name]
    data = read_whole(path, MAX_BYTES)
    decoder = StreamDecoder(receiver.protocol, (receiver.framing(),))
    fixes = _decode_file(decoder, data)
    dated = fixes["time"][np.isfinite(fixes["time"])]
    if not dated.size:
        raise MissionError(
            f"{path}: has no sound message with a time and a position; accepted are {receiver.messages}"
        )
    week = int(dated[0] // WEEK)
    start = np.datetime64("1980-01-06") + 7 * week
    remarks = [
        f"Time is that of GPS, from the start of its week on {start}.", "Heights are above the ellipsoid.",
    ]  # fmt: skip
    left = decoder.statistics
    if left.failed:
        remarks.append(f"{left.failed} messages with a wrong checksum are left out.")
    if left.unknown:
        remarks.append(f"{left.unknown} messages of other kinds are not read.")
    if receiver.attitude is not None and receiver.attitude.search(data):
        remarks.append("The attitude of INSPVA is not read.")
    places = _Places(data, receiver.mark, 0) if receiver.mark in data else _Places(data, b"\n", 1)
    time = np.round(fixes["time"] - WEEK * week, 6)
    return _track(path, name, fixes, time, fixes["height"], places, [], remarks)


def _decode_file(decoder: StreamDecoder, data: bytes) -> NDArray[np.void]:
    parts = [decoder.feed(data[at : at + _BLOCK]).fix for at in range(0, len(data), _BLOCK)]
    return np.concatenate([*parts, decoder.finish().fix])


class _Places:
    """Numbers of lines, or of messages: from which on one counts, by the marks that end or begin them."""

    def __init__(self, data: bytes, mark: bytes, first: int) -> None:
        found = np.frombuffer(data, np.uint8)
        marks = found[: len(found) - len(mark) + 1] == mark[0]
        for place in range(1, len(mark)):
            marks &= found[place : len(found) - len(mark) + 1 + place] == mark[place]
        self._data, self._marks, self._first = data, np.flatnonzero(marks), first

    def find_numbers(self, ends: IntArray) -> IntArray:
        """Return the numbers of what ends at places in the data."""
        return np.asarray(np.searchsorted(self._marks, ends - 1) + self._first)

    def of_bytes(self, part: bytes) -> int:
        """Return the number of the first place with some bytes."""
        return int(self.find_numbers(np.array([self._data.find(part) + len(part)]))[0])


def _report_broken(reason: str, framing: Nmea | Ubx, places: _Places) -> list[Dropped]:
    if not framing.broken:
        return []
    return [Dropped(reason, framing.broken, places.of_bytes(framing.first_broken))]


def _track(
    path: Path,
    name: str,
    fixes: NDArray[np.void],
    time: FloatArray,
    height: FloatArray,
    places: _Places,
    dropped: list[Dropped],
    remarks: list[str],
) -> RawFlight:
    """Return the fixes of a file as a flight."""
    rows_read = len(fixes) + sum(one.count for one in dropped)
    lines = places.find_numbers(fixes["end"])
    kind = fixes["fix_type"]
    dropped += Dropped.of("without a fix", kind == NO_FIX, lines)
    known = kind != NO_FIX
    velocity, kind = fixes["velocity_n"][known], kind[known]
    named = {
        one: f"{int((kind == one).sum())} of {len(kind)} positions are {words}."
        for one, words in NAMED.items()
        if (kind == one).any()
    }
    doubts = [named.pop(SIMULATED)] if SIMULATED in named else []
    return Track(
        path=path,
        format=name,
        time=time[known],
        latitude=np.degrees(fixes["latitude"][known]),
        longitude=np.degrees(fixes["longitude"][known]),
        height=height[known],
        speed=np.hypot(velocity[:, 0], velocity[:, 1]),
        course=np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0])) % 360,
        down=velocity[:, 2],
        lines=lines[known],
        columns=units_of_the_format(_COLUMNS[name]),
        rows_read=rows_read,
        dropped=tuple(dropped),
        remarks=(*remarks, *named.values()),
        doubts=tuple(doubts),
        unmeasured={
            f"without a fix: {reason}": kind == one
            for one, reason in UNMEASURED.items()
            if (kind == one).any()
        },
    ).flight()


def _utc(utc: FloatArray) -> tuple[FloatArray, str]:
    """Return times since the midnight before the first, which count a leap second, and that midnight."""
    dated = np.flatnonzero(utc >= _DATED)
    time = utc.copy()
    if not dated.size:
        return over_leap_second(time, of_day=True)[0], "midnight of a day that the file does not name,"
    before = np.flatnonzero(np.isfinite(utc[: dated[0]]))
    if before.size:
        time[before] += DAY * round((utc[dated[0]] - utc[before[-1]]) / DAY)
    time = over_leap_second(time, of_day=False)[0]
    first = int(time[np.isfinite(time)][0] // DAY)
    return np.round(time - DAY * first, 6), f"{np.datetime64(first, 'D')} 00:00"


def _gps_time(fixes: NDArray[np.void]) -> tuple[FloatArray, str]:
    """Return the time since the start of the first week of GPS [s], and what week it is in words."""
    fixed = fixes["fix_type"] != NO_FIX
    of_week = fixes["week_time"]
    week = np.round((fixes["utc"] - GPS_EPOCH - of_week) / WEEK)
    if fixed.any() and (week[fixed] > 0).all():
        first = int(week[np.argmax(fixed)])
        start = np.datetime64("1980-01-06") + 7 * first
        return of_week + WEEK * (week - first), f"its week on {start}"
    time = of_week.copy()
    time[fixed] = np.unwrap(time[fixed], period=WEEK)
    return time, "a week that the file does not name"
