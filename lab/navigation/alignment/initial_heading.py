"""Initial heading: the sources of the heading at the first sample of a log, each with its σ.

A given heading is used unchanged. Otherwise, the source with the smallest σ is used: two antennas, the course
of a vehicle that moves where its nose points, velocities matched with the specific force (any vehicle,
`lab.data.checks.velocity_matching`), or a magnetometer. If two sources contradict each other, σ is their
difference. P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd
ed., ch. 5.6, 6.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.data.checks.velocity_matching import (
    GYRO_BIAS_SIGMA,
    WINDOW,
    Match,
    match,
    measure_liveliness,
    steps,
    window_of,
)
from lab.data.log.auxiliary_data import AuxiliaryData, Headings, Magnetometer
from lab.data.log.vehicle import Vehicle, vehicle_of
from lab.motion.frames.magnetic_field import magnetic_declination
from lab.motion.frames.rotation import wrap
from lab.motion.kinematics.running_turns import running_attitudes
from lab.navigation.alignment import limits
from lab.navigation.solution import Fixes, Imu

_COURSE = "from the course"
_ROUNDING = 1e-6  # of time stamps [s]


class Hints(NamedTuple):
    """Information about the heading in addition to IMU and fixes.

    Attributes
    ----------
    vehicle : Vehicle
        The vehicle that carries the sensors.
    given, given_sigma : float
        Heading at the first sample and its σ; NaN if none is given [rad].
    headings : Headings or None
        Measured headings.
    magnetometer : Magnetometer or None
        The magnetometer.
    forward_assumed : bool
        Whether it is only assumed which axis of the IMU points forward, and measured velocities can show it.
    """

    vehicle: Vehicle = vehicle_of("")
    given: float = np.nan
    given_sigma: float = np.nan
    headings: Headings | None = None
    magnetometer: Magnetometer | None = None
    forward_assumed: bool = False

    @classmethod
    def of(
        cls,
        beside: AuxiliaryData,
        vehicle: str,
        heading: float | None,
        heading_sigma: float,
        velocity_n: FloatArray,
    ) -> Hints:
        """Return the hints of a log and of the settings; the settings take precedence.

        If no velocity is measured, an unknown vehicle does not follow its nose: velocities can contradict
        that, but differences of positions are too poor. Of copters that flew sideways, they let half pass.

        Parameters
        ----------
        beside
            The hints in the log.
        vehicle
            Vehicle of the settings, or "auto".
        heading, heading_sigma
            Heading of the settings and its σ [°]; None if it is unknown.
        velocity_n : (m, 3) array
            Measured velocities; NaN if unmeasured [m/s].
        """
        known = vehicle_of(beside.vehicle if vehicle == "auto" else vehicle)
        unmeasured = bool(np.isnan(velocity_n[:, :2]).all())
        if not known.name and unmeasured:
            known = known._replace(sideslip=np.inf)
        return cls(
            known,
            np.nan if heading is None else float(np.radians(heading)),
            float(np.radians(heading_sigma)),
            beside.headings,
            beside.magnetometer,
            beside.forward_assumed and not unmeasured,
        )


class Found(NamedTuple):
    """A heading at the first sample.

    Attributes
    ----------
    heading, sigma : float
        Heading and its σ [rad].
    source : str
        Description of its source.
    time : float
        Time of the observation [s]; NaN if there was none.
    gyro_bias, gyro_bias_sigma : (3,) arrays or None
        Gyro bias that was found with it [rad/s].
    late, late_sigma : float
        Lateness of the time stamps of the fixes, estimated with the heading, and its σ [s]; NaN if not
        estimated.
    course_apart : float
        This heading minus the course, if the course contradicts it; NaN otherwise [rad].
    """

    heading: float
    sigma: float
    source: str
    time: float
    gyro_bias: FloatArray | None = None
    gyro_bias_sigma: FloatArray | None = None
    late: float = np.nan
    late_sigma: float = np.nan
    course_apart: float = np.nan

    @property
    def is_course(self) -> bool:
        """Whether the heading is the course."""
        return self.source.startswith(_COURSE)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on the clock of the fixes, and on axes of the IMU that the course contradicts."""
        remarks, late, apart = [], self.late, np.degrees(self.course_apart)
        known = max(limits.ALIGNMENT.reported_latency, limits.ALIGNMENT.latency_sigmas * self.late_sigma)
        if abs(late) > known:
            remarks.append(
                f"The same motion shows that the fixes are {abs(late):.2f} s "
                f"{'late' if late > 0 else 'early'} (σ {self.late_sigma:.2f} s); set latency_s of the log "
                "accordingly."
            )
        if np.isfinite(apart):
            remarks.append(
                f"The axis that was assumed to point forward is {apart:.0f}° from the course. If the vehicle "
                "moves where its nose points, the IMU is mounted at this angle: mounting_deg = "
                f"[0, 0, {apart:.0f}] in log.toml corrects the axes, or --axes of the import."
            )
        return tuple(remarks)


