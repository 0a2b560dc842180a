"""Start covariance: P0 of a navigator that starts by its fixes and its accelerometers.

The start errs by what it was found with, so its errors are correlated. Levelled accelerometers with the
error b give a tilt of b/g, so P0 has their covariance, −σ²/g. A fix tells where the antenna is; the IMU is a
lever arm away, in a direction that errs by the attitude, and the errors of the receiver that the filter
estimates displace it. The heading may be known so poorly that its effects are not linear, so second moments
are averaged over it.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 5.6.2
(5.96, levelling), 14.3 (lever arm); M. Abramowitz, I. A. Stegun, *Handbook of Mathematical Functions*,
25.4.46 (Gauss-Hermite quadrature).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.motion.frames.rotation import skew
from lab.navigation.alignment.alignment import Alignment, antenna
from lab.navigation.alignment.initial_heading import heading_error_direction, mean_turned
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Belief
from lab.sensors.imu_errors import OFF_DIAGONAL

_NODES = 60
"""Headings over which moments are averaged: enough for the second harmonic of a σ of 180°."""


def start_covariance(
    assumed: Belief,
    navigator: NavigatorSettings,
    names: Sequence[str],
    start: Alignment,
    variances: FloatArray,
) -> FloatArray:
    """Return the covariance (n, n) of the start, or that of the settings if given.

    Parameters
    ----------
    assumed, navigator
        The filter's assumptions, with its lever arm, and its settings.
    names
        Its further blocks of states.
    start
        The start.
    variances : (3,) array
        Variances of the position of the first fix [m²].
    """
    if navigator.p0 is not None:
        return assumed.P0
    independent, scale = assumed.P0.copy(), navigator.p0_scale
    for block, variance in (
        (POS, variances),
        (VEL, start.velocity_sigma**2),
        (ATT, start.attitude_sigma**2 * (1, 1, 0)),
        (GYRO_BIAS, start.gyro_bias_sigma**2),
    ):
        before = np.diag(assumed.P0)[block]
        independent[block], independent[:, block] = 0.0, 0.0
        is_more = block == GYRO_BIAS and not start.rest
        independent[block, block] = np.diag(
            np.maximum(before, scale * variance) if is_more else scale * variance
        )
    effects = _Effects.of(assumed, names, start)
    sigma = np.sqrt(scale) * start.attitude_sigma[2]
    nodes, weights = _quadrature()
    mean, M = effects.at(sigma * nodes, start.attitude_sigma[2])
    # Mean of the covariances given a heading, plus the second moment of the means.
    P = np.tensordot(weights, M @ independent @ M.mT, 1) + (weights * mean.T) @ mean
    return np.asarray((P + P.T) / 2)


@cache
def _quadrature() -> tuple[FloatArray, FloatArray]:
    """Return the nodes (k,) of a standard normal variable, and their weights (k,), whose sum is 1."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    return nodes, weights / weights.sum()


