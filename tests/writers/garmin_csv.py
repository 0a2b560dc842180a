"""Garmin G1000 flight log: a row a second in local time, as the flight deck pads its cells.

Six decimals of a degree (0.1 m), 0.1 ft, 0.01 kt, 0.01 ft/min and 0.1° of track and heading, both magnetic.
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import numpy as np

from lab.missions import Recording
from writers.resampled import resampled

START = datetime(2024, 5, 17, 18, 58, 30, tzinfo=timezone(timedelta(hours=-5)))
"""A minute and a half before midnight in UTC."""
RATE = 1.0
VARIATION = -14.3
"""What is to be added to a magnetic direction at Montréal [°]."""
FOOT, KNOT = 0.3048, 1852 / 3600
UNITS = {
    "Lcl Date": "#yyy-mm-dd", "Lcl Time": "hh:mm:ss", "UTCOfst": "hh:mm", "AtvWpt": "ident",
    "Latitude": "degrees", "Longitude": "degrees", "AltB": "ft Baro", "BaroA": "inch", "AltMSL": "ft msl",
    "OAT": "deg C", "IAS": "kt", "GndSpd": "kt", "VSpd": "fpm", "Pitch": "deg", "Roll": "deg", "LatAc": "G",
    "NormAc": "G", "HDG": "deg", "TRK": "deg", "volt1": "volts", "E1 RPM": "rpm", "AltGPS": "ft wgs",
    "TAS": "kt", "MagVar": "deg", "VSpdG": "fpm", "GPSfix": "enum",
}  # fmt: skip
INFO = '#airframe_info, log_version="1.00", airframe_name="Cessna 172S", system_id="12345678", mode=NORMAL,\n'
NO_ROW = (
    "{date}, {clock},   {offset},      ,             ,             ,        ,      ,        ,  11.2,   0.00,"
)


def rows(
    recording: Recording, variation: float = VARIATION, sign: float = 1.0, true: bool = False
) -> list[str]:
    """Return the rows of a flight.

    Parameters
    ----------
    recording
        The flight.
    variation
        East of true north [°].
    sign
        Of the variation as it is logged.
    true
        Whether the track is from true north.
    """
    flight = resampled(recording, RATE)
    north, east, down = flight.velocity_n.T
    track = np.degrees(np.arctan2(east, north)) - (0.0 if true else variation)
    roll, pitch, yaw = np.degrees(flight.euler).T
    made = []
    for row in range(len(flight.time)):
        now = START + timedelta(seconds=round(float(flight.time[row])))
        lat, lon = np.degrees(flight.latitude[row]), np.degrees(flight.longitude[row])
        speed = float(np.hypot(north[row], east[row])) / KNOT
        up, height = -down[row] / FOOT * 60, flight.height[row] / FOOT
        cells = (
            f"{now:%Y-%m-%d}", f"{now:%H:%M:%S}", "-05:00", "CYUL", f"{lat:.6f}", f"{lon:.6f}",
            f"{height + 90:.1f}", "29.92", f"{height + 103:.1f}", "11.2", f"{speed:.2f}", f"{speed:.2f}",
            f"{up + 20:.2f}", f"{pitch[row]:.2f}", f"{roll[row]:.2f}", "0.01", "-0.02",
            f"{(yaw[row] - variation) % 360:.1f}", f"{track[row] % 360:.1f}", "27.9", "2400.0",
            f"{height:.1f}", f"{speed:.2f}", f"{sign * variation:.1f}", f"{up:.2f}", "3D",
        )  # fmt: skip
        made.append(", ".join(cells))
    return made


def log(lines: list[str]) -> bytes:
    """Return a file with these rows."""
    head = f"{INFO}{', '.join(UNITS.values())}\n  {', '.join(UNITS)}\n"
    return (head + "\n".join(lines) + "\n").encode()


def write(recording: Recording) -> bytes:
    """Return the log of a flight, which begins before the receiver has a fix."""
    clock = {"date": "2024-05-17", "clock": "18:58:29", "offset": "-05:00"}
    return log([NO_ROW.format(**clock) + "," * (len(UNITS) - 12), *rows(recording)])
