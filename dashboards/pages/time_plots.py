"""Time plots: the pages that are nothing but plots over time."""

from __future__ import annotations

from typing import ClassVar

import panel as pn

from dashboards.pages.base import AROUND, GAP, NARROW, Page, plot_grid
from lab.result import Result
from lab.views.figures import TimeFigures
from lab.views.quantities import COVARIANCE, ERRORS, HEIGHT, SENSOR_ERRORS, TEMPERATURE, TimePlot

_TWO_ROWS = (
    f"@media (min-width: {NARROW + 1}px) "
    f"{{ :host {{ grid-auto-rows: max(150px, calc((100vh - {AROUND + 2 * GAP}px) / 2)); }} }}"
)


class TimePlots(Page):
    """A grid of plots over the shared time axis."""

    plots: ClassVar[tuple[TimePlot, ...]]
    columns = 3

    def make(self) -> pn.viewable.Viewable:
        """Return the grid."""
        self._figures = TimeFigures(self.plots, self.axis, buckets=1000 // self.columns)
        return plot_grid(self._figures.figures, self.columns)

    def prepare(self, result: Result) -> None:
        """Have the result work out what these plots show."""
        self._figures.prepare(result)

    def draw(self, result: Result) -> None:
        """Draw a result in the visible stretch of time."""
        self._figures.show(result)


class Errors(TimePlots):
    """Position, velocity and attitude errors with their ±3σ."""

    title = "Errors"
    plots = ERRORS


class Covariance(TimePlots):
    """σ of all 15 states."""

    title = "Covariance"
    plots = COVARIANCE
    columns = 2


class SensorErrors(TimePlots):
    """Estimated biases against the true ones, and the temperature where a profile is set."""

    title = "Sensor errors"
    plots = SENSOR_ERRORS

    def make(self) -> pn.viewable.Viewable:
        """Return the grid; its last row is the temperature."""
        self._figures = TimeFigures(self.plots, self.axis, buckets=1000 // self.columns)
        self._temperature = TimeFigures(TEMPERATURE, self.axis, buckets=1000)
        grid = plot_grid([*self._figures.figures, *self._temperature.figures], self.columns)
        self._panes, self._three_rows, self._grid = list(grid), grid.stylesheets, grid
        self._fit(False)
        return grid

    def prepare(self, result: Result) -> None:
        """Have the result work out what these plots show."""
        super().prepare(result)
        if result.has_temperature:
            self._temperature.prepare(result)

    def draw(self, result: Result) -> None:
        """Draw a result in the visible stretch of time."""
        super().draw(result)
        if (len(self._grid) == len(self._panes)) != result.has_temperature:
            self._fit(result.has_temperature)
        if result.has_temperature:
            self._temperature.show(result)

    def _fit(self, has_temperature: bool) -> None:
        """Let the rows that are shown share the window."""
        self._grid[:] = self._panes if has_temperature else self._panes[:-1]
        self._grid.stylesheets = self._three_rows if has_temperature else [*self._three_rows, _TWO_ROWS]


class Height(TimePlots):
    """Height and vertical velocity as navigated, as they were, and as the fixes say."""

    title = "Height"
    plots = HEIGHT
    columns = 1
