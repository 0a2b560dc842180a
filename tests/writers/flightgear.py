"""FlightGear's pair insgns-gps at 4 Hz and insgns-imu at 50 Hz, with the formats of the protocols."""

from __future__ import annotations

import numpy as np

from lab.missions import Recording
from lab.motion.truth.trajectory import Trajectory

GPS_RATE = 4.0
IMU_RATE = 50.0
START = 30.0
"""FlightGear's clock at the start [s]."""


def write(recording: Recording) -> dict[str, bytes]:
    """Return the bytes of the two files."""
    curve = Trajectory.from_recording(recording, IMU_RATE)
    fixes = np.arange(0.0, curve.duration, 1 / GPS_RATE)
    at = curve.at(fixes)
    gps = np.column_stack((fixes + START, at.latitude, at.longitude, -at.height, at.velocity_n))
    times = np.arange(0.0, curve.duration, 1 / IMU_RATE)
    imu = np.column_stack((times + START, *curve.rates(times)))
    return {
        "fgfs.gps": _text(gps, (4, 10, 10, 3, 8, 8, 8)),
        "fgfs.imu": _text(imu, (4, 6, 6, 6, 5, 5, 5)),
    }


def _text(table: np.ndarray, decimals: tuple[int, ...]) -> bytes:
    form = "\t".join(f"%.{count}f" for count in decimals) + "\n"
    return "".join(form % tuple(row) for row in table.tolist()).encode()
