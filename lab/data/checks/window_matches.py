"""Window matches: the matches of the windows of a log, each computed once for all axes of its IMU.

If gyros and accelerometers are turned together, the attitude of the IMU turns, and nothing else changes. So
a log that is judged in several axes (`lab.data.sheets.sheet_axes`) needs each match once.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from lab.base.arrays import FloatArray
from lab.data.checks import limits
from lab.data.checks.imu_axes import SAME
from lab.data.checks.velocity_matching import Match, Window, match

_MEDIAN_OF_NORMAL = 0.6745
"""Median size of a normal variable over its σ; that of second differences is √6 times as large."""


class WindowMatches:
    """The windows of a log and their matches, which are computed when they are first asked for.

    Attributes
    ----------
    windows : list of Window
        The windows, in the axes of the log.
    """

    def __init__(self, windows: Sequence[Window]) -> None:
        self.windows = list(windows)
        self._first = self.windows
        self._C = SAME  # from the axes of the first log to those of this one
        self._kept: dict[tuple[object, ...], Match] = {}

    def turned(self, C: FloatArray) -> WindowMatches:
        """Return the windows and matches of the same log in other axes.

        Parameters
        ----------
        C : (3, 3) array
            Rotation from the axes of this log to the others.
        """
        other = WindowMatches(
            [one._replace(dtheta=one.dtheta @ C.T, dvelocity=one.dvelocity @ C.T) for one in self.windows]
        )
        other._first, other._C, other._kept = self._first, C @ self._C, self._kept
        return other

    def match(self, number: int, lags: Sequence[float] = (0.0,)) -> Match:
        """Return the match of a window.

        Parameters
        ----------
        number
            Of the window.
        lags
            As of `lab.data.checks.velocity_matching.match`.
        """
        found = self._match(number, tuple(lags), SAME, SAME, by_noise=False)
        return found._replace(
            C_nb=found.C_nb * Rotation.from_matrix(self._C.T),
            gyro_bias=self._C @ found.gyro_bias,
            gyro_bias_sigma=np.sqrt(self._C**2 @ found.gyro_bias_sigma**2),
        )

    def misfit(self, number: int, gyros: FloatArray = SAME, forces: FloatArray = SAME) -> float:
        """Return the misfit of a window with other axes and signs of its gyros or accelerometers.

        The σ of the velocities is that of their noise, and not what the receiver says.

        Parameters
        ----------
        number
            Of the window.
        gyros, forces : (3, 3) arrays
            Applied to the gyros and to the accelerometers.
        """
        C = self._C
        return self._match(number, (0.0,), C.T @ gyros @ C, C.T @ forces @ C, by_noise=True).misfit

    def _match(
        self, number: int, lags: tuple[float, ...], gyros: FloatArray, forces: FloatArray, *, by_noise: bool
    ) -> Match:
        """Return a match in the axes of the first log."""
        key = (number, lags, by_noise, *gyros.ravel().round(3), *forces.ravel().round(3))
        if key not in self._kept:
            window = self._first[number]
            changed = window._replace(dtheta=window.dtheta @ gyros.T, dvelocity=window.dvelocity @ forces.T)
            if by_noise:
                noise = np.broadcast_to(_noise(window.velocity_n), window.sigma.shape)
                changed = changed._replace(sigma=np.maximum(limits.LOG.velocity_sigma, noise))
            self._kept[key] = match(changed, lags=lags)
        return self._kept[key]


def _noise(velocity_n: FloatArray) -> FloatArray:
    """Return the σ of white noise that second differences have like those of the velocities (3,) [m/s]."""
    if len(velocity_n) < limits.LOG.noise_fixes:
        return np.zeros(3)
    steps = np.abs(np.diff(velocity_n, 2, axis=0))
    return np.asarray(np.nan_to_num(np.median(steps, axis=0)) / (_MEDIAN_OF_NORMAL * np.sqrt(6)))
