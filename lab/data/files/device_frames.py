"""Device frames: whose binary frames a file has that was recorded from a port, and that no reader reads.

The frames of some devices become sensor logs all the same: `lab.data.streams.capture`.
"""

from __future__ import annotations

_TO_LOG = (
    "ins-lab import FILE --as log makes a sensor log of it, and so does the page, if it has intact samples "
    "of an IMU and fixes."
)
_TO_CONVERT = "Convert them with the maker's software to a csv with named columns, or to NMEA."
_FRAMES = (
    ("an IMU of Xsens", (b"\xfa\xff\x36",), _TO_LOG),
    ("an IMU of Xsens, in its older format MTData", (b"\xfa\xff\x32",), _TO_CONVERT),
    ("an IMU of MicroStrain", (b"ue\x80", b"ue\x82", b"ue\x91"), _TO_LOG),
    ("an IMU of VectorNav", (b"\xfa\x01", b"\xfa\x03", b"\xfa\x05", b"\xfa\x15", b"\xfa\x1d"), _TO_LOG),
    ("a NovAtel receiver", (b"\xaaD\x12", b"\xaaD\x13"), _TO_CONVERT),
    ("a Septentrio receiver", (b"$@",), _TO_CONVERT),
    ("a SiRF receiver", (b"\xb0\xb3\xa0\xa2",), _TO_CONVERT),
    ("a SkyTraq receiver", (b"\r\n\xa0\xa1",), _TO_CONVERT),
)
"""Devices, the bytes at which their frames begin (their manuals: MTData2 and MTData, MIP, binary output
messages, OEM7, SBF, SiRF Binary, SkyTraq Binary), and what makes a file that is read."""
_FRAME_BYTES = 1024
"""Bytes for each such beginning from which a file consists of frames: they have up to 500 on average."""
_MIN_FRAMES = 8
"""Fewest of them: random bytes have the shortest beginning once in 65,536."""


def advice_on_frames(head: bytes) -> str:
    """Return a sentence on a file of a device's frames; empty for any other one.

    Parameters
    ----------
    head
        Its first bytes, decompressed.
    """
    for device, marks, advice in _FRAMES:
        if sum(head.count(mark) for mark in marks) >= max(_MIN_FRAMES, len(head) / _FRAME_BYTES):
            return f"It looks like binary frames of {device}. {advice}"
    return ""
