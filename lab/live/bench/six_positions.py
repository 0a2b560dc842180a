"""Six positions: bias and scale factor of accelerometers held still with each face down.

References
----------
D. H. Titterton, J. L. Weston, *Strapdown Inertial Navigation Technology*, 2nd ed., ch. 8.3 (six positions).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lab.analysis.calibration.imu_calibration import GRAVITY_SIGMA
from lab.base.arrays import FloatArray

_STEPS = 8
"""Newton steps: with 10 % of scale factor, the fifth changes nothing."""
_SMALLEST = 1e-6
"""Smallest σ that is written [m/s², %]: 0.1 µg, which no sensor reaches within seconds."""


class AccelerometerErrors(NamedTuple):
    """Constant errors of the accelerometers, forward, right, down: measured = (1 + scale) true + bias.

    Attributes
    ----------
    bias, bias_sigma : (3,) arrays
        Bias and its σ [m/s²].
    scale, scale_sigma : (3,) arrays
        Error of the scale factor, as a part of 1, and its σ; gravity's own σ is included.
    """

    bias: FloatArray
    bias_sigma: FloatArray
    scale: FloatArray
    scale_sigma: FloatArray

    def __str__(self) -> str:
        bias = _format_values(self.bias, self.bias_sigma, 3)
        scale = _format_values(100 * self.scale, 100 * self.scale_sigma, 2)
        return f"Accelerometers forward, right, down: bias {bias} m/s², scale factor {scale} % (1 σ)."


def accelerometer_errors(
    force: FloatArray, sigma: FloatArray, gravity: float, gravity_sigma: float = GRAVITY_SIGMA
) -> AccelerometerErrors:
    """Return bias and scale factor from six mean specific forces whose true size is gravity.

    Only the size of the true force is used, so the faces need not be exactly vertical.

    Parameters
    ----------
    force, sigma : (6, 3) arrays
        Mean specific force with each face down and the σ of its noise, forward, right, down [m/s²].
    gravity, gravity_sigma
        Gravity at the place, and its σ [m/s²].
    """
    bias, gain = np.zeros(3), np.ones(3)
    for _ in range(_STEPS):
        true = (force - bias) / gain
        size = np.linalg.norm(true, axis=1)
        along = true / size[:, None]
        jacobian = np.concatenate((-along / gain, -along * true / gain), axis=1)
        change = np.linalg.lstsq(jacobian, gravity - size, rcond=None)[0]
        bias, gain = bias + change[:3], gain + change[3:]
    inverse = np.linalg.pinv(jacobian)
    noise = np.sum((along / gain * sigma) ** 2, axis=1)
    variance = (inverse**2) @ noise
    of_gravity = inverse.sum(axis=1) * gravity_sigma
    spread = np.sqrt(variance + of_gravity**2)
    return AccelerometerErrors(bias, spread[:3], gain - 1, spread[3:])


def _format_values(values: FloatArray, sigmas: FloatArray, least: int) -> str:
    """Return values with their σ, with two digits of the smallest σ, and at least as many places as named."""
    smallest = max(float(sigmas.min()), _SMALLEST)
    digits = max(least, 1 - math.floor(math.log10(smallest)))
    texts = (f"{v:+.{digits}f} ± {s:.{digits}f}" for v, s in zip(values, sigmas, strict=True))
    return ", ".join(texts).replace("-", "−")
