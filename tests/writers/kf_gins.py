"""KF-GINS text: a solution at 20 Hz, positions at 1 Hz, increments of an IMU at 100 Hz; no headers."""

from __future__ import annotations

import numpy as np

from lab.missions import Recording
from lab.motion.truth.trajectory import Trajectory

START = 456_250.0
"""Seconds of the week at the start."""


def text(form: str, table: np.ndarray) -> bytes:
    """Return rows of numbers."""
    return "".join(form % tuple(row) + "\n" for row in table.tolist()).encode()


def places(flight) -> np.ndarray:
    """Return latitude, longitude [°], height [m]."""
    return np.column_stack((np.degrees(flight.latitude), np.degrees(flight.longitude), flight.height))


def write(recording: Recording, start: float = START) -> dict[str, bytes]:
    """Return the files of a flight that begins at a time of the week [s]."""
    curve = Trajectory.from_recording(recording, 100.0)
    week = 604_800.0
    ideal = curve.increments(100.0)
    imu = np.column_stack(((start + ideal.time[1:]) % week, ideal.dtheta, ideal.dvelocity))
    at = np.arange(0, curve.duration, 0.05)
    flight = curve.at(at)
    solution = np.column_stack((
        np.full(at.size, 2017), (start + at) % week, places(flight), flight.velocity_n,
        np.degrees(flight.euler),
    ))  # fmt: skip
    fixed = np.arange(0, curve.duration, 1.0)
    fixes = np.column_stack((
        (start + fixed) % week, places(curve.at(fixed)), np.tile((0.010, 0.009, 0.019), (fixed.size, 1)),
    ))  # fmt: skip
    return {
        "truth.nav": text("%4d %14.6f %16.11f %16.11f %10.4f" + " %12.6f" * 6, solution),
        "GNSS-RTK.txt": text("%.3f %16.10f %16.10f %10.3f %8.3f %8.3f %8.3f ", fixes),
        "IMU.txt": text("%.6f" + " %.15f" * 6, imu),
    }
