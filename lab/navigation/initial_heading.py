"""Initial heading: what a log shows of the heading at its first sample, each with its σ.

A given heading is taken as it is. Otherwise the surest of these: headings measured with two antennas, the
course of a vehicle that goes where its nose points, the velocities matched with the specific force (any
vehicle, `lab.logs.velocity_matching`), and a magnetometer. Where two contradict each other, σ is their
difference. P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*,
2nd ed., ch. 5.6, 6.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.logs.auxiliary_data import AuxiliaryData, Headings, Magnetometer
from lab.logs.vehicle import Vehicle, vehicle_of
from lab.logs.velocity_matching import GYRO_BIAS_SIGMA, WINDOW, Match, lively, match, steps, turned, window_of
from lab.navigation.solution import Fixes, Imu
from lab.rotation import wrap

FloatArray = NDArray[np.float64]

COURSE_SPEED = 1.0
"""A vehicle faster than this, and than `COURSE_SIGMAS`, has a course [m/s]."""
COURSE_SIGMAS = 3
"""The same in σ of its speed: the course is then known within 1/3 rad."""
MAGNETIC_SIGMA = np.radians(10.0)
"""σ of a magnetometer's heading: iron and currents of the vehicle, calibrated once [rad]."""
ANTENNA_SIGMA = np.radians(2.0)
"""σ of a heading by two antennas that come without σ: 1 cm over 0.3 m [rad]."""

_COURSE = "from the course"
_ROUNDING = 1e-6  # of time stamps [s]
_BEFORE = 1.0  # how old a heading or a field may be at the first sample of the IMU [s]
_BIAS_AT_REST = np.radians(0.1)
"""σ of a gyro bias taken at rest, before a match [rad/s]: noise and temperature, five times the drift."""
_MATCH_SIGMA = np.radians(2.0)  # what the model of the match leaves out
_SURE = np.radians(6.0)  # no further windows are looked at
_WORTH = np.radians(30.0)
"""σ up to which a heading found by a match is used [rad]."""
_MISFIT = 9.0
"""Mean square residual, in σ, up to which a match is believed: residuals of three σ."""
_MOST_WINDOWS = 8
"""Most windows that are matched."""
_WITHIN = 1800.0  # of the start: further on gyros carry nothing back [s]
_DRIFT_AT_REST = np.radians(0.02)
"""Drift of a heading that gyros carry back, after their bias was taken at rest [rad/s]."""
_DRIFT = np.radians(1.0)
"""The same of a bias that nobody knows [rad/s]."""
_CONTRADICTION = 3.5
"""Difference of two headings, in σ, from which they contradict each other."""
_DECLINATION_YEAR = 2025.0  # declination drifts by 0.1-0.2° a year, far below the σ
_MODEL_HEIGHTS = (-1.0, 850.0)  # heights for which the World Magnetic Model is made [km]
_WEAK = 6.0  # horizontal field [µT] below which compasses are not to be trusted (World Magnetic Model 2025)


class Hints(NamedTuple):
    """What is known of the heading beside IMU and fixes.

    Attributes
    ----------
    vehicle : Vehicle
        What carries the sensors.
    given, given_sigma : float
        Heading at the first sample and its σ; NaN if none is given [rad].
    headings : Headings or None
        Headings as measured.
    magnetometer : Magnetometer or None
        The magnetometer.
    """

    vehicle: Vehicle = vehicle_of("")
    given: float = np.nan
    given_sigma: float = np.nan
    headings: Headings | None = None
    magnetometer: Magnetometer | None = None

    @classmethod
    def of(cls, beside: AuxiliaryData, vehicle: str, heading: float | None, heading_sigma: float) -> Hints:
        """Return the hints of a log and of settings, which rule.

        Parameters
        ----------
        beside
            What the log holds.
        vehicle
            Vehicle of the settings, or "auto".
        heading, heading_sigma
            Heading of the settings and its σ [°]; None if it is to be found.
        """
        return cls(
            vehicle_of(beside.vehicle if vehicle == "auto" else vehicle),
            np.nan if heading is None else float(np.radians(heading)),
            float(np.radians(heading_sigma)),
            beside.headings,
            beside.magnetometer,
        )


