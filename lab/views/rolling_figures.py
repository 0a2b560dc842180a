"""Rolling figures: plots over the same rolling time: of errors against a known truth, and of attitudes."""

from __future__ import annotations

from collections.abc import Container, Iterable

import numpy as np
from bokeh.models.ranges import Range1d
from bokeh.plotting import figure

from lab.base.arrays import FloatArray
from lab.live.live_errors import LiveErrors
from lab.views import quantities
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
LABELS = ("lab", "own", "device", "truth")
"""Labels of the curves, short on a phone: lab, one's own algorithm, the device itself, truth."""
_COLOURS = (quantities.ESTIMATE, quantities.ORANGE, quantities.GREEN, quantities.TRUTH)
_LEAST = 1.0
"""Least half height of an ordinate [°]: below, it would follow the noise of a phone at rest."""
_HALF_TURN = 180.0
"""Step of an angle from which it has passed half a turn, and not moved [°]."""


class RollingFigures:
    """Rolling plots over the same time, whose changes travel together.

    Parameters
    ----------
    window
        Length of time that is shown [s].
    name
        Name of the shared range of the abscissas.

    Attributes
    ----------
    figures : list of figure
        The figures, in the order of the plots.
    """

    def __init__(self, window: float, name: str) -> None:
        self.window = window
        self._range = Range1d(start=window, end=0.0, name=name)
        self._parcel = Parcel()
        self._drawn: list[RollingPlot] = []
        self.figures: list[figure] = []

    def _hold_plots(self, plots: Iterable[RollingPlot]) -> None:
        """Hold the plots, made with the range and the parcel."""
        self._drawn = list(plots)
        self._ages = self._parcel.number(self._range)
        self._parcel.seal()
        self.figures = [plot.figure for plot in self._drawn]
        self._drawn[0].source.tags = [self._parcel.carrier]

    def clear(self) -> None:
        """Forget all rows, as for another source; drawn with the next `move`."""
        for plot in self._drawn:
            plot.clear()

    def move(self, now: float, groups: Container[int] | None = None) -> None:
        """Move the window to a time [s], and send what was added, of some groups alone if they are given."""
        for plot in self._drawn:
            plot.move(now, self.window)
        self._parcel.send(groups)

    @property
    def taken(self) -> bool:
        """Whether the browser has drawn what was sent last."""
        return self._parcel.taken

    def widen(self, window: float) -> None:
        """Show another length of time [s]."""
        self.window = window
        self._parcel.set(self._ages, start=window)


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
        self._hold_plots(self._plots.values())

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


class LiveAttitudeFigures(RollingFigures):
    """Three plots over the same rolling time: roll, pitch, heading.

    Parameters
    ----------
    window
        Length of time that is shown [s].
    """

    def __init__(self, window: float) -> None:
        super().__init__(window, "live attitude ages")
        legend = {label: (label,) for label in LABELS}
        self._hold_plots(
            RollingPlot(
                title, "°", LABELS, self._range, self._parcel, least=_LEAST, colours=_COLOURS, legend=legend
            )
            for title in ("Roll of all", "Pitch of all", "Heading of all")
        )
        self._last = np.full((len(LABELS), 3), np.nan)

    def clear(self) -> None:
        """Forget all rows, as for another source; drawn with the next `move`."""
        self._last[:] = np.nan
        super().clear()

    def add(self, time: FloatArray, euler: FloatArray) -> None:
        """Append attitudes.

        Parameters
        ----------
        time : (n,) array
            Times that count from the zero of the plots [s].
        euler : (n, 4, 3) array
            Roll, pitch, heading [rad] in the order of `LABELS`; NaN where they are not known.
        """
        if not time.size:
            return
        shown = np.degrees(euler)
        steps = np.abs(np.diff(shown, axis=0, prepend=self._last[None]))
        self._last = shown[-1].copy()
        shown[steps > _HALF_TURN] = np.nan  # no line across the plot where an angle passes half a turn
        for number, plot in enumerate(self._drawn):
            plot.add(time, shown[:, :, number], self.window)
