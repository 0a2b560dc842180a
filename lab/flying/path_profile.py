"""Path profile: speed, course and height over time, along a path of straight legs and corners.

Everything changes along one smooth step, x³ (10 - 15 x + 6 x²), whose first two derivatives vanish at its
ends, so that speed and turn rate, and the accelerations they cause, have no jumps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lab.base.arrays import FloatArray

PEAK = 1.875
"""Largest slope of the smooth step."""

_SLICES = 2000
"""Slices of Simpson's rule along a turn. A plain choice: its error is far below a millimetre."""
_HALVINGS = 60
"""Halvings of the cruise speed of a short leg: doubles have no more digits."""
_STRAIGHT = 1e-9
"""Change of course below which a corner is none [rad]."""


def step(x: FloatArray) -> FloatArray:
    """Return the smooth step from 0 to 1."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x * x))


def step_slope(x: FloatArray) -> FloatArray:
    """Return the derivative of the smooth step."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(30 * (x * (1 - x)) ** 2)


def step_integral(x: FloatArray) -> FloatArray:
    """Return the integral of the smooth step from 0; ½ at 1, and linear from there on."""
    inside = np.clip(x, 0.0, 1.0)
    return np.asarray(inside**4 * (2.5 - 3 * inside + inside**2) + np.maximum(x - 1.0, 0.0))


@dataclass(frozen=True)
class Turn:
    """A corner: its turn rate rises in `ramp`, stays for `steady` and falls in `ramp`; or a turn in a stop.

    Attributes
    ----------
    change : float
        Change of course [rad].
    speed : float
        Speed in it [m/s].
    rate : float
        Turn rate of its steady part [rad/s].
    ramp, steady : float
        Times [s].
    reach : float
        Distance from its begin to the corner, and from there to its end [m].
    lasts_still : float
        Time stood still, for a stop [s].
    """

    change: float = 0.0
    speed: float = 0.0
    rate: float = 0.0
    ramp: float = 0.0
    steady: float = 0.0
    reach: float = 0.0
    lasts_still: float = 0.0

    @classmethod
    def at_speed(cls, change: float, speed: float, rate: float, ramp: float) -> Turn:
        """Return the turn by a change of course at a speed, at most at a rate."""
        if abs(change) < _STRAIGHT:
            return cls()
        rate = math.copysign(min(rate, abs(change) / ramp), change)
        # Both ramps together turn as much as one of them would at the full rate.
        turn = cls(change, speed, rate, ramp, change / rate - ramp)
        # By symmetry begin and end are equally far from the corner; Simpson's rule along the turn.
        time = np.linspace(0.0, turn.lasts, 2 * _SLICES + 1)
        weights = np.full(time.size, 2.0)
        weights[1::2], weights[[0, -1]] = 4.0, 1.0
        course = turn.turned(time)
        along = [float(weights @ part(course)) * turn.lasts / (6 * _SLICES) for part in (np.cos, np.sin)]
        # The chord is the base of a triangle with two equal sides, which meet in the corner.
        reach = speed * math.hypot(*along) / (2 * math.cos(change / 2))
        return cls(change, speed, rate, ramp, turn.steady, reach)

    @property
    def lasts(self) -> float:
        """How long it takes [s]."""
        return 2 * self.ramp + self.steady + self.lasts_still

    def turned(self, time: FloatArray) -> FloatArray:
        """Return the change of course up to times from its begin [rad]."""
        if self.lasts_still:
            return self.change * step(time / self.lasts_still)
        if not self.ramp:
            return np.zeros_like(time)
        up = step_integral(time / self.ramp)
        down = step_integral((time - self.ramp - self.steady) / self.ramp)
        return self.rate * self.ramp * (up - down)


