"""Autocorrelation: figures of the innovations' autocorrelation over the lag, with the band of white noise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from bokeh.models.annotations import BoxAnnotation
from bokeh.models.formatters import CustomJSTickFormatter
from bokeh.models.ranges import Range1d
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tickers import BasicTicker, FixedTicker
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from lab.analysis.consistency import whiteness_band
from lab.views.envelope import nice_limit
from lab.views.figures import hide, plain_figure
from lab.views.quantities import AXIS_COLOURS, EAST_NORTH_UP, LAGS
from lab.views.time_plot import THIN

if TYPE_CHECKING:
    import xarray as xr

    from lab.experiment.result import Result

LEAST_LIMIT = 0.4
"""Smallest limit of the ordinate, so that it stays constant while small correlations change."""


def three_sigma(dataset: xr.Dataset) -> float:
    """Return the half-width of the ±3σ band of white innovations, from the one of 95 % of the dataset."""
    return 3 * float(dataset.attrs["band"]) / whiteness_band(1)


class AutocorrelationFigures:
    """One figure for each component of the position and the velocity innovations.

    Attributes
    ----------
    figures : list of figure
        Position east, north, up; velocity east, north, up.
    """

    def __init__(self) -> None:
        columns = [f"{kind}_{axis}" for kind in ("position", "velocity") for axis in EAST_NORTH_UP]
        self._source = ColumnDataSource({name: np.zeros(0) for name in ("lag", *columns)})
        self._band = {
            name: BoxAnnotation(fill_color="#8b95a5", fill_alpha=0.22, bottom=0, top=0) for name in columns
        }
        self.figures = [
            self._draw(name, colour) for name, colour in zip(columns, AXIS_COLOURS * 2, strict=True)
        ]

    def show(self, result: Result) -> None:
        """Draw a result, lags 1 to `LAGS`; at lag 0 it is always one."""
        dataset = result.autocorrelation
        count = min(LAGS + 1, dataset.sizes["lag"])
        data = {"lag": np.arange(1, count)}
        largest = LEAST_LIMIT
        for kind in ("position", "velocity"):
            values = dataset[kind].values[1:count]
            data |= {f"{kind}_{axis}": values[:, index] for index, axis in enumerate(EAST_NORTH_UP)}
            largest = max(largest, float(np.abs(np.nan_to_num(values)).max(initial=0)))
        band = three_sigma(dataset)
        for annotation in self._band.values():
            annotation.update(bottom=-band, top=band)
        limit = nice_limit(largest)
        channels = [column for name, column in data.items() if name != "lag"]
        for fig, channel in zip(self.figures, channels, strict=True):
            # Real receivers may leave out a channel.
            hide(fig, result.recorded is not None and not np.isfinite(channel).any(), in_place=True)
            fig.y_range.update(start=-limit, end=limit)
        self._source.data = data

    def _draw(self, name: str, colour: str) -> figure:
        kind, axis = name.split("_")
        fig = plain_figure(
            f"{kind.capitalize()} autocorrelation, {axis}{THIN}·{THIN}±3σ if white",
            x_range=Range1d(start=0.2, end=LAGS + 0.8),
            y_range=Range1d(start=-LEAST_LIMIT, end=LEAST_LIMIT),
            tools=[],
        )
        fig.yaxis.ticker = fig.ygrid.ticker = BasicTicker(desired_num_ticks=4)
        fig.xaxis.ticker = fig.xgrid.ticker = FixedTicker(ticks=list(range(10, LAGS + 1, 10)))
        fig.xaxis.formatter = CustomJSTickFormatter(code="return `${tick} fixes`")
        fig.add_layout(self._band[name])
        bars = fig.vbar("lag", width=0.55, top=name, source=self._source, color=colour, line_color=None)
        tooltips = [("lag", "@lag fixes"), ("r", f"@{name}{{0.000}}")]
        fig.add_tools(HoverTool(mode="vline", renderers=[bars], tooltips=tooltips))
        return fig
