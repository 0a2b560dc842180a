"""Variables of SimConnect as its wrapper for Python records them: doubles in full, angles in radians."""

from __future__ import annotations

import numpy as np

from lab.missions import Recording
from writers.fslogger import FOOT, KNOT, absolute_time


def write(recording: Recording) -> bytes:
    """Return the bytes of a csv with the variables that a recording has."""
    roll, pitch, yaw = recording.euler.T
    north, east, down = recording.velocity_n.T / FOOT
    columns: dict[str, np.ndarray] = {
        "timestamp": recording.time,  # of the computer
        "ABSOLUTE_TIME": absolute_time(recording),
        "PLANE_LATITUDE": np.degrees(recording.latitude),
        "PLANE_LONGITUDE": np.degrees(recording.longitude),
        "PLANE_ALTITUDE": recording.height / FOOT,
        "PLANE_PITCH_DEGREES": -pitch,
        "PLANE_BANK_DEGREES": -roll,
        "PLANE_HEADING_DEGREES_TRUE": yaw % (2 * np.pi),
        "VELOCITY_WORLD_X": east,
        "VELOCITY_WORLD_Y": -down,
        "VELOCITY_WORLD_Z": north,
    }
    if recording.airspeed is not None:
        columns["AIRSPEED_TRUE"] = recording.airspeed / KNOT
    rows = [",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns.values()), strict=True)]
    return "\n".join([",".join(columns), *rows, ""]).encode()
