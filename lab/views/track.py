"""Track: the ground track in metres on the map, both axes to the same scale."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from bokeh.core.properties import value
from bokeh.models.annotations import Title
from bokeh.models.formatters import CustomJSTickFormatter
from bokeh.models.ranges import DataRange1d
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tickers import BasicTicker
from bokeh.models.tools import HoverTool, PanTool, ResetTool, SaveTool, WheelZoomTool

from lab.views.envelope import thin_path
from lab.views.figures import plain_figure
from lab.views.legend import add_legend
from lab.views.quantities import CURSOR, ESTIMATE, FIXES, TRUTH

if TYPE_CHECKING:
    from lab.experiment.result import Result

POINTS = 2000
"""Largest number of drawn points of a path."""


class TrackFigure:
    """Truth, estimate, GPS fixes, and the position of the aircraft at the time cursor.

    Attributes
    ----------
    figure : figure
        The figure.
    """

    def __init__(self) -> None:
        empty = {"easting": np.zeros(0), "northing": np.zeros(0), "time": np.zeros(0)}
        self._true, self._estimated, self._fixes, self._now = (
            ColumnDataSource(dict(empty)) for _ in range(4)
        )
        self._result: Result | None = None
        self._title = Title(text="Ground track")
        self.figure = plain_figure(
            self._title,
            "easting [m]",
            "northing [m]",
            height=420,
            match_aspect=True,
            x_range=DataRange1d(range_padding=0.06),
            y_range=DataRange1d(range_padding=0.06),
            tools=[PanTool(), zoom := WheelZoomTool(), ResetTool(), SaveTool()],
        )
        fig = self.figure
        fig.toolbar_location, fig.toolbar.active_scroll = "right", zoom
        fig.xaxis.ticker = BasicTicker(desired_num_ticks=4)
        for axis in (fig.xaxis, fig.yaxis):
            axis.formatter = CustomJSTickFormatter(
                code="return tick.toLocaleString('en').replaceAll(',', '\\u2009')"
            )
        estimated = fig.line("easting", "northing", source=self._estimated, color=ESTIMATE, line_width=2.2)
        true = fig.line(
            "easting", "northing", source=self._true, color=TRUTH, line_width=1.6, line_dash="dashed"
        )
        fixes = fig.scatter(
            "easting", "northing", source=self._fixes, color=FIXES, size=5, line_color=None, alpha=0.7
        )
        fig.scatter(
            "easting",
            "northing",
            source=self._now,
            fill_color=CURSOR,
            size=11,
            line_color="white",
            line_width=2,
        )
        tooltips = [
            ("time", "@time{0.0} s"),
            ("easting", "@easting{0.0} m"),
            ("northing", "@northing{0.0} m"),
        ]
        fig.add_tools(HoverTool(renderers=[estimated, fixes], tooltips=tooltips))
        legend = add_legend(fig, {"estimate": estimated, "truth": true, "GPS fixes": fixes})
        self._truth = legend["truth"]

    def show(self, result: Result, time: float) -> None:
        """Draw a result, with the aircraft at a time [s]."""
        self._result = result
        label = result.projection.label
        self._title.text = f"Ground track, {label}"
        self._truth.update(visible=result.truth_arrays is not None, label=value(result.truth_word))
        for source, path in ((self._true, "true"), (self._estimated, "estimated")):
            if path not in result.drawn_track.path:
                source.data = {"easting": np.zeros(0), "northing": np.zeros(0), "time": np.zeros(0)}
                continue
            track = result.drawn_track.sel(path=path)
            points = np.stack([track["easting"].values, track["northing"].values], axis=-1)
            kept = thin_path(points, POINTS)
            source.data = {
                "easting": points[kept, 0],
                "northing": points[kept, 1],
                "time": track["time"].values[kept],
            }
        gps = result.gps
        self._fixes.data = {
            "easting": gps["easting"].values,
            "northing": gps["northing"].values,
            "time": result.fixes.time,
        }
        self.show_time(time)

    def release(self) -> None:
        """Refer to no result any more; what is drawn stays."""
        self._result = None

    def show_time(self, time: float) -> None:
        """Mark the estimated position at a time [s]."""
        if self._result is None:
            return
        index = min(int(np.searchsorted(self._result.time, time)), len(self._result.time) - 1)
        east, north, _ = self._result.places(np.array([index]))[0]
        self._now.data = {"easting": [east], "northing": [north], "time": [time]}
