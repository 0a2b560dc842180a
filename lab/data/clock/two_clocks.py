"""Two clocks: whether those of an IMU and of its receiver run equally fast.

The fixes turn as a weighted sum of the gyros does, whatever the axes: the part about the vertical. If the
stamps of
the IMU are late by an offset that grows, no constant offset brings both together. Offset and growth are
searched over the first minutes with turns and followed over the rest, each time twice as far.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray, running_sums
from lab.base.numbers import format_number
from lab.data.clock.limits import LIMITS
from lab.motion.frames.displacement import velocity_of_positions

_PARAMETERS = 6
"""Three weights of the gyros, their bias, offset and rate."""
_ROUNDS = 10
"""Steps of Gauss and Newton to the best offset and rate. A plain choice: three are mostly enough."""


class ClockRate(NamedTuple):
    """How fast the clock of an IMU runs.

    Attributes
    ----------
    ratio : float
        Time that passes by the stamps of the IMU while the receiver's clock shows one second [s].
    sigma : float
        Its σ.
    first, last : float
        How much later the IMU's stamps are than the receiver's at the first and the last turn [s].
    """

    ratio: float
    sigma: float
    first: float
    last: float

    @property
    def remark(self) -> str:
        """A sentence on the two clocks."""
        side = "fast" if self.ratio > 1 else "slow"
        return (
            f"The clock of the IMU runs {format_number(100 * abs(self.ratio - 1))} % {side} (ratio "
            f"{self.ratio:.4f} ± {self.sigma:.4f}): by the turns, its stamps are "
            f"{_describe_lateness(self.first)} at the first and {_describe_lateness(self.last)} at "
            "the last. The stamps are used as they are; divide the times of the IMU by the ratio."
        )


def _describe_lateness(seconds: float) -> str:
    return f"{abs(seconds):.2f} s {'late' if seconds >= 0 else 'early'}"


def clock_rate(
    time: FloatArray, dtheta: FloatArray, fix_time: FloatArray, position: FloatArray, velocity_n: FloatArray
) -> ClockRate | None:
    """Return how fast the clock of an IMU runs, if it does not run as that of the receiver; else None.

    Parameters
    ----------
    time : (n + 1,) array
        Ends of the samples [s].
    dtheta : (n, 3) array
        Increments of the angle, in any axes [rad].
    fix_time : (m,) array
        Times of validity of the fixes [s].
    position : (m, 3) array
        Latitude, longitude [rad] and height [m].
    velocity_n : (m, 3) array
        Velocities [m/s]; NaN where unknown.
    """
    start, end, turn = _find_turns(fix_time, position, velocity_n)
    inside = (start > time[0] + LIMITS.offset) & (end < time[-1] - LIMITS.offset)
    start, end, turn = start[inside], end[inside], turn[inside]
    if turn.size < LIMITS.legs or not np.std(turn) > 0:
        return None
    lively = np.flatnonzero(np.abs(turn) > np.std(turn))
    start, end, turn = start[lively[0] :], end[lively[0] :], turn[lively[0] :]
    angle = running_sums(dtheta)
    legs = _Legs(time, angle, start, end, turn)
    span = float(end[-1] - start[0])
    known = min(LIMITS.begin, span)
    first = legs.until(known)
    if first.turn.size < LIMITS.legs:
        return None
    offsets = np.linspace(-1, 1, 2 * round(LIMITS.offset / LIMITS.offset_step) + 1) * LIMITS.offset
    count = int(np.ceil(LIMITS.ratio * known / (2 * LIMITS.offset_step)))
    rates = np.linspace(-1, 1, 2 * count + 1) * LIMITS.ratio
    found = min(itertools.product(offsets, rates), key=lambda one: first.cost(*one))
    while True:
        found, sigma = legs.until(known).refine_offset(*found)
        if known >= span:
            break
        known = min(2 * known, span)
    constant, _ = legs.refine_offset(
        *min(itertools.product(offsets, (0.0,)), key=lambda one: legs.cost(*one)), free=1
    )
    left, without = legs.cost(*found), legs.cost(*constant)
    offset, rate = found
    if (
        left > (1 - LIMITS.likeness) * float(np.sum((turn - turn.mean()) ** 2))
        or left > (1 - LIMITS.explained) * without
        or abs(rate) < max(LIMITS.least, LIMITS.sigmas * sigma, LIMITS.apart / span)
    ):
        return None
    return ClockRate(1 + rate, sigma, offset, offset + rate * span)


class _Legs(NamedTuple):
    """Turns of the fixes from ``start`` to ``end``, and the integrated gyros."""

    time: FloatArray
    angle: FloatArray
    start: FloatArray
    end: FloatArray
    turn: FloatArray

    def until(self, length: float) -> _Legs:
        """Return the legs of the first part [s]."""
        count = int(np.searchsorted(self.end, self.start[0] + length, side="right"))
        return self._replace(start=self.start[:count], end=self.end[:count], turn=self.turn[:count])

    def left(self, offset: float, rate: float) -> FloatArray:
        """Return what the gyros leave of the turns, if they are late by an offset that grows."""
        at = [one + offset + rate * (one - self.start[0]) for one in (self.start, self.end)]
        sensed = np.column_stack(
            [np.interp(at[1], self.time, axis) - np.interp(at[0], self.time, axis) for axis in self.angle.T]
            + [self.end - self.start]  # the bias
        )
        # Linear in weights and bias: only offset and rate need a search.
        weights, *_ = np.linalg.lstsq(sensed, self.turn, rcond=None)
        return np.asarray(self.turn - sensed @ weights)

    def cost(self, offset: float, rate: float) -> float:
        """Return the sum of squares of what is left."""
        return float(np.sum(self.left(offset, rate) ** 2))

    def refine_offset(self, offset: float, rate: float, free: int = 2) -> tuple[tuple[float, float], float]:
        """Return the best offset and rate near some, and σ of the rate; with one free, the rate stays."""
        steps = LIMITS.offset_step * np.array((1.0, 1 / float(self.end[-1] - self.start[0])))
        best, reach = np.array((offset, rate)), 1.0
        for _ in range(_ROUNDS):
            change = np.clip(-self._inverse(best, reach * steps[:free]) @ self.left(*best), -1, 1)
            better = best + reach * steps * np.append(change, (0.0,) * (2 - free))
            if self.cost(*better) < self.cost(*best):
                best = better
            else:
                reach /= 2
        variance = LIMITS.correlated * self.cost(*best) / max(self.turn.size - _PARAMETERS, 1)
        sigma = steps[free - 1] * np.sqrt(variance * np.sum(self._inverse(best, steps[:free])[-1] ** 2))
        return (float(best[0]), float(best[1])), float(sigma)

    def _inverse(self, place: FloatArray, steps: FloatArray) -> FloatArray:
        """Return the inverse of the change of what is left by steps of the offset, or of offset and rate."""
        each = np.eye(steps.size, 2) * np.append(steps, 0.0)[:2]
        slopes = [(self.left(*place + step) - self.left(*place - step)) / 2 for step in each]
        return np.asarray(np.linalg.pinv(np.transpose(slopes)))


def _find_turns(
    time: FloatArray, position: FloatArray, velocity_n: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return from when to when, and by how much, the course changes between fixes."""
    known = np.isfinite(time)
    time, position, velocity = time[known], position[known], velocity_n[known, :2]
    if time.size < LIMITS.legs or not (np.diff(time) > 0).all():
        return (np.empty(0),) * 3
    if np.isnan(velocity).any():
        velocity = velocity_of_positions(time, position)[:, :2]
    # Fixes more often than once in half a second show the course no better.
    step = max(1, round(0.5 / float(np.median(np.diff(time)))))
    time, velocity = time[::step], velocity[::step]
    fast = np.linalg.norm(velocity, axis=1) > LIMITS.speed
    turn = np.diff(np.arctan2(velocity[:, 1], velocity[:, 0]))
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    used = fast[1:] & fast[:-1] & (np.diff(time) < LIMITS.leg) & (np.abs(turn) < 1)
    return time[:-1][used], time[1:][used], turn[used]
