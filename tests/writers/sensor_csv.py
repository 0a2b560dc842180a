"""A phone's table: accelerometer and gyro in its axes, and the latest fix in every row."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.missions import Recording

HEADER = (
    "Time since start in ms,ACCELEROMETER X (m/s²),ACCELEROMETER Y (m/s²),ACCELEROMETER Z (m/s²),"
    "GYROSCOPE X (rad/s),GYROSCOPE Y (rad/s),GYROSCOPE Z (rad/s),LOCATION Latitude :,LOCATION Longitude :,"
    "LOCATION Altitude ( m),LOCATION Speed ( Kmh),LOCATION ORIENTATION (°)"
)


def write(recording: Recording) -> bytes:
    """Return the bytes of a table with the phone's top forward and its screen up."""
    attitude = Rotation.from_euler("ZYX", recording.euler[:, ::-1])
    acceleration = np.gradient(recording.velocity_n, recording.time, axis=0)
    force = attitude.inv().apply(acceleration - [0, 0, STANDARD_GRAVITY])
    turn = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / np.diff(recording.time)[:, None]
    rate = np.vstack((turn, turn[-1:]))
    north, east, _ = recording.velocity_n.T
    rows = np.column_stack((
        1e3 * recording.time, force[:, 1], force[:, 0], -force[:, 2], rate[:, 1], rate[:, 0], -rate[:, 2],
        np.degrees(recording.latitude), np.degrees(recording.longitude), recording.height,
        3.6 * np.hypot(north, east), np.degrees(np.arctan2(east, north)) % 360,
    ))  # fmt: skip
    lines = [",".join(f"{x:.12g}" for x in row) for row in rows.tolist()]
    return "\r\n".join([HEADER, *lines, ""]).encode()
