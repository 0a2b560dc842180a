"""Trajectory: from a flight record to one twice-differentiable curve, its truth and its ideal IMU.

The recorded velocity is splined, integrated over the ellipsoid and anchored on the position fixes by a slow
correction: differentiating velocity once gives far less noise than differentiating rounded positions twice.
One C2 curve with its knots on the IMU grid is then put through latitude, longitude, height and attitude
(`geodetic_path`; close to a pole, where longitude fails, through Cartesian position and attitude:
`polar_path`). Truth and ideal IMU are exact derivatives of that curve, and the IMU's increments are integrals
over intervals that contain no knot, so a navigator with these increments must reproduce the truth.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 2 and
5 (cited as Groves); P. G. Savage, *Strapdown Inertial Navigation Integration Algorithm Design*, JGCD 21
(1998).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lab.base.arrays import FloatArray
from lab.base.files.bounds import MIN_SAMPLES
from lab.base.histories import LONG
from lab.motion.frames import ecef, rotation
from lab.motion.kinematics import ideal_imu
from lab.motion.kinematics.attitude_curve import ATTITUDE_CURVES, AttitudeKind
from lab.motion.kinematics.ideal_imu import IdealImu
from lab.motion.recordings.recording import Recording
from lab.motion.truth.flight_paths import GeodeticPath, PolarPath

AT_ONCE = 2**16
"""Number of times for which the truth is computed in one block, with some 500 bytes of temporary memory
each."""


@dataclass(frozen=True)
class Truth:
    """The true values at given times.

    Attributes
    ----------
    time : (n,) array
        Time from the start of the flight [s].
    latitude, longitude : (n,) arrays
        Geodetic position on WGS-84 [rad], longitude within ±π.
    height : (n,) array
        Height above the ellipsoid [m].
    velocity_n : (n, 3) array
        Velocity over the Earth, north, east, down [m/s].
    q_nb : (n, 4) array
        Attitude quaternion, scalar first; its sign carries no meaning and may change between samples.
    euler : (n, 3) array
        Roll, pitch, yaw [rad].
    """

    time: FloatArray
    latitude: FloatArray
    longitude: FloatArray
    height: FloatArray
    velocity_n: FloatArray
    q_nb: FloatArray
    euler: FloatArray

    @property
    def position(self) -> FloatArray:
        """Latitude, longitude [rad] and height [m], (n, 3)."""
        return np.stack((self.latitude, self.longitude, self.height), axis=-1)

    def taken(self, samples: NDArray[Any] | slice) -> Truth:
        """Return the truth at some samples: numbers of them, flags, or a slice."""
        return Truth(**{name: getattr(self, name)[samples] for name in Truth.__dataclass_fields__})

    def around(self, times: FloatArray) -> Truth:
        """Return the truth at the samples before and after each of some times (m,), and at the first one."""
        after = np.searchsorted(self.time, times, side="right")
        near = np.concatenate(([0], after - 1, after))
        return self.taken(np.unique(np.clip(near, 0, self.time.size - 1)))


class LongTruth(Truth):
    """The truth of a long flight: float32 velocity and attitude; Euler angles are computed at each use."""

    def __init__(self, time: FloatArray, **parts: FloatArray) -> None:
        for name, values in {"time": time, **parts}.items():
            object.__setattr__(self, name, values)

    @property
    def euler(self) -> FloatArray:
        """Roll, pitch, yaw (n, 3) [rad]."""
        return rotation.euler_from_quaternion(self.q_nb)

    def taken(self, samples: NDArray[Any] | slice) -> Truth:
        """Return the truth at some samples: numbers of them, flags, or a slice; in float64."""
        names = [name for name in Truth.__dataclass_fields__ if name != "euler"]
        part = {name: getattr(self, name)[samples].astype(np.float64, copy=False) for name in names}
        return Truth(**part, euler=rotation.euler_from_quaternion(part["q_nb"]))


class FlightPath(Protocol):
    """A twice-differentiable curve of position and attitude, in any coordinates."""

    def motion(self, times: FloatArray) -> tuple[FloatArray, ...]:
        """Return position, velocity and attitude at the times.

        Returns
        -------
        latitude, longitude, height : (n,) arrays
            Geodetic position [rad], longitude within ±π; height above the ellipsoid [m].
        velocity_n : (n, 3) array
            Velocity over the Earth, north, east, down [m/s].
        q_nb : (n, 4) array
            Attitude quaternion, scalar first.
        """

    def rates(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ω_ib,b (n, 3) [rad/s] and f_b (n, 3) [m/s²] at the times."""

    @property
    def nbytes(self) -> int:
        """Memory of the curve's coefficients [bytes]."""


