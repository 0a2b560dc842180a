"""Limits: values that no sample of a working sensor has, and steps that only damage makes.

Where a frame has no checksum, or one of 8 bits, damage gets through. What is refused is counted, never
changed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

Vector = Sequence[float]


@dataclass(frozen=True)
class Limits:
    """What is accepted of a sample.

    The defaults refuse only what no sensor in the lab's catalogue measures; whoever knows the sensor gives
    its own.

    Attributes
    ----------
    rate : float
        Largest angular rate of an axis [rad/s]. The default, 4500 °/s, is above the widest gyro range on
        the market that the lab knows of (4000 °/s).
    force : float
        Largest specific force of an axis [m/s²]. The default, 2000 m/s², is 200 g, the widest range of
        accelerometers for navigation and crash tests in one package.
    rate_step, force_step : float
        Largest change from one sample to the next [rad/s], [m/s²]. A larger one is refused, unless the next
        sample confirms it: then it is motion. Infinite where a checksum has been passed. A phone that is
        shaken by hand at 100 Hz changes by less than 50 m/s² and 10 rad/s; a lost decimal point or sign of a
        text line mostly by more.
    """

    rate: float = math.radians(4500)
    force: float = 2000.0
    rate_step: float = math.inf
    force_step: float = math.inf


TEXT_LIMITS = Limits(rate_step=20.0, force_step=100.0)
"""Limits for lines without a checksum: twice the steps of a shaken phone."""


class LimitCheck:
    """Applies limits to the samples of one stream.

    Parameters
    ----------
    limits
        What is accepted.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self._steps = math.isfinite(limits.rate_step) or math.isfinite(limits.force_step)
        self._last: Vector | None = None
        self._odd: Vector | None = None

    def accepts(self, rate: Vector, force: Vector) -> bool:
        """Return whether a sample is within the limits; NaN stands for a whole triad that is not measured."""
        limits = self.limits
        if not (_is_within(rate, limits.rate) and _is_within(force, limits.force)):
            return False
        if not self._steps:
            return True
        values = (*rate, *force)
        near = self._last is None or self._is_near(values, self._last)
        if near or (self._odd is not None and self._is_near(values, self._odd)):
            self._last, self._odd = values, None
            return True
        self._odd = values
        return False

    def scale_rates(self, factor: float) -> None:
        """Multiply the rates of the samples before, whose unit was another one."""
        self._last, self._odd = (
            one and (*(factor * rate for rate in one[:3]), *one[3:]) for one in (self._last, self._odd)
        )

    def _is_near(self, values: Vector, others: Vector) -> bool:
        # Written so that NaN, of a triad that is not measured, is near.
        limits = self.limits
        return not (
            any(abs(a - b) > limits.rate_step for a, b in zip(values[:3], others[:3], strict=True))
            or any(abs(a - b) > limits.force_step for a, b in zip(values[3:], others[3:], strict=True))
        )


def _is_within(vector: Vector, largest: float) -> bool:
    x, y, z = vector
    if -largest <= x <= largest and -largest <= y <= largest and -largest <= z <= largest:
        return True
    return x != x and y != y and z != z  # noqa: PLR0124 - NaN in all three; isnan costs three calls
