"""Likeness: how one series of numbers follows another, and the unit whose factor is between them.

Two measurements of one motion agree but for noise. A wrong unit makes one of them larger by a known factor, a
wrong sign reverses it, and swapped columns turn or mirror it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from lab.base.arrays import ComplexArray, FloatArray
from lab.base.parameters.units import DEGREE, FOOT, KILOMETRE_PER_HOUR, KNOT, MILE_PER_HOUR
from lab.data.checks import limits

UNITS: Mapping[str, Mapping[float, tuple[str, str]]] = {
    "angle": {1 / DEGREE: ("degrees", "radians"), DEGREE: ("radians", "degrees")},
    "speed": {
        1 / KILOMETRE_PER_HOUR: ("km/h", "m/s"),
        1 / MILE_PER_HOUR: ("mph", "m/s"),
        1 / KNOT: ("knots", "m/s"),
        1 / FOOT: ("feet per second", "m/s"),
        60 / FOOT: ("feet per minute", "m/s"),
        100.0: ("cm/s", "m/s"),
        KILOMETRE_PER_HOUR: ("m/s", "km/h"),
        KNOT: ("m/s", "knots"),
        FOOT: ("m/s", "feet per second"),
    },
    "height": {
        1 / FOOT: ("feet", "m"), 100.0: ("cm", "m"), 1000.0: ("mm", "m"), FOOT: ("m", "feet"),
    },
}  # fmt: skip
"""For each kind of quantity: factor by which numbers are too large, the unit they are in, and the unit for
which they are taken."""


class Likeness(NamedTuple):
    """How one series follows another.

    Attributes
    ----------
    slope : float
        Factor on the reference, by least squares; negative if it is reversed.
    ratio : float
        Ratio of the sizes, which noise of the reference does not shrink.
    correlation : float
        Correlation, −1 to 1.
    coherence : float
        Its size; of vectors also if they are turned against each other.
    angle : float
        By how much vectors are turned against the reference, from its first component to its second [rad].
    strength : float
        Rms of the reference.
    """

    slope: float
    ratio: float
    correlation: float
    coherence: float
    angle: float
    strength: float


def likeness(
    reference: FloatArray | ComplexArray, other: FloatArray | ComplexArray, *, centred: bool = True
) -> Likeness:
    """Return how a series follows a reference.

    Parameters
    ----------
    reference, other : (n,) arrays
        Numbers, or vectors of two components as complex numbers.
    centred
        Whether both may be off by a constant.
    """
    if centred and len(reference):
        reference, other = reference - reference.mean(), other - other.mean()
    cross = complex(np.vdot(reference, other))
    power, power_of_other = (float(np.vdot(one, one).real) for one in (reference, other))
    both = math.sqrt(power * power_of_other)
    if not both > 0:
        return Likeness(math.nan, 1.0, 0.0, 0.0, 0.0, math.sqrt(power / max(len(reference), 1)))
    return Likeness(
        slope=cross.real / power,
        ratio=math.sqrt(power_of_other / power),
        correlation=cross.real / both,
        coherence=abs(cross) / both,
        angle=float(np.angle(cross)),
        strength=math.sqrt(power / len(reference)),
    )


def find_nearest_unit(
    factor: float, units: Mapping[float, tuple[str, str]], within: float
) -> tuple[str, str] | None:
    """Return the unit of numbers and the one they are taken for, if their factor is nearly that.

    Parameters
    ----------
    factor
        By how much the numbers are too large.
    units
        One of `UNITS`.
    within
        Factor between both that noise explains.
    """
    near = min(units, key=lambda unit: abs(math.log(abs(factor) / unit)))
    return units[near] if abs(math.log(abs(factor) / near)) < math.log(within) else None


def near_units(factor: float, kind: str) -> str:
    """Return the units that numbers look like: one that is close, otherwise all near; empty without any."""
    for within in (limits.LOG.sure_unit_ratio, limits.LOG.unit_ratio):
        found = [
            shown
            for unit, (shown, taken) in UNITS[kind].items()
            if taken in ("m", "m/s") and abs(math.log(abs(factor) / unit)) < math.log(within)
        ]
        if found:
            return " or ".join(found)
    return ""


def cause(factor: float, kind: str) -> str:
    """Return the likely cause of numbers that are too large, of a kind of quantity in `UNITS`."""
    if not factor or not math.isfinite(factor):
        return "a column of another quantity"
    reversed_ = "it has the opposite sign" if factor < 0 else ""
    if abs(abs(factor) - 1) < limits.LOG.same_slope:
        return reversed_ or "noise"
    unit = find_nearest_unit(factor, UNITS[kind], 1 + limits.LOG.unit_slope)
    words = f"{unit[0]} read as {unit[1]}" if unit else "another unit"
    if reversed_:
        return f"{words}, and {reversed_}"
    return words if unit else f"{words} or column"


def rms(values: FloatArray | ComplexArray, axis: int | None = None) -> Any:
    """Return the root mean square of the sizes of numbers, of all or along an axis.

    Parameters
    ----------
    values : array
        The numbers.
    axis
        The axis; None for all numbers.
    """
    return np.sqrt(np.mean(np.abs(values) ** 2, axis=axis))
