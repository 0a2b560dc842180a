"""Plots: a result as HoloViews objects, for notebooks and reports.

`quantities` declares the content. Curves are thinned to the resolution of a screen, so a notebook stays
small. All time axes of a layout are linked.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import holoviews as hv
import numpy as np
import panel as pn
from bokeh.document import Document
from bokeh.plotting import figure
from jinja2 import Environment
from panel.theme.base import DarkTheme

from lab.views import notebook_display
from lab.views.autocorrelation import three_sigma
from lab.views.envelope import envelope, limits, thin_path
from lab.views.notebook_display import theme_hook
from lab.views.paper_figure import Layout, Overlay, register_backend
from lab.views.quantities import (
    AXIS_COLOURS,
    CONSISTENCY,
    COVARIANCE,
    EAST_NORTH_UP,
    ERRORS,
    ESTIMATE,
    FIXES,
    HEIGHT,
    INNOVATIONS,
    SCALE_COVARIANCE,
    SCALE_ERRORS,
    SENSOR_ERRORS,
    TEMPERATURE,
    TRUTH,
    aid_plots,
    further_plots,
    kinds_of_aids,
    times_of_aid,
    with_scale,
)
from lab.views.time_plot import AID_CLOCKS, Curve, TimePlot

if TYPE_CHECKING:
    from lab.experiment.result import Result

WIDTH, HEIGHT_PIXELS = 330, 230
"""Size of a plot [px]."""
PATH_POINTS = 2000
"""Points of a path on the map."""
BUCKETS = 300
"""Number of intervals to which each curve is thinned: one for each pixel of a plot of this width."""


APP_PAGE = Environment().from_string(
    """
{% extends base %}
{% block preamble %}{{ super() }}
<meta name="viewport" content="width=device-width, initial-scale=1">
{% endblock %}
"""
)
"""Panel's plain page with the line without which a phone shrinks a page of 980 px to its width."""
OPEN_TAB = ".bk-tab.bk-active { color: var(--background-text-color, inherit); }"
"""Bokeh writes the title of the open tab in black, whatever the ground."""


def use_bokeh() -> None:
    """Have HoloViews draw with Bokeh, and notebooks show that; the backend stays Bokeh afterwards."""
    _load_bokeh()
    if hv.Store.current_backend != "bokeh":
        hv.Store.set_current_backend("bokeh")


@cache
def _load_bokeh() -> None:
    """Load the scripts, and register the displays of a notebook, which ``pn.extension()`` does not do.

    As in Panel, the environment variable PANEL_INLINE=True puts the scripts into the page, for offline use.
    """
    hv.extension("bokeh", logo=False, inline=pn.config.inline)
    register_backend()


def fit_phones() -> None:
    """Have the page be as wide as a phone, when ``panel serve`` shows the notebook as an app.

    The title of the open tab can be read on dark ground, too. The scripts of plots are loaded here, so that
    the cell of the first plot shows nothing else.
    """
    use_bokeh()
    pn.Tabs.stylesheets = [OPEN_TAB]
    if (app := _app()) is not None:
        app.template = APP_PAGE


def _app() -> Document | None:
    """Return the page that ``panel serve`` makes of the notebook; None in Jupyter and in a script."""
    page = pn.state.curdoc
    return page if page is not None and page.session_context is not None else None


def columns(wide: int) -> int:
    """Return the number of plots in a row: one on a phone, when a server shows the app; otherwise `wide`."""
    return 1 if "Mobi" in pn.state.headers.get("User-Agent", "") else wide


def follow_theme(*figures: figure) -> None:
    """Have plots that a notebook draws itself turn dark with JupyterLab, or with its app, as those here do.

    Parameters
    ----------
    *figures
        Figures of Bokeh, which no cell shows yet; without any, all later plots of HoloViews.
    """
    for drawn in figures:
        notebook_display.follow_theme(drawn)
    if pn.config.theme == "dark" and (app := _app()) is not None:  # such as with ?theme=dark
        app.theme = DarkTheme().bokeh_theme
    if not figures:
        use_bokeh()
        kinds = (hv.opts.Curve, hv.opts.Area, hv.opts.Scatter, hv.opts.ErrorBars, hv.opts.HeatMap)
        hv.opts.defaults(*(kind(hooks=[theme_hook]) for kind in kinds))


