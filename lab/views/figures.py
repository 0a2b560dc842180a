"""Figures: the linked, fast Bokeh figures of the page; made once, afterwards only their data change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any
from weakref import ref

import numpy as np
from bokeh.core.properties import value
from bokeh.events import DoubleTap, Tap
from bokeh.models.annotations import LegendItem, Span, Title
from bokeh.models.callbacks import CustomJS
from bokeh.models.formatters import CustomJSTickFormatter
from bokeh.models.glyphs import Line, Scatter, VArea, VStrip
from bokeh.models.ranges import Range1d
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.sources import CDSView, ColumnDataSource
from bokeh.models.tickers import FixedTicker
from bokeh.models.tools import BoxZoomTool, CrosshairTool, HoverTool, WheelPanTool, WheelZoomTool
from bokeh.plotting import figure

from lab.run.run import Run
from lab.views.envelope import SMALLEST_DRAWN, FloatArray, limits
from lab.views.legend import add_legend
from lab.views.quantities import CURSOR, HELD, LETTERS, NOTES
from lab.views.thinned import Thinned, columns_of, thinned
from lab.views.time_plot import AID_CLOCKS, CLOCKS, Band, Clock, Curve, Interval, TimePlot

if TYPE_CHECKING:
    from lab.experiment.ensembles.ensemble import Ensemble
    from lab.experiment.result import Result

UNPACK = """
const {all} = cb_obj.data;
const length = all.length / names.length;
const column = (i) => new Float32Array(all.buffer, all.byteOffset + 4 * i * length, length);
const data = Object.fromEntries(names.map((name, i) => [name, column(i)]));
source.setv({data}, {sync: false});
"""
"""Splits the transferred block into the columns of a source, without copying or sending them back."""


OUTSIDE = "outside ±3σ"
"""Name of the marks of values beyond ±3σ."""
SAME_EVERYWHERE = {"estimate", "truth", "GPS fixes"}
"""Curves that look the same in all plots: the legend of the page explains them once."""
MOST_DECADES = 10
"""Most decades of a logarithmic axis with one tick each: a figure of 150 px has room for no more."""


class TimeAxis:
    """The time axis that all figures of one session share: range, cursor and crosshair.

    Parameters
    ----------
    touch
        Whether the figures are on a touch screen, where dragging scrolls the page.
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
    """

    def __init__(self, *, touch: bool = False, name: str = "time", hover: bool = True) -> None:
        self.touch, self.hover = touch, hover
        self.duration = 1.0
        self.range = Range1d(start=0.0, end=1.0, bounds=(0.0, 1.0), min_interval=0.05, name=f"{name} axis")
        self.cursor = Span(
            dimension="height", location=0.0, line_color=CURSOR, line_width=1.2, name=f"{name} cursor"
        )
        self.outages = ColumnDataSource({"start": [], "end": []}, name=f"{name} without GPS")
        self._strips: list[GlyphRenderer[Any]] = []
        self._shaded: list[figure] = []
        self._notes: ColumnDataSource | None = None
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


class Columns:
    """A data source whose columns are sent to the browser in one block.

    Otherwise each array would be a separate message; 28 messages take longer than drawing the plots.

    Parameters
    ----------
    names
        Names of the columns.
    name
        Name of the source in its document.

    Attributes
    ----------
    source : ColumnDataSource
        Data source of the figures. Once it is in a document, its data are only in the browser.
    """

    def __init__(self, names: Sequence[str], name: str) -> None:
        self._names = list(dict.fromkeys(names))
        nothing = {"all": np.zeros(0, np.float32)}
        self._parcel = ColumnDataSource(nothing, name=f"parcel:{name}")
        self.source = ColumnDataSource(
            {column: np.zeros(0, np.float32) for column in self._names}, name=name, tags=[self._parcel]
        )
        unpack = CustomJS(args={"source": self.source, "names": self._names}, code=UNPACK)
        self._parcel.js_on_change("data", unpack)

    def show(self, columns: dict[str, FloatArray]) -> None:
        """Draw columns of equal length, of single precision."""
        if self.source.document is None:
            self.source.data = columns
        else:
            self._parcel.data = {"all": np.concatenate([columns[name] for name in self._names])}


class TimeFigures:
    """Figures over the shared time axis, with one data source for each clock.

    Parameters
    ----------
    plots
        The plots to show, one figure each.
    axis
        Time axis, shared with other figures.
    buckets
        Number of intervals to which the visible time is thinned; one or two for each pixel of a figure's
        width.
    in_place
        Whether a figure without known values leaves its place empty; otherwise the others close the gap.

    Attributes
    ----------
    figures : list of figure
        In the order of `plots`.
    """

    def __init__(
        self, plots: Sequence[TimePlot], axis: TimeAxis, buckets: int = 400, *, in_place: bool = False
    ) -> None:
        self.plots = tuple(plots)
        self.axis = axis
        self._buckets = buckets
        self._in_place = in_place
        self._sources: dict[Clock, Columns] = {}
        self._ready: tuple[ref[Result | Ensemble], tuple[float, float], Thinned] | None = None
        for clock in CLOCKS:
            names = [name for plot in self.plots for name in columns_of(plot, clock)]
            if names:
                self._sources[clock] = Columns(("time", *names), f"{clock}:{self.plots[0].name}")
        outside = [name for plot in self.plots for name in plot.outside]
        self._outside = Columns(("time", *outside), f"outside:{self.plots[0].name}") if outside else None
        self._all_marks = CDSView()
        self._legends: dict[str, LegendItem] = {}
        self._glyphs: dict[str, GlyphRenderer[Any]] = {}
        self._layers: list[_Layer] = []
        self.figures = [self._draw(plot) for plot in self.plots]

    def prepare(self, result: Result | Ensemble) -> None:
        """Thin a result to the data that `show` draws; in any thread."""
        window = self.axis.window
        self._ready = (ref(result), window, self._thinned(result, window))

    def show(self, result: Result | Ensemble, held: Sequence[Result] = ()) -> None:
        """Draw a result, or the averages of an ensemble, in the visible stretch of time.

        Parameters
        ----------
        result
            What is drawn.
        held
            Results drawn beside it, as thin curves with the outlines of their bands: at most as many as there
            are colours in `HELD`.
        """
        window, ready = self.axis.window, self._ready
        beside = self._draw_held(held, window)
        self._ready = None
        prepared = ready is not None and ready[0]() is result and ready[1] == window
        drawn = ready[2] if ready is not None and prepared else self._thinned(result, window)
        for clock, source in self._sources.items():
            source.show(drawn.columns[clock])
        if self._outside is not None:
            self._outside.show(drawn.outside)
        for plot, fig in zip(self.plots, self.figures, strict=True):
            series = {
                name: columns[name]
                for clock, columns in drawn.columns.items()
                for name in columns_of(plot, clock)
            }
            if plot.band is not None:
                assert isinstance(fig.title, Title)
                fig.title.text = plot.judged_heading(drawn.inside[plot.name])
            extent = [*series.values(), *beside.get(plot.name, ())]
            set_ordinate(fig, *limits(extent, plot.scale))
            self._show_known(plot, fig, result)
            if plot.scale == "logarithmic":
                self._name_zeros(plot, fig, series)

    def _draw_held(self, held: Sequence[Result], window: tuple[float, float]) -> dict[str, list[FloatArray]]:
        """Draw held results in a window of time; return their curves and bands by the name of the plot."""
        found: dict[str, list[FloatArray]] = {}
        for slot in range(max(len(held), len(self._layers))):
            if slot == len(self._layers):
                self._layers.append(_Layer(self.plots, slot))
            layer = self._layers[slot]
            result = held[slot] if slot < len(held) else None
            if result is not None and not layer.shows(result, window):
                layer.show(result, window, self._thinned(result, window, layer.clocks).columns)
                layer.add_to(self.plots, self.figures)
            elif result is None:
                layer.hide()
            for plot, series in layer.extent(self.plots).items():
                found.setdefault(plot, []).extend(series)
        return found

    def _thinned(
        self, result: Result | Ensemble, window: tuple[float, float], clocks: Sequence[Clock] | None = None
    ) -> Thinned:
        wanted = tuple(self._sources) if clocks is None else clocks
        return thinned(self.plots, result, window, self._buckets, wanted)

    def _show_known(self, plot: TimePlot, fig: figure, result: Result | Ensemble) -> None:
        """Hide a figure, or an entry of its legend, without known values, as in sensor logs and homework."""
        # Nothing is hidden in a stretch of time without fixes: zooming must not hide a figure.
        hides = not getattr(result, "shows_sensor_errors", True)
        whole = hides or getattr(result, "recorded", None) is not None
        known = {curve.name: not whole or _is_known(plot, curve, result) for curve in plot.curves}
        hide(fig, not any(known.values()), in_place=self._in_place)
        for curve in plot.drawn:
            label = _spoken(curve.label, result)
            if self._glyphs[curve.name].name != label:
                self._glyphs[curve.name].name = label
            if curve.name in self._legends:
                is_known = known.get(curve.name, not whole or _is_known(plot, curve, result))
                self._legends[curve.name].update(visible=is_known, label=value(label))

    def _name_zeros(self, plot: TimePlot, fig: figure, series: dict[str, FloatArray]) -> None:
        """Report visible curves that are zero, because a logarithmic axis cannot show them."""
        zeros = [curve for curve in plot.curves if _is_zero(series[curve.name])]
        assert isinstance(fig.title, Title)
        fig.title.text = f"{plot.heading}: zero" if len(zeros) == len(plot.curves) else plot.heading
        for curve in plot.curves:
            if curve.name in self._legends:
                named = curve in zeros and len(zeros) < len(plot.curves)
                label = f"{curve.label}: zero" if named else curve.label
                self._legends[curve.name].label = value(label)

    def _draw(self, plot: TimePlot) -> figure:
        source = self._sources[plot.clock].source
        fig = time_figure(plot.heading, self.axis, logarithmic=plot.scale == "logarithmic")
        if plot.band is not None:  # its title says more
            assert isinstance(fig.title, Title)
            fig.title.text_font_size = "12px"
        if plot.band is not None:
            draw_band(fig, plot.band, source)
        glyphs = {}
        if plot.fixes is not None:
            glyphs[plot.fixes.label] = draw_curve(fig, plot.fixes, self._sources["time_gps"].source, "time")
        glyphs |= {curve.label: draw_curve(fig, curve, source, "time") for curve in reversed(plot.curves)}
        if self._outside is not None:
            for name in plot.outside:
                mark = Scatter(x="time", y=name, size=4, marker="square", fill_color=CURSOR, line_color=None)
                fig.add_glyph(self._outside.source, mark, name=OUTSIDE, view=self._all_marks)
        if self.axis.hover:
            first = glyphs[plot.curves[0].label]
            fig.add_tools(HoverTool(mode="vline", renderers=[first], tooltips=_tooltips(plot)))
        self._glyphs |= {curve.name: glyphs[curve.label] for curve in plot.drawn}
        if len(glyphs) > 1 and (self.axis.hover or not set(glyphs) <= SAME_EVERYWHERE):
            items = add_legend(fig, dict(reversed(glyphs.items())))
            self._legends |= {curve.name: items[curve.label] for curve in plot.drawn}
        return fig


class _Layer:
    """A held result in some figures: thin curves, and the outlines of their bands.

    What is the same in all results, as the truth and the fixes, is not drawn again; nor are the measurements
    of other sensors, which another result need not have.
    """

    def __init__(self, plots: Sequence[TimePlot], slot: int) -> None:
        self._colour, self._letter = HELD[slot], LETTERS[slot]
        self.clocks = tuple(
            clock
            for clock in CLOCKS
            if clock not in AID_CLOCKS and any(plot.clock == clock for plot in plots)
        )
        self._sources: dict[Clock, Columns] = {}
        for clock in self.clocks:
            names = dict.fromkeys(name for plot in plots for name in columns_of(plot, clock))
            self._sources[clock] = Columns(("time", *names), f"held {slot} {clock}:{plots[0].name}")
        self._drawn: tuple[ref[Result], tuple[float, float]] | None = None
        self._columns: dict[Clock, dict[str, FloatArray]] = {}
        self._glyphs: list[GlyphRenderer[Any]] = []

    def add_to(self, plots: Sequence[TimePlot], figures: Sequence[figure]) -> None:
        """Add the curves to the figures, once there is something to draw.

        A browser does not draw the first curve of a source that gets its first data with its curves.
        """
        if self._glyphs:
            return
        for plot, fig in zip(plots, figures, strict=True):
            if plot.clock in self._sources:
                self._add(plot, fig, self._sources[plot.clock].source, self._colour)

    def _add(self, plot: TimePlot, fig: figure, source: ColumnDataSource, colour: str) -> None:
        for curve in _own_curves(plot):
            if curve.style == "points":
                points = Scatter(x="time", y=curve.name, size=3, fill_color=colour, line_color=None)
                self._glyphs.append(fig.add_glyph(source, points, name=f"{self._letter}: {curve.label}"))
            else:
                line = Line(x="time", y=curve.name, line_color=colour, line_width=1.0)
                self._glyphs.append(fig.add_glyph(source, line, name=f"{self._letter}: {curve.label}"))
        if plot.band is not None and not isinstance(plot.band, Interval):
            for edge in (plot.band.low, plot.band.high):
                line = Line(x="time", y=edge, line_color=colour, line_width=0.8, line_dash="dashed")
                self._glyphs.append(fig.add_glyph(source, line))

    def shows(self, result: Result, window: tuple[float, float]) -> bool:
        """Return whether a result is drawn already in a window of time."""
        return self._drawn is not None and (self._drawn[0]() is result and self._drawn[1] == window)

    def show(
        self, result: Result, window: tuple[float, float], columns: dict[Clock, dict[str, FloatArray]]
    ) -> None:
        """Draw the columns of a result in a window of time."""
        self._drawn, self._columns = (ref(result), window), columns
        for clock, source in self._sources.items():
            source.show(columns[clock])
        self._set_visible(True)

    def hide(self) -> None:
        """Draw nothing."""
        self._drawn, self._columns = None, {}
        self._set_visible(False)

    def _set_visible(self, visible: bool) -> None:
        for glyph in self._glyphs:
            if glyph.visible != visible:
                glyph.visible = visible

    def extent(self, plots: Sequence[TimePlot]) -> dict[str, list[FloatArray]]:
        """Return what is drawn, by the name of the plot."""
        found: dict[str, list[FloatArray]] = {}
        for plot in plots:
            columns = self._columns.get(plot.clock, {})
            names = [curve.name for curve in _own_curves(plot)]
            if plot.band is not None:
                names += [plot.band.low, plot.band.high]
            found[plot.name] = [columns[name] for name in names if name in columns]
        return found


def _own_curves(plot: TimePlot) -> tuple[Curve, ...]:
    """Return the curves that differ from result to result on one flight: not the truth."""
    return tuple(curve for curve in plot.curves if curve.style != "dashed")


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
            *([] if axis.touch else [BoxZoomTool(dimensions="width")]),
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


def draw_curve(fig: figure, curve: Curve, source: ColumnDataSource, x: str) -> GlyphRenderer[Any]:
    """Draw a curve of a source and return its renderer."""
    # `add_glyph` makes one glyph; `fig.line` makes two more, for selected and muted data, which are not used.
    if curve.style == "points":
        points = Scatter(x=x, y=curve.name, size=4, fill_color=curve.colour, line_color=None)
        return fig.add_glyph(source, points, name=curve.label)
    dash = "dashed" if curve.style == "dashed" else "solid"
    width = 1.6 if curve.style == "dashed" else 1.3
    line = Line(x=x, y=curve.name, line_color=curve.colour, line_width=width, line_dash=dash)
    return fig.add_glyph(source, line, name=curve.label)


def draw_band(fig: figure, band: Band, source: ColumnDataSource) -> None:
    """Draw a band of a source over its time."""
    area = VArea(x="time", y1=band.low, y2=band.high, fill_color=band.colour, fill_alpha=0.2)
    fig.add_glyph(source, area, name=band.label)


def _is_zero(values: FloatArray) -> bool:
    known = np.abs(values[np.isfinite(values)]).astype(np.float64)
    return bool(known.size and known.max() < SMALLEST_DRAWN)


def _is_known(plot: TimePlot, curve: Curve, result: Result | Ensemble) -> bool:
    over_time = plot.clock == "time" and curve in plot.curves
    parts = result.parts() if over_time and isinstance(result, Run) else [result]
    return any(np.isfinite(curve.read(part)).any() for part in parts)


def _spoken(label: str, result: Result | Ensemble) -> str:
    """Return the label of a curve; a reference is not called truth."""
    return getattr(result, "truth_word", label) if label == "truth" else label


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


def _tooltips(plot: TimePlot) -> list[tuple[str, str]]:
    rows = [("time", "@time{0.00} s")]
    rows += [(curve.label, f"@{curve.name}{{0.0000}} {plot.unit}") for curve in plot.curves]
    if plot.band is not None:
        edges = f"@{plot.band.low}{{0.0000}} … @{plot.band.high}{{0.0000}}"
        rows.append((plot.band.label, f"{edges} {plot.unit}"))
    return rows
