"""Pressure height: heights from the pressure of the air, as a barometer of the navigator.

The height is that of the standard atmosphere; for a stream, it is shifted so that it begins at the height of
the first fix: the weather moves it by a hundred metres. One reading is used in each `PERIOD`, since the
errors of a barometer last for longer than a sample of the IMU.

References
----------
International Civil Aviation Organization, *Manual of the ICAO Standard Atmosphere*, Doc 7488 (1993).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.clock.faults import increasing

PERIOD: Final = 1.0
"""Time between the readings that are used [s]: that of the barometer in `lab.sensors.barometer`."""
ACCEPTED: Final = (22_700.0, 130_000.0)
"""Pressures of a barometer that works [Pa]: from the tropopause, 11 km high, to a mine 2 km deep."""
_SEA_LEVEL: Final = 101_325.0  # [Pa]
_TEMPERATURE, _LAPSE = 288.15, 0.0065  # [K], [K/m]
_GAS: Final = 287.05287  # of dry air [J/kg/K]
_EXPONENT: Final = _GAS * _LAPSE / STANDARD_GRAVITY


def height_of(pressure: FloatArray) -> FloatArray:
    """Return the height in the standard atmosphere [m] of pressures [Pa], below the tropopause."""
    return np.asarray(_TEMPERATURE / _LAPSE * (1 - (pressure / _SEA_LEVEL) ** _EXPONENT))


def pressure_at(height: FloatArray) -> FloatArray:
    """Return the pressure of the standard atmosphere [Pa] at heights [m], below the tropopause."""
    return np.asarray(_SEA_LEVEL * (1 - _LAPSE * height / _TEMPERATURE) ** (1 / _EXPONENT))


def reading_at(times: FloatArray, time: float) -> int:
    """Return which of the readings at times (k,) is that at a time: the last one before it, or the first."""
    return max(int(np.searchsorted(times, time, "right")) - 1, 0)


class Heights:
    """The heights by pressure of a stream."""

    def __init__(self) -> None:
        self._newest = self._period = -np.inf
        self.shift = np.nan
        """What is added to the heights by pressure [m]; NaN before a reading and a fix have come."""

    def accept(self, rows: NDArray[np.void]) -> tuple[FloatArray, FloatArray]:
        """Return times [s] and heights by pressure [m] of the readings to use among some rows.

        Parameters
        ----------
        rows : (n,) array of `lab.data.clock.timed_samples.TIMED_IMU`
            Rows in the order of arrival that have a time, a rate and a force; those that are not later than
            all before are left out.
        """
        time = rows["time"]
        good = increasing(time, self._newest)
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
