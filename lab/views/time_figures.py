"""Time figures: the linked, fast Bokeh figures of the page; made once, afterwards only their data change."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any
from weakref import ref

import numpy as np
from bokeh.core.properties import value
from bokeh.models.annotations import LegendItem, Title
from bokeh.models.callbacks import CustomJS
from bokeh.models.glyphs import Line, Scatter, VArea
from bokeh.models.renderers import GlyphRenderer
from bokeh.models.sources import CDSView, ColumnDataSource
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from lab.run.run import Run
from lab.views.envelope import SMALLEST_DRAWN, FloatArray, limits
from lab.views.figures import TimeAxis, hide, set_ordinate, time_figure
from lab.views.legend import add_legend
from lab.views.quantities import CURSOR, HELD, LETTERS
from lab.views.thinned import Thinned, find_columns, find_times, thinned
from lab.views.time_plot import AID_CLOCKS, CLOCKS, Band, Clock, Curve, Interval, TimePlot

if TYPE_CHECKING:
    import pandas as pd

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
        self._seen: dict[str, ref[Result | Ensemble]] = {}  # what is drawn, by what its names begin with
        for clock in CLOCKS:
            names = [name for plot in self.plots for name in find_columns(plot, clock)]
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

    def show(self, result: Result | Ensemble, held: Sequence[Result | None] = ()) -> None:
        """Draw a result, or the averages of an ensemble, in the visible stretch of time.

        Parameters
        ----------
        result
            What is drawn.
        held
            Results drawn beside it, as thin curves with the outlines of their bands, each with the colour and
            the letter of its place: at most as many as there are colours in `HELD`. None leaves a place free.
        """
        window, ready = self.axis.window, self._ready
        marks = (f"{letter}: " for letter in LETTERS)
        of_held: dict[str, ref[Result | Ensemble]] = {
            mark: ref(one) for mark, one in zip(marks, held, strict=False) if one is not None
        }
        self._seen = {"": ref(result), **of_held}
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
                for name in find_columns(plot, clock)
            }
            if plot.band is not None:
                assert isinstance(fig.title, Title)
                fig.title.text = plot.judged_heading(drawn.inside[plot.name])
            extent = [*series.values(), *beside.get(plot.name, ())]
            set_ordinate(fig, *limits(extent, plot.scale))
            self._show_known(plot, fig, result)
            if plot.scale == "logarithmic":
                self._name_zeros(plot, fig, series)

    def _draw_held(
        self, held: Sequence[Result | None], window: tuple[float, float]
    ) -> dict[str, list[FloatArray]]:
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

    def _read_samples(self, plot: TimePlot) -> pd.DataFrame:
        """Return the samples of what a plot draws in the visible stretch, each at its own time."""
        import pandas as pd  # noqa: PLC0415 - an opening page needs none of it

        start, end = self.axis.window
        unit = f" [{plot.unit}]" if plot.unit else ""
        glyphs = {curve.name: self._glyphs[curve.name] for curve in reversed(plot.drawn)}
        titles: dict[str, str] = {}
        if plot.band is not None:
            edges = {plot.band.low: "from", plot.band.high: "to"}
            titles |= {edge: f"{plot.band.label} {word}" for edge, word in edges.items()}
        drawn_of_held = titles.keys() | {curve.name for curve in _own_curves(plot)}
        if isinstance(plot.band, Interval):  # it is the same for all
            drawn_of_held -= titles.keys()
        titles |= {name: str(glyph.name) for name, glyph in glyphs.items() if glyph.visible}
        tables = []
        for mark, drawn in self._seen.items():
            result = drawn()
            if result is None:  # that of a long flight is let go of before the next run
                continue
            for clock in self._sources:
                columns = find_columns(plot, clock, result)
                names = columns.keys() & (drawn_of_held if mark else titles.keys())
                named = {f"{mark}{titles[name]}{unit}": columns[name] for name in titles if name in names}
                if named:
                    times = pd.Index(find_times(result, clock), name="time [s]")
                    table = pd.DataFrame(named, index=times)
                    tables.append(table[(times >= start) & (times <= end)])
        return pd.concat(tables, axis=1).sort_index()

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
        fig.tags = ["thinned"]  # for the menu of the plot, which asks for the samples
        self.axis.samples[fig.id] = partial(self._read_samples, plot)
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
            names = dict.fromkeys(name for plot in plots for name in find_columns(plot, clock))
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


def _tooltips(plot: TimePlot) -> list[tuple[str, str]]:
    rows = [("time", "@time{0.00} s")]
    rows += [(curve.label, f"@{curve.name}{{0.0000}} {plot.unit}") for curve in plot.curves]
    if plot.band is not None:
        edges = f"@{plot.band.low}{{0.0000}} … @{plot.band.high}{{0.0000}}"
        rows.append((plot.band.label, f"{edges} {plot.unit}"))
    return rows
