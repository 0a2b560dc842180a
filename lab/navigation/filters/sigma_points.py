"""Sigma points: a navigator and its covariance as 2 n navigators, and the inverse; attitudes on SO(3).

A sigma point is a possible truth: the navigator minus an error from its covariance, with an exact rotation
for the attitude. The navigators compute in a wander-azimuth frame (`wander`), and the errors are those of
the computer frame, resolved in the frame of the navigator.

The transform is the scaled one with α = 1, β = 0, κ = 3 − n for n states: the points lie at √3 σ, where they
have the fourth moment of the normal distribution, weigh 1/6 each, and the centre 1 − n/3. A negative weight
can make a covariance indefinite, but not here: except for the small products of scale factors with rates and
forces, the kinematics are nonlinear only in the attitude. The root of P has the attitude first, so that the
attitude varies in six points only, and their weights sum to one.

References
----------
S. J. Julier, J. K. Uhlmann, H. F. Durrant-Whyte, *A new method for the nonlinear transformation of means and
covariances in filters and estimators*, IEEE Trans. AC 45 (2000); S. J. Julier, *The scaled unscented
transformation*, ACC 2002; E. Kraft, *A quaternion-based unscented Kalman filter for orientation tracking*,
FUSION 2003 (mean of attitudes); J. L. Crassidis, F. L. Markley, *Unscented filtering for spacecraft attitude
estimation*, JGCD 26 (2003); M. W. Mueller, M. Hehn, R. D'Andrea, *Covariance correction step for Kalman
filtering with an attitude*, JGCD 40 (2017).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.navigation import strapdown, wander
from lab.navigation.kernels.compilation import inline_kernel, kernel
from lab.navigation.kernels.lane_points import view_point
from lab.navigation.strapdown import (
    Q_NB,
    VELOCITY,
    Quaternion,
    Vector,
    get,
    matrix,
    product,
    put,
    rotate,
    rotation,
    unit,
)
from lab.navigation.wander import Q_EW, displacement_from, put_quaternion, quaternion

SPREAD = math.sqrt(3)
"""Distance of the sigma points from the centre, in σ: √(n + κ)."""
WEIGHT = 1 / 6
"""Weight of each sigma point but the centre, 1 / (2 (n + κ))."""
ROUNDS = 20
"""Largest number of iterations for a mean attitude; five are enough for errors of 60°."""
CONVERGED = 1e-12
"""Step of the iteration at which it ends [rad]."""


@kernel
def cholesky(P: FloatArray, order: NDArray[np.int64], root: FloatArray) -> None:
    """Write the root of P, P = root rootᵀ, which is lower triangular with its rows in the given order.

    A state whose variance is explained by the states before it gets a column of zeros.
    """
    for j in range(order.size):
        row = order[j]
        pivot = P[row, row]
        for k in range(j):
            pivot -= root[row, k] * root[row, k]
        root[row, j] = math.sqrt(pivot) if pivot > 1e-14 * P[row, row] else 0.0
        per_pivot = 1 / root[row, j] if root[row, j] > 0 else 0.0
        for i in range(j + 1, order.size):
            total = P[order[i], row]
            for k in range(j):
                total -= root[order[i], k] * root[row, k]
            root[order[i], j] = total * per_pivot


@inline_kernel
def rotation_vector(p: Quaternion, q: Quaternion) -> Vector:
    """Return the rotation vector of p ⊗ q*, no longer than π."""
    w, x, y, z = product(p, conjugate(q))
    sine = math.sqrt(x * x + y * y + z * z)
    size = 2 * math.atan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0
    # q and −q are one rotation: the sign of w chooses its shorter vector.
    f = math.copysign(size, w)
    return f * x, f * y, f * z


@inline_kernel
def conjugate(q: Quaternion) -> Quaternion:
    """Return q*, the opposite rotation."""
    return q[0], -q[1], -q[2], -q[3]


@kernel
def displace(state: FloatArray, x: FloatArray, places: NDArray[np.int64]) -> None:
    """Subtract an error x from a navigator, with exact rotations (`wander.displace`).

    Parameters
    ----------
    state
        The navigator, changed in place.
    x : (n,) array
        The error.
    places : (n − 9,) array
        Where the estimates of the states from the biases on are in the state of the navigator.
    """
    wander.displace(state, x)
    for i in range(9, x.size):
        state[places[i - 9]] -= x[i]


@kernel
def transport(P: FloatArray, phi: Vector) -> None:
    """Transform P to the attitude corrected by φ: the error is then J (error − φ).

    J is the left Jacobian of SO(3) (Mueller et al. 2017), J = I + (1 − cos φ)/φ² [φ×] + (φ − sin φ)/φ³ [φ×]².
    """
    square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    angle = math.sqrt(square)
    if angle < 1e-3:
        first, second = 0.5 - square / 24, 1 / 6 - square / 120
    else:
        first, second = (1 - math.cos(angle)) / square, (angle - math.sin(angle)) / (angle * square)
    # J P, column by column; then (J P) Jᵀ, row by row.
    for i in range(P.shape[0]):
        a = (P[6, i], P[7, i], P[8, i])
        turned = strapdown.cross(phi, a)
        a = strapdown.plus(strapdown.plus(a, first, turned), second, strapdown.cross(phi, turned))
        P[6, i], P[7, i], P[8, i] = a
    for i in range(P.shape[0]):
        a = get(P[i], 6)
        turned = strapdown.cross(phi, a)
        put(P[i], 6, strapdown.plus(strapdown.plus(a, first, turned), second, strapdown.cross(phi, turned)))
    for i in range(P.shape[0]):
        for j in range(6, 9):
            P[j, i] = P[i, j]


@kernel
def draw_sigma_points(
    state: FloatArray,
    P: FloatArray,
    order: NDArray[np.int64],
    root: FloatArray,
    x: FloatArray,
    points: FloatArray,
    places: NDArray[np.int64],
) -> None:
    """Write the sigma points: the navigator minus ± √3 times each column of the root of P.

    Parameters
    ----------
    state : (LENGTH,) array
        The navigator.
    P : (n, n) array
        Covariance of its error.
    order : (n,) array
        Order of the states in the root.
    root, x : (n, n) and (n,) arrays
        Workspace; zeros at first.
    points
        Receives the 2 n sigma points, see `lane_points`.
    places : (n − 9,) array
        As of `displace`.
    """
    n = x.size
    cholesky(P, order, root)
    for point in range(2 * n):
        size = SPREAD if point < n else -SPREAD
        for i in range(n):
            x[i] = size * root[i, point % n]
        there = view_point(points, point)
        for i in range(state.size):
            there[i] = state[i]
        displace(there, x, places)


@kernel
def gather(
    state: FloatArray,
    points: FloatArray,
    deviations: FloatArray,
    attitudes: FloatArray,
    x: FloatArray,
    P: FloatArray,
    places: NDArray[np.int64],
) -> None:
    """Write mean and covariance of the sigma points.

    Parameters
    ----------
    state : (LENGTH,) array
        The navigator, the centre of the points.
    points
        The 2 n sigma points, see `lane_points`.
    deviations, attitudes : (2 n, n) and (2 n, 4) arrays
        Workspace.
    x : (n,) array
        Receives the error of the navigator relative to the mean.
    P : (n, n) array
        Receives the covariance of the error of the mean.
    places : (n − 9,) array
        As of `displace`.
    """
    n = x.size
    for point in range(2 * n):
        _difference(state, view_point(points, point), deviations[point], attitudes[point], places)
    q = _mean_attitude(quaternion(state, Q_NB), attitudes)
    centre = rotation_vector(quaternion(state, Q_NB), q)
    for i in range(n):
        x[i] = 0.0
    for point in range(2 * n):
        deviation = deviations[point]
        phi = rotation_vector(quaternion(attitudes[point], 0), q)
        for i in range(3):
            deviation[6 + i] = phi[i] - centre[i]
        for i in range(n):
            x[i] += WEIGHT * deviation[i]
    # The same as the sum above, by the definition of the mean attitude, without its rounding.
    put(x, 6, (-centre[0], -centre[1], -centre[2]))
    # The deviations d are from the centre, which deviates from the mean by −x: the weighted sum of squares
    # about the mean, including the centre, is that of d minus x xᵀ.
    for i in range(n):
        for j in range(i + 1):
            P[i, j] = 0.0
    for point in range(2 * n):
        for i in range(n):
            weighted = WEIGHT * deviations[point, i]
            for j in range(i + 1):
                P[i, j] += weighted * deviations[point, j]
    for i in range(n):
        for j in range(i + 1):
            P[i, j] -= x[i] * x[j]
            P[j, i] = P[i, j]


@inline_kernel
def _difference(
    state: FloatArray, truth: FloatArray, x: FloatArray, attitude: FloatArray, places: NDArray[np.int64]
) -> None:
    """Write the error of a navigator relative to another one as truth, and the attitude of that other one.

    Both are resolved in the frame of the navigator, as `wander.displace` takes them. The error of the
    attitude is left out.
    """
    turn = product(conjugate(quaternion(truth, Q_EW)), quaternion(state, Q_EW))
    # Rotation vector of a turn of a few milliradians at most, to 10⁻¹⁵.
    f = 2 * (1 + (turn[1] * turn[1] + turn[2] * turn[2]) / 6)
    # The verticals differ by u = K δr = (−δθ_y, δθ_x).
    offset = displacement_from(state, (f * turn[2], -f * turn[1], 0.0), truth[strapdown.HEIGHT])
    C = matrix(conjugate(turn))
    v = rotate(C, get(truth, VELOCITY))
    put_quaternion(attitude, 0, product(conjugate(turn), quaternion(truth, Q_NB)))
    for i in range(3):
        x[i] = offset[i]
        x[3 + i] = state[VELOCITY + i] - v[i]
        x[6 + i] = 0.0
    for i in range(9, x.size):
        x[i] = state[places[i - 9]] - truth[places[i - 9]]


@inline_kernel
def _mean_attitude(centre: Quaternion, attitudes: FloatArray) -> Quaternion:
    """Return the attitude from which the weighted rotation vectors to all points sum to zero (Kraft)."""
    q = centre
    at_centre = 1 - WEIGHT * attitudes.shape[0]
    for _ in range(ROUNDS):
        a, b, c = rotation_vector(centre, q)
        a, b, c = at_centre * a, at_centre * b, at_centre * c
        for point in range(attitudes.shape[0]):
            phi = rotation_vector(quaternion(attitudes[point], 0), q)
            a, b, c = a + WEIGHT * phi[0], b + WEIGHT * phi[1], c + WEIGHT * phi[2]
        q = unit(product(rotation((a, b, c)), q))
        if abs(a) + abs(b) + abs(c) < CONVERGED:
            break
    return q
