"""Alignment: the start of a navigator with recorded sensors.

At rest, the accelerometers show the vertical, and the gyros show their bias. In motion, the acceleration of
the fixes is subtracted first. The heading comes from `lab.navigation.alignment.initial_heading`; the gyros
carry it back to the start. If no sensor or motion shows it, it stays unknown. P. D. Groves, *Principles of
GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 5.6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray, running_sums
from lab.motion.frames import earth
from lab.motion.frames.displacement import displaced
from lab.motion.frames.rotation import quaternion_from_euler, wrap
from lab.motion.kinematics.running_turns import running_attitudes
from lab.navigation.alignment import limits
from lab.navigation.alignment.initial_heading import (
    UNKNOWN,
    Found,
    Hints,
    by_antennas,
    by_course,
    by_magnetometer,
    by_velocity,
    choose_surest_heading,
    contradict,
    mean_turned,
    shows_course,
)
from lab.navigation.alignment.rest_alignment import LEAST_FORCE
from lab.navigation.filters.error_models import ACCEL_BIAS
from lab.navigation.lever_arm import mean_rates_at_fixes
from lab.navigation.solution import Belief, Fixes, Imu, Start

_SECOND = 1.0
"""Length of the intervals in which rest and turns are detected [s]."""
_ROUNDS = 3
"""Number of iterations of levelling and heading, each with the result of the previous one."""


class Alignment(NamedTuple):
    """The start of a navigator.

    Attributes
    ----------
    start : Start
        Position, velocity and attitude of the IMU at the first sample.
    gyro_bias : (3,) array
        Initial gyro bias [rad/s].
    attitude_sigma : (3,) array
        σ of the attitude error, north, east, down, from noise, motion and heading alone [rad]. Tilts also err
        by the accelerometers' errors; see `lab.navigation.alignment.start_covariance`.
    gyro_bias_sigma : (3,) array
        σ of the gyro bias [rad/s].
    velocity_sigma : (3,) array
        σ of the velocity of the antenna, north, east, down [m/s].
    rate : (3,) array
        Rate of rotation in b, by which the velocity of the antenna differs [rad/s]; zero at rest.
    force_n : (3,) array
        Specific force in n by which roll and pitch were found [m/s²]: acceleration minus gravity.
    rest : float
        Duration of the rest at the start [s].
    heading : Found
        The initial heading and its source.
    """

    start: Start
    gyro_bias: FloatArray
    attitude_sigma: FloatArray
    gyro_bias_sigma: FloatArray
    velocity_sigma: FloatArray
    rate: FloatArray
    force_n: FloatArray
    rest: float
    heading: Found

    def with_longer_arm(self, by: FloatArray) -> Alignment:
        """Return the start with another lever arm; `by` (3,) is its difference in b [m]."""
        start = self.start
        moved = _of_imu(
            start.position, start.velocity_n, start.q_nb, by, self.rate, self.force_n, self.heading.sigma
        )
        return self._replace(start=start._replace(position=moved[0], velocity_n=moved[1]))

    @property
    def remark(self) -> str:
        """Description of how the start was found."""
        levelled = (
            f"Levelled at rest over {self.rest:.1f} s, gyro biases from the same rest"
            if self.rest
            else "Levelled in motion with the acceleration from the fixes, gyro biases from the motion too"
        )
        if not self.heading.source:
            return (
                f"{levelled}; the heading is unknown, since no motion and no sensor shows it. "
                "navigator.initial_heading sets it."
            )
        heading = f"heading {self.heading.source}, σ {np.degrees(self.heading.sigma):.0f}°."
        return " ".join((f"{levelled}; {heading}", *self.heading.remarks))


EXACT = Belief(P0=np.zeros((15, 15)), R=np.eye(6), noise=np.zeros(12), decay=np.zeros(6))
"""What a filter assumes of exact sensors and an antenna at the IMU."""


def align(
    imu: Imu,
    fixes: Fixes,
    velocity_sigma: FloatArray,
    hints: Hints | None = None,
    assumed: Belief = EXACT,
) -> Alignment:
    """Return the start of a navigator.

    Parameters
    ----------
    imu, fixes
        The measurements; the fixes are those of the antenna, with all three velocities.
    velocity_sigma : (m, 3) array
        σ of the velocities [m/s]; see `lab.navigation.log_navigation`.
    hints
        Further information about vehicle and heading.
    assumed
        The filter's assumptions: the lever arm, the noise of the sensors, and the biases of the
        accelerometers. The mean rate at rest has at least the noise of a usual MEMS gyro.
    """
    hints = Hints() if hints is None else hints
    rest = _rest(imu, fixes, velocity_sigma)
    position, velocity = (
        _at_start(imu.time[0], fixes, values) for values in (fixes.position, fixes.velocity_n)
    )
    velocity, start_sigma = _start_velocity(
        velocity, velocity_sigma[max(0, np.searchsorted(fixes.time, imu.time[0], "right") - 1)], rest
    )
    length = rest or limits.ALIGNMENT.levelling_time
    force = _mean_force(imu, length) if rest else _force_at_start(imu)
    g = float(earth.gravity(np.sin(position[0]), position[2]))
    acceleration, spread = (np.zeros(3), 0.0) if rest else _acceleration(imu, fixes, velocity_sigma, length)
    # Specific force is acceleration without gravity, which points down.
    force_n = acceleration - (0, 0, g)
    bias, bias_sigma = (
        (_mean_rate(imu, rest), np.zeros(3)) if rest else _straight_gyro_bias(imu, fixes, velocity_sigma)
    )
    found = _heading(imu, fixes, velocity_sigma, hints, bias, rest)
    if not rest and (found.gyro_bias is not None or not hints.vehicle.follows_nose):
        bias, bias_sigma = _bias_of_motion(imu, found)
    tilt = (
        _rest_force_sigma(imu, rest, assumed) / g
        if rest
        else float(np.hypot(limits.ALIGNMENT.tilt_in_motion, spread / g))
    )
    if np.isnan(hints.given):
        bias_sigma_of_force = float(np.sqrt(np.diag(assumed.P0)[ACCEL_BIAS].max()))
        of_all = float(np.hypot(tilt, bias_sigma_of_force / g))
        found = _with_compass(imu, hints, found, (force, force_n), of_all, length, position)
    heading, heading_sigma = found.heading, found.sigma
    roll, pitch = level(force, force_n, heading)
    q_nb = quaternion_from_euler(np.array([roll, pitch, heading]))
    if rest:
        # At rest, the gyros measure the Earth's rate and their bias; of the Earth's rate, the vertical part
        # is known.
        up = (
            Rotation.from_quat(q_nb, scalar_first=True).inv().apply([0, 0, -earth.RATE * np.sin(position[0])])
        )
        bias = bias - up
        noise = np.maximum(limits.ALIGNMENT.rest_noise, np.sqrt(assumed.noise[:3]))
        # The level part of the Earth's rate depends on the unknown heading: it stays in the bias.
        bias_sigma = np.maximum(earth.RATE, noise / np.sqrt(rest))
    rate = (
        np.zeros(3)
        if rest
        else mean_rates_at_fixes(imu, imu.time[:1], assumed.lever_arm, estimated=True)[0, :3] - bias
    )
    position, velocity = _of_imu(position, velocity, q_nb, assumed.lever_arm, rate, force_n, heading_sigma)
    return Alignment(
        Start(position, velocity, q_nb),
        bias,
        np.array([tilt, tilt, heading_sigma]),
        bias_sigma,
        start_sigma,
        rate,
        force_n,
        rest,
        found,
    )


def _of_imu(
    position: FloatArray,
    velocity_n: FloatArray,
    q_nb: FloatArray,
    arm: FloatArray,
    rate: FloatArray,
    force_n: FloatArray,
    sigma: float,
) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity of the IMU from those of the antenna; `sigma` is that of the heading."""
    shift, swing = (mean_turned(part, force_n, sigma) for part in antenna(q_nb, arm, rate))
    return displaced(position[None], -shift[None])[0], velocity_n - swing


