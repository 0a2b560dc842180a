"""Spikes: single samples of an IMU that are no motion: bits lost on a bus, or an interrupted transfer.

The distance of a sample from the median of its neighbours has to exceed three limits together, so that
vibration, impacts and hard manoeuvres pass: what vehicles do from one sample to the next, what the rest of
the log shows, and what the samples around show. An impact rings, and a manoeuvre lasts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray

LEAST = np.repeat((17.5, 80.0), 3)
"""Smallest distance from the neighbours of a spike: 1000 °/s [rad/s] and 8 g [m/s²]. Measured: up to
0.8 rad/s and 10 m/s² on cars and walkers; 9.4 rad/s and 85 m/s² in the crash of a copter."""
NEIGHBOURS = 9
"""Samples of which the median is taken: it ignores up to four."""
USUAL = 0.99
"""Quantile of the distances that the log shows, which up to a percent of spikes hardly raises."""
BEYOND_LOG = 20.0
"""Distance of a spike over that quantile. Measured: up to 10 in the crash of a copter."""
AROUND = 51
"""Samples around a spike that are compared with it: half a second at 100 Hz, over which impacts ring."""
MAX_SPIKES = 3
"""Most spikes of an axis among these: more of them are a motion, or a sensor that is not to be trusted."""
BEYOND_AROUND = 6.0
"""Distance of a spike over the largest others around it. Measured: up to 3 where distances are large."""


def spikes(rates: FloatArray) -> NDArray[np.bool_]:
    """Return which samples of an IMU (n,) are spikes.

    Parameters
    ----------
    rates : (n, 6) array
        Angular rate [rad/s] and specific force [m/s²].
    """
    found = np.zeros(len(rates), np.bool_)
    # A spike is a jump there and back; hardly any log has one, and only those are looked at closely.
    jumps = (np.abs(np.diff(rates, axis=0)) > LEAST / 2).any(axis=0)
    if len(rates) < AROUND or not jumps.any():
        return found
    from scipy.ndimage import median_filter, rank_filter  # noqa: PLC0415 - takes a while, and is rarely needed

    for axis in np.flatnonzero(jumps):
        distance = np.abs(rates[:, axis] - median_filter(rates[:, axis], NEIGHBOURS))
        around = rank_filter(distance, -1 - MAX_SPIKES, AROUND)
        limit = np.maximum(LEAST[axis], BEYOND_LOG * np.quantile(distance, USUAL))
        found |= distance > np.maximum(limit, BEYOND_AROUND * around)
    return found
