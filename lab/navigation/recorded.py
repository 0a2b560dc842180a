"""Recorded: the navigator over a log of real sensors: each fix with its own σ, at its own time, of the IMU.

The filter is handed the log piece by piece, wherever something of it changes: the covariance of the fixes, a
gap of the IMU, and with a lever arm each fix, which is brought from the antenna to the IMU with the attitude
and rate the navigator has there. It is the very filter of the simulated flights. The biases found at the
start are no part of what its settings describe, so that they do not fade: they walk.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab import earth
from lab.ecef import near_pole
from lab.missions.errors import MissionError
from lab.missions.log_pieces import piece
from lab.missions.sensor_log import GnssLog, SensorLog
from lab.navigation import navigator as linear
from lab.navigation import strapdown, unscented
from lab.navigation.alignment import Alignment, align
from lab.navigation.belief import belief, schedule_of
from lab.navigation.checks import check_finite, check_mechanization, check_r, check_smoother, diverged
from lab.navigation.choice import chosen_model
from lab.navigation.error_models import ATT, GYRO_BIAS, POS, VEL
from lab.navigation.initial_heading import Hints
from lab.navigation.kalman import gate
from lab.navigation.navigator import PolarError
from lab.navigation.settings import NavigatorSettings
from lab.navigation.smoother import smooth
from lab.navigation.solution import Belief, Fixes, Imu, Schedule, Solution, Start
from lab.sensors.gps import within
from lab.sensors.suite import SensorSuite
from lab.settings import SettingError

FloatArray = NDArray[np.float64]
Arrays = TypeVar("Arrays", Imu, Fixes)
Advance = Callable[[Imu, Fixes, Solution, int, Schedule], int]

UNKNOWN = 1e4
"""σ of a velocity the receiver does not have, which makes it count for nothing [m/s]."""
NO_VERTICAL_SIGMA = 1.0
"""σ of the initial vertical velocity without any measured [m/s]."""

_ROUNDING = 1e-6  # of time stamps [s]


class RecordedRun(NamedTuple):
    """What a navigator made of a log.

    Attributes
    ----------
    imu : Imu
        What it was given, from the first fix on; times of the log [s].
    fixes : Fixes
        The fixes as they were used: at their time of validity, of the IMU.
    belief : Belief
        What the filter assumed, with an R for each fix.
    alignment : Alignment
        Where it started.
    solution : Solution
        The solution at the times of `imu`; innovations are NaN where the receiver measures nothing.
    remarks : tuple of str
        What was repaired and assumed, for people.
    """

    imu: Imu
    fixes: Fixes
    belief: Belief
    alignment: Alignment
    solution: Solution
    remarks: tuple[str, ...]


class _Piece(NamedTuple):
    """Samples the filter goes through in one go, up to number `end`; its fixes begin with number `fix`."""

    end: int
    fix: int
    in_gap: bool


def navigate_log(
    log: SensorLog,
    sensors: SensorSuite,
    navigator: NavigatorSettings,
    outages: Sequence[tuple[float, float]] = (),
) -> RecordedRun:
    """Navigate a log of real sensors.

    >>> from lab.missions import read_sensor_log
    >>> run = navigate_log(read_sensor_log("drive"), SensorSuite(), NavigatorSettings())

    Parameters
    ----------
    log
        The log.
    sensors
        What the filter assumes of the sensors: their noise and biases, and the variances of a fix where the
        log gives none.
    navigator
        The filter. An R given there takes the place of the log's own σ; P0 is that of the start found in the
        log, unless given.
    outages
        Stretches of time [s] of which the filter gets no fix.

    Raises
    ------
    MissionError
        If there are too few fixes while the IMU recorded.
    SettingError
        If the settings do not go together, or cannot be applied to a log.
    ValueError
        If the solution diverges beyond all numbers, or comes too close to a pole.
    """
    log = piece(log)
    _check(log, navigator)
    assumed = belief(sensors, navigator)
    check_r(assumed.R)
    times = log.gnss.time - log.gnss.latency
    first = _first_sample(log, times)
    imu = Imu(log.time[first:], log.dtheta[first:], log.dvelocity[first:])
    gnss, R, variances = _measurements(log, assumed, navigator)
    fixes = Fixes(times, gnss.position, gnss.velocity_n)
    start = align(imu, fixes, np.sqrt(variances[:, 3:]), _hints(log, navigator))
    # The last fix before the start gave the start.
    rows = (times > imu.time[0] + _ROUNDING) & (times <= imu.time[-1])
    if not rows.any():
        raise MissionError(f"{log.name}: no fix while the IMU recorded; accepted is at least one")
    rows &= ~within(outages, times)
    assumed = assumed._replace(
        P0=_initial(assumed, navigator, start, variances[0]),
        R=R[rows],
        bias_decay=np.zeros_like(assumed.bias_decay),
    )
    fixes = Fixes(*(values[rows].copy() for values in fixes))
    missing = np.append(np.zeros((int(rows.sum()), 3), bool), np.isnan(log.gnss.velocity_n[rows]), axis=1)
    solution = _solution(imu, fixes, log, start, assumed, navigator, missing)
    solution.innovation[missing] = np.nan
    return RecordedRun(imu, fixes, assumed, start, solution, (*log.repairs, start.remark))


def _check(log: SensorLog, navigator: NavigatorSettings) -> None:
    """Refuse settings that cannot be applied to a log."""
    check_mechanization(navigator)
    check_smoother(navigator)
    if navigator.engine != "compiled":
        raise SettingError(
            "navigator.engine: the reference in filterpy takes one R for all fixes and knows no lever arm: "
            "it cannot navigate a log of real sensors; accepted is compiled"
        )
    if navigator.smoother and log.gaps.size:
        raise SettingError(
            f"navigator.smoother: cannot smooth over gaps of the IMU, of which {log.name} has "
            f"{len(log.gaps)}; accepted is false"
        )


def _hints(log: SensorLog, navigator: NavigatorSettings) -> Hints:
    """Return what log and settings say of vehicle and heading."""
    return Hints.of(
        log.beside, navigator.vehicle, navigator.initial_heading, navigator.initial_heading_uncertainty
    )


def _first_sample(log: SensorLog, times: FloatArray) -> int:
    """Return the first sample from which the position is known."""
    first = int(np.searchsorted(log.time, times[0] - _ROUNDING))
    if log.time.size - first < 3 or times.size < 2:
        raise MissionError(f"{log.name}: the fixes begin after the IMU ended; accepted are both together")
    return first


def _measurements(
    log: SensorLog, assumed: Belief, navigator: NavigatorSettings
) -> tuple[GnssLog, FloatArray, FloatArray]:
    """Return the fixes without NaN, their covariances (m, 6, 6), and the diagonals of these (m, 6)."""
    gnss = log.gnss
    sigma = np.concatenate((gnss.position_sigma, gnss.velocity_sigma), axis=1)
    R = np.broadcast_to(assumed.R, (gnss.time.size, 6, 6)).copy()
    if navigator.r is None:
        own = np.isfinite(sigma)
        at = np.arange(6)
        R[:, at, at] = np.where(own, navigator.r_scale * sigma**2, R[:, at, at])
    unknown = np.isnan(gnss.velocity_n)
    for axis in range(3):
        rows = unknown[:, axis]
        R[rows, 3 + axis, :] = 0.0
        R[rows, :, 3 + axis] = 0.0
        R[rows, 3 + axis, 3 + axis] = UNKNOWN**2
    known = GnssLog(
        gnss.time,
        gnss.position,
        np.where(unknown, _velocity_of_positions(gnss), gnss.velocity_n),
        gnss.position_sigma,
        gnss.velocity_sigma,
        gnss.lever_arm,
        gnss.latency,
    )
    return known, R, np.diagonal(R, axis1=1, axis2=2).copy()


def _velocity_of_positions(gnss: GnssLog) -> FloatArray:
    """Return the velocity (m, 3) north, east, down by differences of the positions; down as zero [m/s]."""
    latitude, longitude = gnss.position[:, 0], np.unwrap(gnss.position[:, 1])
    meridian, transverse = earth.radii(np.sin(latitude))
    north = np.gradient(latitude, gnss.time) * meridian
    east = np.gradient(longitude, gnss.time) * transverse * np.cos(latitude)
    return np.stack((north, east, np.zeros_like(north)), axis=-1)


def _initial(
    assumed: Belief, navigator: NavigatorSettings, start: Alignment, variances: FloatArray
) -> FloatArray:
    """Return the covariance of the start that was found, or that of the settings where given."""
    if navigator.p0 is not None:
        return assumed.P0
    variance = np.diag(assumed.P0).copy()
    variance[POS] = navigator.p0_scale * variances[:3]
    variance[VEL] = navigator.p0_scale * np.minimum(variances[3:], NO_VERTICAL_SIGMA**2)
    variance[ATT] = navigator.p0_scale * start.attitude_sigma**2
    gyro = navigator.p0_scale * start.gyro_bias_sigma**2
    variance[GYRO_BIAS] = gyro if start.rest else np.maximum(variance[GYRO_BIAS], gyro)
    return np.diag(variance)


def _solution(
    imu: Imu,
    fixes: Fixes,
    log: SensorLog,
    alignment: Alignment,
    assumed: Belief,
    navigator: NavigatorSettings,
    missing: NDArray[np.bool_],
) -> Solution:
    """Navigate, and smooth where asked for; `fixes` are brought to the IMU in place."""
    usual = float(np.median(np.diff(imu.time)))
    schedule = schedule_of(navigator, usual, imu.dtheta.shape[0])
    try:
        solution = _run(imu, fixes, log, alignment, assumed, navigator, missing, schedule)
    except PolarError as error:
        if near_pole(log.gnss.position[:, 0]).any():
            raise
        raise diverged(
            "the estimate ran off to a pole, which the vehicle did not come near", error
        ) from error
    check_finite(solution, imu.time)
    return smooth(imu, solution, assumed) if navigator.smoother else solution


def _run(
    imu: Imu,
    fixes: Fixes,
    log: SensorLog,
    alignment: Alignment,
    assumed: Belief,
    navigator: NavigatorSettings,
    missing: NDArray[np.bool_],
    schedule: Schedule,
) -> Solution:
    """Advance the filter from piece to piece."""
    solution = Solution.empty(imu.time.size, fixes.time.size, assumed.P0.shape[0])
    R = assumed.R if fixes.time.size else np.eye(6)[None]
    begun = assumed._replace(R=R[0].copy(), noise=assumed.noise.copy())
    run, advance = _begin(alignment.start, begun, float(imu.time[0]), navigator, schedule)
    run.state[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 3] = alignment.gyro_bias
    # A fix with a lever arm just after the start looks there.
    solution.q_nb[0], solution.bias[0] = alignment.start.q_nb, np.append(alignment.gyro_bias, np.zeros(3))
    # A copy: SciPy's rotations refuse arrays that are read-only, as those of a kept log are.
    gap_noise, arm = _gap_noise(imu, log), log.gnss.lever_arm.copy()
    measured = 6 - missing.sum(axis=1)
    done = 0
    for end, fix, in_gap in _pieces(imu, fixes, log, R, measured):
        run.noise[:6] = assumed.noise[:6] + gap_noise * in_gap
        if fix < fixes.time.size:
            run.R[:] = R[fix]
            if isinstance(run, linear.Filter):
                run.R_root[:] = np.linalg.cholesky(R[fix])
            schedule = schedule._replace(gate=gate(navigator.gate, int(measured[fix])))
            seen = int(np.searchsorted(fixes.time, imu.time[end] + _ROUNDING, side="right"))
            if arm.any() and seen > fix:
                _bring_to_imu(fixes, slice(fix, seen), solution, imu, end - 1, arm)
        piece = _shown(Imu(imu.time[: end + 1], imu.dtheta[:end], imu.dvelocity[:end]))
        written = advance(piece, _shown(fixes), solution, done, schedule)
        if written < end + 1:
            raise PolarError(f"{log.name}: the navigator came closer than 0.1° to a pole")
        done = end
    return solution


def _shown(arrays: Arrays) -> Arrays:
    """Return read-only views, as a simulated flight's arrays are: the code is compiled for these."""
    views = [values.view() for values in arrays]
    for view in views:
        view.setflags(write=False)
    return type(arrays)(*views)


