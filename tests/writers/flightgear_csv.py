"""FlightGear's logger: paths, or titles with units; ten significant digits, seconds since its start."""

from __future__ import annotations

import numpy as np

from lab.missions import Recording

FOOT = 0.3048
TITLES = (
    "Time", "Longitude (deg)", "Latitude (deg)", "Altitude (ft)", "Heading (deg)", "Pitch (deg)",
    "Roll (deg)", "Speed North (fps)", "Speed East (fps)", "Speed Down (fps)", "Rudder",
)  # fmt: skip
PATHS = (
    "Time", "/position/longitude-deg", "/position/latitude-deg", "/position/altitude-ft",
    "/orientation/heading-deg", "/orientation/pitch-deg", "/orientation/roll-deg",
    "/velocities/speed-north-fps", "/velocities/speed-east-fps", "/velocities/speed-down-fps", "/controls/x",
)  # fmt: skip
"""What the logger writes where the user gives no titles."""
START = 12.35


def columns(recording: Recording) -> dict[str, np.ndarray]:
    """Return what is logged, by title."""
    roll, pitch, yaw = np.degrees(recording.euler).T
    values = (
        START + recording.time, np.degrees(recording.longitude), np.degrees(recording.latitude),
        recording.height / FOOT, yaw % 360, pitch, roll, *recording.velocity_n.T / FOOT,
        np.zeros(len(recording.time)),
    )  # fmt: skip
    return dict(zip(TITLES, values, strict=True))


def text(logged: dict[str, np.ndarray], delimiter: str = ",") -> bytes:
    """Return the file of columns by title."""
    rows = [
        delimiter.join(f"{v:.10g}" for v in row) for row in np.column_stack(list(logged.values())).tolist()
    ]
    return "\n".join([delimiter.join(logged), *rows, ""]).encode()


def write(recording: Recording) -> bytes:
    """Return the log of a flight, under the paths of its properties."""
    return text(dict(zip(PATHS, columns(recording).values(), strict=True)))
