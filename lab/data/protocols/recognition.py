"""Recognition: which decoders fit the first bytes of a stream, and what they found in them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lab.base.parameters.counted import count_noun
from lab.data.protocols.catalogue import DECODERS
from lab.data.protocols.column_map import ColumnMap
from lab.data.protocols.decoder import Decoder
from lab.data.protocols.stream_decoder import StreamDecoder
from lab.data.protocols.text_lines import TextLines

_STRONG = frozenset(("vectornav", "mip", "ublox", "mavlink", "novatel", "septentrio", "phone"))
"""Protocols with a check of 16 bits or more: two frames that pass by chance would be one in 2**32."""
_FEWEST = {True: 2, False: 4}
"""Fewest frames by which a protocol counts as recognised: with a check of 16 bits, and of 8 or none."""
_LARGEST = 2**16
"""Bytes that are looked at: at 115 200 baud they come in 6 s."""
_NAMES = {
    "vectornav": "VectorNav", "xsens": "Xsens", "mip": "MicroStrain MIP", "memsense": "MEMSense",
    "novatel": "NovAtel", "septentrio": "Septentrio SBF", "witmotion": "WitMotion",
    "bno085": "BNO085 in the mode UART-RVC",
    "ublox": "u-blox UBX", "nmea": "NMEA", "mavlink": "MAVLink", "phone": "the page for phones",
    "text": "text lines",
}  # fmt: skip
"""Names of the protocols as their makers write them."""
_TURN_ON = {
    "ublox": ("NAV-PVT", "ESF-MEAS"),
    "nmea": ("GGA and RMC", ""),
    "xsens": ("GnssPvtData", "rate of turn and acceleration in MTData2"),
    "vectornav": ("the group GNSS", "angular rates and accelerations (VNIMU, or the group IMU)"),
    "mip": ("position and velocity of GNSS", "scaled gyro and accelerometer"),
    "mavlink": ("GPS_RAW_INT", "HIGHRES_IMU or RAW_IMU"),
    "novatel": ("BESTPOS and BESTVEL", "RAWIMUX"),
    "septentrio": ("PVTGeodetic", "ExtSensorMeas"),
}
"""What a device is to send for its position, and for its IMU, by protocol."""
_HEX = re.compile(
    rb"\s*(?:[0-9A-Fa-f]{4,8}:?[ \t]+)?((?:(?:0[xX])?[0-9A-Fa-f]{2}(?:[ ,]{0,2}|$)){4,64})"
    rb"(?=\s*$|\s{1,2}\S|\|)"
)
"""A line of bytes as hexadecimal numbers, with or without their place before it, as of xxd and hexdump."""
_UNCHECKED = re.compile(rb"\$[A-Z]{2}(?:GGA|GNS|RMC|GLL|VTG),[^*$\r\n]{10,120}[\r\n]")
"""A sentence of a receiver without a check."""
_MOSTLY = 0.5
"""Part of the bytes in sound frames from which they are named: text about a protocol has fewer."""
_WHOLE = 0.995
"""Part of the bytes in frames from which no others are mentioned: rounded, they would be 0 %."""
_TEXT_PART = 0.85
"""Part of the bytes that must be in lines of the columns for text: with one damaged byte of 1000, a seventh
of lines of 150 bytes is lost."""


@dataclass(frozen=True)
class Candidate:
    """A decoder that fits.

    Attributes
    ----------
    name : str
        A key of `DECODERS`.
    frames, failed : int
        Frames that passed their check, and checks that failed.
    samples, fixes : int
        Rows that were found in them.
    part : float
        Part of the bytes that is in frames that passed.
    bytes : int
        Bytes that were looked at.
    columns : ColumnMap or None
        Of text: what its columns seem to be.
    """

    name: str
    frames: int
    failed: int
    samples: int
    fixes: int
    part: float
    bytes: int
    columns: ColumnMap | None = None

    @property
    def evidence(self) -> str:
        """What speaks for it, in a sentence."""
        found = f"{count_noun(self.frames, 'line')} with all columns"
        if not self.columns:
            found = count_noun(self.frames, "valid frame")
        rest = "" if self.part > _WHOLE else f"; {1 - self.part:.0%} of the bytes belong to none"
        return f"Recognised as {_NAMES.get(self.name, self.name)} from {found}{rest}."


def recognise(data: bytes) -> list[Candidate]:
    """Return the decoders that fit the bytes of a stream, best first.

    Protocols whose library is not installed are left out.

    Parameters
    ----------
    data
        The first bytes, from anywhere in the stream; one or two seconds of it are enough.
    """
    data = data[:_LARGEST]
    found = [candidate for name in DECODERS if (candidate := _try_decoder(name, data)) is not None]
    return sorted(found, key=_rank_candidate, reverse=True)


def sound_frames(data: bytes) -> str:
    """Return a sentence on frames that hold no position, or are printed as numbers; empty if there are none.

    Parameters
    ----------
    data
        The first bytes, as of `recognise`.
    """
    if printed := recognise(_printed_bytes(data[:_LARGEST])):
        return (
            f"These are bytes printed as hexadecimal numbers. {printed[0].evidence} Send the bytes "
            "themselves, or make a file of them: xxd -r -p TEXT > BYTES, without -p where lines have places."
        )
    if (unchecked := len(_UNCHECKED.findall(data[:_LARGEST]))) > _FEWEST[False]:
        return f"NMEA, {unchecked} sentences without a check: have the device send it, such as *5A."
    best, text = 0, ""
    for name, (position, imu) in _TURN_ON.items():
        decoder = _make_decoder(name)
        if not isinstance(decoder, StreamDecoder):
            continue
        has_imu = bool(len(decoder.feed(data[:_LARGEST]).imu))
        part = 1 - decoder.statistics.skipped / max(decoder.statistics.bytes, 1)
        if part < _MOSTLY or decoder.own_frames < max(_FEWEST[name in _STRONG], best + 1):
            continue
        best = decoder.own_frames
        lacking, wanted = "position", [position]
        if imu and not has_imu:
            lacking, wanted = "position or IMU", [position, imu]
        where = "" if len(data) < _LARGEST else f" in the first {_LARGEST // 1024} kB"
        found = f"{_NAMES[name]}, {best:,} sound messages{where}"
        text = f"{found}, none with {lacking}: turn on {' and '.join(wanted)}."
    return text


def _printed_bytes(data: bytes) -> bytes:
    """Return the bytes that lines of hexadecimal numbers say; none if most lines hold anything else."""
    lines = [line for line in data.splitlines()[1:-1] if line.strip()]
    found = [_HEX.match(line) for line in lines]
    pairs = [re.sub(rb"0[xX]|[ ,]", b"", one[1]) for one in found if one is not None]
    return bytes.fromhex(b"".join(pairs).decode()) if len(pairs) > _MOSTLY * len(lines) else b""


def _make_decoder(name: str) -> Decoder | None:
    """Return a decoder; None if its library is not installed."""
    try:
        return DECODERS[name]()
    except ImportError:
        return None


def _try_decoder(name: str, data: bytes) -> Candidate | None:
    decoder = _make_decoder(name)
    if decoder is None:
        return None
    parts = (decoder.feed(data), decoder.finish())
    seen = decoder.statistics
    samples, fixes, readings = (sum(map(len, rows)) for rows in zip(*parts, strict=True))
    columns = decoder.columns if isinstance(decoder, TextLines) else None
    before = decoder.before if isinstance(decoder, TextLines) else 0
    part = 1 - (seen.skipped - before) / max(len(data) - before, 1)
    own = decoder.own_frames if isinstance(decoder, StreamDecoder) else seen.frames
    if own < _FEWEST[name in _STRONG] or not samples + fixes + readings:
        return None
    if isinstance(decoder, TextLines) and part < _TEXT_PART:
        return None
    return Candidate(name, seen.frames, seen.failed, samples, fixes, part, len(data), columns)


def _rank_candidate(candidate: Candidate) -> tuple[int, float]:
    """Return what candidates are ordered by: rows from frames with a check go before those from text."""
    rows = candidate.samples + candidate.fixes
    return (0 if candidate.columns else 1) * rows, candidate.part
