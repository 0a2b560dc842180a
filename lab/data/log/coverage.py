"""Coverage: from when to when the IMU and the receiver of a log recorded, in the clock of its file."""

from __future__ import annotations

from lab.base.arrays import FloatArray

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
