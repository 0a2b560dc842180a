"""Figures: the shared time axis, and empty figures over it or beside it, with their ticks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.events import DoubleTap, Tap
from bokeh.models.annotations import Span, Title
from bokeh.models.callbacks import CustomJS
from bokeh.models.formatters import CustomJSTickFormatter
from bokeh.models.glyphs import VStrip
from bokeh.models.ranges import Range1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tickers import FixedTicker
from bokeh.models.tools import BoxZoomTool, CrosshairTool, WheelPanTool, WheelZoomTool
from bokeh.plotting import figure

from lab.views.quantities import CURSOR, NOTES

if TYPE_CHECKING:
    import pandas as pd

MOST_DECADES = 10
"""Most decades of a logarithmic axis with one tick each: a figure of 150 px has room for no more."""


class TimeAxis:
    """The time axis that all figures of one session share: range, cursor and crosshair.

    Parameters
    ----------
    name
        First word of the names of its models, by which they are found in a document: no two axes that may be
        in the same document have the same.
    hover
        Whether each figure explains its curves, and shows their values under the mouse. A page does both
        once, for all its figures.

    Attributes
    ----------
    range : Range1d
        Visible stretch of time [s].
    cursor : Span
        The time under study [s].
    outages : ColumnDataSource
        Stretches of time without GPS, shaded in all figures.
    duration : float
        End of the flight [s].
    samples : dict of str to callable
        Of each figure with thinned curves, by its id: returns their samples in the visible stretch, each at
        its own time.
    """

    def __init__(self, *, name: str = "time", hover: bool = True) -> None:
        self.hover = hover
        self.duration = 1.0
        self.range = Range1d(start=0.0, end=1.0, bounds=(0.0, 1.0), min_interval=0.05, name=f"{name} axis")
        # On a layer of their own: what is below stays painted where they move.
        self.cursor = Span(
            dimension="height",
            location=0.0,
            line_color=CURSOR,
            line_width=1.2,
            level="overlay",
            name=f"{name} cursor",
        )
        self.outages = ColumnDataSource({"start": [], "end": []}, name=f"{name} without GPS")
        self.samples: dict[str, Callable[[], pd.DataFrame]] = {}
        self._strips: list[GlyphRenderer[Any]] = []
        self._shaded: list[figure] = []
        self._notes: ColumnDataSource | None = None
        self.crosshair = Span(
            dimension="height", line_color="#808895", line_dash="dotted", line_width=1, level="overlay"
        )

    @property
    def window(self) -> tuple[float, float]:
        """Visible stretch of time [s]."""
        return self.range.start, self.range.end  # type: ignore[return-value]  # never dates here

    @property
    def time(self) -> float:
        """The time under study [s]."""
        return self.cursor.location  # type: ignore[return-value]  # never a date here

    def span(self, duration: float) -> None:
        """Set the end of the axis to that of the flight; a flight of another length is shown whole."""
        if duration != self.duration:
            self.duration = duration
            self.range.update(bounds=(0.0, duration), reset_start=0.0, reset_end=duration)
            self.whole()
            self.cursor.location = min(self.time, duration)

    def show_outages(self, outages: Sequence[tuple[float, float]]) -> None:
        """Shade the stretches of time [s] without GPS."""
        starts, ends = ([float(stretch[edge]) for stretch in outages] for edge in (0, 1))
        if self.outages.data != {"start": starts, "end": ends}:
            self.outages.data = {"start": starts, "end": ends}
            for strip in self._strips:
                strip.visible = bool(starts)

    def shade_outages(self, fig: figure) -> None:
        """Make a figure shade the outages; without outages, it paints nothing more."""
        area = VStrip(
            x0="start", x1="end", fill_color="#808895", fill_alpha=0.18, line_color="#808895", line_alpha=0.18
        )
        strip = fig.add_glyph(self.outages, area, level="underlay")
        strip.visible = bool(self.outages.data["start"])
        self._strips.append(strip)
        self._shaded.append(fig)
        if self._notes is not None:
            self._shade_notes(fig, self._notes)

    def show_notes(self, stretches: Sequence[tuple[float, float]]) -> None:
        """Shade the stretches of time [s] of notes; before the first, the figures have no part for it."""
        starts, ends = ([float(stretch[edge]) for stretch in stretches] for edge in (0, 1))
        if self._notes is None:
            if not starts:
                return
            self._notes = ColumnDataSource({"start": [], "end": []}, name=f"{self.range.name}: notes")
            for fig in self._shaded:
                self._shade_notes(fig, self._notes)
        if self._notes.data != {"start": starts, "end": ends}:
            self._notes.data = {"start": starts, "end": ends}

    @staticmethod
    def _shade_notes(fig: figure, notes: ColumnDataSource) -> None:
        area = VStrip(
            x0="start", x1="end", fill_color=NOTES, fill_alpha=0.13, line_color=NOTES, line_alpha=0.6
        )
        fig.add_glyph(notes, area, level="underlay")

    def show(self, start: float, end: float) -> None:
        """Show a stretch of time [s], as far as it is in the flight."""
        end = min(end, self.duration)
        if start < end:
            self.range.update(start=start, end=end)

    def whole(self) -> None:
        """Show the whole flight."""
        self.range.update(start=0.0, end=self.duration)


def hide(fig: figure, hidden: bool, *, in_place: bool) -> None:
    """Hide a figure or show it again; hidden in place, it leaves its place empty."""
    if in_place:
        styles = {"visibility": "hidden"} if hidden else {}
        if fig.styles != styles:
            fig.styles = styles  # type: ignore[assignment]
    else:
        fig.visible = not hidden


def time_figure(title: str, axis: TimeAxis, *, logarithmic: bool = False, height: int = 150) -> figure:
    """Return an empty figure over the shared time axis: drag to zoom, double-click to reset.

    Parameters
    ----------
    title
        Title, with the unit.
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
        tick_by_hand(fig)
    fig.xaxis.formatter = CustomJSTickFormatter(code="return `${+tick.toFixed(6)} s`")
    axis.shade_outages(fig)
    fig.renderers.append(axis.cursor)
    fig.js_on_event(Tap, CustomJS(args={"cursor": axis.cursor}, code="cursor.location = cb_obj.x"))
    fig.js_on_event(DoubleTap, CustomJS(args={"x": axis.range}, code="x.setv({start: 0, end: x.bounds[1]})"))
    return fig


