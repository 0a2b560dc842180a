"""Trajectory: from a flight record to one twice-differentiable curve, its truth and its ideal IMU.

The recorded velocity is splined, integrated over the ellipsoid and anchored on the position fixes by a slow
correction: differentiating velocity once costs far less noise than differentiating rounded positions twice.
One C2 curve with its knots on the IMU grid is then put through latitude, longitude, height and attitude
(close to a pole, where longitude fails, through Cartesian position and attitude: `polar_trajectory`).
Truth and ideal IMU are exact derivatives of that curve, and the IMU's increments are integrals over intervals
that contain no knot, so a navigator fed with them must return to the truth.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 2 and
5 (cited as Groves); P. G. Savage, *Strapdown Inertial Navigation Integration Algorithm Design*, JGCD 21
(1998).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, RotationSpline

from lab import ecef, ideal_imu, rotation
from lab.anchoring import anchored_offsets
from lab.histories import LONG
from lab.ideal_imu import IdealImu
from lab.recordings.recording import Recording
from lab.spline_windows import CubicCurve, SplineWindows

FloatArray = NDArray[np.float64]
AttitudeKind = Literal["rotation", "euler"]

ATTITUDE_CURVES = get_args(AttitudeKind)
MIN_SAMPLES = 4
"""A cubic needs four points."""
AT_ONCE = 2**16
"""Times at which the truth is computed at once: what is needed meanwhile takes some 500 bytes each."""


@dataclass(frozen=True)
class Truth:
    """What is true at given times.

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


class LongTruth(Truth):
    """The truth of a long flight, whose Euler angles are computed whenever they are asked for."""

    def __init__(self, time: FloatArray, **parts: FloatArray) -> None:
        for name, values in {"time": time, **parts}.items():
            object.__setattr__(self, name, values)

    @property
    def euler(self) -> FloatArray:
        """Roll, pitch, yaw (n, 3) [rad]."""
        return rotation.euler_from_quaternion(self.q_nb)

    def taken(self, samples: NDArray[Any] | slice) -> Truth:
        """Return the truth at some samples: numbers of them, flags, or a slice."""
        names = [name for name in Truth.__dataclass_fields__ if name != "euler"]
        part = {name: getattr(self, name)[samples] for name in names}
        return Truth(**part, euler=rotation.euler_from_quaternion(part["q_nb"]))


class AttitudeCurve(Protocol):
    """A twice-differentiable curve of attitudes."""

    def attitude(self, times: FloatArray) -> Rotation:
        """Return C_nb at the times."""
        ...

    def rate(self, times: FloatArray) -> FloatArray:
        """Return ω_nb,b (n, 3) at the times [rad/s]."""
        ...

    @property
    def nbytes(self) -> int:
        """Memory of the curve's coefficients [bytes]."""
        ...


class RotationCurve:
    """SciPy's `RotationSpline` through the attitudes: no gimbal lock, nothing to unwrap.

    Parameters
    ----------
    times : (n,) array
        Knots [s].
    attitudes
        n rotations C_nb; or another curve, through which this one goes.
    """

    def __init__(self, times: FloatArray, attitudes: Rotation | RotationCurve) -> None:
        def make(part: slice) -> RotationSpline:
            knots = times[part]
            given = attitudes.attitude(knots) if isinstance(attitudes, RotationCurve) else attitudes[part]
            return RotationSpline(knots, given)

        self._spline = SplineWindows(times, make)
        # A curve of one window is made already.
        self._through = None if self._spline.only else attitudes

    def attitude(self, times: FloatArray) -> Rotation:
        """Return C_nb at the times."""
        if self._spline.only is not None:
            return self._spline.only(times)
        return Rotation.from_quat(self._spline(times, lambda spline, at: spline(at).as_quat()))

    def rate(self, times: FloatArray) -> FloatArray:
        """Return ω_nb,b (n, 3) at the times [rad/s]."""
        return self._spline(times, lambda spline, at: spline(at, 1))

    @property
    def nbytes(self) -> int:
        """Memory of the knots and of the coefficients that are kept [bytes]."""
        # Coefficients (4, 3) of the rotation vectors, a quaternion and a time at each knot.
        own = self._spline.kept * (12 + 4 + 1) * 8
        if isinstance(self._through, RotationCurve):
            return own + self._through.nbytes
        return own + (0 if self._through is None else len(self._through) * 4 * 8)

    def resampled(self, times: FloatArray) -> RotationCurve:
        """Return a curve through this one with knots at other times."""
        return RotationCurve(times, self)


class EulerCurve:
    """Cubic spline through roll, pitch and yaw: the classic choice, for flights away from ±90° of pitch.

    Parameters
    ----------
    times : (n,) array
        Knots [s].
    euler : (n, 3) array
        Roll, pitch, yaw without jumps [rad].
    """

    def __init__(self, times: FloatArray, euler: FloatArray) -> None:
        self._spline = CubicCurve(times, euler)

    def attitude(self, times: FloatArray) -> Rotation:
        """Return C_nb at the times."""
        return Rotation.from_quat(rotation.quaternion_from_euler(self._spline(times)), scalar_first=True)

    def rate(self, times: FloatArray) -> FloatArray:
        """Return ω_nb,b (n, 3) at the times [rad/s]."""
        return rotation.body_rate(self._spline(times), self._spline(times, 1))

    @property
    def nbytes(self) -> int:
        """Memory of the knots and of the coefficients that are kept [bytes]."""
        return self._spline.nbytes

    def resampled(self, times: FloatArray) -> EulerCurve:
        """Return a curve through this one with knots at other times."""
        return EulerCurve(times, self._spline(times))


