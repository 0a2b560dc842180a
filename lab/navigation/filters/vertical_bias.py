"""Vertical bias: what the square of a tilt adds to the vertical accelerometer, and no fix shows.

A navigator that is tilted by φ feels g cos φ where it expects g: the vertical accelerometer seems to err by
½ g φ², which a linear filter neglects. A tilt that lasts, as that of a bias of the horizontal accelerometers
in a vehicle that keeps its attitude or its circle, is taken for a vertical bias. After a quarter of an hour
at rest, σ of this bias would be below that.

So the variance of the vertical bias does not fall below the second moment of ½ g φ². It is that beside known
height, vertical velocity and level biases: fixes show the sum of all that acts on the vertical velocity, and
a bias across the bank must not hide the vertical one. The variance that is missing is process noise of this
bias. Of a horizontal normal φ with the covariance Σ, the moment is ¼ g² ((tr Σ)² + 2 tr Σ²).
"""

from __future__ import annotations

import math
from typing import Final

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.navigation.kernels.compilation import inline_kernel, kernel
from lab.navigation.kernels.propagation import NAV
from lab.navigation.strapdown import Vector, cross, rotate

QUARTER: Final = STANDARD_GRAVITY**2 / 4
"""g²/4 [m²/s⁴]."""
MOST: Final = 4 / 3 * STANDARD_GRAVITY**2
"""Second moment of g (1 − cos φ) if nothing is known of the vertical [m²/s⁴]."""
_POSITION, _VELOCITY, _TILT, _BIAS = 0, 3, 6, NAV + 3  # the last that of the accelerometers


@kernel
def raise_vertical_bias(P: FloatArray, own: Vector, down: Vector) -> None:
    """Raise the variance of the vertical accelerometer bias to what the square of the tilt adds to it.

    Parameters
    ----------
    P : (n, ≥ n) array
        Covariance.
    own
        The vertical in the coordinates of the filter's attitude error.
    down
        The vertical in b.
    """
    trace, squares, heading, with_heading = 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        trace += P[_TILT + i, _TILT + i]
        across = 0.0
        for j in range(3):
            squares += P[_TILT + i, _TILT + j] * P[_TILT + i, _TILT + j]
            across += P[_TILT + i, _TILT + j] * own[j]
        heading += own[i] * across
        with_heading += across * across
    # Without the part about the vertical: tr (E P E)² = tr P² − 2 |P d|² + (dᵀ P d)².
    trace -= heading
    squares += heading * heading - 2 * with_heading
    missing = min(QUARTER * (trace * trace + 2 * squares), MOST) - _alone(P, own, down)
    if missing > 0:
        for i in range(3):
            for j in range(i, 3):
                P[_BIAS + i, _BIAS + j] += missing * down[i] * down[j]
                P[_BIAS + j, _BIAS + i] = P[_BIAS + i, _BIAS + j]


@inline_kernel
def _alone(P: FloatArray, own: Vector, down: Vector) -> float:
    """Return the variance of the vertical bias beside known height, vertical velocity and level biases.

    If a level bias has no variance, it is that beside known height and vertical velocity; it is infinite for
    a bias that is known itself.
    """
    zz, zv, vv = 0.0, 0.0, 0.0
    for i in range(3):
        for j in range(3):
            zz += own[i] * P[_POSITION + i, _POSITION + j] * own[j]
            zv += own[i] * P[_POSITION + i, _VELOCITY + j] * own[j]
            vv += own[i] * P[_VELOCITY + i, _VELOCITY + j] * own[j]
    z, v, det = _with_biases(P, _POSITION, own), _with_biases(P, _VELOCITY, own), zz * vv - zv * zv
    if det <= 0:
        return math.inf
    by_z = (vv * z[0] - zv * v[0]) / det, (vv * z[1] - zv * v[1]) / det, (vv * z[2] - zv * v[2]) / det
    by_v = (zz * v[0] - zv * z[0]) / det, (zz * v[1] - zv * z[1]) / det, (zz * v[2] - zv * z[2]) / det
    a, b, c = _left(P, 0, z, v, by_z, by_v), _left(P, 1, z, v, by_z, by_v), _left(P, 2, z, v, by_z, by_v)
    # The inverse of a symmetric matrix with the rows a, b, c has the rows b × c, c × a and a × b, over its
    # determinant.
    seen = rotate((cross(b, c), cross(c, a), cross(a, b)), down)
    volume, information = dot(a, cross(b, c)), dot(seen, down)
    if volume > 0 and information > 0:
        return volume / information
    variance = dot(rotate((a, b, c), down), down)
    return variance if variance > 0 else math.inf


@inline_kernel
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline_kernel
def _with_biases(P: FloatArray, first: int, own: Vector) -> Vector:
    """Return the covariances of the vertical component of three states with the accelerometer biases."""
    return (
        own[0] * P[first, _BIAS] + own[1] * P[first + 1, _BIAS] + own[2] * P[first + 2, _BIAS],
        own[0] * P[first, _BIAS + 1] + own[1] * P[first + 1, _BIAS + 1] + own[2] * P[first + 2, _BIAS + 1],
        own[0] * P[first, _BIAS + 2] + own[1] * P[first + 1, _BIAS + 2] + own[2] * P[first + 2, _BIAS + 2],
    )


@inline_kernel
def _left(P: FloatArray, i: int, z: Vector, v: Vector, by_z: Vector, by_v: Vector) -> Vector:
    """Return a row of the covariance of the accelerometer biases beside known height and velocity."""
    return (
        P[_BIAS + i, _BIAS] - z[i] * by_z[0] - v[i] * by_v[0],
        P[_BIAS + i, _BIAS + 1] - z[i] * by_z[1] - v[i] * by_v[1],
        P[_BIAS + i, _BIAS + 2] - z[i] * by_z[2] - v[i] * by_v[2],
    )
