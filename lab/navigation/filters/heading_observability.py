"""Heading observability: whether a measurement shows the heading by the motion, or at most by chance.

Fixes show the heading by horizontal acceleration, and the gyro bias about the vertical by turns. A vehicle
that goes straight has neither. The filter does not know that: it linearises about the estimated motion, in
which noise of the gyros tilts the specific force to and fro. A velocity error δv of another cause then seems
to belong to a heading error φ as φ × δv does, although this product of two errors shows neither. Over
minutes, σ of the heading falls while its error grows.

So what a measurement would show of the heading is compared with what the errors of position, velocity and
tilt would make it show by chance. If it is not more, heading and vertical gyro bias keep their estimates,
variances and covariance in the update, as the parameters of Schmidt's filter do. Their correlations with all
other states remain, so that nothing is lost once the vehicle turns or accelerates.

The backward pass of a smoother is that of optimal updates. So a smoother finds such fixes in a first pass; in
a second one, its F has no heading before them (`held_heading.straighten`).

References
----------
S. F. Schmidt, *Application of state-space methods to navigation problems*, Advances in Control Systems 3
(1966); G. P. Huang, A. I. Mourikis, S. I. Roumeliotis, *Observability-based rules for designing consistent
EKF SLAM estimators*, Int. J. Robotics Research 29 (2010).
"""

from __future__ import annotations

import math

import numpy as np

from lab.base.arrays import FloatArray
from lab.navigation.kernels.compilation import allocating_kernel, kernel
from lab.navigation.kernels.propagation import NAV
from lab.navigation.strapdown import Vector, cross, get, put

CHANCE = 2.5
"""Response of a measurement to the heading above which it counts, in σ of what it would be by chance. Errors
of the heading after 15 minutes of level flight are 1.1 σ with 2, and 1.0 σ with 2.5. A start with a heading
σ of 60° is found by the take-off run as without this rule (NEES 1.0), with 3 a little worse (1.1)."""
UNKNOWN = math.pi**2
"""Variance of a heading that is known no better than by chance [rad²]: more is not held, where P is so
large that its differences are rounding."""
LEVEL = 1e-4
"""Least variance by chance of a row of H that is level, as a part of the row's own variance: that of a
vertical position or velocity is 10⁻⁶ or less, and shows no heading."""
LINEAR = math.radians(10.0)
"""Largest σ of the heading for which its effect on the tilts by the Earth's rate is linear, for a smoother
[rad]. In 15 minutes of cruise with the default gyro, errors of the smoothed heading are 1.1 σ, as those of
the filter (40 seeds); with 20°, they are 1.2 σ, and 1.4 σ with a factor exp(−σ²/2) instead."""
DIRECTIONS = 2
"""Directions of the states that are kept: of the heading, and of the gyro biases. Other states turn the
heading too little for chance to matter: it shows some 0.1/rad² with each fix."""


@kernel
def write_directions(own: Vector, down: Vector, P: FloatArray, D: FloatArray) -> None:
    """Write the directions (2, n) of heading and vertical gyro bias among the states.

    Parameters
    ----------
    own
        The vertical in the coordinates of the filter's attitude error.
    down
        The vertical in b.
    P : (n, ≥ n) array
        Covariance: a gyro bias that is certain has no part in the vertical one.
    D
        Receives a unit vector in each row.
    """
    for k in range(DIRECTIONS):
        for j in range(D.shape[1]):
            D[k, j] = 0.0
    put(D[0], NAV - 3, own)
    square = 0.0
    for i in range(3):
        if P[NAV + i, NAV + i] > 0:
            D[1, NAV + i] = down[i]
            square += down[i] * down[i]
    if square > 0:
        for i in range(3):
            D[1, NAV + i] /= math.sqrt(square)


@kernel
def covariance_along(P: FloatArray, D: FloatArray, k: int, m: int) -> float:
    """Return the covariance of the states along two of the directions."""
    total = 0.0
    for i in range(D.shape[1]):
        if D[k, i] != 0:
            for j in range(D.shape[1]):
                if D[m, j] != 0:
                    total += D[k, i] * D[m, j] * P[i, j]
    return total


