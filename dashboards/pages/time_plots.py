"""Time plots: the pages that contain only plots over time."""

from __future__ import annotations

from typing import ClassVar

import panel as pn

from dashboards.pages.base import Page, plot_grid
from lab.experiment.result import Result
from lab.views.quantities import (
    COVARIANCE,
    ERRORS,
    SCALE_COVARIANCE,
    SCALE_ERRORS,
    SENSOR_ERRORS,
    TEMPERATURE,
    further_plots,
    with_scale,
)
from lab.views.time_figures import TimeFigures
from lab.views.time_plot import TimePlot

Plots = tuple[tuple[TimePlot, ...], ...]


class TimePlots(Page):
    """A grid of plots over the shared time axis."""

    plots: ClassVar[tuple[TimePlot, ...]]
    scale_plots: ClassVar[tuple[TimePlot, ...]] = ()
    columns = 3

    def make(self) -> pn.viewable.Viewable:
        """Return the grid."""
        self._grids: dict[Plots, tuple[list[TimeFigures], pn.viewable.Viewable]] = {}
        self._shown: Plots = (self.plots,)
        return self._grid(self._shown)[1]

    def wanted(self, result: Result) -> Plots:
        """Return the plots for a result; those after the first group have the full width."""
        return (self.of_imu(result),)

    def of_imu(self, result: Result) -> tuple[TimePlot, ...]:
        """Return the plots of biases, and of scale factors if a result has them."""
        return with_scale(result, self.plots, self.scale_plots)

    def _grid(self, groups: Plots) -> tuple[list[TimeFigures], pn.viewable.Viewable]:
        """Return the grid of some plots; it is made when first shown."""
        if groups not in self._grids:
            first, *wide = groups
            made = [TimeFigures(first, self.axis, buckets=1000 // self.columns)]
            made += [TimeFigures(plots, self.axis, buckets=1000) for plots in wide]
            together = [fig for part in made for fig in part.figures]
            self._grids[groups] = made, plot_grid(together, self.columns)
        return self._grids[groups]

    def prepare(self, result: Result) -> None:
        """Compute the data of these plots, if the result needs no other plots."""
        groups = self._shown
        if groups == self.wanted(result):
            for figures in self._grids[groups][0]:
                figures.prepare(result)

    def draw(self, result: Result) -> None:
        """Draw a result in the visible stretch of time."""
        self._shown = self.wanted(result)
        made, self.view = self._grid(self._shown)
        for figures in made:
            figures.show(result, self.held())


class Errors(TimePlots):
    """Position, velocity and attitude errors with their ±3σ."""

    title = "Errors"
    contents = "the errors of position, velocity and attitude with their ±3σ"
    plots = ERRORS

    @classmethod
    def missing_reason(cls, result: Result) -> str:
        """Return why the errors are unknown."""
        return result.missing_reason("errors")


class Covariance(TimePlots):
    """σ of all states."""

    title = "Covariance"
    contents = "the filter's σ of position, velocity and attitude"
    plots = COVARIANCE
    seen = ("state_sigma",)
    scale_plots = SCALE_COVARIANCE
    columns = 2


class SensorErrors(TimePlots):
    """Estimated and true biases, and other errors of sensors if they are states; and the temperature."""

    title = "States"
    contents = "the biases and the other states of the sensors"
    plots = SENSOR_ERRORS
    seen = ("sensor_errors",)
    scale_plots = SCALE_ERRORS

    def wanted(self, result: Result) -> Plots:
        """Return the plots for a result; the temperature has the full width."""
        rest = (TEMPERATURE,) if result.has_temperature else ()
        return (self.of_imu(result) + further_plots(result.blocks), *rest)
