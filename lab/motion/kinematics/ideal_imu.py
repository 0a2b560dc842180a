"""Ideal IMU: the inputs of a perfect strapdown IMU, and its increments.

The functions take geodetic coordinates and their exact time derivatives, so velocity, acceleration, angular
rate and specific force belong to the same motion.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 2 and
5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.base.histories import shrink_history
from lab.motion.frames import earth
from lab.motion.frames.displacement import metres_per_radian

GAUSS_NODES = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
"""Nodes of the three-point Gauss quadrature on the interval from 0 to 1."""
GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18
"""Their weights."""
AT_ONCE = 2**16
"""Intervals that are integrated in one block, with some 2 kB of temporary memory each."""


@dataclass(frozen=True)
class IdealImu:
    """The output of a perfect strapdown IMU: the integrals of its inputs over each sample interval.

    Attributes
    ----------
    time : (n + 1,) array
        Ends of the intervals, beginning with 0 [s].
    dtheta : (n, 3) array
        Integral of the angular rate ω_ib,b from ``time[k]`` to ``time[k + 1]`` [rad].
    dvelocity : (n, 3) array
        Integral of the specific force f_b over the same interval [m/s].
    dt : float
        Length of every interval [s].
    """

    time: FloatArray
    dtheta: FloatArray
    dvelocity: FloatArray
    dt: float

    def as_kept(self) -> IdealImu:
        """Return a copy for storage in a result: for a long flight, the increments are float32."""
        return replace(self, dtheta=shrink_history(self.dtheta), dvelocity=shrink_history(self.dvelocity))

    def part(self, first: int, last: int) -> IdealImu:
        """Return the output between the samples `first` and `last`, without the latter."""
        intervals = slice(first, last - 1)
        return replace(
            self,
            time=self.time[first:last],
            dtheta=self.dtheta[intervals],
            dvelocity=self.dvelocity[intervals],
        )

    def copy(self) -> IdealImu:
        """Return a copy that shares no memory."""
        return replace(
            self, time=self.time.copy(), dtheta=self.dtheta.copy(), dvelocity=self.dvelocity.copy()
        )

    def to_compute_on(self) -> IdealImu:
        """Return the increments in float64."""
        return replace(
            self,
            dtheta=self.dtheta.astype(np.float64, copy=False),
            dvelocity=self.dvelocity.astype(np.float64, copy=False),
        )


def velocity(position: FloatArray, rate: FloatArray) -> FloatArray:
    """Return velocity_n (n, 3) over the Earth [m/s] (Groves 2.111, solved for the velocity).

    Parameters
    ----------
    position : (n, 3) array
        Latitude, longitude [rad] and height [m].
    rate : (n, 3) array
        Their derivatives in time [rad/s], [m/s].
    """
    per_latitude, per_longitude = metres_per_radian(position[:, 0], position[:, 2])
    return np.stack((rate[:, 0] * per_latitude, rate[:, 1] * per_longitude, -rate[:, 2]), axis=-1)


def acceleration(position: FloatArray, rate: FloatArray, second: FloatArray) -> FloatArray:
    """Return dv_n/dt (n, 3): the derivative of each component of `velocity` [m/s²].

    Parameters
    ----------
    position, rate, second : (n, 3) arrays
        Latitude, longitude [rad] and height [m], and their first and second derivatives in time.
    """
    s, c = np.sin(position[:, 0]), np.cos(position[:, 0])
    meridian, transverse = earth.radii(s)
    # dM/dL = 3 M e² s c / (1 − e² s²) and dN/dL = N e² s c / (1 − e² s²), from Groves 2.105 and 2.106.
    bend = earth.ECCENTRICITY_SQUARED * s * c / (1 - earth.ECCENTRICITY_SQUARED * s * s) * rate[:, 0]
    meridian_rate = 3 * meridian * bend + rate[:, 2]
    transverse_rate = transverse * bend + rate[:, 2]
    meridian, transverse = meridian + position[:, 2], transverse + position[:, 2]
    north = second[:, 0] * meridian + rate[:, 0] * meridian_rate
    east = (second[:, 1] * transverse + rate[:, 1] * transverse_rate) * c - rate[
        :, 1
    ] * transverse * s * rate[:, 0]
    return np.stack((north, east, -second[:, 2]), axis=-1)


def inputs(
    position: FloatArray, rate: FloatArray, second: FloatArray, attitude: Rotation, omega_nb_b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return ω_ib,b [rad/s] and the specific force f_b [m/s²], (n, 3) each (Groves 5.53, solved for f).

    Parameters
    ----------
    position, rate, second : (n, 3) arrays
        Latitude, longitude [rad] and height [m], and their first and second derivatives in time.
    attitude
        n rotations C_nb.
    omega_nb_b : (n, 3) array
        Angular rate of the body relative to n, resolved in the body frame [rad/s].
    """
    s, c = np.sin(position[:, 0]), np.cos(position[:, 0])
    omega_ie_n = earth.RATE * np.stack((c, np.zeros_like(c), -s), axis=-1)
    # By the rates of longitude and latitude themselves: no radius is needed.
    omega_en_n = np.stack((rate[:, 1] * c, -rate[:, 0], -rate[:, 1] * s), axis=-1)
    f_n = acceleration(position, rate, second) + np.cross(
        2 * omega_ie_n + omega_en_n, velocity(position, rate)
    )
    # Gravity points down; specific force is what is left of the acceleration without it.
    f_n[:, 2] -= earth.gravity(s, position[:, 2])
    return omega_nb_b + attitude.apply(omega_ie_n + omega_en_n, inverse=True), attitude.apply(
        f_n, inverse=True
    )


