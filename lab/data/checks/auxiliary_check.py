"""Auxiliary check: whether barometer, odometer, airspeeds or headings of a log contradict GPS and gyros.

A wrong unit or sign is a known factor between two measurements of the same motion. Only such a factor
refuses a log, and only where noise, bias, scale error, wind and sideslip cannot look like it. Where the
motion shows too little, nothing is said.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.base.aid_table import AIDS, SERIES
from lab.base.arrays import FloatArray, running_sums
from lab.base.files.mission_error import MissionError
from lab.data.checks import limits
from lab.data.checks.likeness import likeness, near_units
from lab.data.log.auxiliary_data import Headings, Series
from lab.data.log.sensor_log import SensorLog
from lab.data.log.vehicle import vehicle_of
from lab.motion.frames.rotation import wrap

_PRESSURE = -0.12
"""Change of the pressure of air at sea level with the height [hPa/m]."""
_ANYWAY = "check_sensors = false in log.toml uses them as they are"


def check_auxiliary(log: SensorLog, files: Mapping[str, Path | None]) -> None:
    """Raise if a sensor besides IMU and GPS contradicts them by the factor of a wrong unit or sign.

    Parameters
    ----------
    log
        The log, whose IMU and GPS have been checked.
    files
        The file of each sensor, by its name, for messages.

    Raises
    ------
    MissionError
        Naming file, column and likely cause: heights in feet, cm or mm, depths, pressures; speeds in km/h,
        mph or knots, or positive backwards; headings in radians, or counter-clockwise.
    """
    found: dict[str, Any] = {**log.auxiliary.series, "heading": log.auxiliary.headings}
    for aid in sorted(AIDS, key=lambda aid: aid not in SERIES):
        if aid.check and found.get(aid.name) is not None:
            column = f"{files[aid.name]}, column {aid.column.name}"
            CHECKS[aid.check](log, found[aid.name], column, aid.words)


def _check_heights(log: SensorLog, heights_of: Series, column: str, words: str) -> None:
    """Compare the heights of a barometer with those of the GPS; its bias is free."""
    rows, readings = _at_fixes(log, heights_of)
    time = log.gnss.time[rows]
    heights, readings = (_without_means(time, one) for one in (log.gnss.position[rows, 2], readings))
    if (
        heights.size < limits.LOG.compared_fixes
        or np.ptp(np.percentile(heights, limits.LOG.height_percentiles)) < limits.LOG.climb
    ):
        return
    like = likeness(heights, readings)
    if like.coherence < limits.LOG.coherent:
        return
    factor = float(np.copysign(like.ratio, like.correlation))
    cause = _height_cause(factor)
    if cause:
        raise MissionError(
            f"{column}: the heights of the {words} change {factor:.3g} times as much as those of the GPS "
            f"(correlation {like.correlation:.2f}): {cause}; accepted are heights in m, positive up. "
            f"{_ANYWAY}"
        )


def _height_cause(factor: float) -> str:
    """Return the likely cause of heights that change by another factor than 1; empty if none is near."""
    unit = near_units(factor, "height")
    if factor > 0:
        return f"the heights look like {unit} where m are declared" if unit else ""
    if abs(np.log(factor / _PRESSURE)) < np.log(limits.LOG.unit_ratio):
        return "the numbers look like pressures in hPa where heights in m are declared"
    if not unit and abs(np.log(-factor)) > np.log(limits.LOG.unit_ratio):
        return ""
    return f"the heights look like depths{f' in {unit}' if unit else ''}, positive down"


def _check_speeds(log: SensorLog, odometer: Series, column: str, words: str) -> None:
    """Compare the speeds of an odometer with the speed of the GPS, which no component of it exceeds."""
    rows, readings = _at_fixes(log, odometer)
    speed = _speeds(log)[rows]
    moving = speed > limits.LOG.compared_speed
    if moving.sum() < limits.LOG.compared_fixes:
        return
    ratio = readings[moving] / speed[moving]
    factor = float(np.median(ratio))
    if (
        factor == 0
        or np.mean(np.abs(np.log(np.maximum(ratio / factor, 1e-9))) < np.log(limits.LOG.unit_ratio))
        < limits.LOG.agreeing_ratios
    ):
        return
    what = f"{column}: the speeds of the {words} are {factor:.3g} times those of the GPS (median): they look "
    accepted = f"; accepted are speeds in m/s, positive forward. {_ANYWAY}"
    unit = near_units(factor, "speed")
    if unit:
        raise MissionError(f"{what}like {unit} where m/s are declared{accepted}")
    if 1 / limits.LOG.unit_ratio < -factor < limits.LOG.unit_ratio and _goes_forward(log):
        raise MissionError(f"{what}positive backwards{accepted}")


def _check_airspeeds(log: SensorLog, airspeed: Series, column: str, _: str) -> None:
    """Compare airspeeds with ground speeds on courses to all sides, since a wind changes them."""
    rows, readings = _at_fixes(log, airspeed)
    velocity, speed = log.gnss.velocity_n[rows], _speeds(log)[rows]
    moving = speed > limits.LOG.compared_speed
    if moving.sum() < limits.LOG.compared_fixes:
        return
    course = np.arctan2(velocity[moving, 1], velocity[moving, 0])
    octant = (
        np.floor((course + np.pi) / (2 * np.pi) * limits.LOG.octants).astype(np.intp) % limits.LOG.octants
    )
    count = np.bincount(octant, minlength=limits.LOG.octants)
    if not count.all():
        return
    ground, air = (
        float(np.mean(np.bincount(octant, values[moving], limits.LOG.octants) / count))
        for values in (speed, readings)
    )
    if (
        ground > limits.LOG.ground_speed
        and limits.LOG.airspeed_ratio[0] < air / ground < limits.LOG.airspeed_ratio[1]
    ):
        raise MissionError(
            f"{column}: the airspeeds are {air / ground:.3g} times the speeds of the GPS, as means over "
            "courses to all sides: they look like km/h, mph or knots where m/s are declared; accepted are "
            f"true airspeeds in m/s. {_ANYWAY}"
        )


def _check_headings(log: SensorLog, headings: Headings, column: str, _: str) -> None:
    """Compare the changes of the headings with the turns about the axis called down, over legs of seconds."""
    change, change_of_radians, turn = _turns_between_headings(log, headings)
    if (
        turn.size < limits.LOG.heading_legs
        or (np.abs(turn - np.median(turn)) > limits.LOG.turn).sum() < limits.LOG.turns
    ):
        return
    as_read = _residual(turn, change)
    others = {"counter-clockwise where clockwise is declared": -change}
    if np.degrees(np.abs(headings.heading).max()) <= limits.LOG.radians:
        others["like radians where degrees are declared"] = change_of_radians
        others["like radians, counter-clockwise, where degrees, clockwise, are declared"] = -change_of_radians
    residuals = {cause: _residual(turn, other) for cause, other in others.items()}
    cause = min(residuals, key=lambda one: residuals[one])
    if residuals[cause] < min(limits.LOG.heading_residual, as_read / limits.LOG.heading_gain):
        raise MissionError(
            f"{column}: the headings do not change as the gyro called down turns: they look {cause} (rms "
            f"difference over legs of {limits.LOG.heading_leg:g} s {np.degrees(as_read):.2g}°, otherwise "
            f"{np.degrees(residuals[cause]):.2g}°); accepted are degrees, clockwise from north. {_ANYWAY}"
        )


CHECKS: dict[str, Callable[[SensorLog, Any, str, str], None]] = {
    "height": _check_heights,
    "speed": _check_speeds,
    "airspeed": _check_airspeeds,
    "heading": _check_headings,
}
"""The comparisons, by what `lab.base.aid_table` calls them: log, readings, column, and sensor in words."""


def _turns_between_headings(log: SensorLog, headings: Headings) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the changes of the headings over legs, those if they are radians, and the turns by the gyro."""
    inside = np.flatnonzero((headings.time >= log.time[0]) & (headings.time <= log.time[-1]))
    if inside.size < 2:
        return np.empty(0), np.empty(0), np.empty(0)
    at = [int(inside[0])]
    while (
        after := int(np.searchsorted(headings.time, headings.time[at[-1]] + limits.LOG.heading_leg))
    ) <= inside[-1]:
        at.append(after)
    time, heading = headings.time[at], headings.heading[at]
    turned = np.interp(time, log.time, running_sums(log.dtheta[:, 2]))
    turn = np.diff(turned)
    kept = (np.diff(time) < limits.LOG.longest_heading_leg) & (np.abs(turn) < limits.LOG.largest_turn)
    for start, end in log.breaks:
        kept &= (time[1:] < start) | (time[:-1] > end)
    return wrap(np.diff(heading))[kept], wrap(np.diff(np.degrees(heading)))[kept], turn[kept]


