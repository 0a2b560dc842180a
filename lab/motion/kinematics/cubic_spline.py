"""Cubic spline: piecewise polynomials through knots, and the least-squares spline of few pieces.

They are SciPy's `CubicSpline` and `make_lsq_spline`, to rounding. To import `scipy.interpolate`, which brings
`scipy.optimize`, takes longer than all splines of a flight of minutes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import perm

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgtsv

from lab.base.arrays import FloatArray

MOST_PRODUCTS = 10**8
"""Samples times squared number of coefficients up to which the dense equations of `fit_spline` are solved;
they take a fifth of a second."""


class PiecewisePolynomial:
    """Polynomials between knots, each in the time since the knot before.

    Parameters
    ----------
    times : (n,) array
        Increasing knots [s].
    coefficients : (k, c, n - 1) array
        Coefficients of each interval, that of the highest power first.
    """

    def __init__(self, times: FloatArray, coefficients: FloatArray) -> None:
        self._times, self._coefficients = times, coefficients

    def __call__(self, times: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the values (m, c) at times, or a derivative of them."""
        return self.derivatives(times, [derivative])

    def derivatives(self, times: FloatArray, which: Sequence[int]) -> FloatArray:
        """Return some derivatives at times, one beside the other (m, number · c)."""
        index = find_intervals(self._times, times)
        dt = times - self._times[index]
        coefficients = np.take(self._coefficients, index, axis=2)
        count, c, _ = coefficients.shape
        out = np.empty((len(which) * c, times.size))
        for place, derivative in enumerate(which):
            value = out[place * c : (place + 1) * c]
            np.multiply(coefficients[0], perm(count - 1, derivative), out=value)
            # Horner's scheme, with the factors that differentiating the powers leaves.
            for k in range(1, count - derivative):
                value *= dt
                value += coefficients[k] * perm(count - 1 - k, derivative)
        return out.T

    def antiderivative(self) -> PiecewisePolynomial:
        """Return the integral from the first knot on."""
        count, dt = self._coefficients.shape[0], np.diff(self._times)
        integrals = self._coefficients / np.arange(count, 0, -1)[:, None, None]
        # Horner's scheme at the end of each piece; the sum of all pieces before is the new constant term.
        steps = np.zeros_like(integrals[0])
        for one in integrals:
            steps = (steps + one) * dt
        before = np.concatenate((np.zeros_like(steps[:, :1]), np.cumsum(steps[:, :-1], axis=1)), axis=1)
        return PiecewisePolynomial(self._times, np.concatenate((integrals, before[None])))


def cubic_spline(times: FloatArray, values: FloatArray) -> PiecewisePolynomial:
    """Return the cubic spline through values; the first two pieces are one polynomial, and the last two.

    Parameters
    ----------
    times : (n,) array
        Increasing knots [s], at least four.
    values : (n, c) array
        Values at the knots.
    """
    dt = np.diff(times)
    step = dt[:, None]
    slope = np.diff(values, axis=0) / step
    # The unknowns are the slopes at the knots; the first and the last row join the two outer pieces.
    diagonal = np.concatenate((dt[1:2], 2 * (dt[:-1] + dt[1:]), dt[-2:-1]))
    begin, end = times[2] - times[0], times[-1] - times[-3]
    upper, lower = np.append(begin, dt[:-1]), np.append(dt[1:], end)
    right = np.empty_like(values)
    right[1:-1] = 3 * (step[1:] * slope[:-1] + step[:-1] * slope[1:])
    right[0] = ((dt[0] + 2 * begin) * dt[1] * slope[0] + dt[0] ** 2 * slope[1]) / begin
    right[-1] = (dt[-1] ** 2 * slope[-2] + (2 * end + dt[-1]) * dt[-2] * slope[-1]) / end
    *_, rates, _ = dgtsv(lower, diagonal, upper, right)
    # Hermite's cubic: from values and slopes at both ends of a piece.
    bend = (rates[:-1] + rates[1:] - 2 * slope) / step
    coefficients = bend / step, (slope - rates[:-1]) / step - bend, rates[:-1], values[:-1]
    return PiecewisePolynomial(times, np.stack([one.T for one in coefficients]))


def fit_spline(
    times: FloatArray, values: FloatArray, knots: FloatArray
) -> Callable[[FloatArray], FloatArray]:
    """Return the cubic spline that approximates values in the sense of least squares.

    Parameters
    ----------
    times : (n,) array
        Increasing times [s].
    values : (n, c) array
        Values at them.
    knots : (k,) array
        Knots of the spline; the first and the last stand there four times.
    """
    if times.size * knots.size**2 > MOST_PRODUCTS:
        from scipy.interpolate import make_lsq_spline  # noqa: PLC0415 - long flights only, see above

        # Here, the normal equations agree to 13 digits, and are sixteen times as fast for long flights.
        fitted = make_lsq_spline(
            times, values, knots, k=3, method="norm-eq" if times.size > 100_000 else "qr"
        )
        return lambda at: np.asarray(fitted(at))
    first, weights = _basis(knots, times)
    equations = np.zeros((times.size, knots.size - 4))
    equations[np.arange(times.size)[:, None], first[:, None] + np.arange(4)] = weights
    coefficients = np.linalg.lstsq(equations, values)[0]

    def evaluate(at: FloatArray) -> FloatArray:
        first, weights = _basis(knots, at)
        return np.asarray(sum(weights[:, k, None] * coefficients[first + k] for k in range(4)))

    return evaluate


def find_intervals(knots: FloatArray, times: FloatArray) -> NDArray[np.intp]:
    """Return the interval between knots in which each time lies; the first or last for times beyond."""
    return np.clip(np.searchsorted(knots, times, side="right") - 1, 0, knots.size - 2)


def _basis(knots: FloatArray, times: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Return, for each time, the first cubic B-spline that is not zero, and the values (m, 4) from it on.

    Source: C. de Boor, *A Practical Guide to Splines*, 2001, ch. X, algorithm BSPLVB.
    """
    at = find_intervals(knots[3:-3], times) + 3
    values = np.zeros((times.size, 4))
    values[:, 0] = 1.0
    for degree in range(1, 4):
        # The recursion of Cox and de Boor, in place.
        carried = np.zeros(times.size)
        for k in range(degree):
            right, left = knots[at + k + 1] - times, times - knots[at + k + 1 - degree]
            part = values[:, k] / (right + left)
            values[:, k] = carried + right * part
            carried = left * part
        values[:, degree] = carried
    return at - 3, values
