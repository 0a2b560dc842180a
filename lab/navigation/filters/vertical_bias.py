"""Vertical bias: what the square of a tilt adds to the vertical accelerometer, and no fix shows.

A navigator that is tilted by φ feels g cos φ where it expects g: the vertical accelerometer seems to err by
½ g φ², which a linear filter neglects. A tilt that lasts, as that of a bias of the horizontal accelerometers
in a vehicle that keeps its attitude or its circle, is taken for a vertical bias. After a quarter of an hour
at rest, σ of this bias would be below that.

So σ of the vertical bias does not fall below the second moment of ½ g φ². The variance that is missing is
process noise of this bias. Of a horizontal normal φ with the covariance Σ, the moment is
¼ g² ((tr Σ)² + 2 tr Σ²).
"""

from __future__ import annotations

from typing import Final

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.navigation.kernels.compilation import kernel
from lab.navigation.kernels.propagation import NAV
from lab.navigation.strapdown import Vector

QUARTER: Final = STANDARD_GRAVITY**2 / 4
"""g²/4 [m²/s⁴]."""
MOST: Final = 4 / 3 * STANDARD_GRAVITY**2
"""Second moment of g (1 − cos φ) if nothing is known of the vertical [m²/s⁴]."""
_TILT, _BIAS = NAV - 3, NAV + 3  # of the attitude, and of the accelerometer biases


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
    trace, squares, heading, with_heading, variance = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        trace += P[_TILT + i, _TILT + i]
        across = 0.0
        for j in range(3):
            squares += P[_TILT + i, _TILT + j] * P[_TILT + i, _TILT + j]
            across += P[_TILT + i, _TILT + j] * own[j]
            variance += down[i] * P[_BIAS + i, _BIAS + j] * down[j]
        heading += own[i] * across
        with_heading += across * across
    # Without the part about the vertical: tr (E P E)² = tr P² − 2 |P d|² + (dᵀ P d)².
    trace -= heading
    squares += heading * heading - 2 * with_heading
    missing = min(QUARTER * (trace * trace + 2 * squares), MOST) - variance
    if missing > 0 and variance > 0:
        for i in range(3):
            for j in range(i, 3):
                P[_BIAS + i, _BIAS + j] += missing * down[i] * down[j]
                P[_BIAS + j, _BIAS + i] = P[_BIAS + i, _BIAS + j]
