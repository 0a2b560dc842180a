"""Figures: the linked, fast Bokeh figures of the page; made once, afterwards only their data change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.events import DoubleTap, Tap
from bokeh.models.annotations import Legend, LegendItem, Span
from bokeh.models.callbacks import CustomJS
from bokeh.models.formatters import CustomJSTickFormatter
from bokeh.models.ranges import Range1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.tickers import LogTicker
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tools import BoxZoomTool, CrosshairTool, HoverTool, WheelPanTool, WheelZoomTool
from bokeh.plotting import figure

from lab.views.envelope import FloatArray, envelope, limits
from lab.views.quantities import CURSOR, Band, Clock, Curve, TimePlot

if TYPE_CHECKING:
    from lab.result import Result


class TimeAxis:
    """The time axis all figures of one session share: range, cursor and crosshair.

    Attributes
    ----------
    range : Range1d
        Visible stretch of time [s].
    cursor : Span
        The time under study [s].
    duration : float
        End of the flight [s].
    """

    def __init__(self) -> None:
        self.duration = 1.0
        self.range = Range1d(start=0.0, end=1.0, bounds=(0.0, 1.0), min_interval=0.05)
        self.cursor = Span(dimension="height", location=0.0, line_color=CURSOR, line_width=1.2)
        self.crosshair = Span(dimension="height", line_color="#808895", line_dash="dotted", line_width=1)

    @property
    def window(self) -> tuple[float, float]:
        """Visible stretch of time [s]."""
        return self.range.start, self.range.end  # type: ignore[return-value]  # never dates here

    @property
    def time(self) -> float:
        """The time under study [s]."""
        return self.cursor.location  # type: ignore[return-value]  # never a date here

    def span(self, duration: float) -> None:
        """Make the axis end with the flight; a flight of another length is shown whole."""
        if duration != self.duration:
            self.duration = duration
            self.range.update(bounds=(0.0, duration), reset_start=0.0, reset_end=duration)
            self.whole()
            self.cursor.location = min(self.time, duration)

    def whole(self) -> None:
        """Show the whole flight."""
        self.range.update(start=0.0, end=self.duration)


class TimeFigures:
    """A set of figures over the shared time axis that draw from one data source for each clock.

    Parameters
    ----------
    plots
        What is shown, one figure each.
    axis
        Time axis, shared with other figures.
    height
        Least height of a figure [px].

    Attributes
    ----------
    figures : list of figure
        In the order of `plots`.
    """

    def __init__(self, plots: Sequence[TimePlot], axis: TimeAxis, height: int = 150) -> None:
        self.plots = tuple(plots)
        self.axis = axis
        self._sources: dict[Clock, ColumnDataSource] = {}
        for plot in self.plots:
            columns = self._sources.setdefault(plot.clock, ColumnDataSource({"time": np.zeros(0)})).data
            for name in _columns(plot):
                columns[name] = np.zeros(0)
        self.figures = [self._draw(plot, height) for plot in self.plots]

    def show(self, result: Result) -> None:
        """Draw a result, in the stretch of time that is visible."""
        for clock, source in self._sources.items():
            plots = [plot for plot in self.plots if plot.clock == clock]
            names = [name for plot in plots for name in _columns(plot)]
            series = [values for plot in plots for values in _read(plot, result)]
            time, thinned = envelope(_times(result, clock), series, self.axis.window)
            data = dict(zip(names, (values.astype(np.float32) for values in thinned), strict=True))
            for plot in plots:
                low, high = limits([data[name] for name in _columns(plot)], plot.scale)
                self.figures[self.plots.index(plot)].y_range.update(start=low, end=high)
            source.data = {"time": time.astype(np.float32), **data}

    def _draw(self, plot: TimePlot, height: int) -> figure:
        source = self._sources[plot.clock]
        fig = time_figure(plot.heading, self.axis, logarithmic=plot.scale == "logarithmic", height=height)
        if plot.band is not None:
            draw_band(fig, plot.band, source)
        glyphs = {curve.label: draw_curve(fig, curve, source, "time") for curve in reversed(plot.curves)}
        tooltips = [("time", "@time{0.00} s")]
        tooltips += [(curve.label, f"@{curve.name}{{0.0000}} {plot.unit}") for curve in plot.curves]
        if plot.band is not None:
            edges = f"@{plot.band.name}_low{{0.0000}} … @{plot.band.name}_high{{0.0000}}"
            tooltips.append((plot.band.label, f"{edges} {plot.unit}"))
        fig.add_tools(HoverTool(mode="vline", renderers=[glyphs[plot.curves[0].label]], tooltips=tooltips))
        if len(plot.curves) > 1:
            add_legend(fig, {curve.label: glyphs[curve.label] for curve in plot.curves})
        return fig


def time_figure(title: str, axis: TimeAxis, *, logarithmic: bool = False, height: int = 150) -> figure:
    """Return an empty figure over the shared time axis: drag to zoom, double-click to reset.

    Parameters
    ----------
    title
        What it shows, with the unit.
    axis
        The shared time axis.
    logarithmic
        Whether the ordinate is logarithmic.
    height
        Least height [px].
    """
    fig = figure(
        title=title,
        x_range=axis.range,
        y_range=Range1d(start=0.1 if logarithmic else -1.0, end=1.0),
        y_axis_type="log" if logarithmic else "linear",
        tools=[
            BoxZoomTool(dimensions="width"),
            WheelPanTool(dimension="width", modifiers="shift"),
            WheelZoomTool(dimensions="width", modifiers="ctrl"),
            CrosshairTool(overlay=axis.crosshair),
        ],
        **_frame(height),
    )
    if logarithmic:
        fig.yaxis.ticker = LogTicker(mantissas=[1, 2, 5], desired_num_ticks=5)
    fig.xaxis.formatter = CustomJSTickFormatter(code="return `${+tick.toFixed(6)} s`")
    fig.renderers.append(axis.cursor)
    fig.js_on_event(Tap, CustomJS(args={"cursor": axis.cursor}, code="cursor.location = cb_obj.x"))
    fig.js_on_event(DoubleTap, CustomJS(args={"x": axis.range}, code="x.setv({start: 0, end: x.bounds[1]})"))
    return fig


def plain_figure(title: str, x_label: str, y_label: str, *, height: int = 150, **options: Any) -> figure:
    """Return an empty figure with labelled axes, in the same dress as the figures over time.

    Parameters
    ----------
    title, x_label, y_label
        What it shows, with units.
    height
        Least height [px].
    **options
        Further properties of the figure.
    """
    return figure(title=title, x_axis_label=x_label, y_axis_label=y_label, **_frame(height), **options)


def draw_curve(fig: figure, curve: Curve, source: ColumnDataSource, x: str) -> GlyphRenderer[Any]:
    """Draw a curve of a source and return its renderer."""
    if curve.style == "points":
        return fig.scatter(x, curve.name, source=source, size=4, color=curve.colour, line_color=None)
    dash = "dashed" if curve.style == "dashed" else "solid"
    width = 1.6 if curve.style == "dashed" else 1.3
    return fig.line(x, curve.name, source=source, color=curve.colour, line_width=width, line_dash=dash)


def draw_band(fig: figure, band: Band, source: ColumnDataSource) -> None:
    """Draw a band of a source over its time."""
    low, high = f"{band.name}_low", f"{band.name}_high"
    fig.varea("time", low, high, source=source, color=band.colour, alpha=0.16)
    for edge in (low, high):
        fig.line("time", edge, source=source, color=band.colour, alpha=0.3, line_width=1)


def add_legend(fig: figure, glyphs: dict[str, GlyphRenderer[Any]]) -> None:
    """Put a legend on the right of the title line; a click hides a curve."""
    legend = Legend(
        items=[LegendItem(label=label, renderers=[glyph]) for label, glyph in glyphs.items()],
        orientation="horizontal",
        location="top_right",
        click_policy="hide",
        margin=2,
    )
    fig.add_layout(legend)


def _frame(height: int) -> dict[str, Any]:
    return {
        "sizing_mode": "stretch_both",
        "min_height": height,
        "min_border_left": 52,
        "min_border_right": 14,
        "toolbar_location": None,
        "lod_threshold": None,
        "output_backend": "canvas",
    }


def _columns(plot: TimePlot) -> list[str]:
    names = [curve.name for curve in plot.curves]
    return names + ([f"{plot.band.name}_low", f"{plot.band.name}_high"] if plot.band else [])


def _read(plot: TimePlot, result: Result) -> list[FloatArray]:
    series = [curve.read(result) for curve in plot.curves]
    return series + (list(plot.band.edges(result)) if plot.band else [])


def _times(result: Result, clock: Clock) -> FloatArray:
    return result.time if clock == "time" else result.fixes.time
