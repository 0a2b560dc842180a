"""Allan: figures of the Allan deviation of the sensors at rest, measured and expected from the settings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from bokeh.models.ranges import Range1d
from bokeh.models.sources import ColumnDataSource
from bokeh.models.tools import HoverTool
from bokeh.plotting import figure
from numpy.typing import NDArray

from lab.analysis.allan import FLOOR, AllanDeviation
from lab.sensors.suite import SensorSuite
from lab.units import TO_SI, si
from lab.views.envelope import limits
from lab.views.figures import plain_figure, set_ordinate, tick_by_hand
from lab.views.legend import add_legend
from lab.views.quantities import AXIS_COLOURS

FloatArray = NDArray[np.float64]

BODY = ("x", "y", "z")
UNITS = {"gyro": "°/h", "accelerometer": "mg"}
TITLES = {"gyro": "Gyros", "accelerometer": "Accelerometers"}


def promised(sensors: SensorSuite, triad: str, tau: FloatArray) -> FloatArray:
    """Return the Allan deviation (k, 3) expected from noise density, flicker and random walk, in SI units.

    Quantisation with the step q is included as white noise with σ = q/√12 in each sample, where the noise of
    a sample exceeds half a step.

    Parameters
    ----------
    sensors
        The settings of the sensors.
    triad
        ``"gyro"`` or ``"accelerometer"``.
    tau : (k,) array
        Averaging times [s]; the first is the time from sample to sample.
    """
    errors = sensors.groups()[triad]
    white, flicker, walk = (si(errors, name) for name in ("noise_density", "flicker", "rate_random_walk"))
    step, t, dt = si(errors, "quantisation"), tau[:, None], float(tau[0])
    rounded = np.where(white**2 / dt >= (step / 2) ** 2, step**2 * dt / 12, 0.0)
    return np.asarray(np.sqrt((white**2 + rounded) / t + (FLOOR * flicker) ** 2 + walk**2 * t / 3))


class AllanFigures:
    """The Allan deviation of the gyros and of the accelerometers over the averaging time.

    Attributes
    ----------
    figures : list of figure
        Gyros, accelerometers.
    """

    def __init__(self) -> None:
        names = [f"{axis}{suffix}" for axis in BODY for suffix in ("", "_promised")]
        self._sources = {
            triad: ColumnDataSource({name: np.zeros(0) for name in ("tau", *names)}) for triad in UNITS
        }
        self.figures = [self._draw(triad) for triad in UNITS]

    def show(self, sensors: SensorSuite, deviations: Mapping[str, AllanDeviation]) -> None:
        """Draw the deviations of both triads, beside those expected from the settings."""
        for (triad, unit), fig in zip(UNITS.items(), self.figures, strict=True):
            found = deviations[triad]
            columns = {"tau": found.tau}
            for suffix, values in (("", found.deviation), ("_promised", promised(sensors, triad, found.tau))):
                columns |= {f"{axis}{suffix}": values[:, i] / TO_SI[unit] for i, axis in enumerate(BODY)}
            self._sources[triad].data = columns
            set_ordinate(fig, *limits([columns[axis] for axis in BODY], "logarithmic"))
            fig.x_range.update(start=found.tau[0] / 1.3, end=found.tau[-1] * 1.3)

    def clear(self) -> None:
        """Draw nothing."""
        for source in self._sources.values():
            source.data = {name: np.zeros(0) for name in source.data}

    def _draw(self, triad: str) -> figure:
        source = self._sources[triad]
        fig = plain_figure(
            f"{TITLES[triad]}: Allan deviation [{UNITS[triad]}], dashed: as set",
            "averaging time τ [s]",
            x_axis_type="log",
            y_axis_type="log",
            x_range=Range1d(start=1, end=1e4),
            y_range=Range1d(start=0.1, end=1),
            tools=[],
            height=240,
        )
        tick_by_hand(fig)
        lines = {}
        for axis, colour in zip(BODY, AXIS_COLOURS, strict=True):
            fig.line("tau", f"{axis}_promised", source=source, color=colour, line_dash="dashed", alpha=0.7)
            lines[axis] = fig.line("tau", axis, source=source, color=colour, line_width=1.6)
        tooltips = [("τ", "@tau{0.00} s"), *((axis, f"@{axis}{{0.000}} {UNITS[triad]}") for axis in BODY)]
        fig.add_tools(HoverTool(mode="vline", renderers=[lines["x"]], tooltips=tooltips))
        add_legend(fig, lines)
        return fig
