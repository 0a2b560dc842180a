"""Geodetic path: the curve of a flight in latitude, longitude and height, away from the poles."""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames import rotation
from lab.motion.kinematics import ideal_imu
from lab.motion.kinematics.anchoring import anchored_offsets
from lab.motion.kinematics.attitude_curve import AttitudeCurve, AttitudeKind, attitude_curve
from lab.motion.kinematics.spline_windows import CubicCurve
from lab.motion.recordings.recording import Recording


class GeodeticPath:
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

    def __init__(
        self, time: FloatArray, origin: FloatArray, offsets: FloatArray, attitude: AttitudeCurve
    ) -> None:
        self._origin = origin
        self._position = CubicCurve(time, offsets)
        self._attitude = attitude

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
        position = np.stack((recording.latitude, recording.longitude, recording.height), axis=-1)
        offsets = anchored_offsets(time, position, recording.velocity_n, grid)
        return cls(grid, position[0], offsets, attitude_curve(time, recording.euler, kind).resampled(grid))

    @property
    def nbytes(self) -> int:
        """Memory of the curve's coefficients [bytes]."""
        return self._position.nbytes + self._attitude.nbytes

    def motion(self, times: FloatArray) -> tuple[FloatArray, ...]:
        """Return position, velocity and attitude at the times; see `trajectory.FlightPath`."""
        position = self._position(times) + self._origin
        velocity_n = ideal_imu.velocity(position, self._position(times, 1))
        q_nb = self._attitude.attitude(times).as_quat(scalar_first=True)
        return position[:, 0], rotation.wrap(position[:, 1]), position[:, 2], velocity_n, q_nb

    def rates(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ω_ib,b and f_b at the times; see `lab.motion.truth.trajectory.FlightPath`."""
        return ideal_imu.inputs(
            self._position(times) + self._origin,
            self._position(times, 1),
            self._position(times, 2),
            self._attitude.attitude(times),
            self._attitude.rate(times),
        )