def errors(result: Result) -> Layout:
    """Return position, velocity and attitude errors with ±3σ, three in a row."""
    return _layout(result, ERRORS, wide=3)


def covariance(result: Result) -> Layout:
    """Return σ of all states over time, on logarithmic axes."""
    return _layout(result, with_scale(result, COVARIANCE, SCALE_COVARIANCE), wide=3)


def sensor_errors(result: Result) -> Layout:
    """Return estimated errors of the sensors with ±3σ, the true ones, and the temperature if any."""
    plots = with_scale(result, SENSOR_ERRORS, SCALE_ERRORS) + further_plots(result.blocks)
    return _layout(result, (*plots, *(TEMPERATURE if result.has_temperature else ())), wide=3)


def innovations(result: Result) -> Layout:
    """Return position and velocity innovations with ±3σ, and below them their autocorrelation."""
    use_bokeh()
    plots = [_time_plot(result, plot) for plot in (*INNOVATIONS, *aid_plots(kinds_of_aids(result)))]
    plots += [_autocorrelation(result, name, axis) for name in ("position", "velocity") for axis in range(3)]
    return _stack_plots(result, plots, wide=3)


def consistency(result: Result) -> Layout:
    """Return NEES and NIS with their 95 % intervals, and the innovations in their σ; NIS alone for a log."""
    known = [plot for plot in CONSISTENCY if plot.name != "nees" or not result.missing_reason("consistency")]
    return _layout(result, known, wide=2)


def height(result: Result) -> Layout:
    """Return height and vertical velocity (true, estimated, of the fixes), and the height error."""
    drawn: Layout = _layout(result, HEIGHT, wide=1).opts(hv.opts.Overlay(width=2 * WIDTH))
    return drawn


def ground_track(result: Result) -> Overlay:
    """Return the true path, the estimated path and the fixes on a map in metres, with equal scales."""
    use_bokeh()
    track, gps = result.drawn_track, result.gps
    label = result.projection.label
    easting = hv.Dimension("easting", label=f"Easting ({label})", unit="m")
    northing = hv.Dimension("northing", label="Northing", unit="m")
    layers = [
        hv.Scatter(
            (gps["easting"].values, gps["northing"].values), easting, northing, label="GPS fixes"
        ).opts(color=FIXES, size=4, alpha=0.6)
    ]
    for path, colour, dash in (("true", TRUTH, "solid"), ("estimated", ESTIMATE, "dashed")):
        if path not in track.path:
            continue
        points = np.stack([track[name].sel(path=path).values for name in ("easting", "northing")], axis=-1)
        points = points[thin_path(points, PATH_POINTS)]
        label = result.truth_word if path == "true" else "estimate"
        layers.append(
            hv.Path([points], [easting, northing], label=label).opts(
                color=colour, line_dash=dash, line_width=2, show_legend=True
            )
        )
    drawn: Overlay = Overlay(layers, made_by=lambda: result.facts).opts(
        width=620,
        height=560,
        data_aspect=1,
        legend_position="top",
        legend_cols=3,
        legend_opts={"padding": 0, "margin": 0, "border_line_alpha": 0},
        show_grid=True,
        padding=0.05,
        xformatter="%.0f",
        yformatter="%.0f",
        hooks=[theme_hook],
    )
    return drawn


def _layout(result: Result, plots: Sequence[TimePlot], wide: int) -> Layout:
    use_bokeh()
    return _stack_plots(result, [_time_plot(result, plot) for plot in plots], wide)


