"""TCX as a watch writes it: a point a second, a lap each minute, 9 decimals of a degree, 0.1 m of height."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np

from lab.missions import Recording
from writers.resampled import resampled

START = datetime(2024, 5, 17, 23, 58, 30, tzinfo=UTC)
RATE = 1.0
SPACE = "http://www.garmin.com/xmlschemas"


def write(recording: Recording) -> bytes:
    """Return a file with one activity."""
    flight = resampled(recording, RATE)
    points = [
        f"     <Trackpoint>\n      <Time>{START + timedelta(seconds=float(t)):%Y-%m-%dT%H:%M:%SZ}</Time>\n"
        f"      <Position>\n       <LatitudeDegrees>{lat:.9f}</LatitudeDegrees>\n"
        f"       <LongitudeDegrees>{lon:.9f}</LongitudeDegrees>\n      </Position>\n"
        f"      <AltitudeMeters>{height:.1f}</AltitudeMeters>\n"
        f"      <Extensions><ns3:TPX><ns3:Speed>{speed:.3f}</ns3:Speed></ns3:TPX></Extensions>\n"
        "     </Trackpoint>\n"
        for t, lat, lon, height, speed in zip(
            flight.time,
            np.degrees(flight.latitude),
            np.degrees(flight.longitude),
            flight.height,
            np.hypot(flight.velocity_n[:, 0], flight.velocity_n[:, 1]),
            strict=True,
        )
    ]
    laps = "".join(
        f'   <Lap StartTime="{START + timedelta(seconds=first):%Y-%m-%dT%H:%M:%S.000Z}">\n    <Track>\n'
        f"{''.join(points[first : first + 60])}    </Track>\n   </Lap>\n"
        for first in range(0, len(points), 60)
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<TrainingCenterDatabase xmlns="{SPACE}/TrainingCenterDatabase/v2" '
        f'xmlns:ns3="{SPACE}/ActivityExtension/v2">\n <Activities>\n  <Activity Sport="Other">\n'
        f"   <Id>2024-05-17T23:58:30.000Z</Id>\n{laps}  </Activity>\n </Activities>\n"
        "</TrainingCenterDatabase>\n"
    ).encode()
