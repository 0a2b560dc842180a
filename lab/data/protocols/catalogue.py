"""Catalogue: the decoders and encoders by name."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

from lab.data.protocols.bno085 import Bno085, Bno085Encoder
from lab.data.protocols.decoder import Decoder, DecoderError, Encoder
from lab.data.protocols.decoder_file import FORM, load_decoder
from lab.data.protocols.mavlink import Mavlink
from lab.data.protocols.mavlink_encoder import MavlinkEncoder
from lab.data.protocols.memsense import Memsense, MemsenseEncoder
from lab.data.protocols.mip import Mip, MipEncoder
from lab.data.protocols.nmea import Nmea
from lab.data.protocols.nmea_encoder import NmeaEncoder
from lab.data.protocols.novatel import NovAtel, NovAtelEncoder
from lab.data.protocols.phone import PhoneDecoder, PhoneEncoder
from lab.data.protocols.sbf import Sbf, SbfEncoder
from lab.data.protocols.stream_decoder import StreamDecoder
from lab.data.protocols.text_lines import TextEncoder, TextLines
from lab.data.protocols.ubx import UbloxEncoder, Ubx
from lab.data.protocols.vectornav import VectorNavAscii, VectorNavBinary, VectorNavEncoder
from lab.data.protocols.witmotion import WitMotion, WitMotionEncoder
from lab.data.protocols.xsens import Xsens, XsensEncoder


def _ublox() -> Decoder:
    messages = Ubx()
    sentences = Nmea(lambda: messages.has_fixes)
    messages.yields = lambda: sentences.has_fixes
    return StreamDecoder("ublox", (messages,), beside=(sentences,))


DECODERS: Mapping[str, Callable[[], Decoder]] = {
    "vectornav": lambda: StreamDecoder("vectornav", (VectorNavBinary(), VectorNavAscii()), beside=(Nmea(),)),
    "xsens": lambda: StreamDecoder("xsens", (Xsens(),), beside=(Nmea(),)),
    "mip": lambda: StreamDecoder("mip", (Mip(),), beside=(Nmea(),)),
    "memsense": lambda: StreamDecoder("memsense", (Memsense(),)),
    "novatel": lambda: StreamDecoder("novatel", (NovAtel(),), beside=(Nmea(),)),
    "septentrio": lambda: StreamDecoder("septentrio", (Sbf(),), beside=(Nmea(),)),
    "witmotion": lambda: StreamDecoder("witmotion", (WitMotion(),)),
    "bno085": lambda: StreamDecoder("bno085", (Bno085(),)),
    "ublox": _ublox,
    "nmea": lambda: StreamDecoder("nmea", (Nmea(),)),
    "mavlink": lambda: StreamDecoder("mavlink", (Mavlink(),)),
    "phone": PhoneDecoder,
    "text": TextLines,
}
"""Makes a decoder with its usual settings, by the name of the protocol."""
ENCODERS: Mapping[str, Callable[[], Encoder]] = {
    "vectornav": VectorNavEncoder,
    "xsens": XsensEncoder,
    "mip": MipEncoder,
    "memsense": MemsenseEncoder,
    "novatel": NovAtelEncoder,
    "septentrio": SbfEncoder,
    "witmotion": WitMotionEncoder,
    "bno085": Bno085Encoder,
    "ublox": UbloxEncoder,
    "nmea": NmeaEncoder,
    "mavlink": MavlinkEncoder,
    "phone": PhoneEncoder,
    "text": TextEncoder,
}
"""Makes an encoder with its usual settings, by the name of the protocol."""


def make_decoder(name: str) -> Decoder:
    """Return a new decoder.

    Parameters
    ----------
    name
        A key of `DECODERS`, or ``FILE.py:Name`` of one's own. Whoever serves names it: the file is executed.

    Raises
    ------
    DecoderError
        If there is none of this name, it cannot be loaded, or a library for it is not installed.
    """
    if ":" in name:
        return load_decoder(name)
    if name not in DECODERS:
        raise DecoderError(f"{name!r} is no protocol; accepted are {', '.join(DECODERS)}, and {FORM}")
    try:
        return DECODERS[name]()
    except ImportError as error:
        raise DecoderError(str(error)) from error


LONGEST_LINE = 1024
"""Longest line by which bytes of an unknown protocol count as text [bytes]."""
ROW = 32
"""Bytes in a row of what has neither frames nor lines."""


def last_frames(name: str, data: bytes, most: int) -> list[bytes]:
    """Return the last frames or lines in bytes from anywhere in a stream; of what has none, rows of bytes.

    Parameters
    ----------
    name
        A key of `DECODERS`; others, and an empty name, stand for a protocol that is not known.
    data
        The bytes.
    most
        Most frames.
    """
    try:
        decoder = DECODERS[name]() if name in DECODERS else None
    except ImportError:  # of a library that is not installed
        decoder = None
    found: list[bytes] = []
    if isinstance(decoder, StreamDecoder):
        decoder.passed = deque(maxlen=most)
        decoder.feed(data)
        found = list(decoder.passed)
    else:
        lines = data.split(b"\n")[1:-1]  # the first may be cut, and the last goes on
        if decoder is not None or (lines and max(map(len, lines)) < LONGEST_LINE):
            found = lines[-most:]
    return found or [data[at : at + ROW] for at in range(0, len(data), ROW)][-most:]
