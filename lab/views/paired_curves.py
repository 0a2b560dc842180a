"""Paired curves: the three axes of a triad on logarithmic axes, each beside a dashed one to compare with."""

from __future__ import annotations

import numpy as np
from bokeh.models.ranges import Range1d
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure

from lab.base.arrays import FloatArray
from lab.views.envelope import limits
from lab.views.figures import plain_figure, set_ordinate, tick_by_hand
from lab.views.legend import add_legend
from lab.views.quantities import AXIS_COLOURS

BODY = ("x", "y", "z")


class PairedCurves:
    """Three solid curves and three dashed ones in the same colours.

    Parameters
    ----------
    title
        Title; it fits a phone with up to 40 characters.
    ordinate
        What is drawn, without its unit.
    abscissa
        Label of the abscissa, with its unit.
    short
        Symbol and unit of the abscissa for the tooltip, such as ("τ", "s").
    unit
        Unit of the ordinate.

    Attributes
    ----------
    figure : figure
        The figure.
    """

    def __init__(self, title: str, ordinate: str, abscissa: str, short: tuple[str, str], unit: str) -> None:
        names = [f"{axis}{suffix}" for axis in BODY for suffix in ("", "_dashed")]
        self._source = ColumnDataSource({name: np.zeros(0) for name in ("at", *names)})
        self.figure: figure = plain_figure(
            title,
            abscissa,
            f"{ordinate} [{unit}]",
            x_axis_type="log",
            y_axis_type="log",
            x_range=Range1d(start=1, end=1e4),
            y_range=Range1d(start=0.1, end=1),
            tools=[],
            height=240,
        )
        tick_by_hand(self.figure)
        lines = {}
        for axis, colour in zip(BODY, AXIS_COLOURS, strict=True):
            self.figure.line(
                "at", f"{axis}_dashed", source=self._source, color=colour, line_dash="dashed", alpha=0.7
            )
            lines[axis] = self.figure.line("at", axis, source=self._source, color=colour, line_width=1.6)
        symbol, of = short
        tooltips = [(symbol, f"@at{{0.00}} {of}"), *((axis, f"@{axis}{{0.000}} {unit}") for axis in BODY)]
        self.figure.add_tools(HoverTool(mode="vline", renderers=[lines["x"]], tooltips=tooltips))
        add_legend(self.figure, lines)

    def show(self, at: FloatArray, solid: FloatArray, dashed: FloatArray) -> None:
        """Draw curves.

        Parameters
        ----------
        at : (k,) array
            Abscissa, above zero and increasing.
        solid, dashed : (k, 3) arrays
            A column for each axis.
        """
        columns = {"at": at}
        for suffix, values in (("", solid), ("_dashed", dashed)):
            columns |= {f"{axis}{suffix}": values[:, i] for i, axis in enumerate(BODY)}
        self._source.data = columns
        set_ordinate(self.figure, *limits([columns[axis] for axis in BODY], "logarithmic"))
        self.figure.x_range.update(start=at[0] / 1.3, end=at[-1] * 1.3)

    def clear(self) -> None:
        """Draw nothing."""
        self._source.data = {name: np.zeros(0) for name in self._source.data}