def plain_figure(
    title: str | Title,
    x_label: str | None = None,
    y_label: str | None = None,
    *,
    height: int = 150,
    **options: Any,
) -> figure:
    """Return an empty figure with labelled axes, in the style of the figures over time.

    Parameters
    ----------
    title, x_label, y_label
        Title and labels, with units.
    height
        Least height [px].
    **options
        Further properties of the figure.
    """
    return figure(title=title, x_axis_label=x_label, y_axis_label=y_label, **_frame(height), **options)


def tick_by_hand(fig: figure) -> None:
    """Leave the ticks of a logarithmic ordinate to `set_ordinate`; over few decades, Bokeh sets too many."""
    fig.yaxis.ticker = fig.ygrid.ticker = FixedTicker(ticks=[])
    fig.yaxis.formatter = CustomJSTickFormatter(code="return `${+tick.toPrecision(3)}`")


def set_ordinate(fig: figure, low: float, high: float) -> None:
    """Set the ends of the ordinate, and its ticks if `tick_by_hand` was called."""
    fig.y_range.update(start=low, end=high)
    ticker = fig.yaxis[0].ticker
    if isinstance(ticker, FixedTicker):
        ticker.ticks = decade_ticks(low, high)


def decade_ticks(low: float, high: float) -> list[float]:
    """Return ticks of a logarithmic axis: powers of ten; over few decades 1, 2, 5; within one, more.

    Over many decades, some powers of ten are omitted. Invalid ends of a logarithmic axis give no ticks.
    """
    if not 0 < low < high < np.inf:
        return []
    first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
    mantissas: tuple[float, ...] = (1, 2, 5) if last - first < 4 else (1,)
    if high / low < 10:
        mantissas = (1, 1.5, 2, 3, 5, 7) if high / low > 3 else (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8)
    every = -(-(last - first) // MOST_DECADES)
    ticks = (float(f"{m}e{e}") for e in range(first, last + 1) if e % every == 0 for m in mantissas)
    return [tick for tick in ticks if low <= tick <= high]


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
