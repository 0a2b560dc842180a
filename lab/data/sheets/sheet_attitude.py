"""Sheet attitude: roll, pitch and yaw, or a quaternion, of a file, if the motion bears it out.

Programs differ in unit, order and frames: degrees or radians, the scalar first or last, north-east-down or
east-north-up. Each reading is compared with the motion of the positions: the nose points along the course,
and lift or thrust, which point up in the body, turn the velocity. A phone in a pocket agrees with neither.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from lab.base.arrays import FloatArray, interpolate_columns, running_sums
from lab.base.parameters.units import DEGREE, STANDARD_GRAVITY
from lab.data.clock.faults import increasing
from lab.data.files.unit_names import UNITS
from lab.data.log.auxiliary_data import Reference
from lab.data.log.sensor_log import GnssLog, SensorLog
from lab.data.rebuild.raw_flight import ColumnUnit
from lab.data.sheets.column_names import GIVEN, NUMBERED, Heading
from lab.data.sheets.sheet import Sheet
from lab.data.sheets.sheet_clock import Clock, find_clock
from lab.data.sheets.sheet_heights import BY_SIZE
from lab.motion.frames.displacement import metres_per_radian

_COMPASS = re.compile(r"(?i)heading|hdg")
"""A course that is called so beside roll and pitch is where the nose points."""
_TURN = 2.05 * np.pi
"""Largest angle that may be in radians [rad]: a full turn and 2 % of rounding."""
_USUAL = 0.99
"""Part of the rows by whose angles the unit is judged: single cells are damaged."""
_FIXED_POINT = ((7.3e2, "°"), (3.61e4, "0.01°"), (3.61e7, "1e-5°"))
"""Largest angle in each unit: two turns in degrees, a turn in centidegrees (ArduPilot, MAVLink), and in 1e-5°
(UBX-NAV-ATT)."""
_FACTORS = {**UNITS["angle"], "0.01°": 1e-2 * DEGREE, "1e-5°": 1e-5 * DEGREE}
"""Factor of each unit to radians."""
_HORIZON = 0.05
"""Least cosine of a tilt by which lift is divided: 3° from lying on the side."""
_STEP = 1.0
"""Time between the positions that show course and acceleration [s]: a metre of noise adds 0.6 m/s²."""
_MOVES = 2.0
"""Speed from which the positions show a course [m/s]."""
_MAX_JUDGED = 50_000
"""Most rows by which readings are compared."""
_MAX_STEPS = 100_000
"""Most steps: 28 hours."""
_MIN_STEPS = 10
"""Fewest such steps."""
_ALONG = 0.7
"""Mean cosine between nose and course from which they agree: 45°, as in a wind of 0.7 times the airspeed."""
_TILTED = 0.6
"""Correlation of the acceleration with that of the tilt from which an attitude agrees without the course, as
of a copter that flies sideways, and with the other sign contradicts."""
_OTHER = 0.2
"""Weight of the one of both that agrees less."""
_MIN_TILT = 0.8
"""Rms of the acceleration that the tilt says from which it is compared [m/s²]: 5°. Cars lean less."""
_LEVEL = 0.3
"""Acceleration of the bank over that across the course below which a vehicle does not fly."""
_ON_WHEELS = "It does not bank into its turns: a car is assumed (setting vehicle)."
_MOST_TILT = np.radians(60.0)
"""Median tilt from which an attitude is that of a sensor in another position, such as an upright phone."""
_MAX_GAP = 2.5
"""Longest interval over which an attitude is interpolated, in usual ones."""
_LEAST_GAP = 1.0
"""Interval over which it is interpolated in any case [s]."""
_SWAP, _FLIP = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)), (1.0, -1.0, -1.0)
"""East, north, up from north, east, down; and the diagonal to forward, left, up from forward, right, down."""
_LENGTHS = (0.5, 2.0)
"""Length of a quaternion over the usual one within which it is one: loggers write zeros."""


class Attitude(NamedTuple):
    """The attitude of a file.

    Attributes
    ----------
    time : (k,) array
        Times at which it is known, in the clock of the file [s].
    euler : (k, 3) array
        Roll, pitch, yaw [rad].
    units : tuple of ColumnUnit
        Its columns.
    remark : str
        What was taken, or why nothing was.
    vehicle : str
        "car" for one that does not bank into its turns, as nothing that flies; else empty.
    """

    time: FloatArray
    euler: FloatArray
    units: tuple[ColumnUnit, ...]
    remark: str
    vehicle: str = ""

    def at(self, time: FloatArray) -> FloatArray:
        """Return roll, pitch, yaw (n, 3) at other times; NaN where they are unknown."""
        found = np.full((len(time), 3), np.nan)
        if len(self.time) < 2:
            return found
        gaps = np.diff(self.time)
        after = np.clip(np.searchsorted(self.time, time), 1, len(self.time) - 1)
        near = gaps[after - 1] <= max(_MAX_GAP * float(np.median(gaps)), _LEAST_GAP)
        near &= (time >= self.time[0]) & (time <= self.time[-1])
        if near.any():
            turn = Slerp(self.time, Rotation.from_euler("ZYX", self.euler[:, ::-1]))(time[near])
            found[near] = turn.as_euler("ZYX")[:, ::-1]
        return found


class _Reading(NamedTuple):
    """One way in which columns may be an attitude."""

    turn: Rotation
    unit: str
    words: str


class _Columns(NamedTuple):
    sheet: Sheet
    clock: Clock
    headings: tuple[Heading, ...]
    values: FloatArray
    given: bool

    def thinned(self) -> _Columns:
        """Return the columns themselves, or every so many rows of a long table, which show as much."""
        every = slice(None, None, -(-len(self.values) // _MAX_JUDGED))
        clock = self.clock._replace(time=self.clock.time[every])
        return self if every.step == 1 else self._replace(clock=clock, values=self.values[every])


def find_attitude(
    sheets: Sequence[Sheet], time: FloatArray, position: FloatArray, velocity: FloatArray
) -> Attitude | None:
    """Return the attitude in the sheets; None if no columns name one.

    Parameters
    ----------
    sheets
        The tables of the file.
    time : (m,) array
        Times of the fixes [s].
    position : (m, 3) array
        Latitude, longitude [rad], height.
    velocity : (m, 3) array
        Velocity north, east, down [m/s]; NaN where unknown.
    """
    refused = None
    motion = None
    for columns in _candidates(sheets):
        motion = motion or _motion(time, position, velocity)
        some = columns.thinned()
        read = list(_readings(some))
        scores = [_agreement(_known_reading(some, one, ""), motion) for one in read]
        best = max(scores, key=lambda one: one.size)
        as_written = columns.given and len(columns.headings) == len("rpy")
        at = 0 if as_written else next(i for i, one in enumerate(scores) if one.size >= best.size - _LIKE)
        if columns.given or scores[at].agrees:
            whole = read[at] if some is columns else next(islice(_readings(columns), at, None))
            found = _known_reading(columns, whole, scores[at].words)
            words = f"{found.remark} {_ON_WHEELS}" if scores[at].level else found.remark
            return found._replace(remark=words, vehicle="car" if scores[at].level else "")
        names = ", ".join(one.text for one in columns.headings)
        refused = refused or Attitude(
            np.empty(0), np.empty((0, 3)), (),
            f"The attitude in {names} is not used: {scores[at].words}. If it is that of the vehicle, "
            f"--column {columns.headings[0].text}={columns.headings[0].quantity}[{read[at].unit}], "
            "and the others alike, says so.",
        )  # fmt: skip
    return refused


_LIKE = 0.05
"""Difference of two agreements up to which the usual reading is taken."""


def _candidates(sheets: Sequence[Sheet]) -> Iterator[_Columns]:
    """Yield the columns that name an attitude, those of the longest table first.

    Angles come before quaternions, which have more readings.
    """
    for sheet in sorted(sheets, key=len, reverse=True):
        clock = find_clock(sheet, sheet.has_imu)
        if clock is None:
            continue
        found = [sheet.all_of(name)[:1] for name in ("roll", "pitch", "yaw")]
        found[2] = found[2] or [one for one in sheet.all_of("course") if _COMPASS.search(one[0].text)][:1]
        sets = [[one for (one,) in found]] if all(found) else []
        parts = [{one.sensor: (one, values) for one, values in sheet.all_of(f"q{i}")[::-1]} for i in range(4)]
        sets += [[of[name] for of in parts] for name in parts[0] if all(name in of for of in parts)]
        for one in sets:
            headings = tuple(heading for heading, _ in one)
            values = np.column_stack([heading.sign * numbers for heading, numbers in one])
            values = _of_unit_length(values) if len(one) > len("rpy") else values
            if np.isfinite(values).all(axis=1).any():
                yield _Columns(sheet, clock, headings, values, any(two.sensor == GIVEN for two in headings))


def _of_unit_length(values: FloatArray) -> FloatArray:
    """Return quaternions over their usual length, as of fixed-point numbers; NaN for those that are none."""
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.linalg.norm(values, axis=1)
        known = size[np.isfinite(size) & (size > 0)]
        ratio = size / (float(np.median(known)) if known.size else 1.0)
        fine = (ratio > _LENGTHS[0]) & (ratio < _LENGTHS[1])
        return np.where(fine[:, None], values / size[:, None], np.nan)


def _readings(columns: _Columns) -> Iterator[_Reading]:
    """Yield the ways in which columns may be an attitude, the usual one first; NaN turns are none."""
    known = np.asarray(np.isfinite(columns.values).all(axis=1))
    values = np.where(known[:, None], columns.values, 0.0)
    if len(columns.headings) == len("rpy"):
        largest = float(np.quantile(np.abs(values[known]).max(axis=1), _USUAL))
        named = next((one.unit for one in columns.headings if one.unit), "")
        by_size = next((unit for most, unit in _FIXED_POINT if largest <= most), "°")
        units = [named] if named else [by_size] if largest > _TURN else ["°", "rad"]
        for unit in units:
            own = [_FACTORS[one.unit or unit] for one in columns.headings]
            roll, pitch, yaw = (values * own).T
            turn = Rotation.from_euler("ZYX", np.column_stack((yaw, pitch, roll)))
            yield _Reading(turn, unit, "")
            # From east to north, yaw counts the other way; pitch is nose down, and roll is alike.
            enu = np.column_stack((np.pi / 2 - yaw, -pitch, roll))
            yield _Reading(Rotation.from_euler("ZYX", enu), unit, ", yaw from east to north")
        return
    values[~known, 0] = 1.0
    orders = (True, False) if columns.headings[0].sensor.startswith(NUMBERED) else (True,)
    for first in orders:
        scalar = "" if first else ", the scalar last"
        turn = Rotation.from_quat(values, scalar_first=first)
        for inverse, words in ((False, ""), (True, ", from the navigation frame to the body")):
            one = turn.inv() if inverse else turn
            yield _Reading(one, "", scalar + words)
            swap, flip = Rotation.from_matrix(_SWAP), Rotation.from_matrix(np.diag(_FLIP))
            yield _Reading(swap * one * flip, "", f", in east, north, up{scalar}{words}")


def _known_reading(columns: _Columns, reading: _Reading, why: str) -> Attitude:
    """Return one reading at the times at which it is known."""
    time = columns.clock.time
    kept = np.isfinite(columns.values).all(axis=1) & np.isfinite(time)
    order = np.flatnonzero(kept)[np.argsort(time[kept], kind="stable")]
    order = order[np.append(True, np.diff(time[order]) > 0)[: len(order)]]
    named = all(one.unit for one in columns.headings)
    source = "named in the heading" if named else BY_SIZE if reading.unit else "a quaternion"
    units = tuple(ColumnUnit(one.text, one.unit or reading.unit, source) for one in columns.headings)
    names = ", ".join(one.text for one in columns.headings)
    unit = f" in {reading.unit} ({source})" if reading.unit else ""
    remark = f"Attitude: {names} of {columns.sheet.name}{unit}{reading.words}{f'; {why}' if why else ''}."
    return Attitude(time[order], reading.turn[order].as_euler("ZYX")[:, ::-1], units, remark)


class _Motion(NamedTuple):
    time: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


def _even_times(first: float, last: float, step: float) -> FloatArray:
    """Return even times; at most `_MAX_STEPS`, whatever the stamps of a damaged file are."""
    return np.asarray(first + step * np.arange(min(max((last - first) / step, 0.0), _MAX_STEPS)))


def _motion(time: FloatArray, position: FloatArray, velocity: FloatArray) -> _Motion:
    """Return velocity and acceleration (n, 2), north and east, at even times."""
    none = _Motion(np.empty(0), np.empty((0, 2)), np.empty((0, 2)))
    kept = np.isfinite(time) & np.asarray(np.isfinite(position[:, :2]).all(axis=1))
    kept[kept] = increasing(time[kept])
    t = time[kept]
    if t.size < _MIN_STEPS:
        return none
    step = max(_STEP, float(np.median(np.diff(t))))
    even = _even_times(t[0], t[-1], step)
    if even.size < _MIN_STEPS:
        return none
    place = position[kept]
    metres = np.column_stack(metres_per_radian(place[:, 0], 0.0))
    moved = np.column_stack((place[:, 0], np.unwrap(place[:, 1])))
    moved = (moved - moved[0]) * metres[0]
    here = interpolate_columns(even, t, moved)
    fast = np.gradient(here, step, axis=0)
    bent = np.zeros_like(here)
    # Second differences; the gradient of a gradient would smooth over four steps.
    bent[1:-1] = (here[2:] - 2 * here[1:-1] + here[:-2]) / step**2
    if np.isfinite(velocity[kept][:, :2]).all():
        fast = interpolate_columns(even, t, velocity[kept][:, :2])
        bent = np.gradient(fast, step, axis=0)
    return _Motion(even, fast, bent)


class _Agreement(NamedTuple):
    size: float
    agrees: bool
    words: str
    level: bool = False


def _agreement(attitude: Attitude, motion: _Motion) -> _Agreement:
    """Return how well an attitude agrees with course and acceleration, and that in words."""
    euler = attitude.at(motion.time)
    known = np.asarray(np.isfinite(euler).all(axis=1))
    moving = known & (np.hypot(*motion.velocity.T) > _MOVES)
    if moving.sum() < _MIN_STEPS:
        return _Agreement(0.0, False, "the motion does not show whether it is")
    roll, pitch, yaw = euler[known].T
    course = np.arctan2(motion.velocity[known, 1], motion.velocity[known, 0])
    along = float(np.mean(np.cos(yaw - course)[moving[known]]))
    up = np.cos(roll) * np.cos(pitch)
    if float(np.median(np.arccos(np.clip(up, -1, 1)))) > _MOST_TILT:
        return _Agreement(-1.0, False, "it is upside down or upright, as of a sensor in another position")
    # North and east of the body's down axis.
    down_n = Rotation.from_euler("ZYX", np.column_stack((yaw, pitch, roll))).as_matrix()[:, :2, 2]
    # Lift along minus this axis carries the weight, and its level part accelerates.
    said = -STANDARD_GRAVITY * down_n / np.maximum(up, _HORIZON)[:, None]
    said -= said.mean(axis=0)
    seen = motion.acceleration[known] - motion.acceleration[known].mean(axis=0)
    shown = float(np.sqrt(np.mean(np.sum(said**2, axis=1)))) > _MIN_TILT and bool(seen.any())
    tilt = float(np.sum(said * seen) / np.sqrt(np.sum(said**2) * np.sum(seen**2))) if shown else 0.0
    agrees = (along > _ALONG and tilt > -_TILTED) or tilt > _TILTED
    fast = moving[known]
    across = (motion.velocity[known, 0] * motion.acceleration[known, 1]
              - motion.velocity[known, 1] * motion.acceleration[known, 0])[fast]  # fmt: skip
    # v × a over |v|: the acceleration to the right of the course.
    across /= np.hypot(*motion.velocity[known].T)[fast]
    banked = float(np.sum(STANDARD_GRAVITY * np.tan(roll[fast]) * across) / max(np.sum(across**2), 1e-9))
    level = along > _ALONG and banked < _LEVEL and float(np.sqrt(np.mean(across**2))) > _MIN_TILT
    words = f"the mean cosine between nose and course is {along:.2f}"
    words += f", the correlation of tilt and acceleration {tilt:.2f}" if shown else ""
    return _Agreement(max(along, tilt) + _OTHER * min(along, tilt), agrees, words, level)


_SAME_TURNS = 0.7
"""Correlation of the gyros with the rates of an attitude from which both are of one body."""
_RATE_STEP = 0.5
"""Time between the attitudes whose rates are compared [s]: noise of 0.1° is 0.3 °/s."""


def make_reference(
    sheets: Sequence[Sheet], log: SensorLog, gnss: GnssLog
) -> tuple[Reference | None, list[str]]:
    """Return the attitude of a file as the reference of its log, if its rates are those of the gyros.

    Parameters
    ----------
    sheets
        The tables of the log.
    log
        Its IMU and receiver, in forward, right, down.
    gnss
        The fixes in the clock of the file.

    Returns
    -------
    Reference or None, list of str
        The reference, and the report.
    """
    found = find_attitude(sheets, gnss.time, gnss.position, gnss.velocity_n)
    if found is None or not len(found.time):
        return None, [found.remark] if found else []
    time = found.time - log.epoch
    inside = (time >= log.time[0]) & (time <= log.time[-1])
    at = _even_times(log.time[0], log.time[-1], _RATE_STEP)
    euler = found.at(at + log.epoch)
    known = np.asarray(np.isfinite(euler).all(axis=1))
    both = known[1:] & known[:-1]
    if inside.sum() < 2 or not both.any():
        return None, ["The attitude in the files is of another time than the IMU, and is not used."]
    turn = Rotation.from_euler("ZYX", np.nan_to_num(euler[:, ::-1]))
    # Turns between the even times in body axes, as gyros measure them.
    said = (turn[:-1].inv() * turn[1:]).as_rotvec()[both]
    seen = np.diff(interpolate_columns(at, log.time, running_sums(log.dtheta)), axis=0)[both]
    said, seen = said - said.mean(axis=0), seen - seen.mean(axis=0)
    size = np.sqrt(np.sum(said**2) * np.sum(seen**2))
    like = float(np.sum(said * seen) / size) if size else 0.0
    if like < _SAME_TURNS:
        return None, [
            f"{found.remark.removesuffix('.')}. It is not used: its rates are not those of the gyros "
            f"(correlation {like:.2f})."
        ]
    unknown = np.full((int(inside.sum()), 3), np.nan)
    words = f"{found.remark} It is the reference of the log: its rates are those of the gyros ({like:.2f})."
    return Reference(time[inside], unknown, unknown, found.euler[inside]), [words]
