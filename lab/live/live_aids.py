"""Live aids: the measurements besides fixes that the live filter uses, as the batch has them.

They are heights by pressure, and zero velocity where the IMU shows that the vehicle stands still.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.live.rolling import Rolling
from lab.navigation import aids
from lab.navigation.aiding import CONDITION_PERIOD, ROUNDING, of_one_kind, zero_velocity
from lab.navigation.aids import Aids
from lab.navigation.settings import NavigatorSettings
from lab.navigation.solution import Solution
from lab.sensors.suite import SensorSuite
from lab.units import si

FloatArray = NDArray[np.float64]

READINGS: Final = {
    "time": ((), np.float64),
    "value": ((), np.float64),
    "innovation": ((), np.float64),
    "variance": ((), np.float64),
}
"""Columns of the readings of a barometer: heights by pressure, and what came of them in the filter."""


class LiveAids:
    """The measurements of a filter besides fixes.

    Parameters
    ----------
    sensors, navigator
        The assumptions of the filter.
    readings
        Rows with the columns `READINGS`; the results are written into them.
    samples
        Rows with the columns ``time`` and ``standing``.
    """

    def __init__(
        self, sensors: SensorSuite, navigator: NavigatorSettings, readings: Rolling, samples: Rolling
    ) -> None:
        self.readings, self._samples, self._navigator = readings, samples, navigator
        self._is_fitted = bool(sensors.barometer.fitted)
        self.stands = bool(navigator.zero_velocity)
        """Whether the filter uses zero velocity."""
        self.are_used = self._is_fitted or self.stands
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
        if not self._is_fitted:
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

    def within(self, begun: float, after: float, until: float) -> tuple[Aids, int]:
        """Return the measurements after a time and until another, and the number of the first reading.

        Parameters
        ----------
        begun
            Start of the filter, from which the seconds count [s].
        after, until
            The times [s].
        """
        first, end = (self.readings.number("time", time, "right") for time in (after, until))
        if np.isnan(self.shift) or not self._is_fitted:
            first = end
        time, value = (self.readings.rows(name, first, end) for name in ("time", "value"))
        heights = of_one_kind(time, aids.HEIGHT, value + self.shift, self._variance)
        still = zero_velocity(self._standing(begun, after, until), self._navigator) if self.stands else []
        return Aids.together([heights, *still, self._never], self._place), first

    def _standing(self, begun: float, after: float, until: float) -> FloatArray:
        """Return the whole seconds since the start in which the vehicle stands still."""
        first = max(int(np.floor((after - begun) / CONDITION_PERIOD)), 1)
        seconds = begun + CONDITION_PERIOD * np.arange(first, int((until - begun) / CONDITION_PERIOD) + 2)
        seconds = seconds[(seconds > after) & (seconds <= until)]
        samples = [self._samples.number("time", second - ROUNDING) for second in seconds.tolist()]
        still = [bool(self._samples.rows("standing", at, at + 1)[0]) for at in samples]
        return np.asarray(seconds[np.array(still, dtype=np.bool_)])

    def keep(self, out: Solution, used: Aids, first: int) -> None:
        """Keep the results of readings, which begin with number `first`."""
        rows = np.flatnonzero(used.kind == aids.HEIGHT)[:-1]  # without that which is never due
        self.readings.rows("innovation", first, first + rows.size)[:] = out.aid_innovation[rows]
        self.readings.rows("variance", first, first + rows.size)[:] = out.aid_variance[rows]
