"""Projection: positions as metres on a map, UTM wherever it is defined."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pymap3d
import utm
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Projection(NamedTuple):
    """A map projection, fixed by where a flight starts, so that all of it lies on one sheet.

    Attributes
    ----------
    latitude, longitude : float
        Where the flight starts [rad].
    zone : int
        UTM zone, or 0 for local east and north from the start, beyond the latitudes UTM covers.
    """

    latitude: float
    longitude: float
    zone: int

    @classmethod
    def at(cls, latitude: float, longitude: float) -> Projection:
        """Return the projection for a flight that starts at a place [rad]."""
        degrees = np.degrees(latitude)
        covered = -80 <= degrees <= 84
        return cls(
            latitude, longitude, utm.latlon_to_zone_number(degrees, np.degrees(longitude)) if covered else 0
        )

    @property
    def label(self) -> str:
        """Name of the coordinates, such as ``"UTM zone 18 north"``."""
        if not self.zone:
            return "from the start"
        return f"UTM zone {self.zone} {'north' if self.latitude >= 0 else 'south'}"

    def project(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return easting and northing (n,) [m] of positions (n, 3): latitude, longitude [rad], height [m]."""
        latitude, longitude = np.degrees(position[:, 0]), np.degrees(position[:, 1])
        if not self.zone:
            east, north, _ = pymap3d.geodetic2enu(
                latitude, longitude, 0.0, np.degrees(self.latitude), np.degrees(self.longitude), 0.0
            )
            return np.asarray(east), np.asarray(north)
        if latitude.size == 0:
            return np.zeros(0), np.zeros(0)
        easting, northing, *_ = utm.from_latlon(
            latitude, longitude, force_zone_number=self.zone, force_northern=self.latitude >= 0
        )
        return np.asarray(easting), np.asarray(northing)
