"""Phone encoder: samples and fixes as lines of a phone, a line each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.live.decoders.merging import merged
from lab.live.decoders.phone_line import RADIANS, PhoneLine
from lab.live.samples import NO_FIX


class PhoneEncoder:
    """Writes samples and fixes; an `Encoder`. Numbers are exact; satellites and kinds of fixes are left out.

    The lab's phone lines have no temperature and pressure, and a fix without a position is left out.
    """

    name = "phone"

    def __init__(self) -> None:
        self._number = 0
        self._first = 0

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the lines of samples and fixes in the order of their time."""
        return merged(imu, fix, self._sample, self._fix)

    def _sample(self, row: np.void) -> bytes:
        line = PhoneLine(self._number, first=self._first, source="simulated", unit=RADIANS)
        line.imu = [[float(one) for one in (row["time"], *row["rate"], *row["force"])]]
        self._first += 1
        return self._written(line)

    def _fix(self, row: np.void) -> bytes:
        if row["fix_type"] <= NO_FIX:
            return b""
        line = PhoneLine(self._number, source="simulated", unit=RADIANS)
        place = (np.degrees(row["latitude"]), np.degrees(row["longitude"]), row["height"])
        sigma = (row["horizontal_sigma"], row["vertical_sigma"])
        rest = (*row["velocity_n"], row["speed_sigma"], row["sea_level"])
        line.fix = [[float(one) for one in (row["time"], row["utc"], *place, *sigma, *rest)]]
        return self._written(line)

    def _written(self, line: PhoneLine) -> bytes:
        self._number += 1
        return line.written()
