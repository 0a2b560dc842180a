"""Rotation spline: a curve through attitudes with continuous angular rate and acceleration.

Between knots, the rotation vector from the knot before is a cubic polynomial in time. The rates at the knots
solve a system of equations that is linear but for a small term, so it is solved a few times with the same
factors. It is SciPy's `RotationSpline`, to rounding, in a fifth of the time.

References
----------
N. Mayorov, *Smooth Attitude Interpolation*, github.com/scipy/scipy/files/2932755/attitude_interpolation.pdf.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbtrf, dgbtrs

from lab.base.arrays import FloatArray
from lab.motion.kinematics.cubic_spline import find_intervals

SMALL_ANGLE = 1e-3
"""Angle below which functions of it are computed as series [rad]; the terms omitted are below 1e-15."""
ITERATIONS, TOLERANCE = 10, 1e-9
"""Most solutions of the equations for the rates, and the relative change of a rate that ends them."""
BAND = 5
"""Diagonals of the equations on each side: the rates at a knot and at its neighbours."""


class RotationSpline:
    """A twice-differentiable curve through attitudes.

    Parameters
    ----------
    times : (n,) array
        Increasing knots [s], at least two.
    q_nb : (n, 4) array
        Attitudes at the knots: unit quaternions, scalar first.
    """

    def __init__(self, times: FloatArray, q_nb: FloatArray) -> None:
        self._times, self._q_nb = times, q_nb.T.copy()
        dt = np.diff(times)
        turn = _rotation_vector(_product(self._q_nb[:, :-1], self._q_nb[:, 1:], inverse=True))
        # Between two knots Hermite's cubic, from zero to the whole turn.
        rate, end = _rates(turn, dt)
        self._coefficients = np.stack(
            ((dt * (rate + end) - 2 * turn) / dt**3, (3 * turn - dt * (2 * rate + end)) / dt**2, rate)
        )

    def attitude(self, times: FloatArray) -> FloatArray:
        """Return q_nb (m, 4) at the times."""
        index, dt = self._interval(times)
        cubic, square, linear = np.take(self._coefficients, index, axis=2)
        turn = dt * (linear + dt * (square + dt * cubic))
        angle = np.sqrt(_dot(turn, turn))
        small = angle < SMALL_ANGLE
        scale = np.sin(0.5 * angle) / np.where(small, 1.0, angle)
        # The series of sin(φ/2) / φ.
        scale[small] = 0.5 - angle[small] ** 2 / 48
        q_turn = np.concatenate((np.cos(0.5 * angle)[None], scale * turn))
        return np.ascontiguousarray(_product(self._q_nb[:, index], q_turn).T)

    def rate(self, times: FloatArray) -> FloatArray:
        """Return ω_nb,b (m, 3) at the times [rad/s]."""
        index, dt = self._interval(times)
        cubic, square, linear = np.take(self._coefficients, index, axis=2)
        turn = dt * (linear + dt * (square + dt * cubic))
        change = linear + dt * (2 * square + dt * 3 * cubic)
        first, second, _ = _series(turn)
        across = _cross(turn, change)
        # ω = J φ̇ with the right Jacobian J = I − first [φ×] + second [φ×]²: the rate is in b.
        return np.ascontiguousarray((change - first * across + second * _cross(turn, across)).T)

    def _interval(self, times: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the interval of each time, and the time since its knot."""
        index = find_intervals(self._times, times)
        return index, times - self._times[index]


