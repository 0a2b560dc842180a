"""Projection: UTM against a published point and against Krüger's series; local axes near the poles."""

from __future__ import annotations

import numpy as np
import pymap3d
import pytest

from lab.motion.frames.projection import Projection

A, F, K0 = 6378137.0, 1 / 298.257223563, 0.9996


def kruger(latitude: float, longitude: float, zone: int) -> tuple[float, float]:
    """Return easting and northing of the transverse Mercator projection [m], from Krüger's series in n.

    L. Krüger, *Konforme Abbildung des Erdellipsoids in der Ebene* (1912), to n³: better than 1 mm.
    """
    n = F / (2 - F)
    radius = A / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    alpha = (
        n / 2 - 2 / 3 * n**2 + 5 / 16 * n**3,
        13 / 48 * n**2 - 3 / 5 * n**3,
        61 / 240 * n**3,
    )
    s, away = np.sin(np.radians(latitude)), np.radians(longitude - (6 * zone - 183))
    root = 2 * np.sqrt(n) / (1 + n)
    t = np.sinh(np.arctanh(s) - root * np.arctanh(root * s))
    xi, eta = np.arctan2(t, np.cos(away)), np.arctanh(np.sin(away) / np.hypot(1, t))
    east, north = eta, xi
    for j, a in enumerate(alpha, start=1):
        east += a * np.cos(2 * j * xi) * np.sinh(2 * j * eta)
        north += a * np.sin(2 * j * xi) * np.cosh(2 * j * eta)
    return 500_000 + K0 * radius * east, K0 * radius * north


def project(
    projection: Projection, latitude: float, longitude: float, height: float = 0.0
) -> tuple[float, float]:
    """Return easting and northing of one place in degrees."""
    east, north = projection.project(np.array([(np.radians(latitude), np.radians(longitude), height)]))
    return float(east[0]), float(north[0])


def at(latitude: float, longitude: float) -> Projection:
    """Return the projection of a flight that starts at a place in degrees."""
    return Projection.at(np.radians(latitude), np.radians(longitude))


def test_a_published_point():
    """The CN Tower, 43°38′33.24″ N 79°23′13.7″ W, is at 17T 630084 m E 4833438 m N."""
    latitude, longitude = 43 + 38 / 60 + 33.24 / 3600, -(79 + 23 / 60 + 13.7 / 3600)
    tower = at(latitude, longitude)
    assert tower.zone == 17
    assert tower.label == "UTM zone 17 north"
    assert project(tower, latitude, longitude) == pytest.approx((630084, 4833438), abs=1)


@pytest.mark.parametrize(
    ("latitude", "longitude", "zone"),
    [
        (45.47, -73.74, 18), (33.94, -118.4, 11), (0.0, 3.0, 31), (82.9, -179.9, 1), (60.2, 24.9, 35),
        (47.0, 5.99, 31), (47.0, 6.01, 32), (10.0, 179.9, 60),
    ],
)  # fmt: skip
def test_north_of_the_equator(latitude, longitude, zone):
    projection = at(latitude, longitude)
    assert projection.zone == zone
    assert project(projection, latitude, longitude) == pytest.approx(
        kruger(latitude, longitude, zone), abs=0.01
    )


@pytest.mark.parametrize(("latitude", "longitude", "zone"), [(-33.95, 151.18, 56), (-78.5, -68.0, 19)])
def test_south_of_the_equator_the_northing_counts_from_ten_thousand_kilometres(latitude, longitude, zone):
    projection = at(latitude, longitude)
    east, north = kruger(latitude, longitude, zone)
    assert projection.label == f"UTM zone {zone} south"
    assert project(projection, latitude, longitude) == pytest.approx((east, north + 1e7), abs=0.01)


def test_the_exceptions_of_norway_and_svalbard():
    assert at(60.4, 5.3).zone == 32
    assert at(78.2, 15.6).zone == 33


def test_a_flight_stays_on_the_sheet_where_it_starts():
    """Over the edge of a zone and over the equator, coordinates go on without a jump."""
    start = at(0.01, 5.99)
    for latitude, longitude in ((0.01, 6.3), (-0.2, 5.9), (-0.2, 6.3)):
        assert project(start, latitude, longitude) == pytest.approx(kruger(latitude, longitude, 31), abs=0.01)


@pytest.mark.parametrize("beyond", [180.02, -179.98])
def test_over_the_date_line(beyond):
    start = at(-17.0, 179.99)
    east, north = kruger(-17.0, 180.02, 60)
    assert project(start, -17.0, beyond) == pytest.approx((east, north + 1e7), abs=0.01)


@pytest.mark.parametrize("latitude", [85.0, 83.5, -79.5, -88.0])
def test_near_the_poles_coordinates_are_local_east_and_north(latitude):
    projection = at(latitude, 20.0)
    assert projection.zone == 0
    assert projection.label == "from the start"
    east, north, _ = pymap3d.geodetic2enu(latitude + 0.01, 20.1, 0, latitude, 20.0, 0)
    assert project(projection, latitude + 0.01, 20.1) == pytest.approx((east, north), abs=1e-6)


def test_an_estimate_that_strays_to_the_pole_is_still_shown():
    east, north = project(at(45.0, 9.0), 89.0, 9.0)
    assert (east, north) == pytest.approx(kruger(84.0, 9.0, 32), abs=0.01)


@pytest.mark.parametrize("latitude", [45.0, 88.0])
def test_no_positions_give_no_coordinates(latitude):
    east, north = at(latitude, 9.0).project(np.zeros((0, 3)))
    assert east.shape == north.shape == (0,)
