"""The Earth against pymap3d's ellipsoid and against the closed-form normal potential."""

from __future__ import annotations

import math

import numpy as np
import pymap3d
import pymap3d.rcurve
import pytest

from lab.motion.frames import earth

LATITUDES = np.radians([-89.0, -70.0, -33.9, -5.0, 0.0, 20.0, 45.5, 80.0])


@pytest.mark.parametrize("latitude", LATITUDES)
def test_radii_agree_with_pymap3d(latitude: float) -> None:
    meridian, transverse = earth.radii(math.sin(latitude))
    assert meridian == pytest.approx(pymap3d.rcurve.meridian(latitude, deg=False), rel=1e-12)
    assert transverse == pytest.approx(pymap3d.rcurve.transverse(latitude, deg=False), rel=1e-12)


@pytest.mark.parametrize(
    ("degrees", "published"), [(0.0, 9.7803253359), (90.0, 9.8321849378), (-90.0, 9.8321849378)]
)
def test_gravity_on_the_ellipsoid_is_the_published_one(degrees: float, published: float) -> None:
    assert earth.gravity(math.sin(math.radians(degrees)), 0.0) == pytest.approx(published, abs=2e-9)


def normal_potential(x: float, z: float) -> float:
    """Gravity potential of the level ellipsoid in a meridian plane (Heiskanen & Moritz, eq. 2-62)."""
    a, b = earth.SEMI_MAJOR_AXIS, earth.SEMI_MAJOR_AXIS * (1 - earth.FLATTENING)
    E2 = a * a - b * b
    E = math.sqrt(E2)
    r2 = x * x + z * z - E2
    u = math.sqrt(0.5 * (r2 + math.sqrt(r2 * r2 + 4 * E2 * z * z)))
    sin_beta = z / u
    cos2_beta = x * x / (u * u + E2)

    def q(u: float) -> float:
        return 0.5 * ((1 + 3 * u * u / E2) * math.atan(E / u) - 3 * u / E)

    return (
        earth.GRAVITATIONAL_CONSTANT / E * math.atan(E / u)
        + 0.5 * earth.RATE**2 * a * a * q(u) / q(b) * (sin_beta * sin_beta - 1 / 3)
        + 0.5 * earth.RATE**2 * (u * u + E2) * cos2_beta
    )


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("height", [0.0, 100.0, 3000.0, 12000.0])
def test_gravity_is_the_vertical_gradient_of_the_normal_potential(latitude: float, height: float) -> None:
    step = 500.0
    x, _, z = pymap3d.geodetic2ecef(latitude, 0.0, height, deg=False)
    up = np.array([math.cos(latitude), math.sin(latitude)])
    potential = [normal_potential(x + up[0] * s, z + up[1] * s) for s in (-step, step)]
    down = (potential[0] - potential[1]) / (2 * step)
    # The formula leaves out the cubic term in height, 0.3 µm/s² at 12 km; differencing costs 0.3 too.
    assert earth.gravity(math.sin(latitude), height) == pytest.approx(down, abs=2e-6)


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("height", [-100.0, 3000.0])
def test_gravity_gradient_is_the_finite_difference(latitude: float, height: float) -> None:
    step = 1e-4
    by_latitude, by_height = earth.gravity_gradient(math.sin(latitude), math.cos(latitude), height)
    north, south = (earth.gravity(math.sin(latitude + s), height) for s in (step, -step))
    above, below = (earth.gravity(math.sin(latitude), height + s) for s in (100.0, -100.0))
    assert by_latitude == pytest.approx((north - south) / (2 * step), abs=1e-8)
    assert by_height == pytest.approx((above - below) / 200.0, rel=1e-9)


def test_scalars_and_arrays_give_the_same() -> None:
    s = np.sin(LATITUDES)
    together = earth.gravity(s, np.full_like(s, 500.0))
    np.testing.assert_array_equal(together, [earth.gravity(float(v), 500.0) for v in s])
