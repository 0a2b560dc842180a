"""Flight: the flight over time: height, speed, attitude, and what the sensors measured."""

from __future__ import annotations

from dashboards.pages.time_plots import Plots, TimePlots
from lab.experiment.result import Result
from lab.views.flight_plots import FLIGHT, sensor_plots
from lab.views.quantities import TEMPERATURE, kinds_of_aids


class FlightPlots(TimePlots):
    """Height, speed, attitude, rates, specific force and other sensors: estimated, true and measured."""

    title = "Flight"
    contents = "what was flown, measured and estimated"
    plots = FLIGHT
    seen = ("solution", "truth")

    def wanted(self, result: Result) -> Plots:
        """Return the plots for a result; the temperature has the full width."""
        rest = (TEMPERATURE,) if result.has_temperature else ()
        return (FLIGHT + sensor_plots(kinds_of_aids(result)), *rest)
