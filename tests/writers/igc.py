"""IGC as a glider's flight recorder writes it, by aerofiles' writer: a fix a second, over midnight.

Positions to 0.001', and with the extensions LAD, LOD and TDS to 0.00001' (2 cm) and 0.01 s; heights to 1 m.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from io import BytesIO

import numpy as np
from aerofiles.igc import Writer

from lab.missions import Recording
from writers.resampled import resampled

START = datetime(2024, 5, 17, 23, 58, 30, tzinfo=UTC)
"""A minute and a half before midnight."""
RATE = 1.0
PRESSURE_OFFSET = 37


def minutes(degrees: float) -> tuple[float, int]:
    """Return an angle to a thousandth of a minute, rounded to zero, and two more decimals of the minute."""
    whole = round(abs(degrees) * 60 * 1e5)
    return float(np.copysign((whole // 100) / 60e3, degrees)), whole % 100


def write(recording: Recording, *, fine: bool = True, start: datetime = START) -> bytes:
    """Return the file of a flight, with decimals in extensions or without."""
    flight = resampled(recording, RATE)
    file = BytesIO()
    writer = Writer(file)
    writer.write_headers(
        {
            "manufacturer_code": "XLB", "logger_id": "INS", "date": start.date(), "logger_type": "INS,LAB",
            "gps_receiver": "uBLOX,NEO-M9N,max50000m", "glider_type": "Carat A", "pilot": "N. N.",
        }
    )  # fmt: skip
    if fine:
        writer.write_fix_extensions([("FXA", 3), ("LAD", 2), ("LOD", 2), ("TDS", 2)])
    rows = zip(
        flight.time, np.degrees(flight.latitude), np.degrees(flight.longitude), flight.height, strict=True
    )
    for t, lat, lon, height in rows:
        now = start + timedelta(seconds=float(t) + (0.25 if fine else 0.0))
        (south_north, more_lat), (west_east, more_lon) = minutes(lat), minutes(lon)
        more = [12, more_lat, more_lon, now.microsecond // 10_000] if fine else None
        writer.write_fix(
            now.time(),
            south_north,
            west_east,
            True,
            round(height) + PRESSURE_OFFSET,
            round(height),
            extensions=more,
        )
    writer.write_security("0123456789ABCDEF" * 4)
    return file.getvalue()
