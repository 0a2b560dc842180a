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

from lab.base.arrays import FloatArray, running_sums
from lab.base.files.mission_error import MissionError
from lab.base.parameters.units import LEAP_SECONDS, STANDARD_GRAVITY
from lab.data.checks import limits
from lab.data.checks.gyro_check import (
    VELOCITY_SIGMA,
    are_explained,
    check_course,
    check_velocities,
)
from lab.data.checks.likeness import UNITS, find_nearest_unit
from lab.data.checks.path_check import UNIT, UNLIKE, path_faults
from lab.data.checks.velocity_matching import Match, Window, choose_liveliest
from lab.data.checks.window_matches import WindowMatches
from lab.data.log.log_section import cut_section
from lab.data.log.sensor_log import SensorLog
from lab.data.log.vehicle import VEHICLES, Vehicle, vehicle_of
from lab.motion.frames.displacement import velocity_of_positions
from lab.motion.frames.rotation import wrap
from lab.motion.kinematics.running_turns import running_attitudes

_OR_ANOTHER_VEHICLE = (
    ". The check does not apply to a vehicle that does not move where its nose points: name it, such as "
    f'vehicle = "copter" in log.toml; accepted are {", ".join(VEHICLES)}'
)

_DIRECTIONS = (
    "swapped columns or reversed signs of vn_m_s, ve_m_s, lat_deg or lon_deg",
    "column vd_m_s, which is positive down",
)
"""Columns of a log by which a direction may be wrong, of the horizontal and of the vertical motion."""


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
    climb : (k,) array
        Mean gravity along the path, which a vehicle on wheels feels, too [m/s²].
    across : (k,) array
        Mean acceleration to the right of the path, in turns [m/s²]; NaN where the turn is.
    """

    start: FloatArray
    end: FloatArray
    turn: FloatArray
    speed: FloatArray
    climb: FloatArray
    across: FloatArray


def find_windows(log: SensorLog) -> list[Window]:
    """Return the windows of a log without a break in which its velocity changes most."""
    gnss = log.gnss
    sigma = np.where(np.isfinite(gnss.velocity_sigma), gnss.velocity_sigma, VELOCITY_SIGMA)
    arrays = (log.time, log.dtheta, log.dvelocity, gnss.time - gnss.latency, gnss.velocity_n, sigma)
    return choose_liveliest(arrays, limits.LOG.lag_windows, limits.LOG.largest_lag)


def match_windows(log: SensorLog) -> WindowMatches:
    """Return the matches of the windows in which the velocity of a log changes most."""
    return WindowMatches(find_windows(cut_section(log)))


def check_log(log: SensorLog, matches_of: Callable[[SensorLog], WindowMatches] = match_windows) -> None:
    """Raise if a log is implausible; the longest stretch without a break is judged.

    Parameters
    ----------
    log
        The log.
    matches_of
        Returns its matches as `match_windows` does, if other axes of the same log have been checked.

    Raises
    ------
    MissionError
        Naming the likely cause: ms for s, g for m/s², rates for increments or increments for rates, degrees
        for radians or radians for degrees, axes that do not point forward, right, down, fixes whose positions
        do not move as their velocities say, or a clock of the receiver that is not the IMU's.
    """
    _check_interval(log)
    _check_path(log)
    log = cut_section(log)
    vehicle = vehicle_of(log.auxiliary.vehicle)
    if vehicle.stays_level:
        _check_force(log)
        _check_tumbling(log)
    matches = matches_of(log)
    if vehicle.follows_nose:
        _check_leap_seconds(log)
        _check_gyro_unit(log, motion_of(log))
    check_velocities(log.name, matches)  # before the course, because it tells all axes
    if vehicle.follows_nose:
        motion, are_right = motion_of(log), _axes_are_right(matches, vehicle)
        try:
            if not are_right:
                _check_bank(log, motion)
                _check_across(log, motion)
            if vehicle.name or not are_right:
                _check_forward(log, motion, backward_only=are_right)
        except MissionError as error:
            raise MissionError(f"{error}{'' if vehicle.name else _OR_ANOTHER_VEHICLE}") from None
    if vehicle.stays_level:
        check_course(log, matches)
    _check_clock(log, matches)


def is_explained(log: SensorLog) -> bool:
    """Return whether the velocities of a log change as its IMU says, where they change enough to tell."""
    return are_explained(match_windows(log))


def _check_path(log: SensorLog) -> None:
    """Compare the positions of the fixes with their velocities; both are of the receiver."""
    gnss = log.gnss
    for found in path_faults(gnss.time, gnss.position, gnss.velocity_n):
        like, what = found.like, f"{log.name}: the {'heights' if found.vertical else 'positions'} of the GPS "
        if found.kind == UNLIKE:
            continue
        if found.kind == UNIT:
            said = f"change {like.ratio:.3g} times as much as its velocities say"
        elif found.vertical:
            said = "rise where its velocities point down"
        else:
            said = f"do not move where its velocities point, but {abs(np.degrees(like.angle)):.0f}° beside"
        columns = "" if found.kind == UNIT else f" ({_DIRECTIONS[found.vertical]})"
        raise MissionError(f"{what}{said} (coherence {like.coherence:.2f}): {found.cause}{columns}")


def _check_leap_seconds(log: SensorLog) -> None:
    """Compare the turns by the GPS with the gyros at the offset between GPS time and UTC, and near zero."""
    motion = motion_of(log)
    margin = LEAP_SECONDS + limits.LOG.around_leap
    inside = (motion.start >= margin) & (motion.end <= log.duration - margin) & np.isfinite(motion.turn)
    motion = FixMotion(*(column[inside] for column in motion))
    if motion.turn.size < limits.LOG.legs or np.std(motion.turn) < limits.LOG.lively_turn:
        return
    around = np.arange(
        -limits.LOG.around_leap, limits.LOG.around_leap + limits.LOG.lag_step / 2, limits.LOG.lag_step
    )
    at_zero, at_leap = (
        max(
            (largest_correlation(log, axis, motion, motion.turn, lags) for axis in log.dtheta.T),
            key=lambda one: abs(one[0]),
        )
        for lags in (None, np.concatenate((around - LEAP_SECONDS, around + LEAP_SECONDS)))
    )
    if abs(at_zero[0]) < limits.LOG.unlike_turns and abs(at_leap[0]) > limits.LOG.axis_correlation:
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
    inside = np.flatnonzero(
        (time >= limits.LOG.largest_lag) & (time <= log.duration - limits.LOG.largest_lag)
    )
    if inside.size < 2:
        empty = np.empty(0)
        return FixMotion(*(empty,) * len(FixMotion._fields))
    step = max(1, round(limits.LOG.leg / float(np.median(np.diff(time)))))
    at = inside[::step]
    velocity = gnss.velocity_n[:, :2]
    if np.isnan(velocity).any():
        velocity = velocity_of_positions(gnss.time, gnss.position)[:, :2]
    velocity, time = velocity[at], time[at]
    speed = np.linalg.norm(velocity, axis=1)
    rise = -np.nan_to_num(gnss.velocity_n[at, 2]) / np.maximum(speed, limits.LOG.course_speed)
    pull = 0.5 * STANDARD_GRAVITY * (rise[1:] + rise[:-1])
    course = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    dt = np.diff(time)
    turn = np.where(np.minimum(speed[1:], speed[:-1]) > limits.LOG.course_speed, np.diff(course) / dt, np.nan)
    turn[np.abs(np.diff(course)) > limits.LOG.course_step] = np.nan
    short = dt < limits.LOG.longest_leg * limits.LOG.leg
    across = turn * (speed[1:] + speed[:-1]) / 2
    return FixMotion(*(one[short] for one in (time[:-1], time[1:], turn, np.diff(speed) / dt, pull, across)))


def _check_interval(log: SensorLog) -> None:
    usual = float(np.median(np.diff(log.time)))
    if usual > limits.LOG.imu_interval:
        raise MissionError(
            f"{log.name}: samples of the IMU are usually {usual:.3g} s apart; accepted are up to "
            f"{limits.LOG.imu_interval:g} s. Times that look like this are often ms where s are "
            "declared (column t_s)"
        )


def _check_force(log: SensorLog) -> None:
    _, force = log.rates
    sizes = np.linalg.norm(force, axis=1)
    size = float(np.median(sizes)) / STANDARD_GRAVITY
    _check_one_unit(log, sizes)
    dt = float(np.median(np.diff(log.time)))
    causes = {
        1 / STANDARD_GRAVITY: "the accelerometers' numbers look like g where m/s² are declared",
        STANDARD_GRAVITY: "the accelerometers' numbers look like m/s² where g are declared",
        1 / dt: "the numbers look like rates where increments are declared",
        dt: "the numbers look like increments where rates are declared",
    }
    near = min(causes, key=lambda factor: abs(np.log(max(size, 1e-12) / factor)))
    what = f"{log.name}: the IMU measures {size:.3g} times gravity (median over the log): "
    if not limits.LOG.gravity_ratio[0] < size < limits.LOG.gravity_ratio[1]:
        low, high = limits.LOG.gravity_unit_ratio
        likely = causes[near] if low < size / near < high else "another unit than declared is likely"
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


def _check_one_unit(log: SensorLog, sizes: FloatArray) -> None:
    """Refuse a specific force whose unit changes from part to part of the log."""
    parts = np.array([np.median(one) for one in np.array_split(sizes, min(sizes.size, limits.LOG.parts))])
    steps = np.diff(np.log(np.maximum(np.sort(parts), 1e-12)))
    if steps.size and abs(steps.max() - np.log(STANDARD_GRAVITY)) < np.log(limits.LOG.part_ratio):
        light = parts < np.sqrt(parts.min() * parts.max())
        starts = log.time[:-1][np.flatnonzero(light) * sizes.size // parts.size]
        small, usual = np.median(parts[light]), np.median(parts[~light])
        raise MissionError(
            f"{log.name}: the specific force is {small:.3g} m/s² in the parts that begin at "
            f"{', '.join(f'{one:.0f}' for one in starts)} s, and {usual:.3g} m/s² elsewhere (medians): it "
            "changes between g and m/s²; accepted is one unit in a column"
        )


def _check_tumbling(log: SensorLog) -> None:
    """Refuse a mean rate about a horizontal axis that would tip over a vehicle that stays level."""
    mean = float(np.linalg.norm(log.dtheta[:, :2].sum(axis=0))) / log.duration
    steps = np.median(np.abs(np.diff(log.rates[0][:, :2], axis=0)), axis=0)
    if mean > limits.LOG.tumbling and steps.max() > limits.LOG.rate_step:
        raise MissionError(
            f"{log.name}: the gyros show {np.degrees(mean):.3g} °/s about a horizontal axis on average, "
            "which would overturn the vehicle, but the direction of gravity is constant: the numbers look "
            "like degrees where radians are declared (columns gx_rad_s, gx_deg_s)"
        )


def _likeness(log: SensorLog, motion: FixMotion) -> FloatArray | None:
    """Return correlation, factor and lag of each gyro with the course's rate; None if it shows too little."""
    rows = np.isfinite(motion.turn)
    if rows.sum() < limits.LOG.legs or np.std(motion.turn[rows]) < limits.LOG.lively_turn:
        return None
    return np.array([largest_correlation(log, log.dtheta[:, axis], motion, motion.turn) for axis in range(3)])


