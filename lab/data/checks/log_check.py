"""Log check: whether the numbers of a sensor log contradict their stated units, axes or clock.

Gravity has a known magnitude and, on a vehicle that is level on average, a known direction. A vehicle that
moves where its nose points turns with its course and senses its change of speed. A wrong unit violates one
of these by a known factor; wrong axes show them on another axis. Copters, boats and walkers may move in
any direction and are not judged by this. A wrong clock violates what holds for every vehicle: the velocity
changes by the sensed force. So do wrong gyros (`lab.data.checks.gyro_check`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import LEAP_SECONDS, STANDARD_GRAVITY
from lab.data.checks.fix_check import check_fixes
from lab.data.checks.gyro_check import VELOCITY_SIGMA, are_explained, check_gyros
from lab.data.checks.velocity_matching import Match, Window, liveliest, turned
from lab.data.checks.window_matches import WindowMatches
from lab.data.log.log_section import piece
from lab.data.log.sensor_log import SensorLog
from lab.data.log.vehicle import VEHICLES, Vehicle, vehicle_of
from lab.motion.frames.displacement import metres_per_radian
from lab.motion.frames.rotation import wrap

MAX_LAG = 3.0
"""Largest clock offset that is tried [s]."""

_MAX_INTERVAL = 0.5
"""Longest usual interval between samples of an IMU [s]: loggers of phones take 10 to 1000 Hz, and between
slower samples the motion of a vehicle is unknown."""
_GRAVITY_RATIO = (0.7, 1.5)
"""Median specific force of a log [g]: every vehicle has about 1; a wrong unit is a factor of 9.8 or the
rate."""
_UNIT_TOLERANCE = (0.7, 1.4)
"""Median specific force over a unit's factor at which that unit is named: the motion adds to gravity."""
_LEG = 1.0
"""Length of the legs in which turns and changes of speed are compared [s]: fixes of 1 Hz have it."""
_MAX_LEG = 2.5
"""Longest of these legs, over `_LEG`: a longer one has a gap in it."""
_MIN_COURSE_SPEED = 2.0
"""Speed from which fixes show a course [m/s]: with velocities good to 0.1 m/s to 3°."""
_MAX_COURSE_STEP = np.pi / 2
"""Largest change of the course in a leg that is believed [rad]: a larger one is noise, or a turn on the
spot."""
_MAX_TUMBLING = np.radians(25.0)
"""Largest mean rate about a horizontal axis [rad/s]: five σ of the bias of consumer gyros; a rate of 0.5
°/s, its numbers read as radians, is 29 °/s."""
_MIN_PITCH_OF_TURN = 0.15
"""Pitch rate of banked turns over their yaw rate, from which axes are judged by it: the sine of a bank of
9°. The tests, on real logs too, pass at half and at twice it."""
_LIVELY_TURN = np.radians(2.0)
"""σ of the rate of the course from which turns are compared [rad/s]: gyros of 1 °/s of noise still show
it. The tests pass at half; at twice it, swapped axes and degrees for radians on a shipped flight are
missed."""
_LIVELY_SPEED = 0.3
"""σ of the acceleration along the path from which it is compared [m/s²]: noise of fixes at 1 Hz is 0.1.
The tests pass at half; at twice it, swapped axes of the car of comma2k19 are missed."""
_MIN_CORRELATION = 0.8
"""Smallest correlation at which an axis agrees with the fixes."""
_MAX_CORRELATION_LEAD = 0.3
"""By how much the right axis may follow the speed better than the forward one."""
_SAME_FACTOR = (0.5, 2.0)
"""Ratio of a factor to 57 (degrees to a radian) at which that unit is named."""
_MIN_LAG = 0.4
"""Smallest clock offset that refuses a log [s]: receivers are up to 0.3 s late by themselves, which a
navigator is told or finds."""
_LAG_STEP = 0.1
"""Step of the clock offsets tried with each axis [s]: a tenth of a leg."""
_LAGS = np.arange(-MAX_LAG, MAX_LAG + _LAG_STEP / 2, _LAG_STEP)
"""These offsets [s]."""
_AROUND_LEAP = 1.5
"""Offsets around it that are tried [s]: the receiver's latency and the recorder's delay add to it."""
_MAX_UNLIKE = 0.5
"""Largest correlation of the turns near zero offset at which they do not belong together."""
_MIN_LEGS = 20
"""Fewest legs by which an axis is judged. At one of the offsets, noise of 0.45 m/s reached the correlation in
12 % of rests with 11 legs, and in 0.1 % with 20."""
_WINDOWS = 4
"""Largest number of windows for the estimate of the clock offset: each is fitted eight times or more."""
_MIN_WINDOWS = 2
"""Fewest windows that have to show an offset."""
_STARTS = (-1.5, 1.5)
"""Offsets from which it is fitted too [s]: within one of them the fit finds its way to `MAX_LAG` and to
zero."""
_MAX_LAG_SIGMA = 0.1
"""σ of an offset up to which a window shows it [s]: a quarter of the smallest that refuses a log. The
tests pass at twice it; at half, an offset of 1 s on a shipped flight is missed."""
_MAX_LAG_APART = 0.2
"""Distance from the median at which windows agree on an offset [s]: two σ. The tests pass at half and at
twice it."""
_MIN_AGREEING = 0.6
"""Part of the windows that has to agree on it."""
_MAX_MISFIT = 9.0
"""Mean square residual, in σ, up to which a window shows an offset: residuals of three σ."""
_MAX_EXPLAINED_MISFIT = 1.0
"""Mean square residual, in σ, up to which the IMU as it is explains the velocities. Measured: up to 0.6 on
real logs, from 1.2 on with two axes swapped."""
_MAX_HEADING_SIGMA = np.radians(10.0)
"""σ of the heading up to which a window shows where the nose points [rad]."""
_MAX_OFF_COURSE = np.radians(30.0)
"""Mean angle between nose and course up to which the axes are right [rad]: wrong ones turn it by 90° or
180°."""
_MIN_WANDERING = np.radians(10.0)
"""Spread of that angle from which a vehicle goes where it likes [rad]. Measured: up to 4° on aeroplanes
and cars."""
_OR_ANOTHER_VEHICLE = (
    ". The check does not apply to a vehicle that does not move where its nose points: name it, such as "
    f'vehicle = "copter" in log.toml; accepted are {", ".join(VEHICLES)}'
)