class Trajectory:
    """One twice-differentiable flight over the rotating Earth, from time 0 to `duration`.

    Build it with `from_recording`; then ask for the truth (`at`), the instantaneous inputs of an IMU
    (`rates`) or their integrals over the sample intervals (`increments`).

    Parameters
    ----------
    time : (n,) array
        Knots: the IMU grid, from 0 [s].
    origin : (3,) array
        Latitude, longitude [rad] and height [m] the offsets count from.
    offsets : (n, 3) array
        Latitude, longitude (without jumps) and height at the knots, minus the origin. The spline of small
        offsets keeps the second derivative free of the roundoff of the coordinates themselves.
    attitude
        Curve of attitudes with the same knots.
    imu_rate
        Rate of the IMU grid [Hz].

    Attributes
    ----------
    duration : float
        Length of the flight, a whole number of IMU intervals [s].
    imu_rate : float
        Rate of the IMU grid [Hz].
    position_residual, velocity_residual : (3,) arrays
        Curve minus recording, rms, north, east, down [m], [m/s]; zero for a trajectory not made from a
        recording.
    """

    def __init__(
        self,
        time: FloatArray,
        origin: FloatArray,
        offsets: FloatArray,
        attitude: AttitudeCurve,
        imu_rate: float,
    ) -> None:
        self.imu_rate = float(imu_rate)
        self.duration = float(time[-1])
        self.position_residual = np.zeros(3)
        self.velocity_residual = np.zeros(3)
        self._time = time
        self._origin = origin
        self._position = CubicCurve(time, offsets)
        self._attitude = attitude

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

        Returns
        -------
        Trajectory
            For a record that comes closer than 1° to a pole, a `PolarTrajectory`.

        Raises
        ------
        ValueError
            For a record that is too short, for an unknown setting, and for Euler angles close to a pole.
        """
        _check(recording, imu_rate, attitude_curve)
        time = recording.time - recording.time[0]
        intervals = int(time[-1] * imu_rate + 1e-6)  # 1e-6: stamps are rounded
        grid = np.arange(intervals + 1) / imu_rate
        if ecef.near_pole(recording.latitude).any():
            from lab.polar_trajectory import PolarTrajectory  # noqa: PLC0415 - a subclass of this one

            polar = PolarTrajectory.through(recording, grid, imu_rate)
            polar._compare(time, recording)
            return polar
        position = np.stack((recording.latitude, recording.longitude, recording.height), axis=-1)
        offsets = anchored_offsets(time, position, recording.velocity_n, grid)
        attitude = _attitude_curve(time, recording.euler, attitude_curve).resampled(grid)
        trajectory = cls(grid, position[0], offsets, attitude, imu_rate)
        trajectory._compare(time, recording)
        return trajectory

    @property
    def time(self) -> FloatArray:
        """The IMU grid: (n + 1,) times from 0 to `duration` [s]."""
        return self._time

    @property
    def nbytes(self) -> int:
        """Memory of the curve's knots and coefficients [bytes]."""
        return int(self._time.nbytes) + self._position.nbytes + self._attitude.nbytes

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
        times = self._within(times)
        if times.size <= AT_ONCE:
            return self._at(times)
        is_long = times.size > LONG
        widths = {"latitude": (), "longitude": (), "height": (), "velocity_n": (3,), "q_nb": (4,)}
        widths |= {} if is_long else {"euler": (3,)}
        whole = {name: np.empty((times.size, *width)) for name, width in widths.items()}
        for first in range(0, times.size, AT_ONCE):
            part = slice(first, first + AT_ONCE)
            there = self._at(times[part])
            for name, values in whole.items():
                values[part] = getattr(there, name)
        return LongTruth(times, **whole) if is_long else Truth(times, **whole)

    def _at(self, times: FloatArray) -> Truth:
        """Return the truth at times within the flight."""
        position = self._position(times) + self._origin
        q_nb = self._attitude.attitude(times).as_quat(scalar_first=True)
        return Truth(
            time=times,
            latitude=position[:, 0],
            longitude=rotation.wrap(position[:, 1]),
            height=position[:, 2],
            velocity_n=ideal_imu.velocity(position, self._position(times, 1)),
            q_nb=q_nb,
            euler=rotation.euler_from_quaternion(q_nb),
        )

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
        times = self._within(times)
        return ideal_imu.inputs(
            self._position(times) + self._origin,
            self._position(times, 1),
            self._position(times, 2),
            self._attitude.attitude(times),
            self._attitude.rate(times),
        )

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

    def _within(self, times: ArrayLike) -> FloatArray:
        """Return the times as an array, refusing any outside the flight."""
        times = np.atleast_1d(np.asarray(times, dtype=np.float64))
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
        recorded = np.stack((recording.latitude, recording.longitude, recording.height), axis=-1)[flown]
        self.position_residual = _rms(ecef.way(recorded, truth.position))
        self.velocity_residual = _rms(
            ecef.turned(truth.velocity_n, truth.position, recorded) - recording.velocity_n[flown]
        )


def _rms(values: FloatArray) -> FloatArray:
    """Return the root mean square over the first axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _check(recording: Recording, imu_rate: float, attitude_curve: str) -> None:
    """Refuse what no curve can be made of."""
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
            "attitude curve 'euler' does not go with a recording closer than 1° to a pole, where the heading "
            "jumps; accepted here: rotation"
        )


def _attitude_curve(time: FloatArray, euler: FloatArray, kind: AttitudeKind) -> RotationCurve | EulerCurve:
    """Return the curve through recorded Euler angles with knots at the recorded times."""
    if kind == "rotation":
        return RotationCurve(
            time, Rotation.from_quat(rotation.quaternion_from_euler(euler), scalar_first=True)
        )
    return EulerCurve(time, np.unwrap(euler, axis=0))