def _check_gyro_unit(log: SensorLog, motion: FixMotion) -> None:
    """Compare the size of the turns with the course's, about the fastest axis of those that follow it.

    Velocities at 1 Hz do not show it: gyros that hardly turn, and a bias of 2 °/s, explain a turn of 20 s.
    An axis that is not quite level follows the course as well as the vertical one, by some percent.
    """
    likeness = _likeness(log, motion)
    rows = np.isfinite(motion.turn)
    if likeness is not None:
        factors = np.abs(likeness[np.abs(likeness[:, 0]) >= limits.LOG.axis_correlation, 1])
    elif rows.sum() >= limits.LOG.legs and abs(turn := motion.turn[rows].mean()) > limits.LOG.gyro_bias:
        factors = np.array([np.linalg.norm(np.median(log.rates[0], axis=0)) / abs(turn)])  # a circle
    else:
        return
    if not factors.any():
        return
    factor = float(factors.max())
    unit = find_nearest_unit(factor, UNITS["angle"], limits.LOG.degree_ratio)
    if unit:
        raise MissionError(
            f"{log.name}: the gyros turn {factor:.3g} times as fast as the course: the numbers look like "
            f"{unit[0]} where {unit[1]} are declared (columns gx_rad_s, gx_deg_s)"
        )


