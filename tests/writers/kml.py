"""KML as a flight tracker writes it: a gx:Track, all times before all places, four points a second.

Eight decimals of a degree (1 mm), heights above the sea to 1 cm, times of another zone than UTC's.
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import numpy as np

from lab.missions import Recording
from writers.resampled import resampled

START = datetime(2024, 5, 18, 1, 58, 30, tzinfo=timezone(timedelta(hours=2)))
"""A minute and a half before midnight in UTC."""
RATE = 4.0


def write(recording: Recording) -> bytes:
    """Return a file with one track."""
    flight = resampled(recording, RATE)
    times = "".join(
        f"    <when>{(START + timedelta(seconds=float(t))).isoformat(timespec='milliseconds')}</when>\n"
        for t in flight.time
    )
    places = "".join(
        f"    <gx:coord>{lon:.8f} {lat:.8f} {height:.2f}</gx:coord>\n"
        for lat, lon, height in zip(
            np.degrees(flight.latitude), np.degrees(flight.longitude), flight.height, strict=True
        )
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2" '
        'xmlns:gx="http://www.google.com/kml/ext/2.2">\n <Document>\n  <name>Flight</name>\n'
        "  <Placemark><Point><coordinates>-73.7,45.4,30</coordinates></Point></Placemark>\n  <Placemark>\n"
        f"   <gx:Track>\n    <altitudeMode>absolute</altitudeMode>\n{times}{places}   </gx:Track>\n"
        "  </Placemark>\n </Document>\n</kml>\n"
    ).encode()
