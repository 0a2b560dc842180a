"""Wrong units: how one series of numbers agrees with another, and the likely cause if not."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.units import DEGREE, FOOT, KILOMETRE_PER_HOUR, KNOT
from lab.data.checks import limits

_ANGLES = {  # factor of an angle, or of a rate, that is too large
    1 / DEGREE: "degrees read as radians",
    DEGREE: "radians read as degrees",
}
_SPEEDS = {  # factor of a speed that is too large
    1 / KNOT: "knots read as m/s",
    KNOT: "m/s read as knots",
    1 / FOOT: "feet read as metres",
    FOOT: "metres read as feet",
    1 / KILOMETRE_PER_HOUR: "km/h read as m/s",
    KILOMETRE_PER_HOUR: "m/s read as km/h",
    60 / FOOT: "feet per minute read as m/s",
    1000.0: "thousandths read as whole units, or seconds as milliseconds",
    0.001: "whole units read as thousandths, or milliseconds as seconds",
}
FACTORS = {"angle": _ANGLES, "speed": _SPEEDS}
"""Factors by which a wrong unit makes numbers too large, and its name, by kind of quantity."""


@dataclass(frozen=True)
class Agreement:
    """How one series agrees with another.

    Attributes
    ----------
    slope : float
        Factor on the reference, by least squares through the origin.
    correlation : float
        Correlation coefficient; 0 if one of them is constant.
    strength : float
        Rms of the reference.
    """

    slope: float
    correlation: float
    strength: float

    def explained_by_noise(self) -> bool:
        """Return whether noise of the reference explains a slope below 1.

        Errors of the other series alone give the slope, and errors of the reference alone give it over r².
        """
        largest = self.slope / self.correlation**2 if self.correlation else math.inf
        return self.slope < 1 < largest * (1 + limits.LOG.same_slope)


def agreement(reference: FloatArray, other: FloatArray) -> Agreement:
    """Return how a series (n,) agrees with a reference (n,)."""
    power = float(reference @ reference)
    spread = float(np.std(reference) * np.std(other))
    both = float(np.mean((reference - reference.mean()) * (other - other.mean())))
    return Agreement(
        slope=float(reference @ other) / power if power > 0 else math.nan,
        correlation=both / spread if spread > 0 else 0.0,
        strength=math.sqrt(power / max(len(reference), 1)),
    )


def cause(factor: float, kind: str) -> str:
    """Return the likely cause of numbers that are too large, of a kind of quantity in `FACTORS`."""
    if not factor or not math.isfinite(factor):
        return "a column of another quantity"
    turned = "it has the opposite sign" if factor < 0 else ""
    if abs(abs(factor) - 1) < limits.LOG.same_slope:
        return turned or "noise"
    for known, words in FACTORS[kind].items():
        if abs(abs(factor) / known - 1) < limits.LOG.unit_slope:
            return f"{words}, and {turned}" if turned else words
    return f"another unit, and {turned}" if turned else "another unit or column"