def _stack_plots(result: Result, plots: Sequence[hv.Overlay], wide: int) -> Layout:
    drawn: Layout = Layout(plots, made_by=lambda: result.facts).cols(columns(wide)).opts(shared_axes=True)
    return drawn


def _time() -> hv.Dimension:
    return hv.Dimension("time", label="Time", unit="s")


def _value(plot: TimePlot) -> hv.Dimension:
    return hv.Dimension(plot.name, label=plot.title, unit=plot.unit or None)


def _time_plot(result: Result, plot: TimePlot) -> hv.Overlay:
    """Draw the thinned curves of one unit over time, with the band behind them."""
    time = result.time if plot.clock == "time" else result.fixes.time
    if plot.clock in AID_CLOCKS:
        time = times_of_aid(result, plot.clock)
    edges = plot.band.edges(result) if plot.band else ()
    series = [*edges, *(curve.read(result) for curve in plot.curves)]
    thin_time, thinned = envelope(time, series, (time[0], time[-1]) if time.size else (0, 0), BUCKETS)
    layers: list[hv.Element] = []
    if plot.band:
        low, high = thinned[:2]
        area = hv.Area(
            (thin_time, low, high), _time(), [_value(plot), f"{plot.name}_high"], label=plot.band.label
        )
        layers.append(area.opts(color=plot.band.colour, alpha=0.15, line_alpha=0))
    if plot.fixes:
        layers.append(_curve(plot, plot.fixes, result.fixes.time, plot.fixes.read(result)))
    for curve, values in zip(plot.curves, thinned[len(edges) :], strict=True):
        layers.append(_curve(plot, curve, thin_time, values))
    return hv.Overlay(layers).opts(
        width=WIDTH,
        height=HEIGHT_PIXELS,
        title=plot.heading,
        xlabel="Time [s]",
        ylabel="",
        logy=plot.scale == "logarithmic",
        ylim=limits(series, plot.scale),
        show_grid=True,
        show_legend=len(plot.curves) > 1,
        legend_position="top",
        legend_cols=4,
        legend_opts={"padding": 0, "margin": 0, "spacing": 8, "border_line_alpha": 0},
        fontsize={"title": 10, "labels": 9, "ticks": 8, "legend": 8},
        hooks=[theme_hook],
    )


def _curve(plot: TimePlot, curve: Curve, time: np.ndarray, values: np.ndarray) -> hv.Element:
    """Draw one curve."""
    data = (time, values)
    if curve.style == "points":
        return hv.Scatter(data, _time(), _value(plot), label=curve.label).opts(color=curve.colour, size=3)
    dash = "dashed" if curve.style == "dashed" else "solid"
    return hv.Curve(data, _time(), _value(plot), label=curve.label).opts(
        color=curve.colour, line_dash=dash, line_width=1.2
    )


def _autocorrelation(result: Result, name: str, axis: int) -> hv.Overlay:
    """Draw the autocorrelation of one channel's innovations with its ±3σ band."""
    r = result.autocorrelation
    band = three_sigma(r)
    lag = hv.Dimension("lag", label="Lag", unit="fixes")
    value = hv.Dimension(f"autocorrelation_{name}_{EAST_NORTH_UP[axis]}", label="Autocorrelation")
    spikes = hv.Spikes((r["lag"].values[1:], r[name].values[1:, axis]), lag, value)
    return (
        hv.HSpan(-band, band).opts(color=AXIS_COLOURS[axis], alpha=0.15)
        * spikes.opts(color=AXIS_COLOURS[axis], line_width=2)
        * hv.HLine(0).opts(color="grey", line_width=1)
    ).opts(
        width=WIDTH,
        height=HEIGHT_PIXELS,
        title=f"Autocorrelation, {name} {EAST_NORTH_UP[axis]}",
        xlabel="Lag [fixes]; band: ±3σ if white",
        ylabel="",
        ylim=(-0.6, 0.6),
        hooks=[theme_hook],
        show_grid=True,
        fontsize={"title": 10, "labels": 9, "ticks": 8},
    )