@dataclass(frozen=True)
class Leg:
    """A straight: from one speed to the cruise, and from that to another.

    Attributes
    ----------
    length : float
        Distance [m].
    speeds : tuple of 3 floats
        At its begin, in between, at its end [m/s].
    changes : tuple of 2 floats
        Times the changes of speed take [s].
    heights : tuple of 2 floats
        At its begin and its end [m].
    """

    length: float
    speeds: tuple[float, float, float]
    changes: tuple[float, float]
    heights: tuple[float, float]

    @classmethod
    def between(
        cls,
        length: float,
        ends: tuple[float, float],
        cruise: float,
        acceleration: float,
        heights: tuple[float, float],
    ) -> Leg | None:
        """Return the leg that cruises as fast as its length allows; None where that is too short."""
        low = max(ends)

        def make_leg(speed: float) -> Leg:
            # So long that the acceleration is reached where the step is steepest.
            changes = tuple(PEAK * abs(speed - end) / acceleration for end in ends)
            return cls(length, (ends[0], speed, ends[1]), (changes[0], changes[1]), heights)

        if make_leg(cruise).at_cruise >= 0:
            return make_leg(cruise)
        if make_leg(low).at_cruise < 0 or (low == 0 and length <= 0):
            return None
        high = cruise
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if make_leg(middle).at_cruise >= 0 else (low, middle)
        return make_leg(low) if low > 0 else None

    @property
    def at_cruise(self) -> float:
        """Distance left between the changes of speed [m]."""
        first, cruise, last = self.speeds
        used = self.changes[0] * (first + cruise) / 2 + self.changes[1] * (cruise + last) / 2
        return self.length - used

    @property
    def lasts(self) -> float:
        """How long it takes [s]."""
        return sum(self.changes) + self.at_cruise / self.speeds[1]

    @property
    def steepest(self) -> float:
        """Largest slope of its height, m per m."""
        climb = abs(self.heights[1] - self.heights[0])
        return PEAK * climb / self.length if climb else 0.0

    def motion(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distance [m] and the speed [m/s] at times from its begin."""
        first, cruise, last = self.speeds
        up, down = self.changes
        later = time - (self.lasts - down)
        distance, speed = (
            first * np.minimum(time, up) + cruise * np.maximum(time - up, 0.0),
            np.full_like(time, cruise),
        )
        if up:
            part = time / up
            distance += (cruise - first) * up * step_integral(np.minimum(part, 1.0))
            speed += (first - cruise) * (1 - step(part))
        if down:
            part = later / down
            distance += (last - cruise) * down * step_integral(np.maximum(part, 0.0))
            speed += (last - cruise) * step(part)
        return distance, speed


def profile(
    turns: Sequence[Turn], legs: Sequence[Leg], time: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return speed [m/s], change of course since the start [rad], height [m] and climb [m/s] at times.

    Parameters
    ----------
    turns
        The one before the first leg, those between the legs, the one after the last.
    legs
        One fewer than turns.
    time : (n,) array
        Times from the start [s].
    """
    speed, turned, climb = np.zeros_like(time), np.zeros_like(time), np.zeros_like(time)
    height = np.full_like(time, legs[0].heights[0])
    end = course = 0.0
    for number, turn in enumerate(turns):
        begin, end = end, end + turn.lasts
        if turn.lasts:
            during = _samples(time, begin, end)
            speed[during], height[during] = turn.speed, legs[max(number - 1, 0)].heights[1 if number else 0]
            turned[during] = course + turn.turned(time[during] - begin)
            course += turn.change
        if number < len(legs):
            leg, begin, end = legs[number], end, end + legs[number].lasts
            # Roundoff may put the end before the last sample.
            during = _samples(time, begin, end if number + 1 < len(legs) or turns[-1].lasts else np.inf)
            distance, speed[during] = leg.motion(np.minimum(time[during] - begin, leg.lasts))
            low, high = leg.heights
            turned[during] = course
            height[during] = low + (high - low) * step(distance / leg.length)
            climb[during] = (high - low) * step_slope(distance / leg.length) / leg.length * speed[during]
    return speed, turned, height, climb


def _samples(time: FloatArray, begin: float, end: float) -> slice:
    """Return the samples from begin up to, but not at, the end; the last one belongs to the last part."""
    first, last = np.searchsorted(time, (begin, end))
    return slice(int(first), len(time) if end >= time[-1] else int(last))
