"""Aircraft: a small high-wing aeroplane as a mesh, for the 3-D view."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import trimesh

LENGTH = 8.1
"""Length of the mesh [m], about that of a Cessna 172."""


@cache
def aircraft() -> trimesh.Trimesh:
    """Return the aeroplane in body axes: x forward, y right, z down [m]."""
    cabin = _rings([(3.0, 0.25, 0.3), (2.4, 0.5, 0.5), (1.2, 0.6, 0.7), (-0.9, 0.6, 0.7)])
    boom = _rings([(-0.9, 0.6, 0.7), (-5.1, 0.1, 0.15)])
    wing = [(1.1, 0), (1.1, 3.0), (0.9, 5.5), (-0.2, 5.5), (-0.5, 3.0), (-0.5, 0)]
    tail = [(-4.0, 0), (-4.3, 1.8), (-5.0, 1.8), (-5.1, 0)]
    fin = [(-3.6, -0.2), (-4.5, -1.7), (-5.1, -1.7), (-5.0, -0.1)]
    propeller = [(0.95 * np.cos(a), 0.95 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 24, endpoint=False)]
    solids = [
        cabin,
        boom,
        _flat(wing, level=-0.75, thickness=0.15),
        _flat([(x, -y) for x, y in wing], level=-0.75, thickness=0.15),
        _flat(tail, level=-0.1, thickness=0.1),
        _flat([(x, -y) for x, y in tail], level=-0.1, thickness=0.1),
        np.array([(x, side, z) for x, z in fin for side in (-0.06, 0.06)]),
        np.array([(x, y, z) for y, z in propeller for x in (3.02, 3.05)]),
    ]
    mesh = trimesh.util.concatenate([trimesh.convex.convex_hull(points) for points in solids])
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def _rings(stations: Sequence[tuple[float, float, float]]) -> np.ndarray:
    """Return points on ellipses across the body: (x, half width, half height) of each."""
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    return np.array([(x, w * np.cos(a), h * np.sin(a)) for x, w, h in stations for a in angles])


def _flat(outline: Sequence[tuple[float, float]], level: float, thickness: float) -> np.ndarray:
    """Return the corners of a flat plate over an outline in x and y."""
    return np.array([(x, y, level + z) for x, y in outline for z in (-thickness / 2, thickness / 2)])
