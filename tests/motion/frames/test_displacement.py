"""Displacement: metres to latitude and longitude and back, against pymap3d; and their only owner."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pymap3d
import pytest

import lab
from lab.motion.frames.displacement import displaced, displacement, longer_above, metres_per_radian

ROOT = Path(lab.__file__).parent
CURVATURE = {
    "analysis/errors.py": "the turn of north along a position error",
    "analysis/transition.py": "the strapdown's state",
    "motion/frames/displacement.py": "the owner",
    "motion/frames/earth.py": "the definition",
    "motion/frames/ecef.py": "Earth-fixed positions",
    "motion/kinematics/ideal_imu.py": "their derivatives in time",
    "data/rebuild/derived_motion.py": "the transport rate",
    "navigation/strapdown.py": "the transport rate, compiled",
    "navigation/wander.py": "the curvature in the wander frame",
}
"""Files that need the radii of curvature themselves, and what for; all others need metres per radian."""


def uses_radii(path: Path) -> bool:
    """Return whether a file imports or asks for the radii of curvature."""
    return any(
        (isinstance(part, ast.alias) and part.name == "radii")
        or (isinstance(part, ast.Attribute) and part.attr == "radii")
        or (isinstance(part, ast.FunctionDef) and part.name == "radii")
        for part in ast.walk(ast.parse(path.read_text("utf-8")))
    )


@pytest.mark.proof
def test_metres_become_latitude_and_back_in_one_place() -> None:
    found = {path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*.py") if uses_radii(path)}
    assert found == set(CURVATURE)


@pytest.mark.parametrize("latitude", [-80.0, -33.0, 0.0, 45.0, 84.0])
@pytest.mark.parametrize("height", [-100.0, 0.0, 12_000.0])
def test_metres_per_radian_are_those_of_pymap3d(latitude: float, height: float) -> None:
    step = 1e-4  # [°], so that the second order is below 1e-5 m
    north, east = metres_per_radian(np.radians([latitude]), height)
    around = [
        pymap3d.geodetic2enu(latitude + a, 10 + b, height, latitude - a, 10 - b, height)
        for a, b in ((step / 2, 0.0), (0.0, step / 2))
    ]
    assert np.hypot(*around[0][:2]) == pytest.approx(float(north[0]) * np.radians(step), rel=1e-7)
    assert np.hypot(*around[1][:2]) == pytest.approx(float(east[0]) * np.radians(step), rel=1e-7)


@pytest.mark.parametrize("latitude", [-80.0, -33.0, 0.0, 45.0, 84.0])
def test_a_way_at_a_height_is_longer_as_in_earth_fixed_axes(latitude: float) -> None:
    height, step = 10_000.0, 1e-4
    more = [float(one[0]) for one in longer_above(np.radians([latitude]), np.array([height]))]
    for factor, (a, b) in zip(more, ((step, 0.0), (0.0, step)), strict=True):
        low, high = (
            np.linalg.norm(
                np.subtract(
                    pymap3d.geodetic2ecef(latitude + a, b, h), pymap3d.geodetic2ecef(latitude - a, -b, h)
                )
            )
            for h in (0.0, height)
        )
        assert factor == pytest.approx(high / low, rel=1e-8)


def test_a_displacement_leads_back() -> None:
    here = np.array([[0.8, 3.1, 200.0], [-1.2, -0.4, 0.0], [np.radians(89.9999), 1.0, 50.0]])
    moved = np.array([[30.0, -20.0, 5.0], [-7.0, 90.0, -3.0], [4.0, 6.0, 1.0]])
    np.testing.assert_allclose(displacement(here, displaced(here, moved)), moved, atol=1e-6)
