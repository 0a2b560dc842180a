"""Recorded: the navigator over a log of real sensors: each fix with its own σ, at its own time, of the IMU.

The filter is handed the log piece by piece, from fix to fix: before each piece the next fix is brought from
the antenna to the IMU with the navigator's attitude and rate, and its covariance set. It is the very filter
of the simulated flights.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab import earth
from lab.missions.errors import MissionError
from lab.missions.sensor_log import GnssLog, SensorLog
from lab.navigation import strapdown
from lab.navigation.alignment import Alignment, align
from lab.navigation.belief import belief
from lab.navigation.error_models import ATT, GYRO_BIAS, PHI, POS, VEL, with_states
from lab.navigation.navigator import Filter, advance
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Belief, Fixes, Imu, Schedule, Solution
from lab.sensors.suite import SensorSuite

FloatArray = NDArray[np.float64]

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
        What the filter assumed; R is that of the settings, which stands in where the log gives no σ.
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


def navigate_log(log: SensorLog, sensors: SensorSuite, navigator: NavigatorSettings) -> RecordedRun:
    """Navigate a log of real sensors with the linear filter `phi`, corrected at each fix.

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
        Scales and matrices of the filter. An R given there takes the place of the log's own σ; P0 is that of
        the start found in the log, unless given.

    Raises
    ------
    MissionError
        If there are too few fixes while the IMU recorded.
    ValueError
        If the solution diverges beyond all numbers, or comes too close to a pole.
    """
    assumed = belief(sensors, navigator)
    times = log.gnss.time - log.gnss.latency
    first = _first_sample(log, times)
    imu = Imu(log.time[first:], log.dtheta[first:], log.dvelocity[first:])
    gnss, R, variances = _measurements(log, assumed, navigator)
    fixes = Fixes(times, gnss.position, gnss.velocity_n)
    start = align(imu, fixes, np.sqrt(variances[:, 3:]))
    assumed = assumed._replace(P0=_initial(assumed, navigator, start, variances[0]))
    # The last fix before the start gave the start.
    rows = (times > imu.time[0] + _ROUNDING) & (times <= imu.time[-1])
    if not rows.any():
        raise MissionError(f"{log.name}: no fix while the IMU recorded; accepted is at least one")
    fixes = Fixes(*(values[rows].copy() for values in fixes))
    solution = _run(imu, fixes, R[rows], log, start, assumed)
    if not np.isfinite(solution.position[-1]).all() or not (solution.variance >= 0).all():
        raise ValueError(f"{log.name}: the navigation solution diverged beyond all numbers")
    missing = np.append(np.zeros((int(rows.sum()), 3), bool), np.isnan(log.gnss.velocity_n[rows]), axis=1)
    solution.innovation[missing] = np.nan
    return RecordedRun(imu, fixes, assumed, start, solution, (*log.repairs, start.remark))


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


def _run(
    imu: Imu, fixes: Fixes, R: FloatArray, log: SensorLog, alignment: Alignment, assumed: Belief
) -> Solution:
    """Advance the filter from fix to fix and from gap to gap; `fixes` are brought to the IMU in place."""
    model = with_states(PHI, assumed.P0.shape[0])
    solution = Solution.empty(imu.time.size, fixes.time.size, model.states)
    begun = assumed._replace(R=R[0].copy(), noise=assumed.noise.copy())
    run = Filter.begin(alignment.start, begun, float(imu.time[0]), model)
    run.state[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 3] = alignment.gyro_bias
    gap_noise = _gap_noise(imu, log)
    ends = {
        int(k): m for m, k in reversed(list(enumerate(np.searchsorted(imu.time, fixes.time - _ROUNDING))))
    }
    gaps = np.searchsorted(imu.time, log.gaps)
    stops = sorted({*ends, *gaps.ravel().tolist(), imu.time.size - 1} - {0})
    done = 0
    for stop in stops:
        inside = ((gaps[:, 0] <= done) & (stop <= gaps[:, 1])).any()
        run.noise[:] = assumed.noise
        if inside:
            run.noise[:6] += gap_noise
        if stop in ends:
            fix = ends[stop]
            run.R[:] = R[fix]
            run.R_root[:] = np.linalg.cholesky(R[fix])
            _bring_to_imu(fixes, fix, run.state, imu, done, log.gnss.lever_arm)
        piece = Imu(imu.time[: stop + 1], imu.dtheta[:stop], imu.dvelocity[:stop])
        written = advance(run, piece, fixes, solution, done, Schedule(), model)
        if written < stop + 1:
            raise ValueError(f"{log.name}: the navigator came closer than 0.1° to a pole")
        done = stop
    return solution


def _bring_to_imu(
    fixes: Fixes, fix: int, state: FloatArray, imu: Imu, sample: int, lever_arm: FloatArray
) -> None:
    """Take the lever arm off a fix, with the attitude and rate of the navigator shortly before."""
    if not lever_arm.any():
        return
    C_nb = Rotation.from_quat(state[strapdown.Q_NB : strapdown.Q_NB + 4], scalar_first=True)
    # The navigator stands at the fix before: the gyros carry its attitude on.
    last = int(np.searchsorted(imu.time, fixes.time[fix]))
    bias = state[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 3]
    for increment, dt in zip(imu.dtheta[sample:last], np.diff(imu.time[sample : last + 1]), strict=True):
        C_nb = C_nb * Rotation.from_rotvec(increment - bias * dt)
    row = max(last - 1, 0)
    rate = imu.dtheta[row] / (imu.time[row + 1] - imu.time[row]) - bias
    arm, swing = C_nb.apply(lever_arm), C_nb.apply(np.cross(rate, lever_arm))
    latitude, _, height = fixes.position[fix]
    meridian, transverse = earth.radii(float(np.sin(latitude)))
    fixes.position[fix] -= (
        arm[0] / (meridian + height),
        arm[1] / ((transverse + height) * np.cos(latitude)),
        -arm[2],
    )
    fixes.velocity_n[fix] -= swing


def _gap_noise(imu: Imu, log: SensorLog) -> FloatArray:
    """Return the densities (6,) of what is not known in a gap: the spread of the rates for its length."""
    if not log.gaps.size:
        return np.zeros(6)
    dt = np.diff(imu.time)[:, None]
    spread = np.concatenate(((imu.dtheta / dt).var(axis=0), (imu.dvelocity / dt).var(axis=0)))
    return np.asarray(spread * np.diff(log.gaps, axis=1).max())
