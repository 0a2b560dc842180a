"""Live attitude figures: rolling plots of attitudes: ours, one's own, the device's, and the true one."""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.views import quantities
from lab.views.rolling_plot import RollingFigures, RollingPlot

LABELS = ("lab", "own", "device", "truth")
"""Labels of the curves, short on a phone: lab, one's own algorithm, the device itself, truth."""
_COLOURS = (quantities.ESTIMATE, quantities.ORANGE, quantities.GREEN, quantities.TRUTH)
_LEAST = 1.0
"""Least half height of an ordinate [°]: below, it would follow the noise of a phone at rest."""
_HALF_TURN = 180.0
"""Step of an angle from which it has passed half a turn, and not moved [°]."""


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
        self._hold(
            RollingPlot(
                title, "°", LABELS, self._range, self._parcel, least=_LEAST, colours=_COLOURS, legend=legend
            )
            for title in ("Roll of all", "Pitch of all", "Heading of all")
        )
        self._last = np.full((len(LABELS), 3), np.nan)

    def clear(self) -> None:
        """Forget all rows, as for another source; drawn with the next `show`."""
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
