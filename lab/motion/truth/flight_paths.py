"""Flight paths: the curve of a flight, in latitude, longitude and height or, close to a pole, Earth-fixed.

A `PolarPath` is as a `GeodeticPath`, but with a twice-differentiable curve of the Cartesian position r_e and
of the attitude C_eb, which have no singularity at a pole. Latitude, longitude and heading are computed from
them; over the pole, longitude and heading jump.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., eqs. 5.18
and 5.29 (navigation equations in e).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames import earth, ecef, rotation
from lab.motion.kinematics import ideal_imu
from lab.motion.kinematics.anchoring import anchored_cartesian, anchored_offsets
from lab.motion.kinematics.attitude_curve import AttitudeCurve, AttitudeKind, RotationCurve, attitude_curve
from lab.motion.kinematics.spline_windows import CubicCurve
from lab.motion.recordings.recording import Recording


class _Path:
    """The curve of the offsets from an origin, and that of the attitudes."""

    def __init__(
        self, time: FloatArray, origin: FloatArray, offsets: FloatArray, attitude: AttitudeCurve
    ) -> None:
        self._origin = origin
        self._position = CubicCurve(time, offsets)
        self._attitude = attitude

    @property
    def nbytes(self) -> int:
        """Memory of the curve's coefficients [bytes]."""
        return self._position.nbytes + self._attitude.nbytes


class GeodeticPath(_Path):
    """One twice-differentiable curve of position and attitude.

    Parameters
    ----------
    time : (n,) array
        Knots: the IMU grid, from 0 [s].
    origin : (3,) array
        Latitude, longitude [rad] and height [m] of the origin of the offsets.
    offsets : (n, 3) array
        Latitude, longitude (without jumps) and height at the knots, minus the origin. The spline of small
        offsets keeps the second derivative free of the roundoff of the coordinates themselves.
    attitude
        Curve of attitudes C_nb with the same knots.
    """

    @classmethod
    def through(cls, recording: Recording, grid: FloatArray, kind: AttitudeKind) -> GeodeticPath:
        """Return the curve through a flight record.

        Parameters
        ----------
        recording
            At least four samples.
        grid : (n,) array
            The IMU grid, from 0 [s].
        kind
            Kind of the curve of attitudes.
        """
        time = recording.time - recording.time[0]
        position = recording.position
        offsets = anchored_offsets(time, position, recording.velocity_n, grid)
        return cls(grid, position[0], offsets, attitude_curve(time, recording.euler, kind).resampled(grid))

    def motion(self, times: FloatArray) -> tuple[FloatArray, ...]:
        """Return position, velocity and attitude at the times; see `trajectory.FlightPath`."""
        position = self._position(times) + self._origin
        velocity_n = ideal_imu.velocity(position, self._position(times, 1))
        q_nb = self._attitude.attitude(times).as_quat(scalar_first=True)
        return position[:, 0], rotation.wrap(position[:, 1]), position[:, 2], velocity_n, q_nb

    def rates(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ω_ib,b and f_b at the times; see `lab.motion.truth.trajectory.FlightPath`."""
        offset, rate, second = self._position.motion(times)
        return ideal_imu.inputs(
            offset + self._origin,
            rate,
            second,
            self._attitude.attitude(times),
            self._attitude.rate(times),
        )


class PolarPath(_Path):
    """One twice-differentiable curve of position and attitude, poles included.

    Parameters
    ----------
    time : (n,) array
        Knots: the IMU grid, from 0 [s].
    origin : (3,) array
        Position r_e of the origin of the offsets [m].
    offsets : (n, 3) array
        r_e at the knots, minus the origin [m].
    attitude
        Curve of attitudes C_eb with the same knots.
    """

    @classmethod
    def through(cls, recording: Recording, grid: FloatArray) -> PolarPath:
        """Return the curve through a flight record.

        Parameters
        ----------
        recording
            At least four samples.
        grid : (n,) array
            The IMU grid, from 0 [s].
        """
        time = recording.time - recording.time[0]
        C_en = ecef.axes(recording.latitude, recording.longitude)
        position = recording.position
        offsets = anchored_cartesian(time, position, recording.velocity_n, grid)
        C_nb = Rotation.from_quat(rotation.quaternion_from_euler(recording.euler), scalar_first=True)
        attitude = RotationCurve(time, Rotation.from_matrix(C_en) * C_nb).resampled(grid)
        return cls(grid, ecef.position(position[:1])[0], offsets, attitude)

    def motion(self, times: FloatArray) -> tuple[FloatArray, ...]:
        """Return position, velocity and attitude at the times; see `trajectory.FlightPath`."""
        position = ecef.geodetic(self._position(times) + self._origin)
        C_en = ecef.axes(position[:, 0], position[:, 1])
        # Transposed: from e to n.
        velocity_n = np.einsum("nji,nj->ni", C_en, self._position(times, 1))
        C_nb = Rotation.from_matrix(C_en).inv() * self._attitude.attitude(times)
        return *position.T, velocity_n, C_nb.as_quat(scalar_first=True)

    def rates(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ω_ib,b and f_b at the times; see `lab.motion.truth.trajectory.FlightPath`.

        f = r̈ + 2 ω_ie × ṙ − g in e, with the one gravity (Groves 5.18, 5.29).
        """
        offset, rate, second = self._position.motion(times)
        latitude, longitude, height = ecef.geodetic(offset + self._origin).T
        omega_ie = np.array([0.0, 0.0, earth.RATE])
        down = ecef.axes(latitude, longitude)[:, :, 2]
        g_e = earth.gravity(np.sin(latitude), height)[:, None] * down
        f_e = second + 2 * np.cross(omega_ie, rate) - g_e
        C_eb = self._attitude.attitude(times)
        omega_ib_b = self._attitude.rate(times) + C_eb.apply(omega_ie, inverse=True)
        return omega_ib_b, C_eb.apply(f_e, inverse=True)
