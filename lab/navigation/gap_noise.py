"""Gap noise: the process noise of a filled gap of the IMU, whose motion is unknown."""

from __future__ import annotations

from typing import Final

import numpy as np

from lab.base.arrays import FloatArray
from lab.navigation.solution import Imu

AROUND: Final = 5.0
"""Time before and after a gap whose motion stands for that in it [s]: a vehicle that begins to move in a gap
of at most 2 s still moves then, and the live navigator can go back that far."""
_ROUNDING = 1e-6  # of time stamps [s]


def gap_noise(imu: Imu, start: float, end: float) -> FloatArray:
    """Return the densities (6,) of the unknown motion in a filled gap [rad²/s], [m²/s³].

    The rates in the gap are taken to be wrong by their spread about it. An error that lasts for the whole gap
    has the density variance times length; a shorter one has less.

    Parameters
    ----------
    imu
        The increments, with those that fill the gap.
    start, end
        The gap [s].
    """
    edges = np.array([start - AROUND - _ROUNDING, end + AROUND + _ROUNDING])
    first, last = np.searchsorted(imu.time, edges)
    last = min(max(last, 2), imu.time.size)
    first = min(first, last - 2)
    dt = np.diff(imu.time[first:last])[:, None]
    spread = [(part[first : last - 1] / dt).var(axis=0) for part in (imu.dtheta, imu.dvelocity)]
    return np.asarray(np.concatenate(spread) * (end - start))