def _begin(
    start: Start, assumed: Belief, time: float, navigator: NavigatorSettings, schedule: Schedule
) -> tuple[linear.Filter | unscented.Filter, Advance]:
    """Return a filter of a model at its start, and what takes it onwards."""
    if navigator.model == "nonlinear":
        unscented.check(schedule)
        points = unscented.Filter.begin(start, assumed)
        return points, lambda *piece: unscented.advance(points, *piece)
    model = chosen_model(navigator)
    run = linear.Filter.begin(start, assumed, time, model)

    def onwards(imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule) -> int:
        return linear.advance(run, imu, fixes, out, first, schedule, model)

    return run, onwards


def _pieces(
    imu: Imu, fixes: Fixes, log: SensorLog, R: FloatArray, measured: NDArray[np.int64]
) -> Iterator[_Piece]:
    """Yield the pieces of a log, each with one R, one number of measurements, and in a gap or not."""
    sample = np.searchsorted(imu.time, fixes.time - _ROUNDING)  # after which each fix is used
    gaps = np.clip(np.searchsorted(imu.time, log.gaps), 0, imu.time.size - 1)
    last = imu.time.size - 1
    ends = {last, *gaps.ravel().tolist()}
    if log.gnss.lever_arm.any():
        # The navigator stands at the sample before, whose attitude brings the fix to the IMU.
        ends |= {*sample.tolist(), *(sample - 1).tolist()}
    else:
        changes = (np.diff(R, axis=0) != 0).any(axis=(1, 2)) | (np.diff(measured) != 0)
        ends |= set(sample[:-1][changes].tolist())
    done = 0
    for end in sorted(ends - {0}):
        fix = int(np.searchsorted(sample, done, side="right"))
        yield _Piece(end, fix, bool(((gaps[:, 0] <= done) & (end <= gaps[:, 1])).any()))
        done = end


