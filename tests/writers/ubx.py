"""UBX as a u-blox receiver sends it 5 times a second: NAV-PVT, and two messages that no track needs.

1e-7° of position (1 cm), 1 mm of height, 1 mm/s of velocity.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
from pyubx2 import GET, UBXMessage

from lab.missions import Recording
from writers.resampled import resampled

WEEK = 7 * 86_400_000
EPOCH = datetime(1980, 1, 6, tzinfo=UTC)
START = 2315 * WEEK - 90_000
"""A minute and a half before a new week of GPS [ms since 1980-01-06]."""
LEAP_SECONDS = 18
RATE = 5.0


def message(name: str, **fields: float) -> bytes:
    """Return a message of class NAV."""
    made: bytes = UBXMessage("NAV", name, GET, **fields).serialize()
    return made


def pvt(milliseconds: int, lat: float, lon: float, height: float, velocity_n, **changes: float) -> bytes:
    """Return NAV-PVT at a time since 1980-01-06, in GPS time."""
    now = EPOCH + timedelta(milliseconds=milliseconds) - timedelta(seconds=LEAP_SECONDS)
    north, east, down = (round(1e3 * float(speed)) for speed in velocity_n)
    fields = {
        "iTOW": milliseconds % WEEK, "year": now.year, "month": now.month, "day": now.day, "hour": now.hour,
        "min": now.minute, "second": now.second, "nano": now.microsecond * 1000, "validDate": 1,
        "validTime": 1, "fullyResolved": 1, "fixType": 3, "gnssFixOk": 1, "numSV": 12, "lon": lon,
        "lat": lat, "height": round(1e3 * height), "hMSL": round(1e3 * (height + 31.4)), "hAcc": 1500,
        "vAcc": 2500, "velN": north, "velE": east, "velD": down,
    }  # fmt: skip
    return message("NAV-PVT", **fields | changes)


def write(recording: Recording, start: int = START, rate: float = RATE) -> bytes:
    """Return the file of a flight that begins at a time since 1980-01-06, in GPS time [ms]."""
    flight = resampled(recording, rate)
    rows = zip(flight.time, np.degrees(flight.latitude), np.degrees(flight.longitude), flight.height,
               flight.velocity_n, strict=True)  # fmt: skip
    parts = []
    for t, lat, lon, height, velocity_n in rows:
        milliseconds = start + round(1e3 * float(t))
        of_week = milliseconds % WEEK
        parts += [
            pvt(milliseconds, lat, lon, height, velocity_n),
            message("NAV-DOP", iTOW=of_week, gDOP=1.5, pDOP=1.3),
            message("NAV-CLOCK", iTOW=of_week, clkB=1234, clkD=56),
        ]
    return b"".join(parts)