class FixMotion(NamedTuple):
    """The motion by the fixes, in legs of about a second.

    Attributes
    ----------
    start, end : (k,) arrays
        The legs, in the time of the IMU [s].
    turn : (k,) array
        Mean rate of the course, positive to the right [rad/s]; NaN where the vehicle hardly moves.
    speed : (k,) array
        Mean change of the speed [m/s²].
    """

    start: FloatArray
    end: FloatArray
    turn: FloatArray
    speed: FloatArray


def windows_of(log: SensorLog) -> list[Window]:
    """Return the windows of a log without a break in which its velocity changes most."""
    gnss = log.gnss
    sigma = np.where(np.isfinite(gnss.velocity_sigma), gnss.velocity_sigma, VELOCITY_SIGMA)
    arrays = (log.time, log.dtheta, log.dvelocity, gnss.time - gnss.latency, gnss.velocity_n, sigma)
    return liveliest(arrays, _WINDOWS, MAX_LAG)


def matches_of(log: SensorLog) -> WindowMatches:
    """Return the matches of the windows in which the velocity of a log changes most."""
    return WindowMatches(windows_of(piece(log)))


def check_log(log: SensorLog, matches_of: Callable[[SensorLog], WindowMatches] = matches_of) -> None:
    """Raise if a log is implausible; the longest stretch without a break is judged.

    Parameters
    ----------
    log
        The log.
    matches_of
        Returns its matches as `matches_of` does, if other axes of the same log have been checked.

    Raises
    ------
    MissionError
        Naming the likely cause: ms for s, g for m/s², rates for increments or increments for rates, degrees
        for radians or radians for degrees, axes that do not point forward, right, down, fixes whose positions
        do not move as their velocities say, or a clock of the receiver that is not the IMU's.
    """
    _check_interval(log)
    check_fixes(log.name, log.gnss)
    log = piece(log)
    _check_force(log)
    _check_tumbling(log)
    matches = matches_of(log)
    vehicle = vehicle_of(log.auxiliary.vehicle)
    if vehicle.follows_nose:
        _check_leap_seconds(log)
        _check_gyro_unit(log, motion_of(log))
    if vehicle.follows_nose and not _axes_are_right(matches, vehicle):
        motion = motion_of(log)
        try:
            _check_turn(log, motion)
            _check_bank(log, motion)
            _check_forward(log, motion)
        except MissionError as error:
            raise MissionError(f"{error}{'' if vehicle.name else _OR_ANOTHER_VEHICLE}") from None
    check_gyros(log, matches)
    _check_clock(log, matches)


