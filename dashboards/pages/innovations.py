"""Innovations: the differences of navigator and fixes, and their whiteness."""

from __future__ import annotations

import panel as pn

from dashboards.pages.base import Page, plot_grid
from lab.experiment.result import Result
from lab.views.autocorrelation import AutocorrelationFigures
from lab.views.figures import TimeAxis
from lab.views.quantities import INNOVATIONS, aid_plots, kinds_of_aids
from lab.views.time_figures import TimeFigures


class _Grid:
    """The figures for some kinds of measurements besides GPS, and their layout."""

    def __init__(self, kinds: tuple[int, ...], axis: TimeAxis) -> None:
        self.fixes = TimeFigures(INNOVATIONS, axis, in_place=True)
        self.lags = AutocorrelationFigures()
        self.aids = TimeFigures(aid_plots(kinds), axis) if kinds else None
        over_time, over_lags = self.fixes.figures, self.lags.figures
        figures = [*over_time[:3], *over_lags[:3], *over_time[3:], *over_lags[3:]]
        self.view = plot_grid([*figures, *(self.aids.figures if self.aids else ())], 3)


class Innovations(Page):
    """Innovations with ±3σ, their autocorrelation, and the innovations of the measurements besides GPS."""

    title = "Innovations"
    contents = "the innovations of the fixes and their autocorrelation"
    seen = ("innovations",)

    def make(self) -> pn.viewable.Viewable:
        """Return the grid: innovations above, their autocorrelation below."""
        self._grids: dict[tuple[int, ...], _Grid] = {}
        self._shown: tuple[int, ...] = ()
        return self._grid(()).view

    def _grid(self, kinds: tuple[int, ...]) -> _Grid:
        """Return the grid for some kinds of measurements; it is made when first shown."""
        if kinds not in self._grids:
            self._grids[kinds] = _Grid(kinds, self.axis)
        return self._grids[kinds]

    def prepare(self, result: Result) -> None:
        """Compute the innovations and their autocorrelation."""
        if self._shown == kinds_of_aids(result):
            grid = self._grid(self._shown)
            grid.fixes.prepare(result)
            if grid.aids:
                grid.aids.prepare(result)
        _ = result.autocorrelation

    def draw(self, result: Result) -> None:
        """Draw a result."""
        self._shown = kinds_of_aids(result)
        grid = self._grid(self._shown)
        grid.fixes.show(result, self.held())
        grid.lags.show(result)
        if grid.aids:
            grid.aids.show(result)
        self.view = grid.view
