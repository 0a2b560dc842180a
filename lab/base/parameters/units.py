"""Units: the one table of factors to SI, for files, settings and data sheets."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lab.base.parameters.settings import Settings

DEGREE = math.radians(1)
"""[rad]."""
DAY = 86_400.0
"""[s]."""
WEEK = 7 * DAY
"""[s]."""
LEAP_SECONDS = 18.0
"""GPS time minus UTC since 2017 [s]."""
STANDARD_GRAVITY = 9.80665
"""The unit g of datasheets [m/s²]."""
FOOT = 0.3048
"""International foot [m]; exact by definition, as are the mile and the nautical mile."""
STATUTE_MILE = 1609.344
"""[m]."""
NAUTICAL_MILE = 1852.0
"""[m]."""
KNOT = NAUTICAL_MILE / 3600
"""[m/s]."""
KILOMETRE_PER_HOUR = 1 / 3.6
"""[m/s]."""
MILE_PER_HOUR = STATUTE_MILE / 3600
"""[m/s]."""
GAUSS = 1e-4
"""[T]."""
RANKINES_PER_KELVIN = 1.8
"""Degrees Rankine, in which JSBSim counts temperatures, per kelvin."""

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
    "°": DEGREE,
    "°/s": DEGREE,
    "(°/s)²": DEGREE**2,
    "(m/s²)²": 1.0,
    "°/h": DEGREE / 3600,
    "°/s/√Hz": DEGREE,
    "°/h/√h": DEGREE / 3600 / 60,
    "°/s/K": DEGREE,
    "°/s/g": DEGREE / STANDARD_GRAVITY,
    "g": STANDARD_GRAVITY,
    "mg": 1e-3 * STANDARD_GRAVITY,
    "mg/√h": 1e-3 * STANDARD_GRAVITY / 60,
    "mg/K": 1e-3 * STANDARD_GRAVITY,
    "µg/√Hz": 1e-6 * STANDARD_GRAVITY,
    "ppm": 1e-6,
    "mrad": 1e-3,
    "″": DEGREE / 3600,
    "°/h²": DEGREE / 3600**2,
    "mm/s": 1e-3,
    "mg/h": 1e-3 * STANDARD_GRAVITY / 3600,
    "°/h/g": DEGREE / 3600 / STANDARD_GRAVITY,
    "°/√h": DEGREE / 60,
    "°/h/√Hz": DEGREE / 3600,
    "µg": 1e-6 * STANDARD_GRAVITY,
    "mg/√Hz": 1e-3 * STANDARD_GRAVITY,
    "m/s/√h": 1 / 60,
    "ft/s/√h": FOOT / 60,
}
"""Factor from each unit a setting or a data sheet has to SI: radians for angles; temperatures stay in °C."""


def si(group: Settings, name: str) -> NDArray[np.float64]:
    """Return a setting in SI units: a scalar array, or one value for each axis."""
    key = type(group), name
    if key not in _FACTORS:
        _FACTORS[key] = TO_SI[group.param[name].unit]
    return np.asarray(getattr(group, name), dtype=np.float64) * _FACTORS[key]


_FACTORS: dict[tuple[type[Settings], str], float] = {}
"""Factors of settings to SI units: a run asks for a hundred, and reading a declaration takes 20 µs."""
