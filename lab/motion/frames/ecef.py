"""ECEF: positions and directions in Earth-fixed Cartesian axes, for use near a pole.

Axes e: x through Greenwich on the equator, z through the north pole. The functions are exact at the poles,
where the given longitude, or zero, defines the direction of north.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., eqs.
2.112 (position) and 2.150 (axes); B. R. Bowring, *Transformation from spatial to geographical coordinates*,
Survey Review 23 (1976).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.motion.frames.earth import ECCENTRICITY_SQUARED, FLATTENING, SEMI_MAJOR_AXIS, radii

NEAR_POLE = float(np.radians(89.0))
"""Latitude beyond which small displacements and rotations are computed in e [rad]."""


def near_pole(latitude: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of the latitudes so close to a pole that displacements are computed in e."""
    return np.asarray(np.abs(latitude) > NEAR_POLE)


def position(geodetic: FloatArray) -> FloatArray:
    """Return r_e (n, 3) [m] of latitude, longitude [rad] and height [m], (n, 3) (Groves 2.112)."""
    latitude, longitude, height = geodetic.T
    s, c = np.sin(latitude), np.cos(latitude)
    _, transverse = radii(s)
    out = (transverse + height) * c
    z = ((1 - ECCENTRICITY_SQUARED) * transverse + height) * s
    return np.stack((out * np.cos(longitude), out * np.sin(longitude), z), axis=-1)


def geodetic(r_e: FloatArray) -> FloatArray:
    """Return latitude, longitude [rad] and height [m], (n, 3), of r_e (n, 3) [m], to a nanometre.

    Bowring's iteration on the latitude gains three digits or more with each step.
    """
    x, y, z = r_e.T
    a, squared = SEMI_MAJOR_AXIS, ECCENTRICITY_SQUARED
    b = a * (1 - FLATTENING)
    out = np.hypot(x, y)
    # Bowring's start: exact on the ellipsoid, where tan β = (a / b) z / √(x² + y²).
    parametric = np.arctan2(z * a, out * b)
    for _ in range(3):
        s, c = np.sin(parametric), np.cos(parametric)
        latitude = np.arctan2(z + squared / (1 - squared) * b * s**3, out - squared * a * c**3)
        parametric = np.arctan2(b * np.sin(latitude), a * np.cos(latitude))
    s, c = np.sin(latitude), np.cos(latitude)
    height = out * c + z * s - a * np.sqrt(1 - squared * s * s)
    return np.stack((latitude, np.arctan2(y, x), height), axis=-1)


def axes(latitude: FloatArray, longitude: FloatArray) -> FloatArray:
    """Return C_en (n, 3, 3): north, east and down in e, as columns (Groves 2.150)."""
    s, c = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    C_en = np.zeros((*np.shape(s), 3, 3))
    C_en[..., 0, 0], C_en[..., 0, 1], C_en[..., 0, 2] = -s * cl, -sl, -c * cl
    C_en[..., 1, 0], C_en[..., 1, 1], C_en[..., 1, 2] = -s * sl, cl, -c * sl
    C_en[..., 2, 0], C_en[..., 2, 2] = c, -s
    return C_en


def resolve_elsewhere(vectors_n: FloatArray, here: FloatArray, there: FloatArray) -> FloatArray:
    """Return vectors (n, 3) resolved in north, east, down at one place, resolved at another.

    Parameters
    ----------
    vectors_n : (n, 3) array
        The vectors.
    here, there : (n, 2 or more) arrays
        Latitude and longitude of the two places [rad].
    """
    vectors_e = np.einsum("nij,nj->ni", axes(here[:, 0], here[:, 1]), vectors_n)
    return np.asarray(np.einsum("nji,nj->ni", axes(there[:, 0], there[:, 1]), vectors_e))


def resolved_near_pole(vectors_n: FloatArray, here: FloatArray, there: FloatArray) -> FloatArray:
    """Return vectors as `resolve_elsewhere` does close to a pole, and unchanged elsewhere.

    Elsewhere, places a few metres apart have the same north to 10⁻⁵.
    """
    near = near_pole(here[:, 0])
    if near.any():
        vectors_n = vectors_n.copy()
        vectors_n[near] = resolve_elsewhere(vectors_n[near], here[near], there[near])
    return vectors_n


def displacement(here: FloatArray, there: FloatArray) -> FloatArray:
    """Return the displacement (n, 3) to another position nearby, in north, east, down of the first [m].

    Parameters
    ----------
    here, there : (n, 3) arrays
        Latitude, longitude [rad] and height [m]. Down is the difference of the heights.
    """
    apart = position(there) - position(here)
    displacement_n = np.einsum("nji,nj->ni", axes(here[:, 0], here[:, 1]), apart)
    # Down by the heights: the ellipsoid falls away below the plane of the first place.
    displacement_n[:, 2] = here[:, 2] - there[:, 2]
    return np.asarray(displacement_n)


def displaced(here: FloatArray, displacement_n: FloatArray) -> FloatArray:
    """Return the position (n, 3) after a displacement in north, east, down [m]; see `displacement`."""
    # The plane leaves the ellipsoid, so the height is set by itself below.
    level = displacement_n * (1.0, 1.0, 0.0)
    r_e = position(here) + np.einsum("nij,nj->ni", axes(here[:, 0], here[:, 1]), level)
    there = geodetic(r_e)
    there[:, 2] = here[:, 2] - displacement_n[:, 2]
    return there
