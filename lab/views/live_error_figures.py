"""Live error figures: rolling plots of the errors against a known truth, between their ±3σ."""

from __future__ import annotations

import numpy as np
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from lab.live.live_errors import LiveErrors
from lab.views.parcel import Parcel
from lab.views.quantities import ESTIMATE, TRUTH
from lab.views.rolling_plot import RollingPlot

_ERROR, _UPPER, _LOWER = "error", "3σ", "-3σ"
_LEGEND = {"error": (_ERROR,), "±3σ": (_UPPER, _LOWER)}
_PLOTS = {
    "position": ("m", 0.5, ("north", "east", "down")),
    "velocity": ("m/s", 0.05, ("north", "east", "down")),
    "attitude": ("°", 0.05, ("roll", "pitch", "heading")),
}
"""Unit, least half height of the ordinate in this unit, and axes of each quantity. The least heights are
about a tenth of the errors with the default sensors: below, an ordinate would follow noise."""


class LiveErrorFigures:
    """Nine plots of errors over the same rolling time.

    Parameters
    ----------
    window
        Length of time that is shown [s].

    Attributes
    ----------
    figures : list of figure
        Position, velocity, attitude; three axes each.
    """

    def __init__(self, window: float) -> None:
        self.window = window
        ages = Range1d(start=window, end=0.0, name="live error ages")
        self._parcel = Parcel()
        self._plots = {
            (name, k): RollingPlot(
                f"{axis.capitalize()} {'error' if name == 'attitude' else name + ' error'}",
                unit, (_ERROR, _UPPER, _LOWER), ages, self._parcel,
                least=least, colours=(ESTIMATE, TRUTH, TRUTH), legend=_LEGEND,
            )
            for name, (unit, least, axes) in _PLOTS.items()
            for k, axis in enumerate(axes)
        }  # fmt: skip
        self._ages = self._parcel.number(ages)
        self._parcel.seal()
        self.figures: list[figure] = [plot.figure for plot in self._plots.values()]
        next(iter(self._plots.values())).source.tags = [self._parcel.carrier]

    def clear(self) -> None:
        """Forget all rows, as for another source; drawn with the next `show`."""
        for plot in self._plots.values():
            plot.clear()

    def add(self, errors: LiveErrors, zero: float) -> None:
        """Append errors.

        Parameters
        ----------
        errors
            The errors.
        zero
            Time that the plots call zero [s].
        """
        time = errors.time - zero
        for (name, k), plot in self._plots.items():
            error, sigma = getattr(errors, name)[:, k], getattr(errors, f"{name}_sigma")[:, k]
            if name == "attitude":
                error, sigma = np.degrees(error), np.degrees(sigma)
            plot.add(time, np.column_stack((error, 3 * sigma, -3 * sigma)), self.window)

    def show(self, now: float) -> None:
        """Move the window to a time [s], and send what was added."""
        for plot in self._plots.values():
            plot.move(now, self.window)
        self._parcel.send()

    @property
    def taken(self) -> bool:
        """Whether the browser has drawn what was sent last."""
        return self._parcel.taken

    def widen(self, window: float) -> None:
        """Show another length of time [s]."""
        self.window = window
        self._parcel.set(self._ages, start=window)
