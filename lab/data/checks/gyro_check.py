"""Gyro check: whether the axes and signs of the gyros agree with the course and with the accelerometers.

Neither needs to know the vehicle. One that turns changes its course by what its gyros turn about the
vertical, up to a bias, unless it moves where it likes; then they have nothing in common. And whatever it
does, the velocity changes by the specific force, resolved by the gyros (`lab.data.checks.velocity_matching`):
with a wrong sign of one gyro this fails, and with the right sign it holds.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray, running_sums
from lab.base.files.mission_error import MissionError
from lab.data.checks import limits
from lab.data.checks.imu_axes import AS_IT_IS, GYROS_REVERSED, NAMES, SAME, ImuAxes, mark_down_axis, others
from lab.data.checks.window_matches import WindowMatches
from lab.data.log.sensor_log import SensorLog
from lab.motion.frames.displacement import velocity_of_positions

VELOCITY_SIGMA = 0.1
"""σ of a velocity whose receiver does not give one [m/s]: Doppler of consumer receivers."""


class GyroError(MissionError):
    """Gyros contradict the course or the accelerometers; turning the whole IMU does not help.

    Parameters
    ----------
    said
        What contradicts what.
    axes
        What makes it right.
    """

    def __init__(self, said: str, axes: ImuAxes) -> None:
        super().__init__(f"{said}. {axes.remedy}")
        self.said, self.axes = said, axes

    def seen_in(self, C: FloatArray) -> GyroError:
        """Return the same error with the columns of an IMU whose axes times C (3, 3) are those judged."""
        return GyroError(self.said, self.axes.seen_in(C))


class _Stretch(NamedTuple):
    """Fixes in motion without a gap: their times in that of the IMU [s] and course [rad]."""

    time: FloatArray
    course: FloatArray


def are_explained(matches: WindowMatches) -> bool:
    """Return whether the IMU as it is explains the velocities in the windows, if there are any."""
    return not matches.windows or float(_misfits(matches).mean()) < limits.LOG.gyro_misfit


def check_course(log: SensorLog, matches: WindowMatches) -> None:
    """Compare the course with the gyros about the vertical and about each axis, of either sign.

    Parameters
    ----------
    log
        The log, without a break.
    matches
        Of the windows in which the velocity changes most.

    Raises
    ------
    GyroError
        If the course changes as a gyro of another axis or sign turns.
    """
    stretches = list(_stretches(log))
    if not stretches:
        return
    turned = _turn_residual(log, stretches, np.zeros(3))
    if turned < limits.LOG.course_change:
        return
    _, force = log.rates
    up = np.median(force, axis=0)
    down = -up / np.linalg.norm(up)
    right, reversed_ = (_turn_residual(log, stretches, sign * down) / turned for sign in (1, -1))
    what = f"{log.name}: the course changes by {np.degrees(turned):.0f}° (rms), and the gyros "
    # The velocities, where they change enough, must not contradict it.
    if (
        reversed_ < limits.LOG.explained_course
        and right > limits.LOG.unexplained_course
        and _misfits(matches, GYROS_REVERSED).sum() <= limits.LOG.worse_fit * _misfits(matches).sum()
    ):
        raise GyroError(
            f"{what}turn against it about the vertical (with the sign reversed, {100 * reversed_:.0f} % of "
            f"this is left, and {100 * right:.0f} % as it is): the gyro called down has the wrong sign, or "
            "the gyros have swapped axes",
            GYROS_REVERSED,
        )
    if min(right, reversed_) < limits.LOG.unexplained_axis:
        return
    for axis, sign in itertools.product((0, 1), (1, -1)):
        left = _turn_residual(log, stretches, sign * np.eye(3)[axis]) / turned
        if left < limits.LOG.explained_course:
            raise GyroError(
                f"{what}show this about the axis called {'' if sign > 0 else 'minus '}{NAMES[axis]}, not "
                f"about down ({100 * left:.0f} % of it is left, and {100 * right:.0f} %): swapped axes of "
                "the gyros are likely, and the other two columns are then wrong as well",
                ImuAxes(mark_down_axis(axis, sign), SAME),
            )


def _stretches(log: SensorLog) -> Iterator[_Stretch]:
    gnss = log.gnss
    time = gnss.time - gnss.latency
    velocity = gnss.velocity_n[:, :2]
    if not np.isfinite(velocity).all(axis=1).any() and time.size > 1:
        velocity = velocity_of_positions(gnss.time, gnss.position)[:, :2]
    speed = np.linalg.norm(velocity, axis=1)
    sigma = gnss.velocity_sigma[:, :2].max(axis=1, initial=0.0)
    sigma = np.where(np.isfinite(sigma), sigma, VELOCITY_SIGMA)
    fast = (
        (speed > np.maximum(limits.LOG.gyro_speed, limits.LOG.gyro_speed_sigmas * sigma))
        & (time >= 0)
        & (time <= log.duration)
    )
    rows = np.flatnonzero(fast)
    course = np.arctan2(velocity[:, 1], velocity[:, 0])
    for part in np.split(rows, np.flatnonzero(np.diff(time[rows]) > limits.LOG.stretch_gap) + 1):
        if part.size < limits.LOG.stretch_fixes:
            continue
        pieces = max(1, round((time[part[-1]] - time[part[0]]) / limits.LOG.longest_stretch))
        for piece in np.array_split(part, pieces):
            if (
                piece.size >= limits.LOG.stretch_fixes
                and time[piece[-1]] - time[piece[0]] > limits.LOG.shortest_stretch
            ):
                yield _Stretch(time[piece], course[piece])


def _turn_residual(log: SensorLog, stretches: Sequence[_Stretch], axis: FloatArray) -> float:
    """Return the rms of the course minus the angle turned about an axis, without its drift [rad]."""
    total = running_sums(log.dtheta @ axis)
    left = []
    for one in stretches:
        apart = np.unwrap(one.course - np.interp(one.time, log.time, total))
        since = one.time - one.time.mean()
        apart -= apart.mean()
        drift = float(np.clip(since @ apart / (since @ since), -limits.LOG.gyro_bias, limits.LOG.gyro_bias))
        left.append(apart - drift * since)
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)))


def _misfits(matches: WindowMatches, axes: ImuAxes = AS_IT_IS) -> FloatArray:
    """Return the misfit of each window with some axes."""
    return np.array([matches.misfit(number, *axes) for number in range(len(matches.windows))])


def check_velocities(name: str, matches: WindowMatches) -> None:
    """Compare the velocities with the accelerometers, resolved by gyros, in all axes and signs of both.

    Parameters
    ----------
    name
        Of the log, for messages.
    matches
        Of the windows in which the velocity changes most.

    Raises
    ------
    GyroError
        If other axes explain the velocities, and those of the log do not.
    """
    misfits = _misfits(matches)
    if misfits.size < limits.LOG.gyro_windows or misfits.mean() < limits.LOG.gyro_misfit:
        return
    worst = int(np.argmax(misfits))
    tried = sorted(others(), key=lambda axes: matches.misfit(worst, *axes))[: limits.LOG.axes_compared]
    left = {axes.words: (float(_misfits(matches, axes).mean()), axes) for axes in tried}
    (words, (mean, best)), *more = sorted(left.items(), key=lambda one: one[1][0])
    explained = _misfits(matches, best) < np.maximum(limits.LOG.better * misfits, limits.LOG.gyro_misfit)
    if not (mean < limits.LOG.much_better * misfits.mean() and explained.all()):
        return
    alike = [other for other, (one, _) in more if one < limits.LOG.alike_misfit * mean]
    raise GyroError(
        f"{name}: gyros, accelerometers and the velocities of the GPS do not belong together (mean square "
        f"residual {misfits.mean():.2g} σ², and {mean:.2g} σ² with {' or '.join((words, *alike))}): swapped "
        "axes or signs are likely",
        best,
    )
