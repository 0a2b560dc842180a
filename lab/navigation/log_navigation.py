"""Log navigation: the navigator on a sensor log, with a σ and a time for each fix.

The filter is the same as for simulated flights, with the lever arm and the latency of the log. It processes
the log in stretches: gaps of the IMU are separate, and so are fixes with different numbers of measurements.
The settings do not describe the biases found at the start, so these do not decay: they are random walks.

The filter gives no weight to a velocity that was not measured. The start takes it from the positions, with
the σ that follows from theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.files.mission_error import MissionError
from lab.base.parameters.setting_error import SettingError
from lab.data.log.log_section import cut_section
from lab.data.log.sensor_log import GnssLog, SensorLog
from lab.motion.frames.displacement import velocity_of_positions
from lab.navigation import navigator as linear
from lab.navigation.aiding import collect_aids, needs_rest
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.alignment.alignment import Alignment, align
from lab.navigation.alignment.initial_heading import Hints
from lab.navigation.alignment.start_covariance import start_covariance
from lab.navigation.belief import (
    assumed_latency,
    assumed_lever_arm,
    belief,
    chosen_blocks,
    implausible,
    r_factors,
    schedule_filter,
)
from lab.navigation.checks import (
    check_finite,
    check_mechanization,
    check_place,
    check_r,
    check_smoother,
    check_user_states,
    divergence_error,
)
from lab.navigation.filters import smoother, unscented
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.kalman import MEASUREMENTS, gate
from lab.navigation.filters.schedule import Stretch
from lab.navigation.filters.wander_models import linear_model
from lab.navigation.log_readings import collect_readings, drop_sensors_without_readings
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import NO_REST, Belief, Fixes, Imu, Solution, Start
from lab.navigation.standstill import at_rest, standing_still
from lab.sensors.gps import mask_within
from lab.sensors.suite import SensorSuite

_APART = 1.0
"""Time between two positions whose difference is a velocity [s]: at 10 Hz, the difference of two neighbours
has ten times its error. In a steady turn, their difference has the course of the middle."""
AROUND: Final = 5.0
"""Time before and after a gap whose motion stands for that in it [s]: a vehicle that begins to move in a gap
of at most 2 s still moves then, and the live navigator can go back that far."""
Arrays = TypeVar("Arrays", Imu, Fixes)

UNKNOWN = 1e4
"""σ of an unmeasured velocity, so that it has no effect [m/s]."""
WITHHELD = 1e6
"""σ of each measurement of a withheld fix [m], [m/s]."""

_MIN_SAMPLES, _MIN_FIXES = 3, 2
"""Fewest samples of the IMU from the first fix on, and fewest fixes: two steps, and one to correct them."""
_ROUNDING = 1e-6  # of time stamps [s]


class RecordedRun(NamedTuple):
    """The navigation of a log.

    Attributes
    ----------
    imu : Imu
        The input, from the first fix on; times of the log [s].
    fixes : Fixes
        The fixes as they were used: at their time of validity, of the antenna.
    belief : Belief
        The filter's assumptions, with an R for each fix.
    alignment : Alignment
        The start of the navigator.
    solution : Solution
        The solution at the times of `imu`; innovations are NaN where the receiver measures nothing.
    aids : Aids
        The measurements besides GPS that were used.
    blocks : tuple of str
        The further blocks of states of the filter.
    remarks : tuple of str
        Repairs and assumptions, as text.
    """

    imu: Imu
    fixes: Fixes
    belief: Belief
    alignment: Alignment
    solution: Solution
    aids: Aids
    blocks: tuple[str, ...]
    remarks: tuple[str, ...]


def navigate_log(
    log: SensorLog,
    sensors: SensorSuite,
    navigator: NavigatorSettings,
    outages: Sequence[tuple[float, float]] = (),
    withheld: NDArray[np.bool_] | None = None,
    start: Alignment | None = None,
    *,
    rests_of_all: bool = False,
) -> RecordedRun:
    """Navigate a sensor log.

    >>> from lab.missions import read_sensor_log
    >>> run = navigate_log(read_sensor_log("drive"), SensorSuite(), NavigatorSettings())

    Parameters
    ----------
    log
        The log.
    sensors
        The filter's assumptions about the sensors: noise, biases, and the variances of a fix if the log gives
        none.
    navigator
        The filter. An R given there takes the place of the log's own σ; P0 is that of the start found in the
        log, unless given.
    outages
        Intervals of time [s] without fixes for the filter.
    withheld : (m,) array
        Mask of the fixes that the filter gets with the σ `WITHHELD`. They have no effect, and their
        innovations are prediction errors. The returned belief has their own R.
    start
        Start of the navigator, if it is already known for the same latency and lever arm.
    rests_of_all
        Whether withheld fixes, too, say where the vehicle rests, as in a run with them.

    Raises
    ------
    MissionError
        If there are too few fixes during the IMU data.
    SettingError
        If the settings are incompatible, or cannot be applied to a log.
    ValueError
        If the solution diverges beyond all numbers, or comes too close to a pole.
    """
    log = cut_section(log)
    _check(navigator)
    readings = collect_readings(log, sensors)
    sensors, remarks = drop_sensors_without_readings(sensors, readings, log)
    check_user_states(navigator)
    assumed = belief(sensors, navigator)
    assumed = assumed._replace(lever_arm=assumed_lever_arm(navigator, log.gnss.lever_arm))
    check_r(assumed.R)
    times = log.gnss.time - assumed_latency(navigator, log.gnss.latency)
    first = _first_sample(log, times)
    imu = Imu(log.time[first:], log.dtheta[first:], log.dvelocity[first:])
    gnss, R, variances = used_fixes(log.gnss, assumed, navigator)
    fixes = Fixes(times, gnss.position, gnss.velocity_n)
    start = start or align(
        imu, *start_fixes(fixes, log.gnss.velocity_n, variances), _hints(log, navigator), assumed
    )
    names = chosen_blocks(navigator, sensors)
    rows = _fixes_after_start(log, imu, times) & ~mask_within(outages, times)
    assumed = assumed._replace(
        P0=start_covariance(assumed, navigator, names, start, variances[0, :3]),
        R=R[rows],
        decay=np.append(np.zeros(6), assumed.decay[6:]),
        gaps=np.array([(*gap, *gap_noise(imu, *gap)) for gap in log.gaps.tolist()]).reshape(-1, 8),
    )
    fixes = Fixes(*(values[rows].copy() for values in fixes))
    missing = np.append(np.zeros((int(rows.sum()), 3), bool), np.isnan(log.gnss.velocity_n[rows]), axis=1)
    begin = start.start._replace(gyro_bias=start.gyro_bias)
    given = np.ones(fixes.time.size, np.bool_) if withheld is None else ~withheld[rows]
    judged = np.ones_like(given) if rests_of_all else given
    rest, standing = _find_rests(imu, fixes, assumed, navigator, judged)
    aids = collect_aids(sensors, navigator, readings, imu, standing)
    if navigator.rest_updates:
        imu = imu._replace(rest=rest)
    solution = _solution(
        imu, fixes, log, begin, assumed, navigator, 6 - missing.sum(axis=1), given, aids, names
    )
    solution.innovation[missing] = np.nan
    imu = imu._replace(rest=NO_REST)
    return RecordedRun(
        imu, fixes, assumed, start, solution, aids, names, (*log.repairs, *remarks, start.remark)
    )


def _fixes_after_start(log: SensorLog, imu: Imu, times: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of the fixes during the IMU data; the last one before the start was used for it.

    Raises
    ------
    MissionError
        If there are none.
    """
    rows = (times > imu.time[0] + _ROUNDING) & (times <= imu.time[-1])
    if not rows.any():
        raise MissionError(f"{log.name}: no fix while the IMU recorded; accepted is at least one")
    return np.asarray(rows)


