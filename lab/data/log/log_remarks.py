"""Log remarks: on times in which only the IMU or the receiver recorded, and on axes that show one value.

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
_MIN_ALONE = 2.0
"""Shortest time in which only one of the two recorded that is reported [s]: as the longest gap of the IMU
that is filled. Sensors that are switched on together start within it."""


def clock_text(seconds: float) -> str:
    """Return a time in the clock of a file to the millisecond, also where it counts from 1970."""
    return f"{seconds:.3f}".rstrip("0").rstrip(".")


def span_text(time: FloatArray) -> str:
    """Return the first and the last of the times (n,), in words [s]."""
    return f"{clock_text(float(time.min()))} to {clock_text(float(time.max()))} s" if time.size else "no rows"


def coverage_remarks(imu: FloatArray, fixes: FloatArray) -> list[str]:
    """Return remarks about time at the ends of a log in which only the IMU or only the receiver recorded.

    Parameters
    ----------
    imu : (n,) array
        Time stamps of the samples, in the clock of the file [s].
    fixes : (m,) array
        Times of validity of the fixes, in the same clock [s].
    """
    remarks = []
    late, early = fixes[0] - imu[0], fixes[-1] - imu[-1]
    if late > _MIN_ALONE:
        remarks.append(
            f"The first fix comes {late:.3g} s after the start of the IMU, at {clock_text(fixes[0])} s of "
            "the file's clock: nothing before it is navigated."
        )
    elif late < -_MIN_ALONE:
        remarks.append(
            f"The IMU starts {-late:.3g} s after the first fix, at {clock_text(imu[0])} s of the file's "
            f"clock: {_fixes(int((fixes < imu[0]).sum()))} before it, and nothing is navigated there."
        )
    if early > _MIN_ALONE:
        remarks.append(
            f"The IMU ends {early:.3g} s before the last fix, at {clock_text(imu[-1])} s of the file's "
            f"clock: {_fixes(int((fixes > imu[-1]).sum()))} after it, and nothing is navigated there."
        )
    elif early < -_MIN_ALONE:
        remarks.append(
            f"The last fix comes {-early:.3g} s before the end of the IMU, at {clock_text(fixes[-1])} s of "
            "the file's clock: the navigator coasts from there."
        )
    return remarks


def _fixes(count: int) -> str:
    return "1 fix is" if count == 1 else f"{count} fixes are"


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
    if not _is_moving(position):
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


def _is_moving(position: FloatArray) -> bool:
    if not len(position):
        return False
    north, east = metres_per_radian(position[:1, 0], position[:1, 2])
    extent = np.ptp(position[:, 0]) * north[0], np.ptp(np.unwrap(position[:, 1])) * east[0]
    return bool(max(extent) > _MIN_EXTENT)