UNKNOWN = Found(0.0, np.pi, "", np.nan)
"""An unknown heading."""


def contradict(one: Found, other: Found) -> bool:
    """Return whether two headings are further apart than their σ explain."""
    apart = abs(float(wrap(other.heading - one.heading)))
    return bool(apart > limits.ALIGNMENT.contradiction_sigmas * np.hypot(one.sigma, other.sigma))


def choose_surest_heading(found: Sequence[Found]) -> Found:
    """Return the most certain of several headings; its σ and source report a contradiction."""
    known = sorted((one for one in found if one.sigma < np.pi), key=lambda one: one.sigma)
    if not known:
        return UNKNOWN
    best = known[0]
    for other in known[1:]:
        apart = abs(float(wrap(other.heading - best.heading)))
        if contradict(best, other):
            return best._replace(
                sigma=min(np.pi, max(best.sigma, apart)),
                source=f"{best.source} (contradicted: {np.degrees(apart):.0f}° away from the heading "
                f"{other.source})",
            )
    return best


def shows_course(fixes: Fixes, velocity_sigma: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of the fixes that are fast enough for a course."""
    speed = np.linalg.norm(fixes.velocity_n[:, :2], axis=1)
    slowest = np.maximum(
        limits.ALIGNMENT.course_speed,
        limits.ALIGNMENT.course_sigmas * np.linalg.norm(velocity_sigma[:, :2], axis=1),
    )
    return np.asarray(speed > slowest)


def by_course(
    imu: Imu, fixes: Fixes, velocity_sigma: FloatArray, turning: FloatArray, rest: float, vehicle: Vehicle
) -> Found:
    """Return the heading from the course of the first lasting motion, carried back by the gyros.

    A slow vehicle may move backwards, or be carried. The first course above `forward_speed` shows it.

    Parameters
    ----------
    imu, fixes
        The measurements.
    velocity_sigma : (m, 3) array
        σ of the velocities [m/s].
    turning : (n + 1,) array
        Rotation about the vertical since the first sample [rad].
    rest
        How long the vehicle was at rest at the start [s].
    vehicle
        The vehicle, with the largest difference between its course and its heading.
    """
    if np.isinf(vehicle.sideslip):
        return UNKNOWN
    speed = np.linalg.norm(fixes.velocity_n[:, :2], axis=1)
    sigma = np.linalg.norm(velocity_sigma[:, :2], axis=1)
    course = np.arctan2(fixes.velocity_n[:, 1], fixes.velocity_n[:, 0])
    fast = shows_course(fixes, velocity_sigma) & (fixes.time >= imu.time[0] - _ROUNDING)

    def first_of(motion: NDArray[np.bool_]) -> Found:
        lasting = motion & np.append(motion[1:], False)
        if not lasting.any():
            return UNKNOWN
        first = int(np.argmax(lasting))
        time = float(fixes.time[first])
        drift = _drift(rest) * (time - imu.time[0])
        return Found(
            float(wrap(course[first] - np.interp(time, imu.time, turning))),
            float(min(np.pi, np.sqrt(vehicle.sideslip**2 + (sigma[first] / speed[first]) ** 2 + drift**2))),
            f"{_COURSE} at {time:.1f} s",
            time,
        )

    found, forward = first_of(fast), first_of(fast & (speed > limits.ALIGNMENT.forward_speed))
    return _forward(found, forward, rest, vehicle) if forward.source else found


def _forward(found: Found, forward: Found, rest: float, vehicle: Vehicle) -> Found:
    """Return the heading by the first course, of a vehicle that may move backwards there.

    Parameters
    ----------
    found, forward
        The headings by the first course, and by the first one of a vehicle that moves forward.
    rest, vehicle
        As in `by_course`.
    """
    apart = float(wrap(forward.heading - found.heading))
    if abs(apart) > np.pi / 2:
        found = found._replace(
            heading=float(wrap(found.heading + np.pi)),
            source=f"{found.source}, where the vehicle moved backwards",
        )
        apart = float(wrap(forward.heading - found.heading))
    between = np.hypot(np.sqrt(2) * vehicle.sideslip, _drift(rest) * (forward.time - found.time))
    # Neither forward nor backward: it was carried.
    return forward if abs(apart) > limits.ALIGNMENT.contradiction_sigmas * between else found


def by_antennas(imu: Imu, headings: Headings | None, turning: FloatArray, rest: float) -> Found:
    """Return the heading of the first measurement with two antennas, carried back by the gyros."""
    if headings is None:
        return UNKNOWN
    rows = np.flatnonzero(
        (headings.time >= imu.time[0] - limits.ALIGNMENT.heading_age) & (headings.time <= imu.time[-1])
    )
    if not rows.size:
        return UNKNOWN
    first = int(rows[0])
    time = float(headings.time[first])
    own = headings.sigma[first] if np.isfinite(headings.sigma[first]) else limits.ALIGNMENT.antenna_sigma
    drift = _drift(rest) * abs(time - imu.time[0])
    heading = float(wrap(headings.heading[first] - np.interp(time, imu.time, turning)))
    return Found(heading, float(min(np.pi, np.hypot(own, drift))), f"by two antennas at {time:.1f} s", time)


def by_velocity(imu: Imu, fixes: Fixes, velocity_sigma: FloatArray, bias: FloatArray, rest: float) -> Found:
    """Return the heading for which specific force and velocities agree, for any vehicle."""
    log = (imu.time, imu.dtheta, imu.dvelocity, fixes.time, fixes.velocity_n, velocity_sigma)
    spread = limits.ALIGNMENT.bias_at_rest if rest else GYRO_BIAS_SIGMA
    best: tuple[float, float, Match] | None = None
    starts = [
        start for _, start in measure_liveliness(log) if start - imu.time[0] < limits.ALIGNMENT.match_time
    ]
    for start in starts[: limits.ALIGNMENT.match_windows]:
        window = window_of(log, start)
        if window is None:
            continue
        found = match(window, bias, spread, lags=(0.0,))
        drift = (_drift(rest) if rest else float(min(limits.ALIGNMENT.drift, found.gyro_bias_sigma[2]))) * (
            start - imu.time[0]
        )
        sigma = float(np.sqrt(found.heading_sigma**2 + limits.ALIGNMENT.match_sigma**2 + drift**2))
        if found.misfit < limits.ALIGNMENT.match_misfit and (best is None or sigma < best[0]):
            best = sigma, start, found
            if sigma < limits.ALIGNMENT.sure_heading:
                break
    if best is None or best[0] > limits.ALIGNMENT.worth_heading:
        return UNKNOWN
    sigma, start, found = best
    increments = steps(
        imu.time, imu.dtheta - found.gyro_bias * np.diff(imu.time)[:, None], imu.time[0], start
    )
    # From the begin of the window back to the first sample: what the gyros turned between is undone.
    C_nb = found.C_nb * running_attitudes(increments)[-1].inv()
    return Found(
        float(C_nb.as_euler("ZYX")[0]),
        sigma,
        f"from the change of the velocity from {start:.0f} to {min(start + WINDOW, imu.time[-1]):.0f} s",
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
    """Return the heading from the magnetic field over the first seconds.

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
        Averaging time [s].
    position : (3,) array
        Latitude, longitude [rad] and height [m].
    """
    if magnetometer is None:
        return UNKNOWN
    rows = (magnetometer.time >= imu.time[0] - limits.ALIGNMENT.heading_age) & (
        magnetometer.time <= imu.time[0] + length
    )
    if not rows.any():
        return UNKNOWN
    field = np.median(magnetometer.field[rows], axis=0)
    # Levelled, with a heading of zero.
    north, east, down = Rotation.from_euler("YX", [attitude[1], attitude[0]]).apply(field)
    level = float(np.hypot(north, east))
    if not level > 0:
        return UNKNOWN
    declination, horizontal, model = magnetometer.declination, np.inf, "declination of the log"
    if not np.isfinite(declination):
        declination, horizontal = magnetic_declination(position)
        model = "declination of the World Magnetic Model"
    sigma = float(np.hypot(limits.ALIGNMENT.magnetic_sigma, tilt_sigma * abs(down) / level))
    if horizontal < limits.ALIGNMENT.weak_field or sigma > np.pi:
        return UNKNOWN
    return Found(
        # In level axes, a nose at the heading ψ sees magnetic north at −ψ.
        float(wrap(np.arctan2(-east, north) + declination)),
        sigma,
        f"by the magnetometer ({model}, {np.degrees(declination):.1f}°)",
        float(imu.time[0]),
    )


def _drift(rest: float) -> float:
    """Return the rate at which the σ of a heading carried by the gyros grows [rad/s]."""
    return float(limits.ALIGNMENT.drift_at_rest if rest else limits.ALIGNMENT.drift)


def mean_turned(vector_n: FloatArray, force_n: FloatArray, sigma: float) -> FloatArray:
    """Return the mean (3,) of a vector that is fixed to the vehicle, over the errors of its heading, in n.

    A vehicle that was levelled by a specific force is turned about this force if its heading is wrong. The
    mean of cos ψ is exp(−σ²/2): of an arm with an unknown heading at rest, the vertical part remains.

    Parameters
    ----------
    vector_n : (3,) array
        The vector, with the heading found.
    force_n : (3,) array
        The specific force, in any unit.
    sigma
        σ of the heading [rad].
    """
    axis = heading_error_direction(force_n)
    along = axis * (axis @ vector_n) / (axis @ axis)
    return np.asarray(along + np.exp(-(sigma**2) * (axis @ axis) / 2) * (vector_n - along))


def heading_error_direction(force_n: FloatArray) -> FloatArray:
    """Return the attitude error (3,) of one radian of heading, after levelling by a specific force in n."""
    return np.asarray(force_n / force_n[2])
