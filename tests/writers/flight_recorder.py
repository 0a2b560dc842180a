"""Flight Recorder's csv: doubles in full, the computer's clock in milliseconds, the simulator's besides."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from lab.missions import Recording
from writers.fslogger import FOOT, KNOT, absolute_time


def write(recording: Recording, own_clock: bool = True) -> bytes:
    """Return the bytes of an export, by a version that has the simulator's clock or by an older one."""
    roll, pitch, yaw = np.degrees(recording.euler).T
    attitude = Rotation.from_euler("ZYX", recording.euler[:, ::-1])
    forward, right, down = attitude.inv().apply(recording.velocity_n.copy()).T / FOOT
    zero = np.zeros(len(roll))
    # The computer sees a frame up to 4 ms late.
    late = np.random.default_rng(5).uniform(0, 0.004, len(roll))
    columns: dict[str, np.ndarray] = {
        "Milliseconds": np.round(1e3 * (recording.time + late)).astype(int),
        "Latitude": np.degrees(recording.latitude),
        "Longitude": np.degrees(recording.longitude),
        "Altitude": recording.height / FOOT,
        "Pitch": -pitch,
        "Bank": -roll,
        "GyroHeading": zero,
        "TrueHeading": yaw % 360.0,
        "MagneticHeading": zero,
        "VelocityBodyX": right,
        "VelocityBodyY": -down,
        "VelocityBodyZ": forward,
        "RotationVelocityBodyX": zero,
        "AccelerationBodyX": zero,
        "LightTaxi": zero.astype(int),
    }
    if own_clock:
        columns["SimulationRate"] = zero.astype(int) + 1
        columns["AbsoluteTime"] = absolute_time(recording)
        if recording.airspeed is not None:
            columns["TrueAirspeed"] = recording.airspeed / KNOT
    rows = [",".join(map(repr, row)) for row in zip(*(c.tolist() for c in columns.values()), strict=True)]
    return "\r\n".join([",".join(columns), *rows, ""]).encode()