def integrate(
    rates: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    intervals: int,
    knot_rate: float,
    rate: float,
) -> IdealImu:
    """Return the integrals of angular rate and specific force over the sample intervals.

    The integral is a three-point Gauss-Legendre quadrature between the knots of the curve, where it is
    smooth.

    Parameters
    ----------
    rates
        Returns ω_ib,b and f_b (n, 3) at n times.
    intervals
        Number of intervals between knots.
    knot_rate
        Knots per second, evenly spaced from time 0 [Hz].
    rate
        Samples per second [Hz]; a divisor or a multiple of `knot_rate`, so that every knot ends an interval.

    Raises
    ------
    ValueError
        If the rate does not fit the knots.
    """
    merge, split = _fit(rate, knot_rate)
    step = 1 / (knot_rate * split)
    samples = intervals * split // merge
    dtheta, dvelocity = np.empty((samples, 3)), np.empty((samples, 3))
    at_once = max(AT_ONCE // merge, 1)
    for first in range(0, samples, at_once):
        part = slice(first, min(first + at_once, samples))
        knots = np.arange(part.start * merge, part.stop * merge)
        # Three times inside each interval between knots: a quadrature over a knot would lose its order.
        omega_ib_b, f_b = rates(((knots[:, None] + GAUSS_NODES) * step).ravel())
        for values, out in ((omega_ib_b, dtheta), (f_b, dvelocity)):
            increments = step * np.einsum("kgi,g->ki", values.reshape(-1, 3, 3), GAUSS_WEIGHTS)
            out[part] = increments.reshape(-1, merge, 3).sum(axis=1)
    return IdealImu(time=np.arange(samples + 1) / rate, dtheta=dtheta, dvelocity=dvelocity, dt=1 / rate)


def _fit(rate: float, knot_rate: float) -> tuple[int, int]:
    """Return the number of knot intervals per sample, and of samples per knot interval."""
    if rate > 0:
        merge, split = max(1, round(knot_rate / rate)), max(1, round(rate / knot_rate))
        if abs(knot_rate * split - rate * merge) < 1e-9 * knot_rate:
            return merge, split
    raise ValueError(
        f"rate {rate:g} Hz does not fit the trajectory's grid of {knot_rate:g} Hz; accepted: its divisors "
        "and multiples. For another rate build the trajectory with that imu_rate"
    )