class Found(NamedTuple):
    """A heading at the first sample.

    Attributes
    ----------
    heading, sigma : float
        Heading and its σ [rad].
    source : str
        Where it comes from, for people.
    time : float
        When it was seen [s]; NaN if nothing showed it.
    gyro_bias, gyro_bias_sigma : (3,) arrays or None
        Gyro bias that was found with it [rad/s].
    late, late_sigma : float
        By how much the fixes' stamps are late, as found with it, and its σ [s]; NaN where it was not.
    """

    heading: float
    sigma: float
    source: str
    time: float
    gyro_bias: FloatArray | None = None
    gyro_bias_sigma: FloatArray | None = None
    late: float = np.nan
    late_sigma: float = np.nan

    @property
    def is_course(self) -> bool:
        """Whether the heading is the course."""
        return self.source.startswith(_COURSE)


UNKNOWN = Found(0.0, np.pi, "", np.nan)
"""The heading where nothing shows it."""


def surest(found: Sequence[Found]) -> Found:
    """Return the surest of several headings, with a σ and a source that tell of a contradiction."""
    known = sorted((one for one in found if one.sigma < np.pi), key=lambda one: one.sigma)
    if not known:
        return UNKNOWN
    best = known[0]
    for other in known[1:]:
        apart = abs(float(wrap(other.heading - best.heading)))
        if apart > _CONTRADICTION * np.hypot(best.sigma, other.sigma):
            return best._replace(
                sigma=min(np.pi, max(best.sigma, apart)),
                source=f"{best.source} (but by {np.degrees(apart):.0f}° another one {other.source})",
            )
    return best


def shows_course(fixes: Fixes, velocity_sigma: FloatArray) -> NDArray[np.bool_]:
    """Return which fixes are fast enough for their course to be known."""
    speed = np.linalg.norm(fixes.velocity_n[:, :2], axis=1)
    slowest = np.maximum(COURSE_SPEED, COURSE_SIGMAS * np.linalg.norm(velocity_sigma[:, :2], axis=1))
    return np.asarray(speed > slowest)


def by_course(
    imu: Imu, fixes: Fixes, velocity_sigma: FloatArray, turning: FloatArray, rest: float, vehicle: Vehicle
) -> Found:
    """Return the heading by the course of the first motion that lasts, carried back by the gyros.

    Parameters
    ----------
    imu, fixes
        The measurements.
    velocity_sigma : (m, 3) array
        σ of the velocities [m/s].
    turning : (n + 1,) array
        Angle turned about the vertical since the first sample [rad].
    rest
        How long the vehicle was at rest at the start [s].
    vehicle
        How far its course may be off its heading.
    """
    speed = np.linalg.norm(fixes.velocity_n[:, :2], axis=1)
    sigma = np.linalg.norm(velocity_sigma[:, :2], axis=1)
    fast = shows_course(fixes, velocity_sigma) & (fixes.time >= imu.time[0] - _ROUNDING)
    lasting = fast & np.append(fast[1:], False)
    if not lasting.any() or np.isinf(vehicle.sideslip):
        return UNKNOWN
    first = int(np.argmax(lasting))
    time = float(fixes.time[first])
    course = np.arctan2(fixes.velocity_n[first, 1], fixes.velocity_n[first, 0])
    drift = _drift(rest) * (time - imu.time[0])
    return Found(
        float(wrap(course - np.interp(time, imu.time, turning))),
        float(min(np.pi, np.sqrt(vehicle.sideslip**2 + (sigma[first] / speed[first]) ** 2 + drift**2))),
        f"{_COURSE} at {time:.1f} s",
        time,
    )


def by_antennas(imu: Imu, headings: Headings | None, turning: FloatArray, rest: float) -> Found:
    """Return the heading by two antennas, of the first time in the log, carried back by the gyros."""
    if headings is None:
        return UNKNOWN
    rows = np.flatnonzero((headings.time >= imu.time[0] - _BEFORE) & (headings.time <= imu.time[-1]))
    if not rows.size:
        return UNKNOWN
    first = int(rows[0])
    time = float(headings.time[first])
    own = headings.sigma[first] if np.isfinite(headings.sigma[first]) else ANTENNA_SIGMA
    drift = _drift(rest) * abs(time - imu.time[0])
    heading = float(wrap(headings.heading[first] - np.interp(time, imu.time, turning)))
    return Found(heading, float(min(np.pi, np.hypot(own, drift))), f"by two antennas at {time:.1f} s", time)


