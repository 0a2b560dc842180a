"""fsLogger's Data.csv: ten digits in every cell, time from an absolute time that double precision rounds."""

from __future__ import annotations

import numpy as np

from lab.missions import Recording

FOOT = 0.3048
KNOT = 1852 / 3600
EPOCH = 63726135141.0


def absolute_time(recording: Recording) -> np.ndarray:
    """Return the simulator's seconds since year 0, to the 8 µs a double has left."""
    return np.asarray(EPOCH + recording.time)


def write(recording: Recording) -> bytes:
    """Return the bytes of a Data.csv with the variables fsLogger comes with that a recording has."""
    roll, pitch, yaw = np.degrees(recording.euler).T
    zero = np.zeros(len(recording.time))
    airspeed, alpha, beta = (
        zero if value is None else value for value in (recording.airspeed, recording.alpha, recording.beta)
    )
    columns = {
        "Time": absolute_time(recording) - EPOCH,
        "ABSOLUTE_TIME": np.floor(absolute_time(recording)),
        "Plane_Altitude": recording.height / FOOT,
        "Indicated_Altitude": recording.height / FOOT + 3.0,
        "Airspeed_True": airspeed / KNOT,
        "Airspeed_Indicated": airspeed / KNOT,
        "Plane_Pitch_Degrees": -pitch,
        "Plane_Bank_Degrees": -roll,
        "Plane_Heading_Degrees_True": yaw % 360.0,
        "Plane_Latitude": np.degrees(recording.latitude),
        "Plane_Longitude": np.degrees(recording.longitude),
        "Incidence_Alpha": np.degrees(alpha),
        "Incidence_Beta": np.degrees(beta),
        "General_Eng_RPM_1": zero + 2400.0,
    }
    rows = [",".join(f"{x:.10g}" for x in row) for row in np.column_stack(list(columns.values())).tolist()]
    return "\r\n".join([",".join(columns), *rows, ""]).encode()
