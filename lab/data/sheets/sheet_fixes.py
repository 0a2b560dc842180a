"""Sheet fixes: the fixes of a receiver out of the sheets of a log, with a report."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import ComplexArray, FloatArray, running_sums
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import DEGREE
from lab.data.checks import estimator_resets
from lab.data.files.unit_names import UNITS
from lab.data.log.sensor_log import GnssLog
from lab.data.rebuild.raw_flight import ColumnUnit, Reset
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_accuracy import read_sigmas
from lab.data.sheets.sheet_clock import Clock, find_clock
from lab.data.sheets.sheet_coordinates import in_degrees, on_the_earth, refuse_radians
from lab.data.sheets.sheet_heights import (
    BY_SIZE,
    Column,
    doubt_of_feet,
    find_column,
    find_heights,
    rescale_column,
)
from lab.data.sheets.sheet_imu import NAMED, in_order, is_of_another_device, of_odd_stamps
from lab.motion.frames.displacement import metres_per_radian, velocity_of_positions
from lab.motion.frames.rotation import wrap

_LOCAL = re.compile(r"(?i)^\s*(?:t|p|pos|position|p_rs_r)[ _.]?[xyz]\b")
"""Headings of positions in a local frame, as of EuRoC and TUM."""
_HELD = 0.5
"""Part of the rows that repeat the position before, from which a logger holds the last fix."""
_ALONG, _CLEARLY = 0.9, 0.5
"""Mean cosine between the course and the motion of the positions from which they agree, and the largest part
of the rms angle between them in ° that may be left in rad."""
_SPEEDS = ("m/s", "km/h", "kt", "mph", "ft/s", "cm/s", "mm/s", "kt/100")
_HEIGHTS_BESIDE = {"kt/100": "cm", "ft/s": "ft"}
"""Units of heights without a unit beside a speed in these: those of TinyGPS, and of who counts in feet."""
_LIKE_UNITS = {"°": ("rad",), "1e-7°": ("1e-6°",)}
"""Units whose numbers may be taken for another one: TinyGPS has 1e-6°."""
_COURSES = {"0.01°": (720.0, 36_001.0, 1e-2), "1e-5°": (36_001.0, 3.6001e7, 1e-5)}
"""Whole numbers of a course in these units are above the first number, two turns in degrees, and up to the
second; and their factor to degrees."""
_CONTRADICTED = 5.0
"""Least factor between velocity and motion that contradicts a guessed unit of time: noise of positions at
10 Hz makes them move up to 2.5 times as fast."""
_PAUSE = 5.0
"""Step of the time, in usual ones, from which the speed may have been another one between."""
_FAST_ENOUGH = 2.0
"""Speed from which positions show the unit of the speed [m/s]."""
_MIN_LEGS = 10
"""Fewest legs that show it."""
_MAX_LEGS = 100_000
"""Most legs: of 70 hours."""
_OF_NOSE = re.compile(r"(?i)heading|hdg|yaw")
_CRAB = np.radians(2.0)
"""Median angle between a heading and the motion from which it is no course [rad]."""
_LEG, _MIN_RISE = 5.0, 0.8
"""Time over which heights and vertical velocity are compared [s], and the correlation that shows a unit."""
_CLIMBED = 30.0
"""Range of heights from which a vertical velocity of zeros is none [m]: receivers are off by less."""
_LIKE_RISE = 0.3
"""Largest distance of the ratio of both from a unit, as a logarithm: noise of the heights adds to it."""
_VERTICAL = ("m/s", "ft/min", "ft/s", "km/h", "kt", "cm/s", "mm/s")
_UNIT_TOLERANCE = 0.1
"""Largest deviation of a median ratio from that of a unit: km/h and ft/s are 10 % apart."""


DOUBTFUL = ("assumed", BY_SIZE)
"""Sources of a unit that the motion may contradict."""


class Fixes(NamedTuple):
    """Fixes of a receiver.

    Attributes
    ----------
    sheet : Sheet
        Where they are from.
    gnss : GnssLog
        The fixes.
    speed, course : (m,) arrays
        Speed [m/s] and course [rad] over ground; NaN where unknown.
    units : tuple of ColumnUnit
        The columns that were used.
    remarks : tuple of str
        The report.
    rows : (m,) array
        Rows of the sheet.
    """

    sheet: Sheet
    gnss: GnssLog
    speed: FloatArray
    course: FloatArray
    units: tuple[ColumnUnit, ...]
    remarks: tuple[str, ...]
    rows: NDArray[np.intp]


def find_fixes(sheets: Sequence[Sheet], wanted: Sequence[str] = (), *, with_height: bool = True) -> Fixes:
    """Return the fixes of the best receiver in the sheets.

    Parameters
    ----------
    sheets
        The sheets of the log.
    wanted
        Headings of the time stamps of the IMU, whose clock the fixes should have.
    with_height
        Whether a receiver needs heights; without them they are NaN.

    Raises
    ------
    MissionError
        If no sheet has latitude, longitude, height where it is needed, and time.
    """
    places = [one for one in sheets if one.all_of("latitude") and one.all_of("longitude")]
    timed = [
        (one, clock)
        for one in places
        # Where the samples of an IMU stand in the same rows, these are as dense as they.
        if (clock := find_clock(one, fast=bool(one.all_of("rate")), wanted=wanted)) is not None
    ]
    if not timed:
        names = ", ".join(one.name for one in sheets)
        lacks = "time stamps beside latitude and longitude" if places else "columns of latitude and longitude"
        local = "" if places else _what_is_there(sheets)
        raise MissionError(
            f"{names}: no {lacks} found{local}.{of_odd_stamps(places)} Accepted are headings such as time, "
            "latitude, longitude, altitude, speed and course, or what the columns are: --column "
            "HEADING=latitude[°]"
        )
    sheet, clock = min(timed, key=_preference)
    others = [one.name for one, _ in timed if one is not sheet]
    fixes = _fixes(sheet, clock, with_height)
    if others:
        fixes = fixes._replace(remarks=(*fixes.remarks, f"Fixes of {', '.join(others)} are not used."))
    return fixes


def _what_is_there(sheets: Sequence[Sheet]) -> str:
    """Return remarks on positions in a room, and on an IMU without a receiver, which cannot be navigated."""
    said = ""
    if local := [text for sheet in sheets for text in sheet.unknown if _LOCAL.search(text)][:3]:
        said = (
            f": {', '.join(local)} are positions in metres from an origin, whose latitude, longitude and "
            "azimuth the file does not give"
        )
    if all(any(one.all_of(name) for one in sheets) for name in ("rate", "force")):
        said += (
            ". It has an IMU, but no positions of a receiver, without which it cannot be navigated; if the "
            "receiver has a file of its own, import the two files together"
        )
    return said


def _preference(timed: tuple[Sheet, Clock]) -> tuple[float, ...]:
    sheet, _ = timed
    rank = sheet.all_of("latitude")[0][0].rank + 5 * ("network" in sheet.name.lower())
    motion = sheet.all_of("speed") or sheet.all_of("north")
    return (is_of_another_device(sheet), not sheet.all_of("height"), rank, not motion, -len(sheet))


def _steps(position: FloatArray) -> ComplexArray:
    """Return the displacements between positions (n, 3), north + i east (n - 1,) [m]."""
    per_latitude, per_longitude = metres_per_radian(position[:, 0], 0.0)
    east = np.diff(np.unwrap(position[:, 1])) * per_longitude[1:]
    return np.asarray(np.diff(position[:, 0]) * per_latitude[1:] + 1j * east)


def _fixes(sheet: Sheet, clock: Clock, with_height: bool) -> Fixes:
    latitude, longitude = (find_column(sheet, name) for name in ("latitude", "longitude"))
    assert latitude is not None and longitude is not None
    latitude, longitude = on_the_earth(sheet, *in_degrees(latitude, longitude))
    height, words = find_heights(sheet, latitude, needed=with_height)
    known = np.isfinite(latitude.values) & np.isfinite(longitude.values)
    known &= np.isfinite(height.values) | (height.name == "")
    rows, time, sorted_ = in_order(np.where(known, clock.time, np.nan), "GPS")
    changed, held = _changes(rows, latitude.values, longitude.values)
    rows, time = rows[changed], time[changed]
    position = np.column_stack((latitude.values, longitude.values, height.values))[rows]
    if latitude.source == longitude.source and latitude.source in DOUBTFUL:
        unit = _unit_by_motion(sheet, latitude.unit, rows, time, position)
        if not unit and latitude.unit == "°" and len(rows) > 1 and np.ptp(position[:, 0]) > 0:
            refuse_radians(sheet, latitude.name, longitude.name, position)
        if unit and unit != latitude.unit:
            source = f"guessed: in {latitude.unit}, the positions do not move as fast as the velocity says"
            position[:, :2] *= UNITS["angle"][unit] / UNITS["angle"][latitude.unit]
            latitude, longitude = (one._replace(unit=unit, source=source) for one in (latitude, longitude))
    pace = find_column(sheet, "speed")
    pace = pace and _speed_unit(pace, rows, time, position)
    if height.source in DOUBTFUL and pace is not None and pace.unit in _HEIGHTS_BESIDE:
        unit = _HEIGHTS_BESIDE[pace.unit]
        position[:, 2] *= UNITS["length"][unit] / UNITS["length"][height.unit]
        height = height._replace(
            unit=unit, source=f"guessed: the positions show that {pace.name} is in {pace.unit}"
        )
        other = f'--unit "{height.name}=m" states another one'
        words = f"Heights: {height.name}, in {unit} ({height.source}; {other})."
    remarks = [
        f"Fixes: {latitude.name}, {longitude.name} of {sheet.name}, in {latitude.unit} ({latitude.source}).",
        words,
        clock.report("GPS"), *sorted_, *held,
    ]  # fmt: skip
    if others := [one.text for one, _ in sheet.all_of("latitude")[1:]]:
        remarks.append(f"Other positions in the file are not used: {', '.join(others)}.")
    velocity, speed, course, units, moved = _velocity(sheet, rows, time, position)
    if clock.guessed and units and units[0].source == NAMED:
        _refuse_contradicted(sheet, clock, speed, time, position)
    sigmas, accuracies, more = read_sigmas(sheet, rows, (height, *units), position, velocity)
    gnss = GnssLog(time, position, velocity, sigmas[:, :3], sigmas[:, 3:], np.zeros(3), 0.0)
    used = tuple(
        ColumnUnit(one.name, one.unit, one.source)
        for one in (latitude, longitude, height, *units, *accuracies)
    )
    feet = doubt_of_feet(height, units if pace is None else (*units, pace))
    return Fixes(sheet, gnss, speed, course, used, (*remarks, *moved, *feet, *more), rows)


def in_height_unit(fixes: Fixes, unit: str, factor: float) -> Fixes:
    """Return fixes whose heights are in another unit than that in which they were read.

    Parameters
    ----------
    fixes
        The fixes.
    unit
        The unit of their heights.
    factor
        How much the numbers change per metre.
    """
    column, taken = fixes.units[2].column, fixes.units[2].unit
    position = fixes.gnss.position * np.array([1.0, 1.0, UNITS["length"][unit] / UNITS["length"][taken]])
    source = f"guessed: the numbers change {factor:.3g} times as much as metres by the accelerometers"
    before = f"Heights: {column}, in "
    remarks = [f"{before}{unit} ({source})." if one.startswith(before) else one for one in fixes.remarks]
    units = (*fixes.units[:2], ColumnUnit(column, unit, source), *fixes.units[3:])
    return fixes._replace(gnss=replace(fixes.gnss, position=position), units=units, remarks=tuple(remarks))


def speed_of_fixes(fixes: Fixes) -> FloatArray:
    """Return the speeds of fixes [m/s], even without a course beside; NaN where unknown."""
    speed = find_column(fixes.sheet, "speed")
    if speed is None:
        return fixes.speed
    return _speed_unit(speed, fixes.rows, fixes.gnss.time, fixes.gnss.position).values[fixes.rows]


def _changes(rows: NDArray[np.intp], *columns: FloatArray) -> tuple[NDArray[np.bool_], list[str]]:
    """Return which rows have a new fix, where a logger writes the latest fix into every row."""
    same = np.ones(max(len(rows) - 1, 0), dtype=bool)
    for column in columns:
        same &= np.diff(column[rows]) == 0
    if not same.size or same.mean() < _HELD:
        return np.ones(len(rows), dtype=bool), []
    return np.append(True, ~same), [
        f"{same.sum()} rows repeat the position of the row before and count as no fix: the logger writes the "
        "latest one into every row."
    ]


def _velocity(
    sheet: Sheet, rows: NDArray[np.intp], time: FloatArray, position: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, list[Column], list[str]]:
    """Return velocity north, east, down, speed, course, the columns they are from, and a report."""
    velocity = np.full((len(rows), 3), np.nan)
    north, east, down, up = (find_column(sheet, name) for name in ("north", "east", "down", "up"))
    speed, course = find_column(sheet, "speed"), find_column(sheet, "course")
    used: list[Column] = []
    remarks: list[str] = []
    pace, angle = np.full(len(rows), np.nan), np.full(len(rows), np.nan)
    if north is not None and east is not None:
        north, east, down, up = _component_units([north, east, down, up], rows, time, position)
        assert north is not None and east is not None
        used += [north, east]
        velocity[:, 0], velocity[:, 1] = north.values[rows], east.values[rows]
        pace, angle = np.hypot(*velocity[:, :2].T), np.arctan2(velocity[:, 1], velocity[:, 0])
    elif speed is not None and course is not None and not _is_of_nose(course, sheet, rows, time, position):
        speed = _speed_unit(speed, rows, time, position)
        course = _course_unit(course, rows, time, position)
        used += [speed, course]
        pace, angle = speed.values[rows], course.values[rows]
        pace, angle = np.where(pace >= 0, pace, np.nan), np.where(angle >= -np.pi, angle, np.nan)
        # At rest any course will do.
        angle = np.where(pace == 0, np.nan_to_num(angle), angle)
        velocity[:, 0], velocity[:, 1] = pace * np.cos(angle), pace * np.sin(angle)
    vertical = down if down is not None else up
    # The U of a heading such as VEL_U is that of POS_U beside it, an uncertainty.
    uncertain = any(one.lower().endswith("_u") for one in sheet.unknown)
    if north is None and vertical is not None and uncertain and vertical.name.lower().endswith("_u"):
        vertical = None
    if vertical is not None:
        sign = 1 if down is not None else -1
        vertical, why = _of_heights(vertical, sign, rows, time, position[:, 2])
        remarks += why
        if vertical is not None:
            used.append(vertical)
            velocity[:, 2] = sign * vertical.values[rows]
    if used:
        words = ", ".join(f"{one.name} in {one.unit} ({one.source})" for one in used)
        remarks.append(f"Velocity: {words}.")
    return velocity, pace, angle, used, remarks


def _is_of_nose(
    course: Column, sheet: Sheet, rows: NDArray[np.intp], time: FloatArray, position: FloatArray
) -> bool:
    """Return whether a heading beside roll and pitch is not the direction of motion: in wind they differ."""
    if not (sheet.all_of("roll") and sheet.all_of("pitch")) or not _OF_NOSE.search(course.name):
        return False
    written = np.exp(1j * _course_unit(course, rows, time, position).values[rows])
    # Noise of the positions turns the way from one to the next, and not that of a second.
    usual = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    leg = slice(None, None, max(1, round(1.0 / usual)) if usual > 0 else 1)
    time, step, written = time[leg], _steps(position[leg]), written[leg]
    written = np.angle(written[1:] + written[:-1])
    fast = (np.abs(step) > _FAST_ENOUGH * np.diff(time)) & np.isfinite(written)
    return bool(fast.sum() >= _MIN_LEGS and np.median(np.abs(wrap(np.angle(step) - written)[fast])) > _CRAB)


def _of_heights(
    vertical: Column, sign: int, rows: NDArray[np.intp], time: FloatArray, height: FloatArray
) -> tuple[Column | None, list[str]]:
    """Return a vertical velocity in the unit that the heights show, if its heading names none.

    One that the heights contradict is None, with the reason.
    """
    said, step = -sign * vertical.values[rows], np.diff(time)
    known = np.isfinite(said) & np.isfinite(height) & np.append(True, step > 0)
    t, v, h = time[known], said[known], height[known]
    if len(t) < _MIN_LEGS or t[-1] - t[0] < _MIN_LEGS * _LEG or not (np.diff(t) > 0).all():
        return vertical, []
    way = running_sums(np.diff(t) * (v[1:] + v[:-1]) / 2)
    begin = t[0] + _LEG / 2 * np.arange(min((t[-1] - t[0] - _LEG) / (_LEG / 2), _MAX_LEGS))
    rise, stated = (np.interp(begin + _LEG, t, one) - np.interp(begin, t, one) for one in (h, way))
    size = np.sqrt(np.sum(rise**2) * np.sum(stated**2))
    like = float(np.sum(rise * stated) / size) if size else 0.0
    if not v.any() and np.ptp(h) > _CLIMBED:
        return None, [
            f"The vertical velocity {vertical.name} is not used: it is always zero, and the heights change."
        ]
    if like < -_MIN_RISE:
        return None, [
            f"The vertical velocity {vertical.name} is not used: the heights change the other way. "
            f'--column "{vertical.name}={"-down" if sign > 0 else "-up"}[{vertical.unit}]" reverses it.'
        ]
    if vertical.source != "assumed" or like < _MIN_RISE:
        return vertical, []
    ratio = float(np.sqrt(np.sum(rise**2) / np.sum(stated**2)))
    unit = min(_VERTICAL, key=lambda one: abs(np.log(ratio / UNITS["speed"][one])))
    if unit == vertical.unit or abs(np.log(ratio / UNITS["speed"][unit])) > _LIKE_RISE:
        return vertical, []
    source = f"guessed: the heights change {ratio:.3g} times as fast as in m/s"
    return rescale_column(vertical, "speed", unit, source), []


def _component_units(
    components: list[Column | None], rows: NDArray[np.intp], time: FloatArray, position: FloatArray
) -> list[Column | None]:
    """Return north, east, down and up in the unit that the positions show, if no heading names one."""
    north, east = components[:2]
    assert north is not None and east is not None
    known = [one for one in components if one is not None and one.source != "assumed"]
    if known:
        return components
    whole = _speed_unit(north._replace(values=np.hypot(north.values, east.values)), rows, time, position)
    factor = UNITS["speed"][whole.unit]
    return [
        one and one._replace(values=one.values * factor, unit=whole.unit, source=whole.source)
        for one in components
    ]


def _path_ratio(stated: FloatArray, time: FloatArray, position: FloatArray) -> float:
    """Return how much as fast as stated [m/s] the positions move; NaN if they move too little."""
    dt, moved, stated = np.diff(time), np.abs(_steps(position)), (stated[1:] + stated[:-1]) / 2
    # Over a pause of the logger, the speeds at its ends say nothing.
    usual = dt < _PAUSE * np.median(dt[dt > 0]) if (dt > 0).any() else dt > 0
    fast = (moved > _FAST_ENOUGH * dt) & (dt > 0) & (stated > 0) & usual
    return float(np.sum(moved[fast]) / np.sum(stated[fast] * dt[fast])) if fast.sum() >= _MIN_LEGS else np.nan


def _refuse_contradicted(
    sheet: Sheet, clock: Clock, speed: FloatArray, time: FloatArray, position: FloatArray
) -> None:
    """Raise if the positions move much faster or slower than the velocity says by a guessed unit of time."""
    fast = (speed[1:] > _FAST_ENOUGH) & (np.diff(time) > 0)
    if fast.sum() < _MIN_LEGS or not (np.diff(time) > 0).all():
        return
    step = velocity_of_positions(time, position)
    ratio = float(np.median(np.hypot(step[1:, 0], step[1:, 1])[fast] / speed[1:][fast]))
    units = [UNITS["speed"][one] for one in _SPEEDS]
    if not 0 < ratio < np.inf or min(abs(np.log(ratio / one)) for one in units) < _UNIT_TOLERANCE:
        return  # the unit of the velocity may be another one
    if 1 / _CONTRADICTED < ratio < _CONTRADICTED:
        return
    count = 1 / (UNITS["time"][clock.unit] * ratio)
    raise MissionError(
        f"{sheet.name}: with {clock.column} in {clock.unit}, as its steps let guess, the positions move "
        f"{ratio:.3g} times as fast as the velocity says. Its numbers seem to be {count:.3g} a second: "
        f'--unit "{clock.column}=s/{count:.3g}" says so, with the count that the logger has'
    )


def _unit_by_motion(
    sheet: Sheet, taken: str, rows: NDArray[np.intp], time: FloatArray, position: FloatArray
) -> str:
    """Return the unit in which coordinates, read in one, move as the velocity says; empty if none does."""
    north, east, speed = (find_column(sheet, name) for name in ("north", "east", "speed"))
    if north is not None and east is not None:
        speed = north._replace(values=np.hypot(north.values, east.values))
    if speed is None or len(rows) < _MIN_LEGS or taken not in _LIKE_UNITS:
        return ""
    for unit in (taken, *_LIKE_UNITS[taken]):
        factor = UNITS["angle"][unit] / UNITS["angle"][taken]
        place = position * (factor, factor, 1.0)
        if (np.abs(place[:, :2]) > (np.pi / 2, np.pi)).any():
            continue
        ratio = _path_ratio(speed.values[rows], time, place)
        units = _SPEEDS if speed.source == "assumed" else ("m/s",)
        if any(abs(np.log(ratio / UNITS["speed"][one])) < _UNIT_TOLERANCE for one in units):
            return unit
    return ""


def _speed_unit(speed: Column, rows: NDArray[np.intp], time: FloatArray, position: FloatArray) -> Column:
    """Return the speed in the unit that the positions show, if its heading names none."""
    if speed.source != "assumed" or len(rows) < _MIN_LEGS:
        return speed
    ratio = _path_ratio(speed.values[rows], time, position)
    if np.isnan(ratio):
        return speed
    unit = min(_SPEEDS, key=lambda one: abs(np.log(ratio / UNITS["speed"][one])))
    if unit == "m/s" or abs(np.log(ratio / UNITS["speed"][unit])) > _UNIT_TOLERANCE:
        return speed
    return speed._replace(
        values=speed.values * UNITS["speed"][unit],
        unit=unit,
        source=f"guessed: the positions move {ratio:.3g} times as fast as in m/s",
    )


def _course_unit(course: Column, rows: NDArray[np.intp], time: FloatArray, position: FloatArray) -> Column:
    """Return the course in radians if its heading names no unit and the positions move so."""
    stated = course.values[rows] / DEGREE
    known = stated[np.isfinite(stated)]
    if course.source != "assumed" or not known.size:
        return course
    for unit, (first, last, factor) in _COURSES.items():
        if first < np.abs(known).max() <= last:
            return course._replace(values=course.values * factor, unit=unit, source=BY_SIZE)
    if np.abs(known).max() > 2 * np.pi:
        return course
    step = _steps(position)
    fast = (np.abs(step) > _FAST_ENOUGH * np.diff(time)) & np.isfinite(stated[1:])
    if fast.sum() < _MIN_LEGS:
        return course
    motion, written = np.angle(step[fast]), stated[1:][fast]
    in_degrees, in_radians = (
        float(np.sqrt(np.mean(wrap(motion - written * unit) ** 2))) for unit in (DEGREE, 1.0)
    )
    mean = float(np.mean(np.cos(motion - written)))
    if mean < _ALONG or in_radians > _CLEARLY * in_degrees:
        return course
    return course._replace(
        values=course.values / DEGREE, unit="rad", source="guessed: the positions move in that direction"
    )


_COUNTERS = {
    "position_resets": estimator_resets.POSITION, "velocity_resets": estimator_resets.VELOCITY,
}  # fmt: skip


def find_resets(fixes: Fixes) -> tuple[tuple[Reset, ...], list[str]]:
    """Return where the counters of an estimator count a jump of the fixes, and the counters' headings."""
    found: list[Reset] = []
    names = []
    values = {"position_resets": fixes.gnss.position, "velocity_resets": fixes.gnss.velocity_n}
    for quantity, kind in _COUNTERS.items():
        counters = fixes.sheet.all_of(quantity)
        known = np.isfinite(values[quantity]).all(axis=1)
        names += [heading.text for heading, _ in counters]
        if not counters or not known.any():
            continue
        rows = fixes.rows[known]
        changes = np.sum([np.abs(np.diff(np.nan_to_num(one[rows]))) for _, one in counters], axis=0)
        time, jumping = fixes.gnss.time[known], values[quantity][known]
        for at in estimator_resets.resets(kind, time, jumping, running_sums(changes)):
            step = estimator_resets.reported_step(kind, jumping, int(at))
            found.append(Reset(float(time[at]), step))
    return tuple(sorted(found, key=lambda one: one.time)), names