def _rates(turn: FloatArray, dt: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ω at the start of each interval, and the derivative of the rotation vector at its end (3, n)."""
    rate = turn / dt
    # At both ends the rate is that of a constant rotation over the outer piece.
    first_rate = rate[:, :1].copy()
    if dt.size == 1:
        return rate, rate
    first, second, inverse = _series(turn)
    # The inverse of the right Jacobian, from rates to derivatives of the rotation vector; and itself.
    to_turn, to_rate = _matrices(turn, 0.5, inverse), _matrices(turn, -first, second)
    size = 3 * (dt.size - 1)
    # LAPACK's band storage: element (i, j) stands in row 2 BAND + i - j of column j.
    band = np.zeros((size, 3 * BAND + 1))
    band[:, 2 * BAND] = np.repeat(4 * (1 / dt[:-1] + 1 / dt[1:]), 3)
    for row in range(3):
        for column in range(3):
            before, after = 2 * BAND + 3 + row - column, 2 * BAND - 3 + row - column
            band[column : size - 3 : 3, before] = 2 * to_rate[row, column, 1:-1] / dt[1:-1]
            band[3 + column :: 3, after] = 2 * to_turn[row, column, 1:-1] / dt[1:-1]
    factors, pivots, failed = dgbtrf(band.T, BAND, BAND, overwrite_ab=True)
    assert not failed, "the diagonal of the equations exceeds the sum of the rest of each row"
    right = 6 * (turn[:, :-1] / dt[:-1] ** 2 + turn[:, 1:] / dt[1:] ** 2)
    # The rates at both ends are known, and stand on the right side.
    right[:, 0] -= 2 / dt[0] * (to_rate[:, :, 0] @ rate[:, 0])
    right[:, -1] -= 2 / dt[-1] * (to_turn[:, :, -1] @ rate[:, -1])
    for _ in range(ITERATIONS):
        end = np.einsum("ijk,jk->ik", to_turn, rate)
        known = right - _nonlinear(turn[:, :-1], end[:, :-1])
        solved, _ = dgbtrs(factors, BAND, BAND, known.T.ravel(), pivots, overwrite_b=True)
        new = solved.reshape(-1, 3).T
        settled = (np.abs(new - rate[:, :-1]) < TOLERANCE * (1 + np.abs(new))).all()
        rate[:, :-1] = new
        if settled:
            break
    end = np.einsum("ijk,jk->ik", to_turn, rate)
    return np.concatenate((first_rate, rate[:, :-1]), axis=1), end


def _nonlinear(turn: FloatArray, change: FloatArray) -> FloatArray:
    """Return the part of the angular acceleration that is quadratic in the rotation vector's derivative."""
    square = _dot(turn, turn)
    angle = np.sqrt(square)
    # Divisions by φ⁴ and φ⁵ lose their digits earlier than those of `_series`.
    small = angle < 1e-2
    at = np.where(small, 1.0, angle)
    sin, cos = np.sin(at), np.cos(at)
    first = np.where(small, 1 / 12 - square / 180, (-at * sin - 2 * (cos - 1)) / at**4)
    second = np.where(small, -1 / 60 + square / 1260, (-2 * at + 3 * sin - at * cos) / at**5)
    third = np.where(small, 1 / 6 - square / 120, (at - sin) / at**3)
    across = _cross(turn, change)
    return np.asarray(
        _dot(turn, change) * (first * across + second * _cross(turn, across)) + third * _cross(change, across)
    )


def _series(turn: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the factors of [φ×] and [φ×]² in the right Jacobian, and of [φ×]² in its inverse (n,)."""
    square = _dot(turn, turn)
    angle = np.sqrt(square)
    small = angle < SMALL_ANGLE
    at = np.where(small, 1.0, angle)
    return (
        np.where(small, 1 / 2 - square / 24, 2 * np.sin(0.5 * at) ** 2 / at**2),
        np.where(small, 1 / 6 - square / 120, (at - np.sin(at)) / at**3),
        np.where(small, 1 / 12 + square / 720, (1 - 0.5 * at / np.tan(0.5 * at)) / at**2),
    )


def _matrices(turn: FloatArray, first: FloatArray | float, second: FloatArray) -> FloatArray:
    """Return I + `first` [φ×] + `second` [φ×]² (3, 3, n) of rotation vectors φ (3, n)."""
    x, y, z = first * turn
    out = second * turn[:, None] * turn[None]
    out[range(3), range(3)] += 1 - second * _dot(turn, turn)
    for row, column, value in ((0, 1, z), (1, 2, x), (2, 0, y)):
        out[row, column] -= value
        out[column, row] += value
    return np.asarray(out)


def _rotation_vector(q: FloatArray) -> FloatArray:
    """Return the shortest rotation vectors (3, n) [rad] of quaternions (4, n)."""
    # q and −q are one rotation: with a scalar part above zero, the shorter way.
    vector = np.where(q[0] < 0, -q[1:], q[1:])
    length = np.sqrt(_dot(vector, vector))
    angle = 2 * np.arctan2(length, np.abs(q[0]))
    small = angle < SMALL_ANGLE
    scale = angle / np.where(small, 1.0, length)
    # The series of φ / sin(φ/2).
    return np.asarray(np.where(small, 2 + angle**2 / 12, scale) * vector)


def _product(p: FloatArray, q: FloatArray, *, inverse: bool = False) -> FloatArray:
    """Return p ⊗ q of quaternions (4, n); p* ⊗ q if `inverse`."""
    w, v = p[0], -p[1:] if inverse else p[1:]
    return np.concatenate(((w * q[0] - _dot(v, q[1:]))[None], w * q[1:] + q[0] * v + _cross(v, q[1:])))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.stack((a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))