class Trajectory:
    """One twice-differentiable flight over the rotating Earth, from time 0 to `duration`.

    Build it with `from_recording`; then ask for the truth (`at`), the instantaneous inputs of an IMU
    (`rates`) or their integrals over the sample intervals (`increments`).

    Parameters
    ----------
    time : (n,) array
        Knots: the IMU grid, from 0 [s].
    path
        Curve of position and attitude with these knots.
    imu_rate
        Rate of the IMU grid [Hz].

    Attributes
    ----------
    path : FlightPath
        The curve: a `PolarPath` for a record that comes closer than 1° to a pole, else a `GeodeticPath`.
    duration : float
        Length of the flight, a whole number of IMU intervals [s].
    imu_rate : float
        Rate of the IMU grid [Hz].
    position_residual, velocity_residual : (3,) arrays
        Curve minus recording, rms, north, east, down [m], [m/s]; zero for a trajectory not made from a
        recording.
    """

    def __init__(self, time: FloatArray, path: FlightPath, imu_rate: float) -> None:
        self.path = path
        self.imu_rate = float(imu_rate)
        self.duration = float(time[-1])
        self.position_residual = np.zeros(3)
        self.velocity_residual = np.zeros(3)
        self._time = time

    @classmethod
    def from_recording(
        cls, recording: Recording, imu_rate: float = 200.0, attitude_curve: AttitudeKind = "rotation"
    ) -> Trajectory:
        """Return the curve through a flight record.

        Parameters
        ----------
        recording
            At least four samples; regular or irregular in time, any rate.
        imu_rate
            Rate of the IMU, whose grid carries the knots of the curve [Hz].
        attitude_curve
            "rotation" for a rotation spline, "euler" for cubic splines on the Euler angles.

        Raises
        ------
        ValueError
            For a record that is too short, for an unknown setting, and for Euler angles close to a pole.
        """
        _check(recording, imu_rate, attitude_curve)
        time = recording.time - recording.time[0]
        intervals = int(time[-1] * imu_rate + 1e-6)  # 1e-6, because time stamps are rounded
        grid = np.arange(intervals + 1) / imu_rate
        path: FlightPath
        if ecef.near_pole(recording.latitude).any():
            path = PolarPath.through(recording, grid)
        else:
            path = GeodeticPath.through(recording, grid, attitude_curve)
        trajectory = cls(grid, path, imu_rate)
        trajectory._compare(time, recording)
        return trajectory

    @property
    def time(self) -> FloatArray:
        """The IMU grid: (n + 1,) times from 0 to `duration` [s]."""
        return self._time

    @property
    def nbytes(self) -> int:
        """Memory of the curve's knots and coefficients [bytes]."""
        return int(self._time.nbytes) + self.path.nbytes

    def at(self, times: ArrayLike) -> Truth:
        """Return the truth at any times within the flight.

        Parameters
        ----------
        times : (n,) array
            Times from 0 to `duration`, in any order [s].

        Raises
        ------
        ValueError
            For times outside the flight.
        """
        times = self._check_times(times)
        if times.size <= AT_ONCE:
            return self._evaluate_truth(times)
        is_long = times.size > LONG
        widths = {"latitude": (), "longitude": (), "height": (), "velocity_n": (3,), "q_nb": (4,)}
        widths |= {} if is_long else {"euler": (3,)}
        whole = {
            name: np.empty((times.size, *width), np.float32 if is_long and width else np.float64)
            for name, width in widths.items()
        }
        for first in range(0, times.size, AT_ONCE):
            part = slice(first, first + AT_ONCE)
            there = self._evaluate_truth(times[part])
            for name, values in whole.items():
                values[part] = getattr(there, name)
        return LongTruth(times, **whole) if is_long else Truth(times, **whole)

    def _evaluate_truth(self, times: FloatArray) -> Truth:
        """Return the truth at times within the flight."""
        latitude, longitude, height, velocity_n, q_nb = self.path.motion(times)
        euler = rotation.euler_from_quaternion(q_nb)
        return Truth(times, latitude, longitude, height, velocity_n, q_nb, euler)

    def rates(self, times: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the instantaneous inputs of an IMU at any times within the flight.

        Parameters
        ----------
        times : (n,) array
            Times from 0 to `duration` [s].

        Returns
        -------
        omega_ib_b : (n, 3) array
            Angular rate of the body in the inertial frame, resolved in the body frame [rad/s].
        f_b : (n, 3) array
            Specific force, resolved in the body frame [m/s²].

        Raises
        ------
        ValueError
            For times outside the flight.
        """
        return self.path.rates(self._check_times(times))

    def increments(self, rate: float | None = None) -> IdealImu:
        """Return the integrals of angular rate and specific force over each sample interval.

        Three-point Gauss-Legendre quadrature between the knots, where the curve is smooth.

        Parameters
        ----------
        rate
            Rate of the samples [Hz]; by default that of the grid. Others must divide it or be a multiple of
            it, so that every knot falls on the end of an interval.

        Raises
        ------
        ValueError
            For a rate that does not fit the grid.
        """
        rate = self.imu_rate if rate is None else float(rate)
        return ideal_imu.integrate(self.rates, len(self._time) - 1, self.imu_rate, rate)

    def _check_times(self, times: ArrayLike) -> FloatArray:
        """Return the times as an array, refusing any outside the flight."""
        times = np.atleast_1d(np.asarray(times, dtype=np.float64))
        # Times on a grid are rounded: the last one may be past the end by that.
        slack = 1e-9 * max(self.duration, 1.0)
        outside = ~((times >= -slack) & (times <= self.duration + slack))
        if outside.any():
            raise ValueError(
                f"time {times[outside][0]:g} s is outside the flight; accepted: 0 to {self.duration:g} s"
            )
        return times

    def _compare(self, time: FloatArray, recording: Recording) -> None:
        """Set the residuals: curve minus recording."""
        flown = time <= self.duration
        truth = self.at(time[flown])
        recorded = recording.position[flown]
        self.position_residual = _rms(ecef.displacement(recorded, truth.position))
        self.velocity_residual = _rms(
            ecef.resolve_elsewhere(truth.velocity_n, truth.position, recorded) - recording.velocity_n[flown]
        )


def _rms(values: FloatArray) -> FloatArray:
    """Return the root mean square over the first axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _check(recording: Recording, imu_rate: float, attitude_curve: str) -> None:
    """Raise `ValueError` if no curve can be made."""
    if attitude_curve not in ATTITUDE_CURVES:
        raise ValueError(
            f"attitude curve {attitude_curve!r} is unknown; accepted: {', '.join(ATTITUDE_CURVES)}"
        )
    if not (np.isfinite(imu_rate) and imu_rate > 0):
        raise ValueError(f"IMU rate {imu_rate:g} Hz is not accepted; it must be positive and finite")
    if len(recording.time) < MIN_SAMPLES:
        raise ValueError(f"recording has {len(recording.time)} samples; at least {MIN_SAMPLES} are needed")
    if recording.duration * imu_rate < MIN_SAMPLES:
        raise ValueError(
            f"recording lasts {recording.duration:g} s; at least {MIN_SAMPLES} intervals of the IMU "
            f"({MIN_SAMPLES / imu_rate:g} s at {imu_rate:g} Hz) are needed"
        )
    if attitude_curve == "euler" and ecef.near_pole(recording.latitude).any():
        raise ValueError(
            "attitude curve 'euler' cannot follow a recording closer than 1° to a pole, where the heading "
            "jumps; accepted here: rotation"
        )