def is_explained(log: SensorLog) -> bool:
    """Return whether the velocities of a log change as its IMU says, where they change enough to tell."""
    return are_explained(matches_of(log))


def _check_leap_seconds(log: SensorLog) -> None:
    """Compare the turns by the GPS with the gyros at the offset between GPS time and UTC, and near zero."""
    motion = motion_of(log)
    margin = LEAP_SECONDS + _AROUND_LEAP
    inside = (motion.start >= margin) & (motion.end <= log.duration - margin) & np.isfinite(motion.turn)
    motion = FixMotion(*(column[inside] for column in motion))
    if motion.turn.size < _MIN_LEGS or np.std(motion.turn) < _LIVELY_TURN:
        return
    around = np.arange(-_AROUND_LEAP, _AROUND_LEAP + _LAG_STEP / 2, _LAG_STEP)
    at_zero, at_leap = (
        max(
            (_largest_correlation(log, axis, motion, motion.turn, lags) for axis in log.dtheta.T),
            key=lambda one: abs(one[0]),
        )
        for lags in (_LAGS, np.concatenate((around - LEAP_SECONDS, around + LEAP_SECONDS)))
    )
    if abs(at_zero[0]) < _MAX_UNLIKE and abs(at_leap[0]) > _MIN_CORRELATION:
        side = "late" if at_leap[2] < 0 else "early"
        raise MissionError(
            f"{log.name}: the stamps of the GPS are about {abs(at_leap[2]):.1f} s {side} relative to the "
            f"IMU's (correlation of the turns {abs(at_leap[0]):.2f}, with equal stamps "
            f"{abs(at_zero[0]):.2f}): one clock is likely to be GPS time and the other UTC, "
            f"{LEAP_SECONDS:g} leap seconds apart; accepted are stamps of one clock"
        )


def motion_of(log: SensorLog) -> FixMotion:
    """Return the motion of a log by its fixes."""
    gnss = log.gnss
    time = gnss.time - gnss.latency
    inside = np.flatnonzero((time >= MAX_LAG) & (time <= log.duration - MAX_LAG))
    if inside.size < 2:
        empty = np.empty(0)
        return FixMotion(empty, empty, empty, empty)
    step = max(1, round(_LEG / float(np.median(np.diff(time)))))
    at = inside[::step]
    velocity = gnss.velocity_n[:, :2]
    if np.isnan(velocity).any():
        per_latitude, per_longitude = metres_per_radian(gnss.position[:, 0], 0.0)
        north = np.gradient(gnss.position[:, 0], time) * per_latitude
        east = np.gradient(np.unwrap(gnss.position[:, 1]), time) * per_longitude
        velocity = np.stack((north, east), axis=-1)
    velocity, time = velocity[at], time[at]
    speed = np.linalg.norm(velocity, axis=1)
    course = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    dt = np.diff(time)
    turn = np.where(np.minimum(speed[1:], speed[:-1]) > _MIN_COURSE_SPEED, np.diff(course) / dt, np.nan)
    turn[np.abs(np.diff(course)) > _MAX_COURSE_STEP] = np.nan
    short = dt < _MAX_LEG * _LEG
    return FixMotion(time[:-1][short], time[1:][short], turn[short], (np.diff(speed) / dt)[short])


