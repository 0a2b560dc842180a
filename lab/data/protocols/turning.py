"""Turning: whether the angular rates of a phone fit the attitude that the phone itself estimates."""

from __future__ import annotations

from math import isfinite

from lab.data.protocols.phone_line import PhoneLine, Row
from lab.data.protocols.samples import NAN

_ENOUGH = 0.02
"""Sum of the squared turns of the attitude from which they say something [rad²]: a turn of the hand by 30° in
ten batches has 0.03. What is rounded to 0.1° at rest reaches it after ten minutes, uncorrelated."""
_CORRELATED = 0.5
"""Least square of the correlation between attitude and rates: half of what moves the one moves the other."""
_LONGEST = 0.5
"""Longest time between batches that are compared [s]: in longer ones the direction is not known."""
_TOLERANCE = 0.2
"""Largest deviation of the factor from 1 that counts as agreement: attitude and rates of a browser come up to
20 ms apart, and a wrong unit makes a factor of 57."""


class Turning:
    """Compares how the direction up moves in device axes with what the angular rates say.

    For a direction u that is fixed to the Earth, du/dt = u × ω in device axes. The factor between the two is
    that of least squares.
    """

    def __init__(self) -> None:
        self._up: Row | None = None
        self._time = NAN
        self._both = 0.0
        self._squares = 0.0
        self._turned = 0.0

    @property
    def factor(self) -> float:
        """Turns of the attitude by those of the angular rates; NaN if it turned too little, or at odds."""
        if self._turned < _ENOUGH or self._both**2 <= _CORRELATED * self._squares * self._turned:
            return NAN
        return self._both / self._squares

    @property
    def evidence(self) -> str:
        """What it shows, in a sentence that begins with a space; empty if it turned too little."""
        factor = self.factor
        if not isfinite(factor):
            return ""
        if abs(factor - 1) < _TOLERANCE:
            return f" The angular rates fit the phone's attitude (factor {factor:.2f})."
        return f" The attitude turns {factor:.2f} times as fast as the angular rates say: check their unit."

    def add(self, line: PhoneLine, unit: float) -> None:
        """Take a batch; `unit` is that of its angular rates [rad/s]."""
        before, self._up = self._up, line.up
        if not line.imu:
            return
        last, self._time = self._time, line.origin + line.imu[-1][0]
        begun = last - line.origin
        if before is None or line.up is None or not 0 < line.imu[-1][0] - begun < _LONGEST:
            return
        x, y, z = 0.0, 0.0, 0.0
        for time, rx, ry, rz, *_ in line.imu:
            step = unit * (time - begun)
            begun = time
            x, y, z = x + step * rx, y + step * ry, z + step * rz
        # The mean of both directions halves the error of a turn that is not small.
        ux, uy, uz = ((one + two) / 2 for one, two in zip(before, line.up, strict=True))
        said = (uy * z - uz * y, uz * x - ux * z, ux * y - uy * x)
        if not all(map(isfinite, said)):
            return
        turned = [one - two for one, two in zip(line.up, before, strict=True)]
        self._squares += sum(one * one for one in said)
        self._turned += sum(one * one for one in turned)
        self._both += sum(one * two for one, two in zip(said, turned, strict=True))
