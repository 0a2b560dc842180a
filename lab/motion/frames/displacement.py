"""Displacement: from latitude, longitude and height to metres north, east, down, and back.

The conversion is of first order: over 1 km to the east at 45°, the error is 8 cm. Close to a pole, where this
fails within metres, the computation uses Earth-fixed axes (`lab.motion.frames.ecef`).
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames import ecef
from lab.motion.frames.earth import radii
from lab.motion.frames.rotation import wrap


def metres_per_radian(latitude: FloatArray, height: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Return metres per radian of latitude (north) and of longitude (east).

    Parameters
    ----------
    latitude : (n,) array
        Geodetic latitude [rad].
    height : (n,) array or float
        Height above the ellipsoid [m].
    """
    meridian, transverse = radii(np.sin(latitude))
    return meridian + height, (transverse + height) * np.cos(latitude)


def longer_above(latitude: FloatArray, height: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by which factors displacements north and east at a height are longer than on the ellipsoid.

    Parameters
    ----------
    latitude : (n,) array
        Geodetic latitude [rad].
    height : (n,) array
        Height above the ellipsoid [m].
    """
    # The cosine of the latitude shortens a parallel at any height, so it is in neither factor.
    meridian, transverse = radii(np.sin(latitude))
    return 1 + height / meridian, 1 + height / transverse


def displacement(here: FloatArray, there: FloatArray) -> FloatArray:
    """Return the displacement (n, 3) from one position to another, in north, east, down of the first [m].

    Parameters
    ----------
    here, there : (n, 3) arrays
        Latitude, longitude [rad] and height [m].
    """
    latitude, longitude, height = here.T
    north, east = metres_per_radian(latitude, height)
    displacement_n = np.empty(here.shape, order="F")
    displacement_n[:, 0] = (there[:, 0] - latitude) * north
    # The way across the date line is the short one.
    displacement_n[:, 1] = wrap(there[:, 1] - longitude) * east
    displacement_n[:, 2] = height - there[:, 2]
    near = ecef.near_pole(latitude)
    if near.any():
        displacement_n[near] = ecef.displacement(here[near], there[near])
    return displacement_n


def displaced(here: FloatArray, displacement_n: FloatArray) -> FloatArray:
    """Return the position (n, 3) after a displacement (n, 3) [m]; the inverse of `displacement`.

    Parameters
    ----------
    here : (n, 3) array
        Latitude, longitude [rad] and height [m].
    displacement_n : (n, 3) array
        Displacement, resolved north, east, down [m].
    """
    latitude, longitude, height = here.T
    north, east = metres_per_radian(latitude, height)
    there = np.stack(
        (
            latitude + displacement_n[:, 0] / north,
            longitude + displacement_n[:, 1] / east,
            height - displacement_n[:, 2],
        ),
        axis=-1,
    )
    near = ecef.near_pole(latitude)
    if near.any():
        there[near] = ecef.displaced(here[near], displacement_n[near])
    return there


def velocity_of_positions(time: FloatArray, position: FloatArray) -> FloatArray:
    """Return the velocity (m, 3) north, east, down from differences of positions; down is zero [m/s].

    Parameters
    ----------
    time : (m,) array
        At least two times [s].
    position : (m, 3) array
        Latitude, longitude [rad] and height [m].
    """
    latitude, longitude = position[:, 0], np.unwrap(position[:, 1])
    per_latitude, per_longitude = metres_per_radian(latitude, 0.0)
    north = np.gradient(latitude, time) * per_latitude
    east = np.gradient(longitude, time) * per_longitude
    return np.stack((north, east, np.zeros_like(north)), axis=-1)