class _Effects(NamedTuple):
    """What the errors of a start consist of.

    Attributes
    ----------
    tilts : (3, n) array
        Effect of levelling's noise and of the accelerometers' errors on the tilts, in the navigator's axes.
    receiver : (6, n) array
        Effect of the receiver's errors on position and velocity.
    arm : (6, n) array
        The same of the errors of arm and rate, in the navigator's axes.
    force_n : (3,) array
        Specific force by which the vehicle was levelled [m/s²].
    shift, swing : (3,) arrays
        Displacement [m] and velocity [m/s] of the antenna relative to the IMU, in the navigator's axes.
    part : float
        Part of a heading error by which tilts are turned: half of it. Without a heading, it is none: the axes
        of the navigator are then as good as any.
    """

    tilts: FloatArray
    receiver: FloatArray
    arm: FloatArray
    force_n: FloatArray
    shift: FloatArray
    swing: FloatArray
    part: float

    @classmethod
    def of(cls, assumed: Belief, names: Sequence[str], start: Alignment) -> _Effects:
        """Return the effects on a filter with some further blocks."""
        n = assumed.P0.shape[0]
        C_nb = Rotation.from_quat(start.start.q_nb, scalar_first=True).as_matrix()
        force = _force_errors(C_nb, start.force_n @ C_nb, names, n)
        # What levelling takes for the force errs by F, and f_n × φ + F has no level part.
        tilts = np.zeros((3, n))
        tilts[0], tilts[1] = -force[1] / start.force_n[2], force[0] / start.force_n[2]
        tilts[0, ATT.start] = tilts[1, ATT.start + 1] = 1.0
        receiver, arm = np.eye(6, n), np.zeros((6, n))
        if blocks.GPS_DRIFT in names:
            receiver[POS, blocks.find_states(names, blocks.GPS_DRIFT)] = -np.eye(3)
        if blocks.LATENCY in names:
            receiver[POS, blocks.find_states(names, blocks.LATENCY)] = start.start.velocity_n[:, None]
        if blocks.LEVER_ARM in names:
            states = blocks.find_states(names, blocks.LEVER_ARM)
            arm[POS, states], arm[VEL, states] = -C_nb, -C_nb @ skew(start.rate)
        if not start.rest:
            arm[VEL, GYRO_BIAS] = -C_nb @ skew(assumed.lever_arm)
        apart = antenna(start.start.q_nb, assumed.lever_arm, start.rate)
        return cls(tilts, receiver, arm, start.force_n, *apart, 0.5 if start.heading.source else 0.0)

    def at(self, angles: FloatArray, sigma: float) -> tuple[FloatArray, FloatArray]:
        """Return the mean error (k, n) for heading errors (k,), and the effect (k, n, n) of the other errors.

        A wrong heading turns the arm by its error. The rotation vector of heading error and tilt has the tilt
        turned by half of it.

        Parameters
        ----------
        angles, sigma
            The heading errors, and the σ with which the start was made [rad].
        """
        k, n = angles.size, self.tilts.shape[1]
        errors = np.outer(angles, heading_error_direction(self.force_n))
        turned, partly = (Rotation.from_rotvec(part * errors).as_matrix() for part in (1.0, self.part))
        mean, M = np.zeros((k, n)), np.tile(np.eye(n), (k, 1, 1))
        mean[:, ATT] = errors
        M[:, ATT] = partly @ self.tilts
        M[:, : VEL.stop] = self.receiver
        for block, vector in ((POS, self.shift), (VEL, self.swing)):
            mean[:, block] = turned @ vector - mean_turned(vector, self.force_n, sigma)
            M[:, block] += turned @ (self.arm[block] - skew(vector) @ self.tilts)
        return mean, M


def _force_errors(C_nb: FloatArray, force: FloatArray, names: Sequence[str], n: int) -> FloatArray:
    """Return the effect (3, n) of the states of the accelerometers on the specific force in n.

    Parameters
    ----------
    C_nb : (3, 3) array
        Attitude.
    force : (3,) array
        Specific force in b [m/s²].
    names, n
        Further blocks and number of states of the filter.
    """
    effect = np.zeros((3, n))
    effect[:, ACCEL_BIAS] = -C_nb
    if blocks.ACCEL_SCALE in names:
        effect[:, blocks.find_states(names, blocks.ACCEL_SCALE)] = -C_nb * force
    if blocks.ACCEL_DRIFT in names:
        effect[:, blocks.find_states(names, blocks.ACCEL_DRIFT)] = -C_nb
    if blocks.ACCEL_MISALIGNMENT in names:
        axes = ["xyz".index(axis) for axis in "".join(OFF_DIAGONAL)]
        states = blocks.find_states(names, blocks.ACCEL_MISALIGNMENT)
        effect[:, states] = -C_nb[:, axes[::2]] * force[axes[1::2]]
    return effect
