"""JSBSim's csv: the headings of its groups, sixteen digits."""

from __future__ import annotations

import numpy as np
import pymap3d

from lab.missions import Recording

FOOT = 0.3048


def write(recording: Recording) -> bytes:
    """Return the bytes of a csv with the groups velocities, atmosphere and position."""
    latitude, longitude = np.degrees(recording.latitude), np.degrees(recording.longitude)
    x, y, z = (
        np.asarray(axis) / FOOT for axis in pymap3d.geodetic2ecef(latitude, longitude, recording.height)
    )
    roll, pitch, yaw = np.degrees(recording.euler).T
    north, east, down = recording.velocity_n.T / FOOT
    zero = np.zeros(len(latitude))
    airspeed, alpha, beta = (
        zero if value is None else value for value in (recording.airspeed, recording.alpha, recording.beta)
    )
    columns = {
        "Time": recording.time,
        "P_{inertial} (deg/s)": zero,
        "V_{Total} (ft/s)": airspeed / FOOT,
        "V_{X_{inertial}} (ft/s)": zero + 1000.0,
        "V_{North} (ft/s)": north,
        "V_{East} (ft/s)": east,
        "V_{Down} (ft/s)": down,
        "P_{SL} (psf)": zero + 2116.0,
        "Altitude ASL (ft)": recording.height / FOOT,
        "Phi (deg)": roll,
        "Theta (deg)": pitch,
        "Psi (deg)": yaw % 360.0,
        "Alpha (deg)": np.degrees(alpha),
        "Beta (deg)": np.degrees(beta),
        "Latitude (deg)": latitude - 0.19,
        "Latitude Geodetic (deg)": latitude,
        "Longitude (deg)": longitude,
        "X_{ECEF} (ft)": x,
        "Y_{ECEF} (ft)": y,
        "Z_{ECEF} (ft)": z,
    }
    rows = [",".join(f"{v:.16g}" for v in row) for row in np.column_stack(list(columns.values())).tolist()]
    return "\n".join([",".join(columns), *rows, ""]).encode()
