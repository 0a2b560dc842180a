"""Magnetic field: that of the Earth by the World Magnetic Model 2025.

References
----------
A. Chulliat et al., *The US/UK World Magnetic Model for 2025-2030*, NOAA (2025).
"""

from __future__ import annotations

import math

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames.rotation import wrap

MODEL_YEAR = 2025.0
"""Year of the field; declination drifts by 0.1-0.2° a year, far below the σ of a magnetometer."""
MODEL_HEIGHTS = (-1.0, 850.0)
"""Heights of the model [km]; nearer ends are taken beyond."""


def magnetic_field(position: FloatArray) -> FloatArray:
    """Return the magnetic field (3,) north, east, down [µT].

    Parameters
    ----------
    position : (3,) array
        Latitude, longitude [rad] and height [m].
    """
    from pygeomag import GeoMag  # noqa: PLC0415 - only flights with a magnetometer need it

    latitude, longitude = np.degrees(position[0]), np.degrees(wrap(position[1]))
    height = float(np.clip(position[2] / 1000, *MODEL_HEIGHTS))
    here = GeoMag(base_year=MODEL_YEAR).calculate(latitude, longitude, height, MODEL_YEAR)
    return np.array([here.x, here.y, here.z]) / 1000


def magnetic_declination(position: FloatArray) -> tuple[float, float]:
    """Return declination [rad] and horizontal field [µT] at a position, as of `magnetic_field`."""
    north, east, _ = magnetic_field(position)
    return math.atan2(east, north), math.hypot(north, east)
