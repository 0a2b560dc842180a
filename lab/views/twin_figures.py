"""Twin figures: spectra and Allan deviations of a real stream, solid, and of its simulations, dashed."""

from __future__ import annotations

import numpy as np
from bokeh.plotting import figure

from lab.base.parameters.units import TO_SI
from lab.live.twin import TwinComparison
from lab.views.allan import TITLES, AllanFigures
from lab.views.paired_curves import PairedCurves

DENSITIES = {"gyro": "°/s/√Hz", "accelerometer": "µg/√Hz"}
"""Units of the spectra by triad."""


class TwinFigures:
    """Spectra of gyros and accelerometers, and their Allan deviations.

    Attributes
    ----------
    figures : list of figure
        In reading order.
    """

    def __init__(self) -> None:
        self._spectra = {
            triad: PairedCurves(
                f"{TITLES[triad]}, dashed: simulated", "spectrum", "frequency [Hz]", ("f", "Hz"), unit
            )
            for triad, unit in DENSITIES.items()
        }
        self._allan = AllanFigures("simulated")
        self.figures: list[figure] = [
            *(curves.figure for curves in self._spectra.values()),
            *self._allan.figures,
        ]

    def show(self, found: TwinComparison) -> None:
        """Draw a comparison."""
        for triad, curves in self._spectra.items():
            rows = slice(1, min(len(found.real.frequency), len(found.simulated.frequency)))  # without f = 0
            unit = TO_SI[DENSITIES[triad]]
            curves.show(
                found.real.frequency[rows],
                np.sqrt(found.real.density[triad][rows]) / unit,
                np.sqrt(found.simulated.density[triad][rows]) / unit,
            )
        counts = {
            triad: min(len(found.real_allan[triad].tau), len(found.simulated_allan[triad].tau))
            for triad in found.real_allan
        }
        self._allan.compare(
            {
                triad: curve._replace(
                    tau=curve.tau[: counts[triad]], deviation=curve.deviation[: counts[triad]]
                )
                for triad, curve in found.real_allan.items()
            },
            {triad: curve.deviation[: counts[triad]] for triad, curve in found.simulated_allan.items()},
        )

    def clear(self) -> None:
        """Draw nothing."""
        for curves in self._spectra.values():
            curves.clear()
        self._allan.clear()
