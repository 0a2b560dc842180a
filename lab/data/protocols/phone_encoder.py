"""Phone encoder: samples and fixes as lines of a phone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lab.data.protocols.phone_line import RADIANS, PhoneLine
from lab.data.protocols.samples import NO_FIX

_TOGETHER = 6
"""Most samples of a line: those of a page in 0.1 s."""


class PhoneEncoder:
    """Writes samples and fixes; an `Encoder`. Numbers are exact; satellites and kinds of fixes are left out.

    The lab's phone lines have no temperature and pressure, and a fix without a position is left out.
    """

    name = "phone"

    def __init__(self) -> None:
        self._number = 0
        self._first = 0

    def encode(self, imu: NDArray[np.void], fix: NDArray[np.void]) -> bytes:
        """Return the lines of samples and fixes; each fix follows the last sample that is not later."""
        after = (
            np.searchsorted(imu["time"], fix["time"], side="right") if len(imu) else np.zeros(len(fix), int)
        )
        data, begin = b"", 0
        for row, end in zip(fix, after.tolist(), strict=True):
            data += self._samples(imu[begin:end]) + self._fix(row)
            begin = max(begin, end)
        return data + self._samples(imu[begin:])

    def _samples(self, imu: NDArray[np.void]) -> bytes:
        data = b""
        for begin in range(0, len(imu), _TOGETHER):
            line = PhoneLine(self._number, first=self._first, source="simulated", unit=RADIANS)
            rows = imu[begin : begin + _TOGETHER]
            line.imu = np.column_stack((rows["time"], rows["rate"], rows["force"])).tolist()
            self._first += len(rows)
            data += self._written(line)
        return data

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
