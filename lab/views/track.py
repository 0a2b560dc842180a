"""Track: the ground track in metres from the start of the flight, both axes to the same scale."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.core.properties import value
from bokeh.models.formatters import CustomJSTickFormatter
from bokeh.models.glyphs import Line, MultiLine, Scatter, Text
from bokeh.models.ranges import DataRange1d
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tickers import BasicTicker
from bokeh.models.tools import HoverTool, PanTool, ResetTool, SaveTool, WheelZoomTool

from lab.base.arrays import FloatArray
from lab.motion.truth.trajectory import Truth
from lab.navigation.solution import Solution
from lab.views.envelope import thin_path
from lab.views.figures import plain_figure
from lab.views.legend import add_legend
from lab.views.quantities import CURSOR, ESTIMATE, FIXES, HELD, TRUTH

if TYPE_CHECKING:
    from lab.experiment.result import Result

POINTS = 1000
"""Largest number of drawn points of a path: more than one for each pixel of a side of the figure."""
SAMPLES = 2**12
"""Samples of a path among which its points are chosen."""

NOWHERE = np.zeros((0, 2)), np.zeros(0)
"""Points and times of a path that is not known."""

Columns = dict[str, FloatArray]


class TrackFigure:
    """Truth, estimate, GPS fixes, start and end, and the position of the aircraft at the time cursor.

    Attributes
    ----------
    figure : figure
        The figure.
    """

    def __init__(self) -> None:
        self._true, self._estimated, self._fixes, self._now = (
            ColumnDataSource(_columns(*NOWHERE)) for _ in range(4)
        )
        self._ends = ColumnDataSource({"east": [], "north": [], "marker": [], "word": []})
        self._held = ColumnDataSource({"east": [], "north": [], "colour": []})
        self._result: Result | None = None
        self._truth: Truth | None = None
        self.figure = plain_figure(
            "Ground track",
            "east of the start [m]",
            "north of the start [m]",
            height=420,
            match_aspect=True,
            x_range=DataRange1d(range_padding=0.1),
            y_range=DataRange1d(range_padding=0.2),
            tools=[PanTool(), zoom := WheelZoomTool(), ResetTool(), SaveTool()],
        )
        fig = self.figure
        fig.toolbar_location = "right"
        fig.toolbar.update(active_scroll=zoom, logo=None)
        fig.xaxis.ticker = BasicTicker(desired_num_ticks=4)
        fig.axis.formatter = CustomJSTickFormatter(
            code="return tick.toLocaleString('en').replaceAll(',', '\\u2009').replace('-', '\\u2212')"
        )
        place: dict[str, Any] = {"x": "east", "y": "north"}
        estimated = fig.add_glyph(self._estimated, Line(**place, line_color=ESTIMATE, line_width=2.2))
        true = fig.add_glyph(self._true, Line(**place, line_color=TRUTH, line_width=1.6, line_dash="dashed"))
        fixes = fig.add_glyph(
            self._fixes, Scatter(**place, fill_color=FIXES, size=5, line_color=None, fill_alpha=0.7)
        )
        fig.add_glyph(self._held, MultiLine(xs="east", ys="north", line_color="colour", line_width=1.0))
        fig.add_glyph(
            self._ends, Scatter(**place, marker="marker", size=9, fill_color=TRUTH, line_color="white")
        )
        fig.add_glyph(
            self._ends,
            Text(**place, text="word", x_offset=8, y_offset=-4, text_font_size="12px", text_color=TRUTH),
        )
        fig.add_glyph(
            self._now, Scatter(**place, fill_color=CURSOR, size=11, line_color="white", line_width=2)
        )
        tooltips = [("time", "@time{0.0} s"), ("east", "@east{0.0} m"), ("north", "@north{0.0} m")]
        fig.add_tools(HoverTool(renderers=[estimated, fixes], tooltips=tooltips))
        for axis in (fig.x_range, fig.y_range):
            axis.update(renderers=[estimated, true, fixes])  # a held flight may be on another continent
        legend = add_legend(fig, {"estimate": estimated, "truth": true, "GPS fixes": fixes}, "below")
        self._truth_entry = legend["truth"]

    def show(self, result: Result, time: float, held: Sequence[Result | None] = ()) -> None:
        """Draw a result, with the aircraft at a time [s], and the paths of held results beside it.

        Each of these has the colour of its place; None leaves a place free.
        """
        self._result = result
        truth = result.truth_arrays
        self._truth_entry.update(visible=truth is not None, label=value(result.truth_word))
        if truth is None or truth is not self._truth:  # it is the same for most changes of settings
            self._truth = truth
            self._true.data = _columns(*NOWHERE) if truth is None else _path(result, truth, result.time)
        self._estimated.data = _path(result, result.solution_arrays, result.time)
        self._fixes.data = _columns(_on_map(result, result.fixes.position), result.fixes.time)
        beside = {
            colour: _path(result, one.solution_arrays, one.time)
            for colour, one in zip(HELD, held, strict=False)
            if one is not None
        }
        if beside or self._held.data["colour"]:
            lines = {name: [one[name] for one in beside.values()] for name in ("east", "north")}
            self._held.data = {**lines, "colour": list(beside)}
        ends = _on_map(result, result.solution_arrays.position[[0, -1]])
        self._ends.data = {
            "east": ends[:, 0], "north": ends[:, 1], "marker": ["circle", "square"], "word": ["start", "end"],
        }  # fmt: skip
        self.show_time(time)

    def release(self) -> None:
        """Refer to no result any more; what is drawn stays."""
        self._result = self._truth = None

    def show_time(self, time: float) -> None:
        """Mark the estimated position at a time [s]."""
        if self._result is None:
            return
        times = self._result.time
        index = min(int(np.searchsorted(times, time)), len(times) - 1)
        here = _on_map(self._result, self._result.solution_arrays.position[[index]])
        self._now.data = _columns(here, np.array([time]))


def _on_map(result: Result, position: FloatArray) -> FloatArray:
    """Return the metres east and north of the start (n, 2) of positions (n, 3)."""
    return np.stack(result.projection._replace(zone=0).project(position), axis=-1)


def _path(result: Result, path: Truth | Solution, time: FloatArray) -> Columns:
    """Return the columns of a path whose points were thinned."""
    some = np.linspace(0, time.size - 1, min(time.size, SAMPLES)).astype(np.intp)
    position = path.taken(some).position if isinstance(path, Truth) else path.position[some]
    points = _on_map(result, position)
    kept = thin_path(points, POINTS)
    return _columns(points[kept], time[some][kept])


def _columns(points: FloatArray, time: FloatArray) -> Columns:
    """Return the columns of points (n, 2) at their times (n,), of single precision."""
    named = {"east": points[:, 0], "north": points[:, 1], "time": time}
    return {name: values.astype(np.float32) for name, values in named.items()}