def antenna(q_nb: FloatArray, arm: FloatArray, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return displacement (3,) [m] and velocity (3,) [m/s] of an antenna relative to the IMU, in n.

    The rotation of the Earth moves an antenna at 10 m by less than 1 mm/s, and is neglected.

    Parameters
    ----------
    q_nb : (4,) array
        Attitude.
    arm, rate : (3,) arrays
        Lever arm [m] and rate of rotation [rad/s], in b.
    """
    C_nb = Rotation.from_quat(q_nb, scalar_first=True).as_matrix()
    return C_nb @ arm, C_nb @ np.cross(rate, arm)


def _rest_force_sigma(imu: Imu, rest: float, assumed: Belief) -> float:
    """Return the σ of the level specific force at rest, apart from the accelerometers' errors [m/s²].

    It is the noise of the mean, and what the means of the seconds differ by beyond their noise: the vehicle
    at rest rocks and settles.
    """
    density = float(assumed.noise[3:6].max())
    ends = imu.time[0] + _SECOND * np.arange(int(rest / _SECOND) + 1)
    total = running_sums(imu.dvelocity)
    means = np.diff([np.interp(ends, imu.time, column) for column in total.T], axis=1) / _SECOND
    # The mean of a second has the variance density / second by white noise alone.
    beyond = max(0.0, float(means.var(axis=1, ddof=1).max()) - density / _SECOND)
    return float(np.sqrt(density / rest + beyond + LEAST_FORCE**2))


def _start_velocity(velocity: FloatArray, sigma: FloatArray, rest: float) -> tuple[FloatArray, FloatArray]:
    """Return the velocity (3,) at the start and its σ.

    A vehicle at rest has a speed below `rest_speed` of `limits`, and one in motion climbs by
    `vertical_speed_sigma`. Where a receiver knows less, the velocity is zero with this σ.
    """
    sigma_of_zero = np.array([np.inf, np.inf, limits.ALIGNMENT.vertical_speed_sigma])
    if rest:
        sigma_of_zero[:] = limits.ALIGNMENT.rest_speed
    return np.where(sigma > sigma_of_zero, 0.0, velocity), np.minimum(sigma, sigma_of_zero)


def level(force: FloatArray, force_n: FloatArray, heading: float) -> tuple[float, float]:
    """Return the roll and pitch [rad] that rotate a specific force measured in b to that in n.

    Parameters
    ----------
    force : (3,) array
        Specific force in b [m/s²].
    force_n : (3,) array
        The same in n: acceleration minus gravity [m/s²].
    heading
        Heading [rad].
    """
    c, s = np.cos(heading), np.sin(heading)
    ahead, right, down = c * force_n[0] + s * force_n[1], c * force_n[1] - s * force_n[0], force_n[2]
    across = float(np.hypot(force[1], force[2]))
    # Without a force across the forward axis, as of a device that stands on its nose, any roll will do.
    # f_y cos φ − f_z sin φ = right is a cosine of φ + atan2(f_z, f_y); the other sign of its angle turns the
    # vehicle upside down.
    roll = -np.arccos(np.clip(right / across, -1, 1)) - np.arctan2(force[2], force[1]) if across else 0.0
    below = force[1] * np.sin(roll) + force[2] * np.cos(roll)
    # The pitch is the angle between the force forward and down in b and that in n.
    pitch = np.arctan2(below, force[0]) - np.arctan2(down, ahead)
    return float(wrap(roll)), float(wrap(pitch))


def _rest(imu: Imu, fixes: Fixes, velocity_sigma: FloatArray) -> float:
    """Return the duration of the rest from the first sample on, in whole seconds; 0 if below two [s]."""
    start = imu.time[0]
    seconds = int(min(imu.time[-1] - start, limits.ALIGNMENT.longest_rest))
    dt = np.diff(imu.time)[:, None]
    rates, forces = imu.dtheta / dt, imu.dvelocity / dt
    slow = np.clip(
        limits.ALIGNMENT.rest_sigmas * velocity_sigma[:, :2].max(axis=1),
        limits.ALIGNMENT.rest_speed,
        limits.ALIGNMENT.largest_rest_speed,
    )
    speed = np.linalg.norm(fixes.velocity_n[:, :2], axis=1) / slow
    # A rest that drifts away from its first second, as on a slope, is none.
    level_force = forces[: max(1, np.searchsorted(imu.time, start + _SECOND))].mean(axis=0)
    for second in range(seconds):
        window = slice(*np.searchsorted(imu.time[1:], [start + second, start + second + _SECOND]))
        if window.stop - window.start < 2:
            return _at_least_two(second)
        moving = speed[(fixes.time >= start + second) & (fixes.time < start + second + _SECOND)]
        still = (
            rates[window].std(axis=0).max() < limits.ALIGNMENT.rest_rate
            and forces[window].std(axis=0).max() < limits.ALIGNMENT.rest_force
            and np.abs(forces[window].mean(axis=0) - level_force).max() < limits.ALIGNMENT.rest_force / 2
            and (not moving.size or float(np.median(moving)) < 1)
        )
        if not still:
            return _at_least_two(second)
    return _at_least_two(seconds)


def _at_least_two(seconds: int) -> float:
    return float(seconds) if seconds >= 2 else 0.0


def _mean_rate(imu: Imu, length: float) -> FloatArray:
    last = max(1, int(np.searchsorted(imu.time, imu.time[0] + length, "right")) - 1)
    return np.asarray(imu.dtheta[:last].sum(axis=0) / (imu.time[last] - imu.time[0]))


def _straight_gyro_bias(imu: Imu, fixes: Fixes, velocity_sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the gyro bias (3,) as the median rate in straight seconds, and its σ [rad/s].

    A vehicle on a constant course has a constant attitude on average. Without ten such seconds, the course
    shows the bias about the vertical; where it does not, the bias is zero, and its σ is the mean rate of the
    whole record.
    """
    ends = np.arange(imu.time[0], imu.time[-1], _SECOND)
    angle = running_sums(imu.dtheta)
    rates = np.diff([np.interp(ends, imu.time, column) for column in angle.T], axis=1).T / _SECOND
    fast = shows_course(fixes, velocity_sigma)
    if fast.sum() >= 2:
        course = np.unwrap(np.arctan2(fixes.velocity_n[fast, 1], fixes.velocity_n[fast, 0]))
        turn = np.diff(np.interp(ends, fixes.time[fast], course)) / _SECOND
        # How many fast fixes fall into each second, as a fraction for receivers at 1 Hz.
        known = np.diff(np.interp(ends, fixes.time, np.cumsum(fast))) > limits.ALIGNMENT.fast_part
        straight = known & (np.abs(turn) < limits.ALIGNMENT.straight_rate)
        if straight.sum() >= limits.ALIGNMENT.straight_seconds:
            return np.median(rates[straight], axis=0), np.full(3, limits.ALIGNMENT.straight_bias_sigma)
    mean = _mean_rate(imu, float(imu.time[-1] - imu.time[0]))
    if fast.sum() < 2 or np.ptp(fixes.time[fast]) < limits.ALIGNMENT.straight_seconds:
        return np.zeros(3), np.abs(mean)
    return _along_course(imu, fixes.time[fast], course, mean)


def _along_course(
    imu: Imu, time: FloatArray, course: FloatArray, mean: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the gyro bias (3,) by which the IMU turned more than the course, and its σ [rad/s].

    A vehicle may begin backwards: then its course turns by π, and twice the course does not. If it was
    carried aside, the course does not show the bias.

    Parameters
    ----------
    imu
        Samples of a vehicle that follows its nose.
    time, course : (m,) arrays
        Course [rad] at times [s].
    mean : (3,) array
        Mean rate of the whole record, the σ about level axes [rad/s].
    """
    # Twice the difference: a jump of the course by π is none of twice the course.
    turning = np.interp(time, imu.time, _heading_turn(imu, np.zeros(3)))
    apart = np.unwrap(2 * (course - turning)) / 2
    since = time - time.mean()
    slope = float(since @ apart) / float(since @ since)
    scatter = float(np.std(apart - apart.mean() - slope * since))
    if scatter > limits.ALIGNMENT.course_scatter:
        return np.zeros(3), np.abs(mean)
    # The errors of neighbouring fixes depend on each other: one in a second counts.
    noise = scatter / np.sqrt(float(since @ since) * min(1.0, np.ptp(time) / time.size))
    # The mean rate of the course: what it turned more than the gyros, plus what they saw.
    hidden = limits.ALIGNMENT.hidden_turn * abs(slope + float(np.polyfit(since, turning, 1)[0]))
    down = _vertical_in_body(imu)
    level = mean - down * float(mean @ down)
    sigma = float(np.linalg.norm((noise, hidden, limits.ALIGNMENT.straight_bias_sigma)))
    # Gyros that read too much turn further than the course: the difference falls by the bias.
    return -slope * down, np.hypot(np.abs(level), np.abs(down) * sigma)


def _vertical_in_body(imu: Imu) -> FloatArray:
    """Return the vertical (3,) in b of a nearly level IMU."""
    force = _mean_force(imu, limits.ALIGNMENT.levelling_time)
    # At rest, the specific force points up.
    return np.asarray(-force / np.linalg.norm(force))


def _force_at_start(imu: Imu) -> FloatArray:
    """Return the mean specific force (3,) over `levelling_time`, in b of the first sample [m/s²]."""
    last = max(1, int(np.searchsorted(imu.time, imu.time[0] + limits.ALIGNMENT.levelling_time, "right")) - 1)
    # The increment of a sample is resolved by the attitude at its begin, so the last one is not needed.
    C = running_attitudes(imu.dtheta[:last])[:-1].as_matrix()
    return np.asarray(np.einsum("kij,kj->i", C, imu.dvelocity[:last]) / (imu.time[last] - imu.time[0]))


def _mean_force(imu: Imu, length: float) -> FloatArray:
    last = max(1, int(np.searchsorted(imu.time, imu.time[0] + length, "right")) - 1)
    return np.asarray(imu.dvelocity[:last].sum(axis=0) / (imu.time[last] - imu.time[0]))


def _at_start(time: float, fixes: Fixes, values: FloatArray) -> FloatArray:
    """Return the value of the fixes (3,) at a time, interpolated; before the first fix, that of the first."""
    after = int(np.clip(np.searchsorted(fixes.time, time), 1, fixes.time.size - 1))
    a, b = fixes.time[after - 1], fixes.time[after]
    step = values[after] - values[after - 1]
    if values is fixes.position:
        # The longitude may cross the date line between the two fixes.
        step = np.array([step[0], wrap(step[1]), step[2]])
    return np.asarray(values[after - 1] + step * (time - a) / (b - a))


def _acceleration(
    imu: Imu, fixes: Fixes, velocity_sigma: FloatArray, length: float
) -> tuple[FloatArray, float]:
    """Return the mean acceleration (3,) over the first seconds, and the larger horizontal σ [m/s²].

    It is that of a line through the velocities, as far as they know it better than `acceleration_sigma`.
    """
    start = imu.time[0]
    near = np.abs(fixes.time - start - length / 2) < length / 2 + limits.ALIGNMENT.margin
    if near.sum() < limits.ALIGNMENT.slope_fixes:
        return np.zeros(3), limits.ALIGNMENT.acceleration_sigma
    time = fixes.time[near] - start
    slope = np.polyfit(time, fixes.velocity_n[near], 1)[0]
    # Of the slope of a straight line through points with this σ.
    variance = (velocity_sigma[near] ** 2).mean(axis=0) / ((time - time.mean()) ** 2).sum()
    # A prior around zero: noisy velocities hardly move it.
    known = limits.ALIGNMENT.acceleration_sigma**2 / (limits.ALIGNMENT.acceleration_sigma**2 + variance)
    return slope * known, float(np.sqrt((variance * known)[:2].max()))


def _heading_turn(imu: Imu, bias: FloatArray) -> FloatArray:
    """Return the angle (n + 1,) by which a nearly level IMU has rotated about the vertical [rad]."""
    turned = (imu.dtheta - bias * np.diff(imu.time)[:, None]) @ _vertical_in_body(imu)
    return running_sums(turned)


def _heading(
    imu: Imu, fixes: Fixes, velocity_sigma: FloatArray, hints: Hints, bias: FloatArray, rest: float
) -> Found:
    """Return the heading at the first sample: given, or from antennas, course and velocities."""
    turning = _heading_turn(imu, bias)
    vehicle = hints.vehicle
    course = by_course(imu, fixes, velocity_sigma, turning, rest, vehicle)
    antennas = by_antennas(imu, hints.headings, turning, rest)
    matched = UNKNOWN
    by_nose = vehicle.follows_nose and bool(course.source)
    if not (by_nose and vehicle.name) or hints.forward_assumed:
        before = bias if rest or vehicle.follows_nose else np.zeros(3)
        matched = by_velocity(imu, fixes, velocity_sigma, before, rest)
    if not np.isnan(hints.given):
        given = Found(float(wrap(hints.given)), hints.given_sigma, "given", float(imu.time[0]))
        return given._replace(gyro_bias=matched.gyro_bias, gyro_bias_sigma=matched.gyro_bias_sigma)
    if by_nose and hints.forward_assumed:
        # The IMU may be turned in the vehicle by any angle; the surer one is used.
        if contradict(course, matched):
            apart = float(wrap(matched.heading - course.heading))
            course, matched = UNKNOWN, matched._replace(course_apart=apart)
    elif by_nose:
        # The course is used unless the specific force contradicts it: then the kind of vehicle is unknown.
        course = course if choose_surest_heading((course, matched)).sigma <= course.sigma else UNKNOWN
        matched = UNKNOWN if course.source else matched
    return choose_surest_heading((antennas, course, matched))


def _bias_of_motion(imu: Imu, found: Found) -> tuple[FloatArray, FloatArray]:
    """Return the gyro bias found with the heading, or zero with the mean rate as its σ; and its σ."""
    if found.gyro_bias is not None and found.gyro_bias_sigma is not None:
        return found.gyro_bias, np.maximum(found.gyro_bias_sigma, limits.ALIGNMENT.straight_bias_sigma)
    return np.zeros(3), np.maximum(
        np.abs(_mean_rate(imu, float(imu.time[-1] - imu.time[0]))), limits.ALIGNMENT.straight_bias_sigma
    )


def _with_compass(
    imu: Imu,
    hints: Hints,
    found: Found,
    forces: tuple[FloatArray, FloatArray],
    tilt: float,
    length: float,
    position: FloatArray,
) -> Found:
    """Return the most certain heading, including that of the magnetometer."""
    compass = found
    for _ in range(_ROUNDS):  # in motion, the vertical depends on the heading
        attitude = level(*forces, compass.heading)
        compass = by_magnetometer(imu, hints.magnetometer, attitude, tilt, length, position)
    return choose_surest_heading((found, compass))
