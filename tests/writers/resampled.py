"""A recording at the rate of a format: points of the curve through it."""

from __future__ import annotations

import numpy as np

from lab.missions import Recording
from lab.motion.truth.trajectory import Trajectory, Truth


def resampled(recording: Recording, rate: float, start: float = 0.0) -> Truth:
    """Return the points of a flight at a rate [Hz], from a time after its first sample on [s]."""
    curve = Trajectory.from_recording(recording, 100.0)
    return curve.at(np.arange(start, curve.duration, 1 / rate))
