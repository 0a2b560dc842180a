"""NovAtel OEM: BESTPOS and BESTVEL five times a second, in binary."""

from __future__ import annotations

from lab.data.protocols.novatel import NovAtelEncoder
from lab.missions import Recording
from writers.sbf import rows_of


def write(recording: Recording) -> bytes:
    """Return the file of a flight."""
    imu, fix = rows_of(recording)
    return NovAtelEncoder().encode(imu, fix)
