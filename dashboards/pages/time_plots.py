"""Time plots: the pages that are nothing but plots over time."""

from __future__ import annotations

from typing import ClassVar

import panel as pn

from dashboards.pages.base import Page, plot_grid
from lab.result import Result
from lab.views.figures import TimeFigures
from lab.views.quantities import COVARIANCE, ERRORS, HEIGHT, SENSOR_ERRORS, TimePlot


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
    """Estimated biases against the true ones."""

    title = "Sensor errors"
    plots = SENSOR_ERRORS


class Height(TimePlots):
    """Height and vertical velocity as navigated, as they were, and as the fixes say."""

    title = "Height"
    plots = HEIGHT
    columns = 1
