"""Sheet gravity: how large gravity is in the accelerations of an IMU, beside the motion of the fixes."""

from __future__ import annotations

import numpy as np

from lab.base.files.mission_error import QuestionError
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.log.sensor_log import GnssLog
from lab.data.sheets.sheet_imu import Imu
from lab.motion.frames.displacement import velocity_of_positions
from lab.motion.kinematics.running_turns import running_attitudes

_LEG = 4.0
"""Time over which the specific force is summed, against vibration and the noise of velocities [s]."""
_AMBIGUOUS = (0.95, 0.9905)
"""Gravity read in mg [g] that may be cm/s² (0.9807). Eight real logs in known units have 0.984 to 1.011,
and a bias of 20 mg is usual for MEMS: below the middle both are likely, down to a bias of 50 mg beside mg."""


def size_of_gravity(imu: Imu, gnss: GnssLog | None) -> float:
    """Return the force of an IMU over what the velocities of the fixes ask for [g]; NaN if they are too few.

    Both are changes of velocity without gravity over some seconds: |Σ C f dt| / |Δv - g T|, C by the gyros.
    Turns and climbs are in both, so it is 1 for any motion, and no attitude is needed.

    Parameters
    ----------
    imu
        The IMU, in its own axes.
    gnss
        The fixes; without any, the IMU is taken to be at rest.
    """
    known = np.isfinite(imu.samples).all(axis=1)
    time, samples = imu.time[known], imu.samples[known]
    if time.size < 2 or (gnss is not None and gnss.time.size < 2):
        return float("nan")
    at, velocity_n = np.arange(time[0], time[-1], _LEG), np.zeros(3)
    if gnss is not None:
        at = gnss.time - gnss.latency
        by_position = velocity_of_positions(gnss.time, gnss.position)
        velocity_n = np.where(np.isnan(gnss.velocity_n), by_position, gnss.velocity_n)
    step = max(1, round(_LEG / float(np.median(np.diff(at))))) if at.size > 1 else 1
    rows = np.flatnonzero((at >= time[0]) & (at <= time[-1]))[::step]
    if rows.size < 2:
        return float("nan")
    at, velocity_n = at[rows], np.broadcast_to(velocity_n, (at.size, 3))[rows]
    dt = np.diff(time)[:, None]
    total = np.cumsum(running_attitudes(samples[1:, :3] * dt)[:-1].apply(samples[1:, 3:] * dt), axis=0)
    gained = np.diff([np.interp(at, time[1:], column) for column in total.T]).T
    expected = np.diff(velocity_n, axis=0)
    expected[:, 2] -= STANDARD_GRAVITY * np.diff(at)
    return float(np.nanmedian(np.linalg.norm(gained, axis=1) / np.linalg.norm(expected, axis=1)))


def refuse_cm_per_s2(imu: Imu, gnss: GnssLog | None) -> None:
    """Raise if accelerations that are read as mg may be cm/s².

    Parameters
    ----------
    imu, gnss
        As of `size_of_gravity`.

    Raises
    ------
    QuestionError
        If gravity is as long as that in cm/s².
    """
    force = imu.accelerometer
    if not (force.unit == "mg" and force.source.startswith("guessed")):
        return
    size = size_of_gravity(imu, gnss)
    if _AMBIGUOUS[0] < size < _AMBIGUOUS[1]:
        by = "at rest" if gnss is None else "by the velocities of the fixes"
        raise QuestionError(
            f"{force.place}: {by}, the accelerometers measure {1000 * size:.0f} for gravity, which may be "
            "cm/s² (981) or mg (1000) with a bias, and the headings name no unit; accepted are columns with "
            "their unit: for each of the three --unit HEADING=cm/s² or --unit HEADING=mg",
            {unit: {one.text: unit for one in force.headings} for unit in ("cm/s²", "mg")},
        )