def _find_rests(
    imu: Imu, fixes: Fixes, assumed: Belief, navigator: NavigatorSettings, given: NDArray[np.bool_]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the masks of the samples at rest and at zero velocity, from the given fixes; empty if unused."""
    if not needs_rest(navigator) or not given.any():
        return NO_REST, NO_REST
    fixes, assumed = Fixes(*(values[given] for values in fixes)), assumed._replace(R=assumed.R[given])
    rest = at_rest(imu, fixes, assumed)
    if not navigator.zero_velocity:
        return rest, rest
    standing, _ = standing_still(rest, imu, fixes, assumed)
    return rest, standing


def _check(navigator: NavigatorSettings) -> None:
    """Refuse settings that cannot be applied to a log."""
    check_mechanization(navigator)
    if navigator.engine != "compiled":
        raise SettingError(
            "navigator.engine: the reference in filterpy cannot handle gaps of the IMU or unmeasured "
            "velocities, so it cannot navigate a sensor log; accepted is compiled"
        )


def _hints(log: SensorLog, navigator: NavigatorSettings) -> Hints:
    """Return the hints of log and settings about vehicle and heading."""
    return Hints.of(
        log.auxiliary,
        navigator.vehicle,
        navigator.initial_heading,
        navigator.initial_heading_uncertainty,
        log.gnss.velocity_n,
    )


def _first_sample(log: SensorLog, times: FloatArray) -> int:
    """Return the first sample from which the position is known."""
    first = int(np.searchsorted(log.time, times[0] - _ROUNDING))
    if log.time.size - first < _MIN_SAMPLES or times.size < _MIN_FIXES:
        raise MissionError(
            f"{log.name}: the fixes begin after the end of the IMU data; accepted are fixes and IMU data of "
            "the same time"
        )
    return first


def used_fixes(
    gnss: GnssLog, assumed: Belief, navigator: NavigatorSettings
) -> tuple[GnssLog, FloatArray, FloatArray]:
    """Return the fixes as the filter uses them, their covariances (m, 6, 6), and the diagonals (m, 6).

    A component of the velocity that the receiver does not measure is replaced by the difference of the
    positions, with the σ `UNKNOWN`.

    Parameters
    ----------
    gnss
        At least two fixes.
    assumed
        The filter's assumptions, with the covariance of a fix that has no σ.
    navigator
        The filter; an R given there takes the place of the receiver's own σ.
    """
    sigma = np.concatenate((gnss.position_sigma, gnss.velocity_sigma), axis=1)
    R = np.broadcast_to(assumed.R, (gnss.time.size, 6, 6)).copy()
    if navigator.r is None:
        own = np.isfinite(sigma)
        at = np.arange(6)
        R[:, at, at] = np.where(own, r_factors(navigator) * sigma**2, R[:, at, at])
    unknown = np.isnan(gnss.velocity_n)
    for axis in range(3):
        rows = unknown[:, axis]
        # Correlated with a component that is not measured, the others would be wrong.
        R[rows, 3 + axis, :] = 0.0
        R[rows, :, 3 + axis] = 0.0
        R[rows, 3 + axis, 3 + axis] = UNKNOWN**2
    velocity = np.where(unknown, velocity_of_positions(gnss.time, gnss.position), gnss.velocity_n)
    known = replace(gnss, velocity_n=velocity)
    return known, R, np.diagonal(R, axis1=1, axis2=2).copy()


def _solution(
    imu: Imu,
    fixes: Fixes,
    log: SensorLog,
    start: Start,
    assumed: Belief,
    navigator: NavigatorSettings,
    measured: NDArray[np.int64],
    given: NDArray[np.bool_],
    aids: Aids = NO_AIDS,
    names: tuple[str, ...] = (),
) -> Solution:
    """Navigate, and smooth if set; withheld fixes have no effect."""
    schedule = schedule_filter(navigator, imu.step, imu.dtheta.shape[0])
    check_smoother(navigator, schedule)
    stretches = _stretches(imu, fixes, log, assumed, navigator, measured)
    if not fixes.time.size:
        assumed = assumed._replace(R=np.eye(6))
    if not given.all():
        assumed = assumed._replace(R=assumed.R + WITHHELD**2 * np.eye(MEASUREMENTS) * ~given[:, None, None])
    arguments = (_make_read_only_views(imu), _make_read_only_views(fixes), start, assumed, schedule)
    try:
        if navigator.model == "nonlinear":
            solution = unscented.navigate(*arguments, stretches, aids, names)
        else:
            engine = smoother.navigate if navigator.smoother else linear.navigate
            model = with_blocks(linear_model(navigator.model, navigator.mechanization), names)
            solution = engine(*arguments, model, stretches, aids)
    except SettingError:
        raise
    except ValueError as error:  # functions of `math` stop at values that are not finite
        raise divergence_error("the filter cannot go on", error) from error
    check_finite(solution, imu.time)
    check_place(solution, log.gnss.position[:, 0])
    return solution


def _make_read_only_views(arrays: Arrays) -> Arrays:
    """Return read-only views like the arrays of a simulated flight, for which the code is compiled."""
    views = {name: np.ascontiguousarray(values).view() for name, values in arrays._asdict().items()}
    for view in views.values():
        view.setflags(write=False)
    return type(arrays)(**views)


def _stretches(
    imu: Imu,
    fixes: Fixes,
    log: SensorLog,
    assumed: Belief,
    navigator: NavigatorSettings,
    measured: NDArray[np.int64],
) -> list[Stretch]:
    """Return the stretches of a log, each with one number of measurements and in a gap or not."""
    sample = np.searchsorted(imu.time, fixes.time - _ROUNDING)  # sample after which each fix is used
    gaps = np.clip(np.searchsorted(imu.time, log.gaps), 0, imu.time.size - 1)
    changes = sample[:-1][np.diff(measured) != 0]
    ends = {imu.time.size - 1, *gaps.ravel().tolist(), *changes.tolist()} - {0}
    noises = np.pad(assumed.gaps[:, 2:], ((0, 0), (0, assumed.noise.size - 6)))
    stretches, done = [], 0
    for end in sorted(ends):
        fix = min(int(np.searchsorted(sample, done, side="right")), fixes.time.size - 1)
        count = int(measured[fix]) if fixes.time.size else MEASUREMENTS
        within_gap = np.flatnonzero((gaps[:, 0] <= done) & (end <= gaps[:, 1]))
        noise = assumed.noise + noises[int(within_gap[-1])] if within_gap.size else assumed.noise
        stretches.append(Stretch(end, gate(navigator.gate, count), implausible(navigator, count), noise))
        done = end
    return stretches


def gap_noise(imu: Imu, start: float, end: float) -> FloatArray:
    """Return the densities (6,) of the unknown motion in a filled gap [rad²/s], [m²/s³].

    The rates in the gap are taken to be wrong by their spread about it. An error that lasts for the whole gap
    has the density variance times length; a shorter one has less.

    Parameters
    ----------
    imu
        The increments, with those that fill the gap.
    start, end
        The gap [s].
    """
    edges = np.array([start - AROUND - _ROUNDING, end + AROUND + _ROUNDING])
    first, last = np.searchsorted(imu.time, edges)
    last = min(max(last, 2), imu.time.size)
    first = min(first, last - 2)
    dt = np.diff(imu.time[first:last])[:, None]
    spread = [(part[first : last - 1] / dt).var(axis=0) for part in (imu.dtheta, imu.dvelocity)]
    # A rate of unknown σ turns by σ T in the gap, and white noise of density σ² T has as much variance there.
    return np.asarray(np.concatenate(spread) * (end - start))


def start_fixes(fixes: Fixes, measured: FloatArray, variances: FloatArray) -> tuple[Fixes, FloatArray]:
    """Return the fixes with which the start is found, and the σ (k, 3) of their velocities [m/s].

    If no fix has a measured velocity, they are those about a second apart, with the velocities of their
    positions; otherwise all.

    Parameters
    ----------
    fixes
        The fixes, with the velocities that the filter uses.
    measured : (m, 3) array
        The measured velocities; NaN if unmeasured [m/s].
    variances : (m, 6) array
        Variances of position and velocity that the filter uses [m²], [(m/s)²].
    """
    unknown, sigma = np.isnan(measured), np.sqrt(variances)
    if unknown[:, :2].all():
        rows = np.flatnonzero(np.diff(np.floor((fixes.time - fixes.time[0]) / _APART), prepend=-1.0))
        if rows.size > 1:
            time, position = fixes.time[rows], fixes.position[rows]
            velocity = velocity_of_positions(time, position)
            velocity[:, 2] = fixes.velocity_n[rows, 2]
            fixes, unknown, sigma = Fixes(time, position, velocity), unknown[rows], sigma[rows]
    over = np.diff(fixes.time, append=fixes.time[-1]) + np.diff(fixes.time, prepend=fixes.time[0])
    unknown[:, 2] = False  # a vertical velocity is not derived from positions
    with np.errstate(divide="ignore"):
        derived = np.sqrt(2) * sigma[:, :3] / over[:, None]
    return fixes, np.where(unknown, derived, sigma[:, 3:])
