"""NMEA 0183 as a receiver sends it 5 times a second: RMC, GGA and two sentences no track needs.

1e-5 minutes of position (2 cm), 0.1 m of height, 0.001 kt of speed, 0.01° of course.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from functools import reduce

import numpy as np

from lab.missions import Recording
from writers.resampled import resampled

START = datetime(2024, 5, 17, 23, 58, 30, tzinfo=UTC)
"""A minute and a half before midnight."""
RATE = 5.0
GEOID = -31.4
KNOT = 1852 / 3600


def sentence(body: str) -> str:
    """Return a sentence with its checksum."""
    return f"${body}*{reduce(lambda a, b: a ^ b, body.encode()):02X}\r\n"


def angle(degrees: float, width: int, sides: str) -> str:
    """Return degrees and minutes with 5 decimals, and the letter of the side."""
    whole = round(abs(degrees) * 60 * 1e5)
    return f"{whole // 6_000_000:0{width}d}{whole % 6_000_000 / 1e5:08.5f},{sides[int(degrees < 0)]}"


def write(recording: Recording, start: datetime = START, rate: float = RATE) -> bytes:
    """Return the log of a flight that begins at a time of day."""
    flight = resampled(recording, rate)
    lines = []
    rows = zip(
        flight.time,
        np.degrees(flight.latitude),
        np.degrees(flight.longitude),
        flight.height,
        flight.velocity_n,
        strict=True,
    )
    for t, lat, lon, height, velocity in rows:
        now = start + timedelta(seconds=round(float(t), 3))
        clock = f"{now:%H%M%S}.{now.microsecond // 10_000:02d}"
        where = f"{angle(lat, 2, 'NS')},{angle(lon, 3, 'EW')}"
        speed = float(np.hypot(velocity[0], velocity[1])) / KNOT
        course = np.degrees(np.arctan2(velocity[1], velocity[0])) % 360
        heading = f"{course:.2f}" if speed > 0.2 else ""
        lines += [
            sentence(f"GNRMC,{clock},A,{where},{speed:.3f},{heading},{now:%d%m%y},,,A"),
            sentence(f"GNGGA,{clock},{where},1,12,0.72,{height - GEOID:.1f},M,{GEOID:.1f},M,,"),
            sentence("GNGSA,A,3,01,04,09,12,17,19,21,,,,,,1.31,0.72,1.10"),
            sentence("GPGSV,1,1,04,01,40,083,46,04,17,308,41,09,07,344,39,12,33,190,45"),
        ]
    return "".join(lines).encode()
