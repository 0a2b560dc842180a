"""Field part: the sphere of points of a magnetometer that is turned in all directions."""

from __future__ import annotations

from html import escape
from typing import NamedTuple

import numpy as np

from dashboards.pages.base import make_hideable, plot_grid
from dashboards.pages.live.watched import ABOVE, LookingPart, Watched
from dashboards.style import whole_column, wide_html
from lab.base.arrays import FloatArray
from lab.data.streams.axis_map import AxisMap
from lab.live.bench.field_sphere import FieldSphere, fit_sphere
from lab.live.station import Station
from lab.views.bench_figures import FieldFigures

SAMPLES = 2**15
"""Last samples that are looked at: five minutes at 100 Hz."""
POINTS = 1500
"""Most points that are drawn."""
_TURN = "Turn the device in all directions: so far, the points lie near a plane and show no sphere."


class _Found(NamedTuple):
    fields: FloatArray
    sphere: FieldSphere | None


class FieldPart(LookingPart):
    """The fields of the last minutes and the sphere through them; for sources with a magnetometer.

    Attributes
    ----------
    view : panel.Column
        All of it; invisible until a field comes.
    """

    every = 1.0

    def __init__(self) -> None:
        super().__init__()
        self._axes, self._since = AxisMap(), 0  # axes of the samples from this one on
        self._figures = FieldFigures()
        self._words = wide_html(margin=(4, 10))
        grid = plot_grid(self._figures.figures, 3, least=260, beside=ABOVE)
        self.view = make_hideable(whole_column(self._words, grid))

    def watch(self, watched: Watched | None) -> None:
        """Show another source, or none."""
        self._watched, self._since = watched, 0
        self._axes = AxisMap() if self._station is None else self._station.source.axes
        self.view.visible = False
        self._figures.show(np.zeros((0, 3)), None)

    def look(self, station: Station) -> _Found:
        """Return the fields in the present axes, and the sphere."""
        source, end = station.source, station.source.end
        if source.axes != self._axes:  # points in other axes lie on another sphere
            self._axes, self._since = source.axes, end.imu
        begin = max(self._since, end.imu - SAMPLES)
        fields = source.since(end._replace(imu=begin)).imu["magnetic"]
        fields = fields[np.isfinite(fields).all(axis=1) & fields.any(axis=1)]
        return _Found(fields[:: max(-(-len(fields) // POINTS), 1)], fit_sphere(fields))

    def show(self, found: _Found) -> None:
        """Draw them."""
        if not len(found.fields):
            return
        self._words.object = f"<p>{escape(_TURN if found.sphere is None else str(found.sphere))}</p>"
        self._figures.show(*found)
        self.view.visible = True
