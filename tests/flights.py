"""Flights in closed form, as recordings and as csv text, for the tests of missions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pymap3d

from lab.missions import Recording

COLUMNS = (
    "time_s", "latitude_deg", "longitude_deg", "height_m", "velocity_north_m_s", "velocity_east_m_s",
    "velocity_down_m_s", "roll_deg", "pitch_deg", "yaw_deg",
)  # fmt: skip


def circle(
    samples: int = 400, latitude: float = 45.0, heading: float = 0.0, turn: float = 270.0, step: float = 0.25
) -> Recording:
    """Return a flight at 50 m/s that turns by `turn` degrees to the right, level, on a plane at the start.

    Its positions come from pymap3d; the curvature of the Earth over its few kilometres is within 1e-3 of the
    velocity.
    """
    time = np.arange(samples) * step
    course = np.radians(heading) + np.radians(turn) * time / time[-1]
    rate = np.radians(turn) / time[-1]
    velocity = 50.0 * np.column_stack([np.cos(course), np.sin(course), np.zeros(samples)])
    if rate:
        north = 50.0 / rate * (np.sin(course) - np.sin(course[0]))
        east = -50.0 / rate * (np.cos(course) - np.cos(course[0]))
    else:
        north, east = velocity[0, 0] * time, velocity[0, 1] * time
    lat, lon, _ = pymap3d.enu2geodetic(east, north, np.zeros(samples), latitude, -73.5, 300.0)
    roll = np.full(samples, np.arctan(50.0 * rate / 9.81))
    return Recording(
        time=time,
        latitude=np.radians(lat),
        longitude=np.radians(lon),
        height=np.full(samples, 300.0),
        velocity_n=velocity,
        euler=np.column_stack([roll, np.full(samples, 0.03), course]),
    )


def table(recording: Recording) -> np.ndarray:
    """Return a recording in the columns and units of a flight csv."""
    return np.column_stack(
        [
            recording.time, np.degrees(recording.latitude), np.degrees(recording.longitude), recording.height,
            recording.velocity_n, np.degrees(recording.euler),
        ]
    )  # fmt: skip


def csv_text(values: np.ndarray, columns: Sequence[str] = COLUMNS, end: str = "\n") -> str:
    """Return csv text of a table, digits enough to give the same numbers back."""
    rows = [",".join(columns), *(",".join(repr(float(x)) for x in row) for row in values)]
    return end.join(rows) + end