def _check_bank(log: SensorLog, motion: FixMotion) -> None:
    """Check the pitch rate of banked turns, which is nose up in turns to either side.

    A vehicle that leans into its turns at bank φ and yaws at ψ̇ pitches at ψ̇ sin φ (Groves, ch. 2.3); one
    that does not shows nothing here.
    """
    rows = np.isfinite(motion.turn)
    if rows.sum() < limits.LOG.legs or np.std(motion.turn[rows]) < limits.LOG.lively_turn:
        return
    for axis in (0, 1):
        correlation, factor, _ = largest_correlation(log, log.dtheta[:, axis], motion, np.abs(motion.turn))
        wrong = -correlation if axis else abs(correlation)
        if wrong > limits.LOG.axis_correlation and factor > limits.LOG.pitch_of_turn:
            raise MissionError(
                f"{log.name}: in banked turns the nose goes up about the axis called "
                f"{('forward', 'minus right')[axis]} (correlation {abs(correlation):.2f}), not about right: "
                "swapped axes or signs are likely"
            )


def _check_forward(log: SensorLog, motion: FixMotion, *, backward_only: bool) -> None:
    """Compare the change of the speed with the horizontal accelerometers, each at its best time.

    Windows that are explained may have turns only, in which an exchange of axes is as good as a rotation; of
    an unnamed vehicle, they may also show that its nose points anywhere.
    """
    if motion.speed.size < limits.LOG.legs or np.std(motion.speed) < limits.LOG.lively_speed:
        return
    forward, right = (
        largest_correlation(log, log.dvelocity[:, axis], motion, motion.speed)[0] for axis in (0, 1)
    )
    backward = forward < -limits.LOG.axis_correlation
    if backward or (
        not backward_only
        and abs(right) > limits.LOG.axis_correlation
        and forward < abs(right) - limits.LOG.correlation_lead
    ):
        axis, value = ("minus forward", forward) if backward else ("right", right)
        raise MissionError(
            f"{log.name}: the acceleration that the GPS shows is along the axis called {axis} (correlation "
            f"{value:.2f}, along forward {forward:.2f}): swapped axes or signs are likely"
        )


