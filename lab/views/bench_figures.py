"""Bench figures: the axes of a device as a picture, and the fields of its magnetometer beside a sphere."""

from __future__ import annotations

from html import escape
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
from lab.views.quantities import AXIS_COLOURS, CURSOR, ESTIMATE

_ARROWS = {
    "forward": ((157, 86), (236, 43), (245, 41)),
    "right": ((157, 86), (240, 120), (250, 128)),
    "down": ((157, 86), (157, 180), (168, 190)),
}
"""Beginning, tip, and place of the label of the arrow of each axis of the vehicle [px]."""
_PLATE = ((82, 96), (168, 50), (232, 76), (146, 122))
"""Corners of a plate that stands for the vehicle: left rear, left front, right front, right rear [px]."""
_PAIRS = tuple(combinations(range(3), 2))
"""Axes of the three views."""
_CIRCLE = np.linspace(0.0, 2 * np.pi, 73)
"""Directions of the outline of a sphere: 5° apart, it is round."""
MICROTESLA = 1e-6
"""Unit of the figures [T]."""


def axis_picture(axes: tuple[str, str, str] | None, *, inverted: bool = False) -> str:
    """Return a picture of a map as SVG, in the colours of the axes on all plots; text has the page's colour.

    Parameters
    ----------
    axes
        Axes of the device that point forward, right and down, such as ``-y``; None while they are unknown.
    inverted
        Whether the device sends the negative of the specific force.
    """
    left_rear, left_front, right_front, right_rear = (f"{x},{y}" for x, y in _PLATE)
    parts = [
        f'<polygon points="{left_rear} {left_front} {right_front} {right_rear}" fill="currentColor" '
        'opacity="0.13"/>',
        f'<polyline points="{left_front} {right_front}" stroke="currentColor" stroke-width="2"/>',
    ]
    for (name, (start, tip, label)), colour, axis in zip(
        _ARROWS.items(), AXIS_COLOURS, axes or ("?", "?", "?"), strict=True
    ):
        (x0, y0), (x1, y1), (x, y) = start, tip, label
        word = f"{name} = {axis.replace('-', '−')}"
        parts.append(
            f'<line x1="{x0}" y1="{y0}" x2="{x1}" y2="{y1}" stroke="{colour}" stroke-width="3"/>'
            f'<circle cx="{x1}" cy="{y1}" r="5" fill="{colour}"/>'
            f'<text x="{x}" y="{y}" fill="currentColor" font-size="15">'
            f"{escape(word)}</text>"
        )
    if inverted:
        parts.append(
            '<text x="8" y="20" fill="currentColor" font-size="13">'
            "The device sends the negative force.</text>"
        )
    return (
        '<svg viewBox="0 0 360 212" role="img" aria-label="Axes of the device in the vehicle" '
        f'style="width:100%;max-width:360px;height:auto;font-family:inherit">{"".join(parts)}</svg>'
    )


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
