"""Anchor: the estimate from which a rest is updated."""

from __future__ import annotations

from typing import NamedTuple

from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.navigation.filters.error_models import ATT


class Anchor(NamedTuple):
    """The estimate at the beginning of a mean: the prior of the update at rest.

    Attributes
    ----------
    time : float
        Time of the stream [s].
    position : (3,) array
        Latitude, longitude [rad], height [m].
    q_nb : (4,) array
        Attitude.
    bias : (6,) array
        Biases of gyros [rad/s] and accelerometers [m/s²].
    P : (15, 15) array
        Covariance.
    """

    time: float
    position: FloatArray
    q_nb: FloatArray
    bias: FloatArray
    P: FloatArray

    def turned(self, turn: float, sigma: float) -> Anchor:
        """Return the estimate turned about the vertical [rad], with a new σ of the heading."""
        turned = Rotation.from_rotvec([0, 0, turn]) * Rotation.from_quat(self.q_nb, scalar_first=True)
        return self._replace(q_nb=turned.as_quat(scalar_first=True), P=with_heading(self.P, sigma))


def with_heading(P: FloatArray, sigma: float) -> FloatArray:
    """Return P with another, independent σ of the attitude about the vertical [rad]."""
    P = P.copy()
    down = ATT.stop - 1
    P[down, :] = P[:, down] = 0.0
    P[down, down] = sigma**2
    return P
