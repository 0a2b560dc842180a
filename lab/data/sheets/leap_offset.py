"""Leap offset: whether one of two tables of a log counts GPS time and the other UTC.

The two are 18 s apart, which a log of a minute does not show by its overlap. A log that its check refuses is
tried again with the stamps of the fixes moved by that; one that passes is reported if its tables begin and
end that far apart, as tables do that were recorded together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import LEAP_SECONDS
from lab.data.checks.log_check import is_explained
from lab.data.log.sensor_log import GnssLog, SensorLog

_NEARLY = 1.0
"""Largest deviation of a begin and an end from that offset [s]: fixes are up to a second apart."""


def offset_that_agrees(imu: FloatArray, gnss: GnssLog, read: Callable[[GnssLog], SensorLog]) -> str:
    """Return a sentence if a log agrees with fixes 18 s earlier or later; empty if it does not.

    Of the two shifts the one is tried that brings the ends of the tables together: by the other a minute has
    less than half of the motion left, which chance may fit.

    Parameters
    ----------
    imu
        Time stamps of the IMU [s].
    gnss
        The fixes, with the stamps of their table.
    read
        Returns the checked log with given fixes, or raises a MissionError.
    """
    shift = -float(np.copysign(LEAP_SECONDS, np.sum(_ends(imu, gnss))))
    try:
        agrees = is_explained(read(replace(gnss, time=gnss.time + shift)))
    except MissionError:
        return ""
    if not agrees:
        return ""
    how, side = ("earlier", "late") if shift < 0 else ("later", "early")
    return (
        f"With the fixes {abs(shift):g} s {how} the log agrees: the stamps of the GPS are {abs(shift):g} s "
        f"{side} relative to the IMU's. One clock is likely to be GPS time and the other UTC, "
        f"{LEAP_SECONDS:g} leap seconds apart; accepted are stamps of one clock"
    )


def end_together(imu: FloatArray, gnss: GnssLog) -> bool:
    """Return whether the fixes begin and end 18 s after the IMU, or both before it."""
    begin, end = _ends(imu, gnss)
    return bool(max(abs(abs(one) - LEAP_SECONDS) for one in (begin, end)) < _NEARLY and begin * end > 0)


def remark_on_ends(imu: FloatArray, gnss: GnssLog) -> str:
    """Return a remark on a log whose tables begin and end 18 s apart, and whose motion shows no offset."""
    begin, end = _ends(imu, gnss)
    side = "after" if begin > 0 else "before"
    return (
        f"The fixes begin {abs(begin):.1f} s and end {abs(end):.1f} s {side} the IMU. If both were recorded "
        f"together, one clock is GPS time and the other UTC, {LEAP_SECONDS:g} leap seconds apart: the "
        "motion does not show it. The stamps are used as they are."
    )


def _ends(imu: FloatArray, gnss: GnssLog) -> tuple[float, float]:
    """Return by how much the fixes begin and end after the IMU [s]."""
    fixes = gnss.time[np.isfinite(gnss.time)] - gnss.latency
    return float(fixes[0] - imu[0]), float(fixes[-1] - imu[-1])
