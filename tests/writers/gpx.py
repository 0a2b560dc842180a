"""GPX 1.1 as phones write it: one point a second, 7 decimals of a degree, 0.1 m of height, no speed."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np

from lab.missions import Recording
from writers.resampled import resampled

START = datetime(2024, 5, 17, 14, 3, 0, tzinfo=UTC)
RATE = 1.0


def write(recording: Recording) -> bytes:
    """Return a file with one track of one segment."""
    flight = resampled(recording, RATE)
    points = "".join(
        f'   <trkpt lat="{lat:.7f}" lon="{lon:.7f}">\n    <ele>{height:.1f}</ele>\n'
        f"    <time>{START + timedelta(seconds=float(t)):%Y-%m-%dT%H:%M:%SZ}</time>\n   </trkpt>\n"
        for t, lat, lon, height in zip(
            flight.time, np.degrees(flight.latitude), np.degrees(flight.longitude), flight.height, strict=True
        )
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<gpx version="1.1" creator="logger" xmlns="http://www.topografix.com/GPX/1/1">\n'
        " <metadata><time>2024-05-17T14:02:11Z</time></metadata>\n"
        f" <trk>\n  <name>Flight</name>\n  <type>flying</type>\n  <trkseg>\n{points}  </trkseg>\n"
        " </trk>\n</gpx>\n"
    ).encode()
