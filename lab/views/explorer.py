"""Explorer: the plots of one result as a Panel layout for a notebook, drawn by the figures of the page.

A tab is made when it is first opened. All time axes are one axis. In a notebook, Python does not hear of a
zoom inside a figure, so a slider chooses the stretch of time; it is drawn again in full resolution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import panel as pn

from lab.views.autocorrelation import AutocorrelationFigures
from lab.views.budget import BudgetFigures
from lab.views.figures import TimeAxis
from lab.views.notebook_display import follow_theme
from lab.views.quantities import (
    CONSISTENCY,
    COVARIANCE,
    ERRORS,
    HEIGHT,
    INNOVATIONS,
    SCALE_COVARIANCE,
    SCALE_ERRORS,
    SENSOR_ERRORS,
    TEMPERATURE,
    aid_plots,
    further_plots,
    kinds_of_aids,
    with_scale,
)
from lab.views.time_figures import TimeFigures
from lab.views.time_plot import TimePlot
from lab.views.track import TrackFigure

if TYPE_CHECKING:
    from bokeh.plotting import figure

    from lab.experiment.result import Result

ROW = 210
"""Height of a row of figures [px]."""
LEAST = 280
"""Least width of a figure [px]: on a narrow page, the figures are below one another."""
BUCKETS = 500
"""Intervals to which a curve is thinned: some for each two pixels of a third of a wide notebook."""


@dataclass
class Tab:
    """The figures of a tab, and the functions that draw the visible stretch of time and the cursor."""

    figures: list[figure]
    draw: Callable[[], None]
    follow: Callable[[float], None] = lambda _time: None
    row: int = ROW


def explore(result: Result) -> Any:
    """Return the plots of a result as a Panel layout; see `Result.explore`."""
    return Explorer(result).view


class Explorer:
    """The tabs of one result with their linked time axis.

    Parameters
    ----------
    result
        The result.

    Attributes
    ----------
    view : panel.Column
        The sliders and the tabs.
    """

    def __init__(self, result: Result) -> None:
        self.result = result
        self.axis = TimeAxis()
        end = float(result.time[-1])
        self.axis.span(end)
        outages = result.experiment.sensors.gps.outages
        self.axis.show_outages([(start - result.epoch, stop - result.epoch) for start, stop in outages])
        self._makers = list_tabs(result, self.axis)
        self._made: dict[int, Tab] = {}
        step = max(round(end / 1000, 1), 0.1)
        self.window = pn.widgets.RangeSlider(
            label="Visible time [s]", start=0.0, end=end, value=(0.0, end), step=step, width=340
        )
        self.cursor = pn.widgets.FloatSlider(
            label="Time cursor [s]", start=0.0, end=end, step=step, width=340
        )
        self._columns = [pn.Column(pn.Spacer(height=0)) for _ in self._makers]
        self.tabs = pn.Tabs(*zip(self._makers, self._columns, strict=True), sizing_mode="stretch_width")
        for widget, name, react in (
            (self.window, "value_throttled", self._zoom),
            (self.cursor, "value", self._follow),
            (self.tabs, "active", self._open),
        ):
            widget.param.watch(lambda _event, react=react: react(), name)
        self._open()
        words = (f"**{result.mission.title or result.mission.name}**", f"{end:.0f} s", result.realisation)
        self.view = pn.Column(
            ", ".join(word for word in words if word),
            pn.Row(self.window, self.cursor),
            self.tabs,
            sizing_mode="stretch_width",
        )

    def _open(self) -> None:
        """Make the selected tab if it is new, and draw it."""
        active = self.tabs.active
        if active not in self._made:
            tab = list(self._makers.values())[active]()
            tab.draw()
            tab.follow(self.axis.time)
            self._made[active] = tab
            self._columns[active][:] = [grid(tab.figures, tab.row)]
        else:
            self._redraw()

    def _redraw(self) -> None:
        tab = self._made[self.tabs.active]
        tab.draw()
        tab.follow(self.axis.time)
        self._send()

    def _zoom(self) -> None:
        start, end = self.window.value
        self.axis.range.update(start=start, end=max(end, start + 0.1))
        self._redraw()

    def _follow(self) -> None:
        self.axis.cursor.location = self.cursor.value
        self._made[self.tabs.active].follow(self.axis.time)
        self._send()

    def _send(self) -> None:
        """Send the changes of the figures to a notebook; a server sends them by itself."""
        pn.io.push_notebook(*self._columns[self.tabs.active])


def list_tabs(result: Result, axis: TimeAxis) -> dict[str, Callable[[], Tab]]:
    """Return, by title, the functions that make the tabs for which a result has data."""

    def of_time(plots: tuple[TimePlot, ...]) -> Callable[[], Tab]:
        def make() -> Tab:
            figures = TimeFigures(plots, axis, BUCKETS)
            return Tab(figures.figures, lambda: figures.show(result))

        return make

    temperature = TEMPERATURE if result.has_temperature else ()
    of_sensors = with_scale(result, SENSOR_ERRORS, SCALE_ERRORS) + further_plots(result.blocks)
    tabs = {
        "Errors": of_time(ERRORS),
        "Covariance": of_time(with_scale(result, COVARIANCE, SCALE_COVARIANCE)),
        "Innovations": lambda: innovations(result, axis),
        "Consistency": of_time(CONSISTENCY),
        "Sensor errors": of_time(of_sensors + temperature),
        "Ground track": lambda: ground_track(result),
        "Height": of_time(HEIGHT),
        "Budget": lambda: budget(result, axis),
    }
    needs = {"Errors": "errors", "Budget": "budget"}
    return {title: make for title, make in tabs.items() if not result.missing_reason(needs.get(title, title))}


def innovations(result: Result, axis: TimeAxis) -> Tab:
    """Return the innovations over time, and their autocorrelation."""
    over_time = TimeFigures((*INNOVATIONS, *aid_plots(kinds_of_aids(result))), axis, BUCKETS)
    lags = AutocorrelationFigures()

    def draw() -> None:
        over_time.show(result)
        lags.show(result)

    return Tab([*over_time.figures, *lags.figures], draw)


def ground_track(result: Result) -> Tab:
    """Return the ground track with the position at the time cursor."""
    track = TrackFigure()
    return Tab([track.figure], lambda: track.show(result, 0.0), track.show_time, row=2 * ROW + 40)


def budget(result: Result, axis: TimeAxis) -> Tab:
    """Return the error budget of the heading."""
    figures = BudgetFigures(axis)
    return Tab(
        figures.figures,
        lambda: figures.show(result.budget, result.observability, "heading"),
        row=ROW + 60,
    )


def grid(figures: list[figure], row: int) -> Any:
    """Return figures side by side, as many as the width allows.

    Parameters
    ----------
    figures
        In reading order.
    row
        Height of a row [px].
    """
    columns = f"repeat(auto-fit, minmax(min({LEAST}px, 100%), 1fr))"
    style = (
        ":host { display: grid !important; gap: 8px; height: auto !important; min-height: 0 !important; "
        "flex: 0 0 auto !important; "  # not as high as one row: what is below would cover the others
        f"grid-template-columns: {columns}; grid-auto-rows: {row}px; }}"
    )
    for fig in figures:
        follow_theme(fig)
    panes = [pn.pane.Bokeh(fig, sizing_mode="stretch_both", margin=0) for fig in figures]
    return pn.Column(*panes, sizing_mode="stretch_width", height=row, stylesheets=[style])