def _bring_to_imu(
    fixes: Fixes, rows: slice, solution: Solution, imu: Imu, before: int, lever_arm: FloatArray
) -> None:
    """Take the lever arm off fixes, with the attitude at the sample before them and the gyros' rate since."""
    rate = imu.dtheta[before] / (imu.time[before + 1] - imu.time[before]) - solution.bias[before, :3]
    turned = rate * (fixes.time[rows, None] - imu.time[before])
    C_nb = Rotation.from_quat(solution.q_nb[before], scalar_first=True) * Rotation.from_rotvec(turned)
    north, east, down = C_nb.apply(lever_arm).T
    latitude, _, height = fixes.position[rows].T
    meridian, transverse = earth.radii(np.sin(latitude))
    fixes.position[rows, 0] -= north / (meridian + height)
    fixes.position[rows, 1] -= east / ((transverse + height) * np.cos(latitude))
    fixes.position[rows, 2] += down
    fixes.velocity_n[rows] -= C_nb.apply(np.cross(rate, lever_arm))


def _gap_noise(imu: Imu, log: SensorLog) -> FloatArray:
    """Return the densities (6,) of what is not known in a gap: the spread of the rates for its length."""
    if not log.gaps.size:
        return np.zeros(6)
    dt = np.diff(imu.time)[:, None]
    spread = np.concatenate(((imu.dtheta / dt).var(axis=0), (imu.dvelocity / dt).var(axis=0)))
    return np.asarray(spread * np.diff(log.gaps, axis=1).max())
