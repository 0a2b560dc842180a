"""Pressure: heights from the pressure in the rows of an IMU, as a barometer of the navigator.

The height is that of the standard atmosphere, shifted so that it begins at the height of the first fix: the
weather moves it by a hundred metres. One reading is used in each `PERIOD`, since the errors of a barometer
last for longer than a sample of the IMU.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.data.log.pressure_height import ACCEPTED, PERIOD, height_of, reading_at


class Heights:
    """The heights by pressure of a stream."""

    def __init__(self) -> None:
        self._newest = self._period = -np.inf
        self.shift = np.nan
        """What is added to the heights by pressure [m]; NaN before a reading and a fix have come."""

    def take(self, rows: NDArray[np.void]) -> tuple[FloatArray, FloatArray]:
        """Return times [s] and heights by pressure [m] of the readings to use among some rows.

        Parameters
        ----------
        rows : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
            Rows in the order of arrival that have a time, a rate and a force; those that are not later than
            all before are left out.
        """
        time = rows["time"]
        good = time > np.maximum.accumulate(np.append(self._newest, time))[:-1]
        self._newest = max(self._newest, *time.tolist()) if time.size else self._newest
        good &= (rows["pressure"] > ACCEPTED[0]) & (rows["pressure"] < ACCEPTED[1])  # NaN is not
        rows = rows[good]
        period = np.floor(rows["time"] / PERIOD)
        rows = rows[np.diff(period, prepend=self._period) > 0]
        if period.size:
            self._period = float(period[-1])
        return rows["time"].copy(), height_of(rows["pressure"])

    def begin_at(self, time: float, height: float, times: FloatArray, heights: FloatArray) -> None:
        """Begin at the height of the first fix; later fixes change nothing.

        Parameters
        ----------
        time, height
            Time [s] and height [m] of a fix.
        times, heights : (k,) arrays
            The readings so far [s], [m]; that at the fix is the last one before it, or the first one.
        """
        if np.isnan(self.shift) and times.size:
            self.shift = height - float(heights[reading_at(times, time)])
