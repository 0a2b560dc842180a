"""Live error figures: rolling plots of the errors against a known truth, between their ±3σ."""

from __future__ import annotations

import numpy as np

from lab.live.live_errors import LiveErrors
from lab.views.quantities import ESTIMATE, TRUTH
from lab.views.rolling_plot import RollingFigures, RollingPlot

_ERROR, _UPPER, _LOWER = "error", "3σ", "-3σ"
_LEGEND = {"error": (_ERROR,), "±3σ": (_UPPER, _LOWER)}
_PLOTS = {
    "position": ("m", 0.5, ("north", "east", "down")),
    "velocity": ("m/s", 0.05, ("north", "east", "down")),
    "attitude": ("°", 0.05, ("roll", "pitch", "heading")),
}
"""Unit, least half height of the ordinate in this unit, and axes of each quantity. The least heights are
about a tenth of the errors with the default sensors: below, an ordinate would follow noise."""


class LiveErrorFigures(RollingFigures):
    """Nine plots of errors over the same rolling time: position, velocity, attitude; three axes each.

    Parameters
    ----------
    window
        Length of time that is shown [s].
    """

    def __init__(self, window: float) -> None:
        super().__init__(window, "live error ages")
        self._plots = {
            (name, k): RollingPlot(
                f"{axis.capitalize()} {'error' if name == 'attitude' else name + ' error'}",
                unit, (_ERROR, _UPPER, _LOWER), self._range, self._parcel,
                least=least, colours=(ESTIMATE, TRUTH, TRUTH), legend=_LEGEND,
            )
            for name, (unit, least, axes) in _PLOTS.items()
            for k, axis in enumerate(axes)
        }  # fmt: skip
        self._hold(self._plots.values())

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
