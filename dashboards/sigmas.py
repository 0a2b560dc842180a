"""Sigmas: variances that are shown and entered as their roots, σ, in the unit of the root."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from lab.base.parameters.setting_kinds import AxisQuantity
from lab.experiment.experiment import Experiment


def sigma_of(declaration: Any) -> AxisQuantity | None:
    """Return the declaration of the root of a variance; None for all other settings.

    >>> from lab.sensors.gps import GpsErrors
    >>> found = sigma_of(GpsErrors.param["velocity_variance"])
    >>> found.label, found.unit, found.bounds
    ('Velocity σ', 'm/s', (0.0001, 100.0))
    """
    label = str(declaration.label)
    if not isinstance(declaration, AxisQuantity) or "variance" not in label.casefold():
        return None
    low, high = declaration.bounds
    soft = declaration.softbounds
    return AxisQuantity(
        to_sigma(declaration.default),
        unit=declaration.unit.removesuffix("²").strip("()"),
        axes=declaration.axes,
        bounds=(math.sqrt(low), math.sqrt(high)),
        softbounds=soft and (math.sqrt(soft[0]), math.sqrt(soft[1])),
        label=label.replace("variance", "σ").replace("Variance", "σ"),
        doc=f"{declaration.doc} Shown as σ, its root.",
    )


@cache
def sigma_at(path: str) -> AxisQuantity | None:
    """Return the declaration of the root of the variance at a dotted path; None for all other settings."""
    return sigma_of(Experiment().declaration(path))


def to_sigma(variances: Any) -> tuple[float, ...]:
    """Return the roots of variances."""
    return tuple(math.sqrt(one) for one in variances)


def to_variance(sigmas: Any) -> Any:
    """Return the squares of σ, without the last digits, so that 0.7 gives 0.49.

    What is no number is passed on, and a negative one stays negative: the setting says what it accepts.
    """
    if isinstance(sigmas, tuple):
        return tuple(to_variance(one) for one in sigmas)
    return sigmas if isinstance(sigmas, str) else float(f"{sigmas * abs(sigmas):.12g}")