def _check_across(log: SensorLog, motion: FixMotion) -> None:
    """Compare the acceleration across the path with the horizontal accelerometers, if one is as large.

    What leans into its turns, as an aircraft, feels nothing across.
    """
    rows = np.isfinite(motion.across)
    if rows.sum() < limits.LOG.legs or np.std(motion.across[rows]) < limits.LOG.lively_across:
        return
    (forward, along, _), (right, across, _) = (
        largest_correlation(log, log.dvelocity[:, axis], motion, motion.across) for axis in (0, 1)
    )
    felt = limits.LOG.felt_across
    reversed_ = right < -limits.LOG.axis_correlation and across > felt
    if reversed_ or (
        abs(forward) > limits.LOG.axis_correlation
        and right < abs(forward) - limits.LOG.correlation_lead
        and along > felt
    ):
        axis, value = ("minus right", right) if reversed_ else ("forward", forward)
        raise MissionError(
            f"{log.name}: in turns, the acceleration that the GPS shows is along the axis called {axis} "
            f"(correlation {value:.2f}, along right {right:.2f}): swapped, reversed or left-handed axes of "
            "the accelerometers are likely"
        )


def _axes_are_right(matches: WindowMatches, vehicle: Vehicle) -> bool:
    """Return whether the IMU explains the velocities without any change of its axes.

    The nose then points along the course or, on an unnamed vehicle, in changing directions: wrong axes
    would turn it by a constant angle.
    """
    found = [
        (window, matches.match(n))
        for n, window in enumerate(matches.windows[: limits.LOG.fewest_lag_windows])
    ]
    angles = [
        _off_course(window, one)
        for window, one in found
        if one.misfit < limits.LOG.explained_misfit and one.heading_sigma < limits.LOG.heading_sigma
    ]
    apart = np.concatenate(angles) if angles else np.empty(0)
    if not apart.size:
        return False
    mean = np.exp(1j * apart).mean()
    spread = np.sqrt(-2 * np.log(max(abs(mean), 1e-12)))  # circular standard deviation
    return bool(
        abs(np.angle(mean)) < limits.LOG.off_course or (not vehicle.name and spread > limits.LOG.wandering)
    )


