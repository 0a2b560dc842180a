"""Projection: positions as metres on a map, in UTM where it is defined."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.frames.rotation import wrap

UTM_LATITUDES = (-80.0, 84.0)
"""Latitudes that UTM covers [°]."""


class Projection(NamedTuple):
    """A map projection, determined by the start of a flight, so that the whole flight has one projection.

    Attributes
    ----------
    latitude, longitude : float
        Start of the flight [rad].
    zone : int
        UTM zone; 0 for local east and north from the start, beyond the latitudes of UTM.
    """

    latitude: float
    longitude: float
    zone: int

    @classmethod
    def at(cls, latitude: float, longitude: float) -> Projection:
        """Return the projection for a flight that starts at a place [rad]."""
        import utm  # noqa: PLC0415 - only needed where a map is shown

        south, north = UTM_LATITUDES
        degrees = np.degrees(latitude)
        # A flight that starts within a degree of the limits could cross them.
        covered = south + 1 <= degrees <= north - 1
        zone = utm.latlon_to_zone_number(degrees, np.degrees(longitude)) if covered else 0
        return cls(latitude, longitude, zone)

    @property
    def label(self) -> str:
        """Name of the coordinates, such as ``"UTM zone 18 north"``."""
        if not self.zone:
            return "from the start"
        return f"UTM zone {self.zone} {'north' if self.latitude >= 0 else 'south'}"

    def project(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return easting and northing (n,) [m] of positions (n, 3): latitude, longitude [rad], height [m].

        An estimate beyond the latitudes of UTM is shown at their limit; NaN stays NaN.
        """
        import pymap3d  # noqa: PLC0415 - only needed where a map is shown
        import utm  # noqa: PLC0415

        latitude, longitude = np.degrees(position[:, 0]), np.degrees(wrap(position[:, 1]))
        if not self.zone:
            east, north, _ = pymap3d.geodetic2enu(
                latitude, longitude, 0.0, np.degrees(self.latitude), np.degrees(self.longitude), 0.0
            )
            return np.asarray(east), np.asarray(north)
        on_map = np.full((2, latitude.size), np.nan)
        known = np.isfinite(latitude)
        if known.any():
            on_map[0, known], on_map[1, known], *_ = utm.from_latlon(
                np.clip(latitude[known], *UTM_LATITUDES),
                longitude[known],
                force_zone_number=self.zone,
                force_northern=self.latitude >= 0,
            )
        return on_map[0], on_map[1]