def _check_interval(log: SensorLog) -> None:
    usual = float(np.median(np.diff(log.time)))
    if usual > _MAX_INTERVAL:
        raise MissionError(
            f"{log.name}: samples of the IMU are usually {usual:.3g} s apart; accepted are up to "
            f"{_MAX_INTERVAL:g} s. Times that look like this are often ms where s are declared (column t_s)"
        )


def _check_force(log: SensorLog) -> None:
    _, force = log.rates
    size = float(np.median(np.linalg.norm(force, axis=1))) / STANDARD_GRAVITY
    dt = float(np.median(np.diff(log.time)))
    causes = {
        1 / STANDARD_GRAVITY: "the accelerometers' numbers look like g where m/s² are declared",
        STANDARD_GRAVITY: "the accelerometers' numbers look like m/s² where g are declared",
        1 / dt: "the numbers look like rates where increments are declared",
        dt: "the numbers look like increments where rates are declared",
    }
    near = min(causes, key=lambda factor: abs(np.log(max(size, 1e-12) / factor)))
    what = f"{log.name}: the IMU measures {size:.3g} times gravity (median over the log): "
    if not _GRAVITY_RATIO[0] < size < _GRAVITY_RATIO[1]:
        likely = (
            causes[near]
            if _UNIT_TOLERANCE[0] < size / near < _UNIT_TOLERANCE[1]
            else "another unit than declared is likely"
        )
        raise MissionError(
            f"{what}{likely}. The columns' names declare the unit (fx_m_s2, fx_g, dvelocity_x_m_s)"
        )
    mean = np.median(force, axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if axis != 2 or mean[2] > 0:
        direction = ("forward", "right", "down")[axis]
        sign = "" if mean[axis] > 0 else "minus "
        raise MissionError(
            f"{log.name}: the reaction to gravity is measured along {sign}{direction}, but a level vehicle "
            "measures it along minus down: swapped axes or signs are likely. axes in log.toml, or "
            "--axes of ins-lab import --as log, says which axes of the IMU point forward, right, down"
        )


def _check_tumbling(log: SensorLog) -> None:
    """Refuse a mean rate about a horizontal axis that would tip over a vehicle that stays level."""
    mean = float(np.linalg.norm(log.dtheta[:, :2].sum(axis=0))) / log.duration
    if mean > _MAX_TUMBLING:
        raise MissionError(
            f"{log.name}: the gyros show {np.degrees(mean):.3g} °/s about a horizontal axis on average, "
            "which would overturn the vehicle, but the direction of gravity is constant: the numbers look "
            "like degrees where radians are declared (columns gx_rad_s, gx_deg_s)"
        )


def _likeness(log: SensorLog, motion: FixMotion) -> FloatArray | None:
    """Return correlation, factor and lag of each gyro with the course's rate; None if it shows too little."""
    rows = np.isfinite(motion.turn)
    if rows.sum() < _MIN_LEGS or np.std(motion.turn[rows]) < _LIVELY_TURN:
        return None
    return np.array(
        [_largest_correlation(log, log.dtheta[:, axis], motion, motion.turn) for axis in range(3)]
    )


def _check_gyro_unit(log: SensorLog, motion: FixMotion) -> None:
    """Compare the size of the turns with the course's, about the fastest axis of those that follow it.

    Velocities at 1 Hz do not show it: gyros that hardly turn, and a bias of 2 °/s, explain a turn of 20 s.
    An axis that is not quite level follows the course as well as the vertical one, by some percent.
    """
    likeness = _likeness(log, motion)
    if likeness is None:
        return
    following = np.abs(likeness[np.abs(likeness[:, 0]) >= _MIN_CORRELATION, 1])
    if not following.size:
        return
    factor = float(following.max())
    degree = 180 / np.pi
    for scale, numbers in ((degree, "degrees where radians"), (1 / degree, "radians where degrees")):
        if _SAME_FACTOR[0] < factor / scale < _SAME_FACTOR[1]:
            raise MissionError(
                f"{log.name}: the gyros turn {factor:.3g} times as fast as the course: the numbers look "
                f"like {numbers} are declared (columns gx_rad_s, gx_deg_s)"
            )


def _check_turn(log: SensorLog, motion: FixMotion) -> None:
    """Compare the course's rate with the gyros, each axis at its best time."""
    likeness = _likeness(log, motion)
    if likeness is None:
        return
    best = int(np.argmax(np.abs(likeness[:, 0])))
    correlation = likeness[2, 0]
    if abs(correlation) < _MIN_CORRELATION and best != 2 and abs(likeness[best, 0]) > _MIN_CORRELATION:
        raise MissionError(
            f"{log.name}: the turns that the GPS shows are about the axis called "
            f"{('forward', 'right')[best]}, not about down (correlation {likeness[best, 0]:.2f} against "
            f"{correlation:.2f}): swapped axes of the gyros are likely"
        )
    if correlation < -_MIN_CORRELATION:
        raise MissionError(
            f"{log.name}: the gyro called down turns against the course (correlation {correlation:.2f}): "
            "swapped axes or signs of the gyros are likely"
        )


def _check_bank(log: SensorLog, motion: FixMotion) -> None:
    """Check the pitch rate of banked turns, which is nose up in turns to either side.

    A vehicle that leans into its turns at bank φ and yaws at ψ̇ pitches at ψ̇ sin φ (Groves, ch. 2.3); one
    that does not shows nothing here.
    """
    rows = np.isfinite(motion.turn)
    if rows.sum() < _MIN_LEGS or np.std(motion.turn[rows]) < _LIVELY_TURN:
        return
    for axis, wrong_sign in ((0, 0), (1, -1)):
        correlation, factor, _ = _largest_correlation(log, log.dtheta[:, axis], motion, np.abs(motion.turn))
        wrong = correlation < -_MIN_CORRELATION if wrong_sign else abs(correlation) > _MIN_CORRELATION
        if wrong and factor > _MIN_PITCH_OF_TURN:
            raise MissionError(
                f"{log.name}: in banked turns the nose goes up about the axis called "
                f"{('forward', 'minus right')[axis]} (correlation {abs(correlation):.2f}), not about right: "
                "swapped axes or signs are likely"
            )


def _check_forward(log: SensorLog, motion: FixMotion) -> None:
    """Compare the change of the speed with the horizontal accelerometers, each at its best time."""
    if motion.speed.size < _MIN_LEGS or np.std(motion.speed) < _LIVELY_SPEED:
        return
    forward, right = (
        _largest_correlation(log, log.dvelocity[:, axis], motion, motion.speed)[0] for axis in (0, 1)
    )
    backward = forward < -_MIN_CORRELATION
    if backward or (abs(right) > _MIN_CORRELATION and forward < abs(right) - _MAX_CORRELATION_LEAD):
        axis, value = ("minus forward", forward) if backward else ("right", right)
        raise MissionError(
            f"{log.name}: the acceleration that the GPS shows is along the axis called {axis} (correlation "
            f"{value:.2f}, along forward {forward:.2f}): swapped axes or signs are likely"
        )


def _axes_are_right(matches: WindowMatches, vehicle: Vehicle) -> bool:
    """Return whether the IMU explains the velocities without any change of its axes.

    The nose then points along the course or, on an unnamed vehicle, in changing directions: wrong axes
    would turn it by a constant angle.
    """
    found = [(window, matches.match(n)) for n, window in enumerate(matches.windows[:_MIN_WINDOWS])]
    angles = [_off_course(window, one) for window, one in found if _is_clear(one)]
    apart = np.concatenate(angles) if angles else np.empty(0)
    if not apart.size:
        return False
    mean = np.exp(1j * apart).mean()
    spread = np.sqrt(-2 * np.log(max(abs(mean), 1e-12)))  # circular standard deviation
    return bool(abs(np.angle(mean)) < _MAX_OFF_COURSE or (not vehicle.name and spread > _MIN_WANDERING))


def _is_clear(found: Match) -> bool:
    return bool(found.misfit < _MAX_EXPLAINED_MISFIT and found.heading_sigma < _MAX_HEADING_SIGMA)


def _off_course(window: Window, found: Match) -> FloatArray:
    """Return the course minus the direction of the nose at fixes in motion [rad]."""
    fast = np.linalg.norm(window.velocity_n[:, :2], axis=1) > _MIN_COURSE_SPEED
    north, east = window.velocity_n[fast, :2].T
    steps = np.clip(np.searchsorted(window.time, window.at[fast] + found.lag), 0, len(window.dtheta))
    turning = turned(window.dtheta - found.gyro_bias * np.diff(window.time)[:, None])
    nose = (found.C_nb * turning[steps]).apply((1.0, 0.0, 0.0)).reshape(-1, 3)
    return wrap(np.arctan2(east, north) - np.arctan2(nose[:, 1], nose[:, 0]))


def _check_clock(log: SensorLog, matches: WindowMatches) -> None:
    """Estimate the clock offset at which the velocity changes by the sensed force, in several windows."""
    lags: list[float] = []
    for number in range(len(matches.windows)):
        found = matches.match(number)
        if not (_shows_lag(found) and abs(found.lag) < _MIN_LAG):
            found = min(found, matches.match(number, _STARTS), key=lambda one: one.cost)
        if _shows_lag(found):
            lags.append(found.lag)
        if len(lags) == _MIN_WINDOWS and np.abs(lags).max() < _MIN_LAG:
            return
    if len(lags) < _MIN_WINDOWS:
        return
    lag = float(np.median(lags))
    agreeing = np.abs(np.array(lags) - lag) < _MAX_LAG_APART
    if abs(lag) >= _MIN_LAG and agreeing.mean() > _MIN_AGREEING:
        side = "late" if lag < 0 else "early"
        raise MissionError(
            f"{log.name}: the stamps of the GPS are about {abs(lag):.1f} s {side} relative to the IMU's "
            f"(the velocity changes like the IMU data of that much {'before' if lag < 0 else 'after'}, in "
            f"{agreeing.sum()} of {len(lags)} stretches): two clocks are likely. latency_s = "
            f"{log.gnss.latency - lag:.1f} in the TOML aligns them"
        )


def _shows_lag(found: Match) -> bool:
    return found.lag_sigma < _MAX_LAG_SIGMA and found.misfit < _MAX_MISFIT


def _largest_correlation(
    log: SensorLog, increments: FloatArray, motion: FixMotion, seen: FloatArray, lags: FloatArray = _LAGS
) -> tuple[float, float, float]:
    """Return correlation, factor and lag at the largest correlation, of either sign.

    It is that of an IMU axis, later by the lag, with the motion by the fixes.
    """
    total = np.concatenate(([0.0], np.cumsum(increments)))
    rows = np.isfinite(seen)
    start, end = motion.start[rows], motion.end[rows]
    until_end, until_start = (np.interp(at + lags[:, None], log.time, total) for at in (end, start))
    a, b = (until_end - until_start) / (end - start), seen[rows]
    a, b = a - a.mean(axis=1, keepdims=True), b - b.mean()
    size, other = (a * a).sum(axis=1), float(b @ b)
    power = np.sqrt(size * other)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.where(power > 0, (a @ b) / power, 0.0)
        # The factor from the ratio of sizes: regression would shrink it by the noise of the course.
        factor = np.where(power > 0, np.sqrt(size / other), 0.0)
    best = int(np.argmax(np.abs(correlation)))
    return float(correlation[best]), float(factor[best]), float(lags[best])