def _off_course(window: Window, found: Match) -> FloatArray:
    """Return the course minus the direction of the nose at fixes in motion [rad]."""
    fast = np.linalg.norm(window.velocity_n[:, :2], axis=1) > limits.LOG.course_speed
    north, east = window.velocity_n[fast, :2].T
    steps = np.clip(np.searchsorted(window.time, window.at[fast] + found.lag), 0, len(window.dtheta))
    turning = running_attitudes(window.dtheta - found.gyro_bias * np.diff(window.time)[:, None])
    nose = (found.C_nb * turning[steps]).apply((1.0, 0.0, 0.0)).reshape(-1, 3)
    return wrap(np.arctan2(east, north) - np.arctan2(nose[:, 1], nose[:, 0]))


def _check_clock(log: SensorLog, matches: WindowMatches) -> None:
    """Estimate the clock offset at which the velocity changes by the sensed force, in several windows."""
    lags: list[float] = []
    for number in range(len(matches.windows)):
        found = matches.match(number)
        if not (_shows_lag(found) and abs(found.lag) < limits.LOG.refused_lag):
            found = min(found, matches.match(number, limits.LOG.lag_starts), key=lambda one: one.cost)
        if _shows_lag(found):
            lags.append(found.lag)
        if len(lags) == limits.LOG.fewest_lag_windows and np.abs(lags).max() < limits.LOG.refused_lag:
            return
    if len(lags) < limits.LOG.fewest_lag_windows:
        return
    lag = float(np.median(lags))
    agreeing = np.abs(np.array(lags) - lag) < limits.LOG.lag_apart
    if abs(lag) >= limits.LOG.refused_lag and agreeing.mean() > limits.LOG.agreeing_windows:
        side = "late" if lag < 0 else "early"
        raise MissionError(
            f"{log.name}: the stamps of the GPS are about {abs(lag):.1f} s {side} relative to the IMU's "
            f"(the velocity changes like the IMU data of that much {'before' if lag < 0 else 'after'}, in "
            f"{agreeing.sum()} of {len(lags)} stretches): two clocks are likely. latency_s = "
            f"{log.gnss.latency - lag:.1f} in the TOML aligns them"
        )


def _shows_lag(found: Match) -> bool:
    return found.lag_sigma < limits.LOG.lag_sigma and found.misfit < limits.LOG.misfit


def largest_correlation(
    log: SensorLog,
    increments: FloatArray,
    motion: FixMotion,
    seen: FloatArray,
    lags: FloatArray | None = None,
) -> tuple[float, float, float]:
    """Return correlation, factor and lag at the largest correlation, of either sign.

    Parameters
    ----------
    log
        The log.
    increments : (n,) array
        Those of an axis of the IMU.
    motion, seen : FixMotion and (k,) array
        The motion by the fixes, and the column of it with which the axis is compared, later by the lag.
    lags
        Lags that are tried [s]; by default up to the largest clock offset.
    """
    if lags is None:
        largest, step = limits.LOG.largest_lag, limits.LOG.lag_step
        lags = np.arange(-largest, largest + step / 2, step)
    total = running_sums(increments)
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
