"""Report scene: the flight in three dimensions as a drawing that one can turn, without any library."""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lab.base.arrays import FloatArray
from lab.motion.truth.trajectory import Truth
from lab.views.quantities import ESTIMATE, FIXES, TRUTH

if TYPE_CHECKING:
    from lab.experiment.result import Result
    from lab.navigation.solution import Solution

POINTS = 400
"""Most points of a path: the drawing has some 700 px across."""
WIDE, HIGH = 1000.0, 420.0
"""Size of the drawing, in its own units."""
FLATTEST = 0.2
"""Least extent of the heights by the horizontal one; a flatter flight has its heights drawn larger."""
STYLE = """
#scene { width: 100%; height: auto; touch-action: pan-y; cursor: grab; break-inside: avoid; }
#scene polyline { fill: none; stroke-linejoin: round; stroke-linecap: round; }
"""

_SCRIPT = Path(__file__).with_name("report_scene.js").read_text("utf-8")
AZIMUTH, ELEVATION = -np.pi / 4, 0.45
"""Direction from which the drawing is first seen: from the south-west, and from above [rad]."""


def scene_html(result: Result) -> str:
    """Return estimate, truth and fixes in three dimensions as HTML, with a shadow on the ground.

    It is drawn without a script; with one, a drag or the arrow keys turn it.
    """
    truth = result.truth_arrays
    paths = [_enu(result, result.solution_arrays)]
    if truth is not None:
        paths.append(_enu(result, truth))
    every = max(1, -(-len(result.fixes.time) // POINTS))
    fixes = _metres(result, result.fixes.position[::every])
    middle = (paths[0].min(axis=0) + paths[0].max(axis=0)) / 2
    extent = np.ptp(paths[0], axis=0)
    across, climb = max(float(np.hypot(*extent[:2])), 1.0), max(float(extent[2]), 1e-3)
    factor = _round_factor(max(1.0, FLATTEST * across / climb))
    scale = np.array([1.0, 1.0, factor]) * min(
        0.92 * WIDE / across, 1.2 * HIGH / (0.5 * across + factor * climb)
    )
    drawn = [((one - middle) * scale).round(1) for one in paths]
    floor = float(drawn[0][:, 2].min())
    shadow = drawn[0].copy()
    shadow[:, 2] = floor
    dots = ((fixes - middle) * scale).round(1)
    lines = [("shadow", "#9aa3ae", "1", "", shadow)]
    lines += [("GPS fixes", FIXES, "4", "", np.repeat(one[None], 2, axis=0)) for one in dots]
    lines.append(("estimate", ESTIMATE, "2.4", "", drawn[0]))
    if truth is not None:
        lines.append((result.truth_word, TRUTH, "1.4", "5 4", drawn[1]))
    svg = "".join(
        f'<polyline stroke="{colour}" stroke-width="{width}" stroke-dasharray="{dash}" '
        f'points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in _project_points(points))}"/>'
        for _, colour, width, dash, points in lines
    )
    words = ", ".join(
        f'<b style="color: {colour}">{escape(name)}</b>'
        for name, colour in {one[0]: one[1] for one in lines}.items()
    )
    larger = f" Heights are drawn {factor:g} times larger." if factor > 1 else ""
    data = escape(json.dumps([points.tolist() for *_, points in lines], separators=(",", ":")))
    return (
        f'<p class="quiet">{words}. Seen from the south-west.{larger} '
        "Drag, or use the arrow keys, to turn it.</p>"
        f'<svg id="scene" tabindex="0" role="img" aria-label="The flight in three dimensions" '
        f'viewBox="{-WIDE / 2} {-HIGH / 2} {WIDE} {HIGH}" data-azimuth="{AZIMUTH}" '
        f'data-elevation="{ELEVATION}" data-paths="{data}">{svg}</svg><script>{_SCRIPT}</script>'
    )


def _project_points(points: FloatArray) -> FloatArray:
    """Return the places (n, 2) of points (n, 3), east, north, up, seen from the first direction."""
    east, north, up = points.T
    turned = east * np.cos(AZIMUTH) + north * np.sin(AZIMUTH)
    away = east * np.sin(AZIMUTH) - north * np.cos(AZIMUTH)
    return np.stack((turned, away * np.sin(ELEVATION) - up * np.cos(ELEVATION)), axis=-1)


def _enu(result: Result, path: Truth | Solution) -> FloatArray:
    some = np.linspace(0, result.time.size - 1, min(result.time.size, POINTS)).astype(np.intp)
    return _metres(result, path.taken(some).position if isinstance(path, Truth) else path.position[some])


def _metres(result: Result, position: FloatArray) -> FloatArray:
    """Return the metres east and north of the start, and the height [m] (n, 3), of positions (n, 3)."""
    return np.column_stack((*result.projection._replace(zone=0).project(position), position[:, 2]))


def _round_factor(factor: float) -> float:
    return float(f"{factor:.1g}") if factor > 1 else 1.0
