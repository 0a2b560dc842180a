"""Live aids: the measurements besides fixes that the live filter uses, as the batch has them."""

from __future__ import annotations

from typing import Final

import numpy as np

from lab.live.rolling import Rolling
from lab.navigation import aids
from lab.navigation.aiding import of_one_kind
from lab.navigation.aids import Aids
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Solution
from lab.sensors.suite import SensorSuite
from lab.units import si

READINGS: Final = {
    "time": ((), np.float64),
    "value": ((), np.float64),
    "innovation": ((), np.float64),
    "variance": ((), np.float64),
}
"""Columns of the readings of a barometer: heights by pressure, and what came of them in the filter."""


class LiveAids:
    """The readings of a barometer, for a filter.

    Parameters
    ----------
    sensors, navigator
        The assumptions of the filter.
    readings
        Rows with the columns `READINGS`; the results are written into them.
    """

    def __init__(self, sensors: SensorSuite, navigator: NavigatorSettings, readings: Rolling) -> None:
        self.readings = readings
        self.is_fitted = bool(sensors.barometer.fitted)
        """Whether the filter uses any."""
        self.shift = np.nan
        """What is added to the heights [m]."""
        self._variance = float(navigator.aiding_scale) * float(si(sensors.barometer, "noise")) ** 2
        self._place = si(sensors.odometer, "lever_arm")
        # It is never due. With it, the same compiled loop runs whether there are readings or not.
        self._never = of_one_kind(np.full(1, np.inf), aids.HEIGHT, np.zeros(1), 1.0)

    @property
    def remark(self) -> str:
        """What becomes of the readings; empty if nobody expects any."""
        there = len(self.readings) > 0
        if not self.is_fitted:
            wanted = "The stream has pressures that are not used; sensors.barometer.fitted = true uses them."
            return wanted if there else ""
        if not there:
            return "The stream has no pressure for sensors.barometer.fitted so far."
        innovation = self.readings.column("innovation")
        used = np.flatnonzero(np.isfinite(innovation))
        if not used.size:
            return "Barometer: no reading was used so far."
        sigma = float(np.sqrt(self.readings.column("variance")[used[-1]]))
        return (
            f"Barometer: the last innovation is {innovation[used[-1]]:.2f} m with σ = {sigma:.2f} m; heights "
            f"by pressure are shifted by {self.shift:.0f} m, to the height of the first fix."
        )

    def within(self, after: float, until: float) -> tuple[Aids, int]:
        """Return the measurements after a time and until another [s], and the number of the first reading."""
        first, end = (self.readings.number("time", time, "right") for time in (after, until))
        if np.isnan(self.shift):
            first = end
        time, value = (self.readings.rows(name, first, end) for name in ("time", "value"))
        heights = of_one_kind(time, aids.HEIGHT, value + self.shift, self._variance)
        return Aids.together([heights, self._never], self._place), first

    def keep(self, out: Solution, first: int) -> None:
        """Keep the results of readings, which begin with number `first`."""
        end = first + out.aid_innovation.size - 1
        self.readings.rows("innovation", first, end)[:] = out.aid_innovation[:-1]
        self.readings.rows("variance", first, end)[:] = out.aid_variance[:-1]
