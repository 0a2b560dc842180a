"""Vertical bias: what the square of a tilt adds to the vertical accelerometer, and no fix shows.

A navigator that is tilted by φ feels f cos φ where it expects the specific force f: the accelerometer along
the apparent vertical, the line of a plumb in the vehicle, seems to err by ½ f φ², which a linear filter
neglects. A tilt that lasts, as that of a bias of the other accelerometers in a vehicle that keeps its
attitude or its circle, is taken for a bias along that line. After a quarter of an hour at rest, or in a
banked circle, σ of this bias would be below that.

So σ of the bias along the apparent vertical does not fall below the second moment of ½ g φ². The variance
that is missing is process noise of this bias. Of a tilt φ about level axes with the covariance Σ, the moment
is ¼ g² ((tr Σ)² + 2 tr Σ²). A heading error tilts the apparent vertical only while the vehicle accelerates.
"""

from __future__ import annotations

import math
from typing import Final

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.navigation import strapdown
from lab.navigation.kernels.compilation import inline_kernel, kernel
from lab.navigation.kernels.propagation import NAV
from lab.navigation.strapdown import Vector, get

QUARTER: Final = STANDARD_GRAVITY**2 / 4
"""g²/4 [m²/s⁴]."""
MOST: Final = 4 / 3 * STANDARD_GRAVITY**2
"""Second moment of g (1 − cos φ) if nothing is known of the vertical [m²/s⁴]."""
_TILT, _BIAS = NAV - 3, NAV + 3  # of the attitude, and of the accelerometer biases


@inline_kernel
def apparent_down(state: FloatArray) -> Vector:
    """Return where a plumb hangs in b, against the specific force of the last step; 0 in free fall."""
    x, y, z = get(state, strapdown.PREVIOUS_DVELOCITY)
    size = math.sqrt(x * x + y * y + z * z)
    per = -1 / size if size > 0 else 0.0
    return x * per, y * per, z * per


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
        The apparent vertical in b, from `apparent_down`.
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
