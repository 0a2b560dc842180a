"""Field figures: the fields of a magnetometer, seen along each axis, and the sphere through them."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from bokeh.models.ranges import Range1d
from bokeh.models.sources import ColumnDataSource
from bokeh.plotting import figure

from lab.base.arrays import FloatArray
from lab.live.bench.field_sphere import FieldSphere
from lab.views.envelope import nice_limit
from lab.views.figures import plain_figure
from lab.views.live_figures import AXES, keep_equal
from lab.views.quantities import CURSOR, ESTIMATE

_PAIRS = tuple(combinations(range(3), 2))
"""Axes of the three views."""
_CIRCLE = np.linspace(0.0, 2 * np.pi, 73)
"""Directions of the outline of a sphere: 5° apart, it is round."""
MICROTESLA = 1e-6
"""Unit of the figures [T]."""


class FieldFigures:
    """Three views of the same points with the outline of a sphere.

    Attributes
    ----------
    figures : list of figure
        Forward and right, forward and down, right and down.
    """

    def __init__(self) -> None:
        self._points = ColumnDataSource({axis: np.zeros(0) for axis in AXES})
        self._outline = ColumnDataSource({f"{end}{k}": np.zeros(0) for end in "xy" for k in range(3)})
        self._ranges: list[Range1d] = []
        self.figures: list[figure] = []
        for k, (i, j) in enumerate(_PAIRS):
            x, y = Range1d(start=-100, end=100), Range1d(start=-100, end=100)
            title = f"Magnetic field, {AXES[i]} and {AXES[j]}"
            fig = plain_figure(title, f"{AXES[i]} [µT]", f"{AXES[j]} [µT]", x_range=x, y_range=y)
            fig.scatter(AXES[i], AXES[j], source=self._points, color=ESTIMATE, size=3, alpha=0.6)
            fig.line(f"x{k}", f"y{k}", source=self._outline, color=CURSOR, line_width=1.6)
            keep_equal(fig, x, y)
            self._ranges += [x, y]
            self.figures.append(fig)

    def show(self, fields: FloatArray, sphere: FieldSphere | None) -> None:
        """Draw fields (n, 3) forward, right, down [T], and the sphere if there is one."""
        points = fields / MICROTESLA
        limit = nice_limit(1.1 * float(np.abs(points).max(initial=1.0)))
        for one in self._ranges:
            one.update(start=-limit, end=limit)
        outline = {name: np.zeros(0) for name in self._outline.data}
        if sphere is not None:
            centre, radius = sphere.centre / MICROTESLA, sphere.radius / MICROTESLA
            for k, (i, j) in enumerate(_PAIRS):
                outline[f"x{k}"] = centre[i] + radius * np.cos(_CIRCLE)
                outline[f"y{k}"] = centre[j] + radius * np.sin(_CIRCLE)
        self._outline.data = outline
        self._points.data = dict(zip(AXES, points.T, strict=True))