@kernel
def chance_variance(P: FloatArray, row: FloatArray, own: Vector) -> float:
    """Return the variance of what a row of H would show per radian of heading by chance.

    It is that of row · (δr × d, δv × d, φ × d) with the vertical d and the errors of the filter, less the
    part of these that comes from the heading itself.
    """
    total, with_heading, heading = 0.0, 0.0, 0.0
    for a in range(0, NAV, 3):
        turned = cross(get(row, a), own)
        if turned[0] == 0 and turned[1] == 0 and turned[2] == 0:
            continue  # H is sparse
        for i in range(3):
            for j in range(3):
                with_heading += turned[i] * P[a + i, NAV - 3 + j] * own[j]
        for b in range(0, NAV, 3):
            other = cross(get(row, b), own)
            if other[0] == 0 and other[1] == 0 and other[2] == 0:
                continue
            for i in range(3):
                for j in range(3):
                    total += turned[i] * P[a + i, b + j] * other[j]
    for i in range(3):
        for j in range(3):
            heading += own[i] * P[NAV - 3 + i, NAV - 3 + j] * own[j]
    return total - with_heading * with_heading / heading if heading > 0 else total


@kernel
def shows_heading(
    P: FloatArray, H: FloatArray, most: FloatArray, rows: int, own: Vector, D: FloatArray
) -> bool:
    """Return whether a measurement shows heading or vertical gyro bias more than by chance.

    Parameters
    ----------
    P : (n, ≥ n) array
        Covariance before the update.
    H : (≥ rows, ≥ n) array
        Measurement matrix, for the filter's own errors.
    most : (≥ rows, ≥ rows) array
        Its diagonal is the largest variance by chance of each row: that of the innovation for a linear
        filter, and that of the measurement for one with sigma points, in whose P a large heading error also
        spreads the velocity to both sides alike, which is not chance.
    rows
        How many numbers are measured.
    own, D
        As of `write_directions`.
    """
    n, heading = D.shape[1], covariance_along(P, D, 0, 0)
    more = heading > UNKNOWN
    for m in range(rows):
        chance, own_variance = min(chance_variance(P, H[m], own), most[m, m]), 0.0
        for i in range(n):
            if H[m, i] != 0:
                for j in range(n):
                    if H[m, j] != 0:
                        own_variance += H[m, i] * P[i, j] * H[m, j]
        for k in range(DIRECTIONS):
            response, direct = 0.0, 0.0
            for i in range(n):
                direct += H[m, i] * D[k, i]
                if H[m, i] != 0:
                    for j in range(n):
                        if D[k, j] != 0:
                            response += H[m, i] * P[i, j] * D[k, j]
            if k == 0:
                # What of it is left if the heading is known.
                own_variance -= response * response / heading
            if direct != 0 or chance > LEVEL * own_variance:
                limit = CHANCE * CHANCE * heading * chance * covariance_along(P, D, k, k)
                more |= response * response > limit
    return more


@kernel
def take_covariance(P: FloatArray, D: FloatArray, kept: FloatArray) -> None:
    """Write the covariance (2, ≥ 2) of the states along the directions."""
    for k in range(DIRECTIONS):
        for m in range(DIRECTIONS):
            kept[k, m] = covariance_along(P, D, k, m)


@allocating_kernel
def put_back_covariance(P: FloatArray, D: FloatArray, kept: FloatArray) -> None:
    """Give the states along the directions a covariance (2, ≥ 2); those with other states stay.

    With the gain K of an optimal update, Schmidt's is K − Dᵀ D K, and P is larger by Dᵀ (D K S Kᵀ Dᵀ) D,
    which is what the optimal update had taken off.
    """
    now = np.empty((DIRECTIONS, DIRECTIONS))
    take_covariance(P, D, now)
    n = D.shape[1]
    for i in range(n):
        for j in range(i, n):
            p = P[i, j]
            for k in range(DIRECTIONS):
                for m in range(DIRECTIONS):
                    p += D[k, i] * (kept[k, m] - now[k, m]) * D[m, j]
            P[i, j] = p
            P[j, i] = p


@kernel
def remove_directions(gain: FloatArray, D: FloatArray) -> None:
    """Remove the components along the directions from a gain, or from an estimate, (n,)."""
    for k in range(DIRECTIONS):
        along = 0.0
        for i in range(D.shape[1]):
            along += D[k, i] * gain[i]
        for i in range(D.shape[1]):
            gain[i] -= D[k, i] * along
