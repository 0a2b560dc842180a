"""Units: the one table that takes settings from datasheet units to SI, and SI to what a person reads."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lab import earth
from lab.settings import Settings

TO_SI = {
    "": 1.0,
    "s": 1.0,
    "Hz": 1.0,
    "K": 1.0,
    "°C": 1.0,
    "K/km": 1e-3,
    "m": 1.0,
    "m/s": 1.0,
    "m²": 1.0,
    "(m/s)²": 1.0,
    "%": 0.01,
    "%/K": 0.01,
    "°": math.radians(1),
    "°/s": math.radians(1),
    "(°/s)²": math.radians(1) ** 2,
    "(m/s²)²": 1.0,
    "°/h": math.radians(1) / 3600,
    "°/s/√Hz": math.radians(1),
    "°/h/√h": math.radians(1) / 3600 / 60,
    "°/s/K": math.radians(1),
    "°/s/g": math.radians(1) / earth.STANDARD_GRAVITY,
    "g": earth.STANDARD_GRAVITY,
    "mg": 1e-3 * earth.STANDARD_GRAVITY,
    "mg/√h": 1e-3 * earth.STANDARD_GRAVITY / 60,
    "mg/K": 1e-3 * earth.STANDARD_GRAVITY,
    "µg/√Hz": 1e-6 * earth.STANDARD_GRAVITY,
    "ppm": 1e-6,
    "mrad": 1e-3,
    "″": math.radians(1) / 3600,
    "°/h²": math.radians(1) / 3600**2,
    "mm/s": 1e-3,
    "mg/h": 1e-3 * earth.STANDARD_GRAVITY / 3600,
    "°/h/g": math.radians(1) / 3600 / earth.STANDARD_GRAVITY,
    "°/√h": math.radians(1) / 60,
    "°/h/√Hz": math.radians(1) / 3600,
    "µg": 1e-6 * earth.STANDARD_GRAVITY,
    "mg/√Hz": 1e-3 * earth.STANDARD_GRAVITY,
    "m/s/√h": 1 / 60,
    "ft/s/√h": 0.3048 / 60,
}
"""Factor from each unit a setting or a data sheet has to SI: radians for angles; temperatures stay in °C."""


def si(group: Settings, name: str) -> NDArray[np.float64]:
    """Return a setting in SI units: a scalar array, or one value for each axis."""
    return np.asarray(getattr(group, name), dtype=np.float64) * TO_SI[group.param[name].unit]
