"""Earth: the WGS-84 ellipsoid, its rotation and its gravity; the one gravity and Earth rate of the lab.

The functions are plain arithmetic on the sine of the latitude. They take scalars or arrays, and the compiled
navigator compiles the same functions, so the ideal IMU and the navigator agree exactly.

References
----------
NIMA TR8350.2, *Department of Defense World Geodetic System 1984*, 3rd ed.; P. D. Groves, *Principles of GNSS,
Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., eqs. 2.105, 2.106 (radii) and 2.134, 2.139
(gravity).
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lab.base.parameters.units import STANDARD_GRAVITY as STANDARD_GRAVITY  # noqa: PLC0414 - part of `lab.earth`

Value = TypeVar("Value", float, NDArray[np.float64])

SEMI_MAJOR_AXIS = 6378137.0
"""Equatorial radius [m]."""
FLATTENING = 1 / 298.257223563
"""Flattening of the ellipsoid."""
ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
"""First eccentricity squared."""
RATE = 7.292115e-5
"""Rotation rate of the Earth [rad/s]."""
GRAVITATIONAL_CONSTANT = 3.986004418e14
"""Geocentric gravitational constant GM [m³/s²]."""
EQUATORIAL_GRAVITY = 9.7803253359
"""Normal gravity at the equator [m/s²]."""
SOMIGLIANA = 1.931852652458e-3
"""Somigliana's constant k."""
CENTRIFUGAL_RATIO = RATE**2 * SEMI_MAJOR_AXIS**3 * (1 - FLATTENING) / GRAVITATIONAL_CONSTANT
"""Centrifugal over gravitational acceleration at the equator, m = ω² a² b / GM."""


def radii(sin_latitude: Value) -> tuple[Value, Value]:
    """Return the meridian and the transverse radius of curvature [m] (Groves 2.105, 2.106)."""
    s2 = sin_latitude * sin_latitude
    curve = 1 - ECCENTRICITY_SQUARED * s2
    root = 1 / curve**0.5
    return SEMI_MAJOR_AXIS * (1 - ECCENTRICITY_SQUARED) * root / curve, SEMI_MAJOR_AXIS * root


def gravity(sin_latitude: Value, height: Value) -> Value:
    """Return normal gravity, positive down along the ellipsoid's normal [m/s²] (Groves 2.134, 2.139).

    The error is within 1 µm/s² of the exact gradient of the normal potential up to 12 km. The small north
    component of normal gravity above the ellipsoid (8 µm/s² per km at 45°) is omitted here and therefore
    everywhere.

    Parameters
    ----------
    sin_latitude
        Sine of the geodetic latitude.
    height
        Height above the ellipsoid [m].
    """
    s2 = sin_latitude * sin_latitude
    curve = 1 - ECCENTRICITY_SQUARED * s2
    surface: Value = EQUATORIAL_GRAVITY * (1 + SOMIGLIANA * s2) * (1 / curve**0.5)
    ratio = height / SEMI_MAJOR_AXIS
    return surface * (1 - 2 * ratio * (1 + FLATTENING * (1 - 2 * s2) + CENTRIFUGAL_RATIO) + 3 * ratio * ratio)


def gravity_gradient(sin_latitude: Value, cos_latitude: Value, height: Value) -> tuple[Value, Value]:
    """Return the derivatives of `gravity` with respect to latitude [m/s² per rad] and height [1/s²].

    Parameters
    ----------
    sin_latitude, cos_latitude
        Sine and cosine of the geodetic latitude.
    height
        Height above the ellipsoid [m].
    """
    s2 = sin_latitude * sin_latitude
    sc = sin_latitude * cos_latitude
    curve = 1 - ECCENTRICITY_SQUARED * s2
    somigliana = 1 + SOMIGLIANA * s2
    surface = EQUATORIAL_GRAVITY * somigliana * (1 / curve**0.5)
    ratio = height / SEMI_MAJOR_AXIS
    slope = 1 + FLATTENING * (1 - 2 * s2) + CENTRIFUGAL_RATIO
    decrease = 1 - 2 * ratio * slope + 3 * ratio * ratio
    surface_by_latitude = surface * sc * (2 * SOMIGLIANA / somigliana + ECCENTRICITY_SQUARED / curve)
    # The second term: d(1 − 2 s²)/dL = −4 s c, with the −2 h / a before it.
    by_latitude = surface_by_latitude * decrease + surface * 8 * ratio * FLATTENING * sc
    return by_latitude, surface * (6 * ratio - 2 * slope) / SEMI_MAJOR_AXIS