def _residual(turn: FloatArray, change: FloatArray) -> float:
    """Return the rms difference of two turns [rad], without the bias of the gyro."""
    apart = wrap(turn - change)
    return float(np.sqrt(np.mean((apart - np.median(apart)) ** 2)))


def _goes_forward(log: SensorLog) -> bool:
    """Return whether the forward accelerometer shows that the nose points along the course.

    A car may drive backwards for long.
    """
    vehicle = vehicle_of(log.auxiliary.vehicle)
    if vehicle.name and not vehicle.follows_nose:
        return False
    from lab.data.checks.log_check import (  # noqa: PLC0415 - imports scipy, which takes a while
        largest_correlation,
        motion_of,
    )

    motion = motion_of(log)
    along = motion.speed + motion.climb
    if along.size < limits.LOG.compared_fixes or np.std(along) < limits.LOG.lively_speed:
        return False
    correlation, _, _ = largest_correlation(log, log.dvelocity[:, 0], motion, along)
    return correlation > limits.LOG.axis_correlation


def _speeds(log: SensorLog) -> FloatArray:
    """Return the speed of each fix [m/s]; an unknown vertical one counts as zero, and others make it NaN."""
    velocity = log.gnss.velocity_n
    return np.asarray(np.hypot(np.hypot(velocity[:, 0], velocity[:, 1]), np.nan_to_num(velocity[:, 2])))


def _at_fixes(log: SensorLog, series: Series) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the fixes during which a sensor reads, and its readings there."""
    time = log.gnss.time - log.gnss.latency
    if not series.time.size:
        return np.empty(0, np.intp), np.empty(0)
    after = np.searchsorted(series.time, time)
    within = (after > 0) & (after < series.time.size)
    after = np.clip(after, 1, max(series.time.size - 1, 1)) % series.time.size
    rows = np.flatnonzero(within & (series.time[after] - series.time[after - 1] < limits.LOG.reading_gap))
    return rows, np.interp(time[rows], series.time, series.value)


def _without_means(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return values without their means over pieces of `height_piece`."""
    piece = np.floor((time - time[:1]) / limits.LOG.height_piece).astype(np.intp)
    count = np.maximum(np.bincount(piece), 1)
    return np.asarray(values - (np.bincount(piece, values) / count)[piece])
