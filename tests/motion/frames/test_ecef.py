"""Earth-fixed axes: against pymap3d, and at the poles themselves."""

from __future__ import annotations

import numpy as np
import pymap3d
from hypothesis import given
from hypothesis import strategies as st

from lab.motion.frames import earth, ecef

RNG = np.random.default_rng(1)
PLACES = np.column_stack(
    [
        np.concatenate((RNG.uniform(-np.pi / 2, np.pi / 2, 500), [np.pi / 2, -np.pi / 2, 0.0])),
        RNG.uniform(-np.pi, np.pi, 503),
        RNG.uniform(-1000, 100_000, 503),
    ]
)

angles = st.floats(-np.pi, np.pi)
metres = st.floats(-1000, 1000)


def test_positions_are_those_of_pymap3d_and_lead_back() -> None:
    r_e = ecef.position(PLACES)
    expected = np.stack(pymap3d.geodetic2ecef(*PLACES.T, deg=False), axis=-1)
    np.testing.assert_allclose(r_e, expected, rtol=0, atol=5e-9)
    back = ecef.geodetic(r_e)
    np.testing.assert_allclose(back[:, 2], PLACES[:, 2], rtol=0, atol=1e-8)
    np.testing.assert_allclose(ecef.position(back), r_e, rtol=0, atol=1e-8)
    np.testing.assert_allclose(back[:, 0], PLACES[:, 0], rtol=0, atol=1e-14)


def test_the_poles_themselves_are_places() -> None:
    b = earth.SEMI_MAJOR_AXIS * (1 - earth.FLATTENING)
    found = ecef.geodetic(np.array([[0.0, 0.0, b + 10], [0.0, 0.0, -b - 20]]))
    np.testing.assert_allclose(found[:, 0], [np.pi / 2, -np.pi / 2], rtol=0, atol=1e-15)
    np.testing.assert_allclose(found[:, 2], [10, 20], rtol=0, atol=1e-8)


def test_axes_are_those_of_pymap3d() -> None:
    C_en = ecef.axes(PLACES[:, 0], PLACES[:, 1])
    for column, enu in enumerate(((0, 1, 0), (1, 0, 0), (0, 0, -1))):
        expected = np.stack(pymap3d.enu2uvw(*enu, PLACES[:, 0], PLACES[:, 1], deg=False), axis=-1)
        np.testing.assert_allclose(C_en[:, :, column], expected, rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        C_en.transpose(0, 2, 1) @ C_en, np.broadcast_to(np.eye(3), C_en.shape), atol=1e-15
    )


@given(st.floats(-np.pi / 2, np.pi / 2), angles, metres, metres, metres)
def test_a_way_leads_there_and_is_found_again(
    latitude: float, longitude: float, north: float, east: float, down: float
) -> None:
    """Over the pole as well: the vertical turns by 10⁻⁷ in a metre, which is what is left."""
    here = np.array([[latitude, longitude, 500.0]])
    found = ecef.displacement(here, ecef.displaced(here, np.array([[north, east, down]])))
    np.testing.assert_allclose(found[0], [north, east, down], rtol=0, atol=0.2)
    assert found[0, 2] == np.float64(500.0) - (np.float64(500.0) - down)


@given(angles, angles, st.floats(0, 2 * np.pi))
def test_what_is_turned_over_the_pole_is_the_same_vector(one: float, other: float, course: float) -> None:
    """At the pole itself every direction is south, and the longitude says which."""
    here, there = np.array([[np.pi / 2, one]]), np.array([[np.pi / 2, other]])
    vector = np.array([[np.cos(course), np.sin(course), 0.5]])
    turned = ecef.resolve_elsewhere(vector, here, there)[0]
    # Seen along the longitude, north is the longitude's opposite: a turn of the longitude turns it all.
    turn = other - one
    expected = [np.cos(course + turn), np.sin(course + turn), 0.5]
    np.testing.assert_allclose(turned, expected, rtol=0, atol=1e-14)
