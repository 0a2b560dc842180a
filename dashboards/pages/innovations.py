"""Innovations: the differences of navigator and fixes, and their whiteness."""

from __future__ import annotations

import panel as pn

from dashboards.pages.base import Page, plot_grid
from lab.result import Result
from lab.views.autocorrelation import AutocorrelationFigures
from lab.views.figures import TimeFigures
from lab.views.quantities import INNOVATIONS


class Innovations(Page):
    """Innovations with ±2σ, and their autocorrelation with the 95 % band of white noise."""

    title = "Innovations"

    def make(self) -> pn.viewable.Viewable:
        """Return the grid: innovations above, their autocorrelation below."""
        self._time = TimeFigures(INNOVATIONS, self.axis, in_place=True)
        self._lags = AutocorrelationFigures()
        over_time, over_lags = self._time.figures, self._lags.figures
        return plot_grid([*over_time[:3], *over_lags[:3], *over_time[3:], *over_lags[3:]], 3)

    def prepare(self, result: Result) -> None:
        """Compute the innovations and their autocorrelation."""
        self._time.prepare(result)
        _ = result.autocorrelation

    def draw(self, result: Result) -> None:
        """Draw a result."""
        self._time.show(result)
        self._lags.show(result)
