"""Septentrio SBF: PVTGeodetic five times a second."""

from __future__ import annotations

import numpy as np

from lab.data.protocols.samples import FIX, FIX_3D, IMU
from lab.data.protocols.sbf import SbfEncoder
from lab.missions import Recording
from writers.resampled import resampled

START = 2315 * 604_800.0 - 60.0
"""A minute before a new week of GPS, counted from 1980 [s]."""
RATE = 5.0


def rows_of(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Return no samples, and the fixes of a flight."""
    flight = resampled(recording, RATE)
    fix = np.zeros(flight.time.size, FIX)
    fix["time"], fix["week_time"] = START + flight.time, (START + flight.time) % 604_800
    fix["latitude"], fix["longitude"], fix["height"] = flight.latitude, flight.longitude, flight.height
    fix["velocity_n"], fix["fix_type"], fix["satellites"] = flight.velocity_n, FIX_3D, 12
    fix["horizontal_sigma"], fix["vertical_sigma"], fix["utc"] = 1.0, 1.5, np.nan
    return np.empty(0, IMU), fix


def write(recording: Recording) -> bytes:
    """Return the file of a flight."""
    return SbfEncoder().encode(*rows_of(recording))
