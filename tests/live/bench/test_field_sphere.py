"""The sphere through the fields of a magnetometer: hard iron, size, scatter, and when there is none."""

from __future__ import annotations

import numpy as np
import pytest

from lab.live.bench.field_sphere import FEWEST, fit_sphere

IRON = np.array([12e-6, -30e-6, 7e-6])
"""Hard iron [T]."""
FIELD, NOISE = 48e-6, 0.4e-6
"""Size of the Earth's field, and noise of an axis [T]."""


def turned(count: int, lowest: float = -1.0, seed: int = 1) -> np.ndarray:
    """Return fields in directions that are spread evenly over a sphere above a height of its radius 1."""
    rng = np.random.default_rng(seed)
    z, angle = rng.uniform(lowest, 1, count), rng.uniform(0, 2 * np.pi, count)
    level = np.sqrt(1 - z**2)
    directions = np.column_stack((level * np.cos(angle), level * np.sin(angle), z))
    return IRON + FIELD * directions + NOISE * rng.standard_normal((count, 3))


@pytest.mark.parametrize("lowest", [-1.0, 0.0, 0.4])
def test_the_centre_is_the_hard_iron(lowest: float) -> None:
    found = fit_sphere(turned(2000, lowest))
    assert found is not None
    np.testing.assert_allclose(found.centre, IRON, atol=0.1 * NOISE if lowest < 0 else 2 * NOISE)
    assert found.radius == pytest.approx(FIELD, abs=NOISE if lowest <= 0 else 2 * NOISE)
    assert found.scatter == pytest.approx(NOISE, rel=0.05)
    assert "48." in str(found) or "47." in str(found)
    assert "\u221230." in str(found) or "\u221229." in str(found)


def test_soft_iron_is_seen_as_scatter() -> None:
    found = fit_sphere((turned(2000) - IRON) * (1.1, 1.0, 0.9))
    assert found is not None
    assert found.scatter > 5 * NOISE


def test_points_near_a_plane_and_few_points_show_no_sphere() -> None:
    flat = turned(500)
    flat[:, 2] = IRON[2] + NOISE * np.random.default_rng(2).standard_normal(500)
    assert fit_sphere(flat) is None
    assert fit_sphere(turned(FEWEST - 1)) is None
    assert fit_sphere(np.tile(IRON, (100, 1))) is None  # a device at rest without noise
