"""Attitude curve: twice-differentiable curves of attitudes, by a rotation spline or by Euler angles."""

from __future__ import annotations

from typing import Literal, Protocol, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames import rotation
from lab.motion.kinematics.rotation_spline import RotationSpline
from lab.motion.kinematics.spline_windows import CubicCurve, SplineWindows

AttitudeKind = Literal["rotation", "euler"]

ATTITUDE_CURVES = get_args(AttitudeKind)


class AttitudeCurve(Protocol):
    """A twice-differentiable curve of attitudes."""

    def attitude(self, times: FloatArray) -> Rotation:
        """Return C_nb at the times."""

    def rate(self, times: FloatArray) -> FloatArray:
        """Return ω_nb,b (n, 3) at the times [rad/s]."""

    @property
    def nbytes(self) -> int:
        """Memory of the curve's coefficients [bytes]."""


class RotationCurve:
    """A `RotationSpline` through the attitudes: no gimbal lock, nothing to unwrap.

    Parameters
    ----------
    times : (n,) array
        Knots [s].
    attitudes
        n rotations C_nb; or another curve that this one interpolates.
    """

    def __init__(self, times: FloatArray, attitudes: Rotation | RotationCurve) -> None:
        def make(part: slice) -> RotationSpline:
            knots = times[part]
            given = attitudes.attitude(knots) if isinstance(attitudes, RotationCurve) else attitudes[part]
            return RotationSpline(knots, given.as_quat(scalar_first=True))

        self._spline = SplineWindows(times, make)
        # A curve of one window already exists.
        self._through = None if self._spline.only else attitudes

    def attitude(self, times: FloatArray) -> Rotation:
        """Return C_nb at the times."""
        q_nb = self._spline(times, lambda spline, at: spline.attitude(at))
        return Rotation.from_quat(q_nb, scalar_first=True)

    def rate(self, times: FloatArray) -> FloatArray:
        """Return ω_nb,b (n, 3) at the times [rad/s]."""
        return self._spline(times, lambda spline, at: spline.rate(at))

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


def attitude_curve(time: FloatArray, euler: FloatArray, kind: AttitudeKind) -> RotationCurve | EulerCurve:
    """Return the curve through recorded Euler angles with knots at the recorded times.

    Parameters
    ----------
    time : (n,) array
        Recorded times [s].
    euler : (n, 3) array
        Roll, pitch, yaw [rad].
    kind
        "rotation" for a rotation spline, "euler" for cubic splines on the Euler angles.
    """
    if kind == "rotation":
        return RotationCurve(
            time, Rotation.from_quat(rotation.quaternion_from_euler(euler), scalar_first=True)
        )
    # A spline through angles that jump by a turn would swing between them.
    return EulerCurve(time, np.unwrap(euler, axis=0))
