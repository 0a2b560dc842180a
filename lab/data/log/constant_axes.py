"""Constant axes: whether axes of an IMU show one value throughout a log in which the vehicle moves.

Noise and vibration change every sample of a working sensor by some steps. One that is dead, or was never
written, shows zero or another constant. At rest a coarse sensor does so too.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.motion.frames.displacement import metres_per_radian

_MIN_EXTENT = 30.0
"""Extent of the positions north or east from which a vehicle moves [m]: those of a consumer receiver at rest
wander by some ten metres."""
_AXES = ("forward", "right", "down")
_TRIADS = ("gyros", "accelerometers")


def constant_axes_remarks(name: str, samples: FloatArray, position: FloatArray) -> list[str]:
    """Return a remark for each triad of which one or two axes are constant in motion.

    These are accepted: IMUs for cars may have a yaw gyro and two accelerometers.

    Parameters
    ----------
    name
        The source, for messages.
    samples : (n, 6) array
        Angular rate [rad/s] and specific force [m/s²], in b, or their integrals.
    position : (m, 3) array
        Latitude, longitude [rad], height [m] of the fixes.

    Raises
    ------
    MissionError
        If a whole triad is constant in motion: nothing can be navigated with it.
    """
    if not _moves(position):
        return []
    constant = (samples == samples[:1]).all(axis=0).reshape(2, 3)
    remarks = []
    for triad, axes, values in zip(_TRIADS, constant, samples[0].reshape(2, 3), strict=True):
        zero = " zero" if not values.any() else ""
        if axes.all():
            raise MissionError(
                f"{name}: all three {triad} are constant{zero} in all {len(samples)} samples, but the "
                "vehicle moves: they are dead, or other data were written in their place. Accepted are data "
                "of three gyros and three accelerometers"
            )
        if axes.any():
            shown = " and ".join(axis for axis, still in zip(_AXES, axes, strict=True) if still)
            verb = "is" if axes.sum() == 1 else "are"
            remarks.append(
                f"Of the {triad}, {shown} {verb} constant in all samples, though the vehicle moves: the "
                "motion about or along it was not measured, and the filter does not know this."
            )
    return remarks


def _moves(position: FloatArray) -> bool:
    if not len(position):
        return False
    north, east = metres_per_radian(position[:1, 0], position[:1, 2])
    extent = np.ptp(position[:, 0]) * north[0], np.ptp(np.unwrap(position[:, 1])) * east[0]
    return bool(max(extent) > _MIN_EXTENT)
