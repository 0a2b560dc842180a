"""Writers: for each format of flight recording the file its simulator or logger would have written.

They follow what is published of the format, at its own precision; they are the other side of round trips and
give the fuzzers their seeds.
"""

from __future__ import annotations

from collections.abc import Callable

from lab.missions import Recording
from writers import ardupilot, gpx, nmea, ulog

WRITERS: dict[str, Callable[[Recording], bytes | dict[str, bytes]]] = {
    "GPX": gpx.write,
    "NMEA 0183": nmea.write,
    "PX4 ULog": ulog.write,
    "ArduPilot DataFlash": ardupilot.write,
}
"""By name of the reader: what gives the bytes of a file, or of several by their names."""
