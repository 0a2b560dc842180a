"""Vertical bias: what the square of a constant tilt adds to the vertical accelerometer, and no fix shows.

A navigator that is tilted by φ feels g cos φ where it expects g: the vertical accelerometer seems to err by
½ g φ², which a linear filter neglects. A tilt that changes averages out. That which the biases of the
horizontal accelerometers cause stays as long as the vehicle keeps its heading, and fixes add it to the
vertical bias. After a quarter of an hour, σ of this bias is below it.

So σ of the vertical bias does not fall below the second moment of ½ g φ², of the part of the tilt that the
estimated biases cause. The variance that is missing is process noise of this bias. Of a horizontal normal φ
with the covariance Σ, the moment is ¼ g² ((tr Σ)² + 2 tr Σ²).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.frames.earth import STANDARD_GRAVITY
from lab.navigation.compilation import kernel
from lab.navigation.propagation import NAV
from lab.navigation.strapdown import Vector

FloatArray = NDArray[np.float64]

QUARTER: Final = STANDARD_GRAVITY**2 / 4
"""g²/4 [m²/s⁴]."""
_TILT, _BIAS = NAV - 3, NAV + 3  # of the attitude, and of the accelerometer biases


@kernel
def covariance_with_biases(P: FloatArray, own: Vector, i: int, j: int) -> float:
    """Return the product of the horizontal parts of the covariances of the attitude with two biases."""
    total, along, across = 0.0, 0.0, 0.0
    for a in range(3):
        total += P[_TILT + a, _BIAS + i] * P[_TILT + a, _BIAS + j]
        along += own[a] * P[_TILT + a, _BIAS + i]
        across += own[a] * P[_TILT + a, _BIAS + j]
    return total - along * across


@kernel
def raise_vertical_bias(P: FloatArray, own: Vector, down: Vector) -> None:
    """Raise the variance of the vertical accelerometer bias to what the square of a constant tilt adds to it.

    Parameters
    ----------
    P : (n, ≥ n) array
        Covariance.
    own
        The vertical in the coordinates of the filter's attitude error.
    down
        The vertical in b.
    """
    trace, squares, variance = 0.0, 0.0, 0.0
    for i in range(3):
        for j in range(3):
            variance += down[i] * P[_BIAS + i, _BIAS + j] * down[j]
            per = P[_BIAS + i, _BIAS + i] * P[_BIAS + j, _BIAS + j]
            if per > 0:
                shared = covariance_with_biases(P, own, i, j)
                squares += shared * shared / per
        if P[_BIAS + i, _BIAS + i] > 0:
            trace += covariance_with_biases(P, own, i, i) / P[_BIAS + i, _BIAS + i]
    missing = QUARTER * (trace * trace + 2 * squares) - variance
    if missing > 0 and variance > 0:
        for i in range(3):
            for j in range(3):
                P[_BIAS + i, _BIAS + j] += missing * down[i] * down[j]
