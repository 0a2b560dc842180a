"""Held heading: what a measurement that shows the heading by chance only leaves as it was.

See `heading_observability`. The model of a filter says in which frame its attitude error is.
"""

from __future__ import annotations

import math

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.filters.heading_observability import (
    DIRECTIONS,
    LINEAR,
    put_back_covariance,
    shows_heading,
    take_covariance,
    write_directions,
)
from lab.navigation.kernels.compilation import inline_kernel, kernel
from lab.navigation.kernels.propagation import NAV, STATES, X
from lab.navigation.strapdown import Vector


@inline_kernel
def own_attitude(state: FloatArray, seen: Vector) -> Vector:
    """Return the row of H for the model's own attitude error, given that of the navigation frame's."""
    return seen


@inline_kernel
def own_attitude_in_body(state: FloatArray, seen: Vector) -> Vector:
    """Return the row of H for an attitude error in b, given that for the navigation frame's."""
    return in_body(state, seen)


@inline_kernel
def in_body(state: FloatArray, v: Vector) -> Vector:
    """Return a vector of the navigation frame, resolved in b."""
    at = strapdown.Q_NB
    C = strapdown.matrix((state[at], state[at + 1], state[at + 2], state[at + 3]))
    return (
        C[0][0] * v[0] + C[1][0] * v[1] + C[2][0] * v[2],
        C[0][1] * v[0] + C[1][1] * v[1] + C[2][1] * v[2],
        C[0][2] * v[0] + C[1][2] * v[1] + C[2][2] * v[2],
    )


@kernel
def keeps_heading(
    state: FloatArray, P: FloatArray, H: FloatArray, S: FloatArray, rows: int, D: FloatArray, kept: FloatArray
) -> bool:
    """Return whether a measurement shows the heading by chance at most; write what an update must keep.

    Parameters
    ----------
    state
        The navigator.
    P : (n, n + 1) array
        The covariance, and the estimate in its last column.
    H, S, rows
        The measurement, as for `shows_heading`.
    D : (2, n) array
        Receives the directions of heading and vertical gyro bias.
    kept : (2, 3) array
        Receives covariance and estimate of the states along them.
    """
    vertical = (0.0, 0.0, 1.0)
    own = own_attitude(state, vertical)
    write_directions(own, in_body(state, vertical), P, D)
    if shows_heading(P, H, S, rows, own, D):
        return False
    take_covariance(P, D, kept)
    for k in range(DIRECTIONS):
        # Behind the covariance, the estimate along this direction.
        kept[k, DIRECTIONS] = 0.0
        for i in range(STATES):
            kept[k, DIRECTIONS] += D[k, i] * P[i, X]
    return True


@kernel
def _let_heading_turn_biases(state: FloatArray, P: FloatArray, F: FloatArray, dt: float) -> None:
    """Add what a step makes the moments of ω (cos ψ − 1) and ω sin ψ grow by to the level gyro biases."""
    variance, growth = P[NAV - 1, NAV - 1], 0.0
    # Ṗ = F P + P Fᵀ: on the diagonal, twice the product of a row of F with its column of P.
    for j in range(STATES):
        growth += 2 * dt * F[NAV - 1, j] * P[NAV - 1, j]
    if growth <= 0:
        return
    # Of ψ with the variance s, E sin² ψ = (1 − exp(−2 s)) / 2, and
    # E (cos ψ − 1)² = 3/2 − 2 exp(−s/2) + exp(−2 s)/2; these are their derivatives with s.
    across = growth * math.exp(-2 * variance)
    along = growth * math.exp(-0.5 * variance) - across
    reset = strapdown.reset_rate(state)
    rate = F[NAV - 2, NAV - 1] + reset[0], reset[1] - F[NAV - 3, NAV - 1]  # of the frame, of −ω × φ
    for i in range(3):
        a = rate[0] * state[strapdown.C_NB + i] + rate[1] * state[strapdown.C_NB + 3 + i]
        b = rate[0] * state[strapdown.C_NB + 3 + i] - rate[1] * state[strapdown.C_NB + i]
        for j in range(3):
            c = rate[0] * state[strapdown.C_NB + j] + rate[1] * state[strapdown.C_NB + 3 + j]
            d = rate[0] * state[strapdown.C_NB + 3 + j] - rate[1] * state[strapdown.C_NB + j]
            P[NAV + i, NAV + j] += along * a * c + across * b * d


@kernel
def straighten(held: FloatArray, m: int, state: FloatArray, P: FloatArray, F: FloatArray, dt: float) -> None:
    """Remove from F what a heading does, before a fix that shows it by chance only.

    The level specific force, by which a heading would turn velocities, is noise and error of the tilt there.
    The Earth's rate shows a heading only as far as its error is small. A larger one tilts the navigator as
    level gyro biases do, by ω (cos ψ − 1) along the level rate ω of the frame and ω sin ψ across. As σ of the
    heading grows, so do the second moments of these two, which level gyro biases take as a random walk.

    Parameters
    ----------
    held : (fixes, 3) array
        As `Solution.fix_held`; zero for all fixes that a filter has yet to use.
    m
        The next fix; there may be none.
    state
        The navigator.
    P : (n, ≥ n) array
        Covariance, changed in place.
    F : (n, n) array
        System matrix for errors in a navigation frame, changed in place.
    dt
        Length of the step [s].
    """
    if m < held.shape[0] and (held[m, 0] != 0 or held[m, 1] != 0 or held[m, 2] != 0):
        heading = NAV - 1
        is_small = P[heading, heading] < LINEAR * LINEAR
        if not is_small:
            _let_heading_turn_biases(state, P, F, dt)
        for row in range(2):
            # Velocity north and east; then the tilts about north and east.
            F[NAV - 6 + row, heading] = 0.0
            F[NAV - 3 + row, heading] *= is_small


@kernel
def restore_heading(P: FloatArray, D: FloatArray, kept: FloatArray) -> None:
    """Undo what an update did to heading and vertical gyro bias; arguments as for `keeps_heading`."""
    put_back_covariance(P, D, kept)
    for k in range(DIRECTIONS):
        missing = kept[k, DIRECTIONS]
        for i in range(STATES):
            missing -= D[k, i] * P[i, X]
        for i in range(STATES):
            P[i, X] += D[k, i] * missing
