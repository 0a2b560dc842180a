"""Along track: velocities of fixes that have a speed without a course, to judge the axes of an IMU by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lab.base.arrays import FloatArray
from lab.data.log.sensor_log import GnssLog
from lab.motion.frames.displacement import metres_per_radian

_POSITION_SIGMA = 3.0
"""σ of a position whose receiver does not give one [m]: phones in the open."""
_FAST = 3.0
"""Speed of the track from which it is compared with the stated one [m/s]: noise of positions adds to less."""
_LIKE = (0.7, 1.4)
"""Median ratio of both within which they are of one motion; a speed in another unit shows no axes."""
_MIN_FIXES = 3
"""Fewest fixes that show a direction in the middle."""


def along_track(gnss: GnssLog, speed: FloatArray) -> GnssLog | None:
    """Return fixes whose velocities are their speeds in the direction of the track; None if they need none.

    Parameters
    ----------
    gnss
        The fixes.
    speed : (m,) array
        Their speeds over ground [m/s].
    """
    time = gnss.time
    if np.isfinite(gnss.velocity_n[:, :2]).any() or not np.isfinite(speed).any() or time.size < _MIN_FIXES:
        return None
    if not (np.diff(time) > 0).all():
        return None
    per_latitude, per_longitude = metres_per_radian(gnss.position[:, 0], 0.0)
    north = np.gradient(gnss.position[:, 0], time) * per_latitude
    east = np.gradient(np.unwrap(gnss.position[:, 1]), time) * per_longitude
    moved = np.hypot(north, east)
    fast = (moved > _FAST) & np.isfinite(speed)
    if not fast.any() or not _LIKE[0] < float(np.median(speed[fast] / moved[fast])) < _LIKE[1]:
        return None
    course = np.arctan2(east, north)
    velocity = np.column_stack((speed * np.cos(course), speed * np.sin(course), np.full(time.size, np.nan)))
    position = np.nanmedian(gnss.position_sigma[:, :2]) if np.isfinite(gnss.position_sigma).any() else np.nan
    known = position if np.isfinite(position) else _POSITION_SIGMA
    across = known / (np.sqrt(2) * float(np.median(np.diff(time))))  # of a central difference
    return replace(gnss, velocity_n=velocity, velocity_sigma=np.full((time.size, 3), across))