def by_velocity(imu: Imu, fixes: Fixes, velocity_sigma: FloatArray, bias: FloatArray, rest: float) -> Found:
    """Return the heading that makes specific force and velocities agree, whatever the vehicle."""
    log = (imu.time, imu.dtheta, imu.dvelocity, fixes.time, fixes.velocity_n, velocity_sigma)
    spread = _BIAS_AT_REST if rest else GYRO_BIAS_SIGMA
    best: tuple[float, float, Match] | None = None
    starts = [start for _, start in lively(log) if start - imu.time[0] < _WITHIN]
    for start in starts[:_MOST_WINDOWS]:
        window = window_of(log, start)
        if window is None:
            continue
        found = match(window, bias, spread, lags=(0.0,))
        drift = (_drift(rest) if rest else float(min(_DRIFT, found.gyro_bias_sigma[2]))) * (
            start - imu.time[0]
        )
        sigma = float(np.sqrt(found.heading_sigma**2 + _MATCH_SIGMA**2 + drift**2))
        if found.misfit < _MISFIT and (best is None or sigma < best[0]):
            best = sigma, start, found
            if sigma < _SURE:
                break
    if best is None or best[0] > _WORTH:
        return UNKNOWN
    sigma, start, found = best
    increments = steps(
        imu.time, imu.dtheta - found.gyro_bias * np.diff(imu.time)[:, None], imu.time[0], start
    )
    C_nb = found.C_nb * turned(increments)[-1].inv()
    return Found(
        float(C_nb.as_euler("ZYX")[0]),
        sigma,
        f"from how the velocity changed from {start:.0f} to {min(start + WINDOW, imu.time[-1]):.0f} s",
        start,
        found.gyro_bias,
        found.gyro_bias_sigma,
        -found.lag,
        found.lag_sigma,
    )


def by_magnetometer(
    imu: Imu,
    magnetometer: Magnetometer | None,
    attitude: tuple[float, float],
    tilt_sigma: float,
    length: float,
    position: FloatArray,
) -> Found:
    """Return the heading by the magnetic field over the first seconds.

    Parameters
    ----------
    imu
        The IMU.
    magnetometer
        The magnetometer, if there is one.
    attitude
        Roll and pitch over these seconds [rad].
    tilt_sigma
        Their σ [rad].
    length
        How many seconds [s].
    position : (3,) array
        Latitude, longitude [rad] and height [m].
    """
    if magnetometer is None:
        return UNKNOWN
    rows = (magnetometer.time >= imu.time[0] - _BEFORE) & (magnetometer.time <= imu.time[0] + length)
    if not rows.any():
        return UNKNOWN
    field = np.median(magnetometer.field[rows], axis=0)
    north, east, down = Rotation.from_euler("YX", [attitude[1], attitude[0]]).apply(field)
    level = float(np.hypot(north, east))
    if not level > 0:
        return UNKNOWN
    declination, horizontal, model = magnetometer.declination, np.inf, "declination of the log"
    if not np.isfinite(declination):
        declination, horizontal = magnetic_declination(position)
        model = "declination of the World Magnetic Model"
    sigma = float(np.hypot(MAGNETIC_SIGMA, tilt_sigma * abs(down) / level))
    if horizontal < _WEAK or sigma > np.pi:
        return UNKNOWN
    return Found(
        float(wrap(np.arctan2(-east, north) + declination)),
        sigma,
        f"by the magnetometer ({model}, {np.degrees(declination):.1f}°)",
        float(imu.time[0]),
    )


def magnetic_declination(position: FloatArray) -> tuple[float, float]:
    """Return declination [rad] and horizontal field [µT] of the World Magnetic Model 2025 at a position."""
    from pygeomag import GeoMag  # noqa: PLC0415 - only logs with a magnetometer need it

    latitude, longitude = np.degrees(position[0]), np.degrees(wrap(position[1]))
    kilometres = position[2] / 1000
    height = float(np.clip(kilometres, *_MODEL_HEIGHTS))
    here = GeoMag(base_year=_DECLINATION_YEAR).calculate(latitude, longitude, height, _DECLINATION_YEAR)
    return float(np.radians(here.d)), float(here.h) / 1000


def _drift(rest: float) -> float:
    """Return how fast a heading carried by the gyros becomes uncertain [rad/s]."""
    return float(_DRIFT_AT_REST if rest else _DRIFT)
