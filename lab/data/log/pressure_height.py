"""Pressure height: the height in the standard atmosphere at a pressure of the air.

References
----------
International Civil Aviation Organization, *Manual of the ICAO Standard Atmosphere*, Doc 7488 (1993).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY

PERIOD: Final = 1.0
"""Time between the readings that are used [s]: that of the barometer in `lab.sensors.barometer`."""
ACCEPTED: Final = (22_700.0, 130_000.0)
"""Pressures of a barometer that works [Pa]: from the tropopause, 11 km high, to a mine 2 km deep."""
_SEA_LEVEL: Final = 101_325.0  # [Pa]
_TEMPERATURE, _LAPSE = 288.15, 0.0065  # [K], [K/m]
_GAS: Final = 287.05287  # of dry air [J/kg/K]
_EXPONENT: Final = _GAS * _LAPSE / STANDARD_GRAVITY


def height_of(pressure: FloatArray) -> FloatArray:
    """Return the height in the standard atmosphere [m] of pressures [Pa], below the tropopause."""
    return np.asarray(_TEMPERATURE / _LAPSE * (1 - (pressure / _SEA_LEVEL) ** _EXPONENT))


def pressure_at(height: FloatArray) -> FloatArray:
    """Return the pressure of the standard atmosphere [Pa] at heights [m], below the tropopause."""
    return np.asarray(_SEA_LEVEL * (1 - _LAPSE * height / _TEMPERATURE) ** (1 / _EXPONENT))


def reading_at(times: FloatArray, time: float) -> int:
    """Return which of the readings at times (k,) is that at a time: the last one before it, or the first."""
    return max(int(np.searchsorted(times, time, "right")) - 1, 0)
