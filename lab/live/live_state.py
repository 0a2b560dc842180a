"""Live state: what the live navigator knows now, its history for plots, and what a rest is updated from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.data.streams.intake import Counts
from lab.data.streams.rolling import Rolling
from lab.motion.frames.rotation import euler_from_quaternion, euler_jacobian
from lab.navigation.filters.error_models import ATT
from lab.navigation.solution import Imu

WAITING: Final = "waiting"
"""No sample has come."""
ALIGNING: Final = "aligning"
"""There is no attitude yet."""
ATTITUDE_ONLY: Final = "attitude only"
"""Attitude without a position of its own."""
NAVIGATING: Final = "navigating"
"""The full solution, with recent fixes."""
COASTING: Final = "coasting"
"""The full solution without recent fixes: σ grows."""
PHASES: Final = (WAITING, ALIGNING, ATTITUDE_ONLY, NAVIGATING, COASTING)
"""All phases, in their usual order."""

_OFF_DIAGONAL: Final = ((0, 1), (0, 2), (1, 2))
"""Elements of a symmetric matrix that a solution keeps beside its diagonal."""


def _unknown_values(count: int = 3) -> FloatArray:
    return np.full(count, np.nan)


@dataclass(frozen=True)
class LiveState:
    """What the navigator knows at a time. Unknown numbers are NaN.

    Attributes
    ----------
    phase, reason : str
        One of `PHASES`, and a sentence why it is that one.
    time : float
        Time of the last sample, in the clock of the host [s].
    position, position_sigma : (3,) arrays
        Latitude, longitude [rad], height [m]; σ north, east, down [m].
    displacement, displacement_sigma : (3,) arrays
        North, east, down [m] since the last rest, without fixes and as long as it means something.
    velocity_n, velocity_sigma : (3,) arrays
        North, east, down [m/s].
    euler, euler_sigma : (3,) arrays
        Roll, pitch, heading [rad]. A heading that nothing shows is relative: its σ is π or more.
    position_covariance, attitude_covariance : (3, 3) arrays
        Covariance of the position north, east, down [m²], and of the attitude as a small rotation about
        north, east, down [rad²].
    rate : (3,) array
        Angular rate forward, right, down over the last step, without the estimated bias [rad/s].
    heading_source : str
        What shows the heading; empty if nothing does.
    bias, bias_sigma : (6,) arrays
        Gyros [rad/s], then accelerometers [m/s²].
    is_at_rest : bool
        Whether the vehicle stands still as far as is known.
    fix_time : float
        Time of validity of the last fix that arrived [s].
    utc_offset : float
        UTC since 1970, as the last fix with a date says it, minus the clock of the host [s].
    is_above_sea : bool or None
        Whether heights are above sea level, and not above the ellipsoid; None before the first fix.
    innovation, innovation_sigma : (6,) arrays
        Of the last fix used or rejected, position [m] and velocity [m/s] north, east, down: navigator minus
        GPS.
    fixes_used, fixes_rejected, fixes_refused : int
        Fixes used; rejected by the gate; without a position, late beyond use or not in order.
    rows : Counts
        What became of the rows of the IMU.
    remarks : tuple of str
        What a user should know about this stream.
    """

    phase: str
    reason: str
    time: float = np.nan
    position: FloatArray = field(default_factory=_unknown_values)
    position_sigma: FloatArray = field(default_factory=_unknown_values)
    displacement: FloatArray = field(default_factory=_unknown_values)
    displacement_sigma: FloatArray = field(default_factory=_unknown_values)
    velocity_n: FloatArray = field(default_factory=_unknown_values)
    velocity_sigma: FloatArray = field(default_factory=_unknown_values)
    euler: FloatArray = field(default_factory=_unknown_values)
    euler_sigma: FloatArray = field(default_factory=_unknown_values)
    position_covariance: FloatArray = field(default_factory=lambda: np.full((3, 3), np.nan))
    attitude_covariance: FloatArray = field(default_factory=lambda: np.full((3, 3), np.nan))
    rate: FloatArray = field(default_factory=_unknown_values)
    heading_source: str = ""
    bias: FloatArray = field(default_factory=lambda: _unknown_values(6))
    bias_sigma: FloatArray = field(default_factory=lambda: _unknown_values(6))
    is_at_rest: bool = False
    fix_time: float = np.nan
    utc_offset: float = np.nan
    is_above_sea: bool | None = None
    innovation: FloatArray = field(default_factory=lambda: _unknown_values(6))
    innovation_sigma: FloatArray = field(default_factory=lambda: _unknown_values(6))
    fixes_used: int = 0
    fixes_rejected: int = 0
    fixes_refused: int = 0
    rows: Counts = field(default_factory=Counts)
    remarks: tuple[str, ...] = ()


class LiveHistory(NamedTuple):
    """Rows of the history: as they were shown at the time, never changed later.

    Attributes
    ----------
    time : (n,) array
        Times of the samples, in the clock of the host [s].
    phase : (n,) array
        Number of the phase in `PHASES`.
    position : (n, 3) array
        Latitude, longitude [rad], height [m]; NaN without a position.
    velocity_n : (n, 3) array
        Velocity north, east, down [m/s]; NaN without a position.
    euler, euler_sigma : (n, 3) arrays
        Roll, pitch, heading [rad] and their σ.
    bias : (n, 6) array
        Biases of gyros [rad/s] and accelerometers [m/s²].
    sigma : (n, 15) array
        σ of the errors, in the order of `lab.navigation.filters.error_models.STATES`.
    fix_time : (m,) array
        Times of validity of fixes, in the clock of the host [s].
    innovation, innovation_covariance : (m, 6) and (m, 6, 6) arrays
        Innovations of the fixes and their covariance S.
    rejected : (m,) array
        Whether the gate rejected the fix.
    """

    time: FloatArray
    phase: NDArray[np.int64]
    position: FloatArray
    velocity_n: FloatArray
    euler: FloatArray
    euler_sigma: FloatArray
    bias: FloatArray
    sigma: FloatArray
    fix_time: FloatArray
    innovation: FloatArray
    innovation_covariance: FloatArray
    rejected: NDArray[np.bool_]


class HistoryCursor(NamedTuple):
    """How much of the history was read: numbers of rows and of fixes."""

    row: int = 0
    fix: int = 0


def euler_with_sigma(
    q_nb: FloatArray, variance: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return roll, pitch, heading and their σ, (n, 3) each [rad].

    Parameters
    ----------
    q_nb : (n, 4) array
        Attitudes.
    variance : (n, 15) or (n, 21) array
        Diagonals of P.
    covariance : (n, 2, 3) array
        Elements (0, 1), (0, 2), (1, 2) of the blocks of position and attitude.
    """
    euler = euler_from_quaternion(q_nb)
    P = symmetric(variance[:, 6:9], covariance[:, 1])
    J = euler_jacobian(euler)
    shown = np.einsum("nij,njk,nik->ni", J, P, J)
    return euler, np.sqrt(np.maximum(shown, 0.0))


def symmetric(diagonal: FloatArray, others: FloatArray) -> FloatArray:
    """Return symmetric matrices (n, 3, 3).

    Parameters
    ----------
    diagonal, others : (n, 3) arrays
        Their diagonals, and their elements (0, 1), (0, 2), (1, 2).
    """
    P = np.zeros((len(diagonal), 3, 3))
    P[:, range(3), range(3)] = diagonal
    for k, (i, j) in enumerate(_OFF_DIAGONAL):
        P[:, i, j] = P[:, j, i] = others[:, k]
    return P


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


def imu_between(samples: Rolling, first: int, last: int) -> Imu:
    """Return the increments of a stream from one sample to another."""
    return Imu(
        samples.rows("time", first, last + 1),
        samples.rows("dtheta", first + 1, last + 1),
        samples.rows("dvelocity", first + 1, last + 1),
    )
