"""Two clocks: whether those of an IMU and of its receiver run equally fast, and count the same weeks.

The fixes turn as a weighted sum of the gyros does, whatever the axes: the part about the vertical. If the
stamps of
the IMU are late by an offset that grows, no constant offset brings both together. Offset and growth are
searched over the first minutes with turns and followed over the rest, each time twice as far.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.parameters.units import DAY
from lab.motion.frames.displacement import metres_per_radian


@dataclass(frozen=True)
class ClockLimits:
    """When two clocks are said to run at different rates."""

    fastest: float = 0.03
    """Largest difference of the rates that is searched: cheap IMUs keep their rate to 1 to 3 %."""
    offset: float = 2.0
    """Largest offset at the first turn that is searched [s]; logs with more are refused."""
    begin: float = 240.0
    """Time over which both are searched first [s]: at 1 %, the offset grows by 2.4 s."""
    fewest: int = 30
    """Fewest legs with a course; three parameters of the gyros, offset and rate are found from them."""
    speed: float = 3.0
    """Speed from which a course is known [m/s]."""
    leg: float = 3.0
    """Longest time between fixes [s]."""
    likeness: float = 0.9
    """Part of the variance of the turns that the gyros must explain."""
    explained: float = 0.25
    """Part of what a constant offset leaves unexplained that the rate must explain."""
    sigmas: float = 6.0
    """Rate from which it is said, in its σ."""
    least: float = 5e-4
    """Smallest difference of the rates that is said: crystals keep 0.01 %."""
    apart: float = 0.15
    """Smallest growth of the offset over the log that is said [s]."""
    rollover: float = 1024 * 7 * DAY
    """Time after which the week number of GPS begins again: it has ten bits [s]."""
    rollovers: int = 3
    """Most of these that a receiver is behind: the third is in 2038."""
    beside: float = 60.0
    """Largest time beside a rollover at which stamps go on [s]."""


LIMITS = ClockLimits()
"""The limits in use."""

_OFFSET_STEP = 0.2
"""Steps of the search [s]: turns last for seconds."""
_PARAMETERS = 6
"""Three weights of the gyros, their bias, offset and rate."""
_CORRELATED = 2.0
"""Factor on the variance of residuals, which are correlated from leg to leg."""


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
            f"The clock of the IMU runs {100 * abs(self.ratio - 1):.2g} % {side} (ratio {self.ratio:.4f} ± "
            f"{self.sigma:.4f}): by the turns, its stamps are {_late(self.first)} at the first and "
            f"{_late(self.last)} at "
            "the last. The stamps are used as they are; divide the times of the IMU by the ratio."
        )


def _late(seconds: float) -> str:
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
    start, end, turn = _turns(fix_time, position, velocity_n)
    inside = (start > time[0] + LIMITS.offset) & (end < time[-1] - LIMITS.offset)
    start, end, turn = start[inside], end[inside], turn[inside]
    if turn.size < LIMITS.fewest or not np.std(turn) > 0:
        return None
    lively = np.flatnonzero(np.abs(turn) > np.std(turn))
    start, end, turn = start[lively[0] :], end[lively[0] :], turn[lively[0] :]
    angle = np.concatenate((np.zeros((1, 3)), np.cumsum(dtheta, axis=0)))
    legs = _Legs(time, angle, start, end, turn)
    span = float(end[-1] - start[0])
    known = min(LIMITS.begin, span)
    first = legs.until(known)
    if first.turn.size < LIMITS.fewest:
        return None
    offsets = np.arange(-LIMITS.offset, LIMITS.offset + _OFFSET_STEP / 2, _OFFSET_STEP)
    rates = (
        np.linspace(-1, 1, 2 * int(np.ceil(LIMITS.fastest * known / (2 * _OFFSET_STEP))) + 1) * LIMITS.fastest
    )
    found = min(((a, b) for a in offsets for b in rates), key=lambda one: first.left(*one))
    while True:
        found = _refined(legs.until(known), *found)
        if known >= span:
            break
        known = min(2 * known, span)
    constant = min(((a, 0.0) for a in offsets), key=lambda one: legs.left(*one))
    constant = _refined(legs, *constant, fixed=True)
    left, without = legs.left(*found), legs.left(*constant)
    total = float(np.sum((turn - turn.mean()) ** 2))
    offset, rate = found
    sigma = _sigma(legs, offset, rate)
    if (
        left > (1 - LIMITS.likeness) * total
        or left > (1 - LIMITS.explained) * without
        or abs(rate) < max(LIMITS.least, LIMITS.sigmas * sigma, LIMITS.apart / span)
    ):
        return None
    return ClockRate(1 + rate, sigma, offset, offset + rate * span)


def over_rollovers(time: FloatArray, weeks_of: FloatArray) -> tuple[FloatArray, str]:
    """Return stamps that go on where their week number begins again, in the weeks of others, and a remark.

    Parameters
    ----------
    time : (m,) array
        Stamps of a receiver [s]; NaN where unknown.
    weeks_of : (n,) array
        Stamps of the IMU [s].
    """
    known = np.flatnonzero(np.isfinite(time))
    others = weeks_of[np.isfinite(weeks_of)]
    if known.size == 0 or others.size == 0:
        return time, ""
    period, beside = LIMITS.rollover, LIMITS.beside
    stamps = time[known]
    again = np.abs(np.diff(stamps) + period) < beside
    moved = np.concatenate(([0.0], period * np.cumsum(again)))
    middle = float(np.median(stamps + moved))
    first, last = float(others.min()), float(others.max())
    behind = round(((first + last) / 2 - middle) / period)
    if abs(behind) > LIMITS.rollovers or not first - beside < middle + behind * period < last + beside:
        behind = 0
    if not behind and not again.any():
        return time, ""
    result = time.copy()
    result[known] = stamps + moved + behind * period
    return result, (
        "The stamps of the GPS are off by 1,024 weeks or a multiple, after which the week number of GPS "
        "begins "
        "again: they are taken in the weeks of the IMU."
    )


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

    def left(self, offset: float, rate: float) -> float:
        """Return the sum of squares of the turns that the gyros leave, if late by an offset that grows."""
        at = [one + offset + rate * (one - self.start[0]) for one in (self.start, self.end)]
        sensed = np.column_stack(
            [np.interp(at[1], self.time, axis) - np.interp(at[0], self.time, axis) for axis in self.angle.T]
            + [self.end - self.start]  # the bias
        )
        weights, *_ = np.linalg.lstsq(sensed, self.turn, rcond=None)
        return float(np.sum((self.turn - sensed @ weights) ** 2))


def _turns(
    time: FloatArray, position: FloatArray, velocity_n: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return from when to when, and by how much, the course changes between fixes."""
    known = np.isfinite(time)
    time, position, velocity = time[known], position[known], velocity_n[known, :2]
    if time.size < LIMITS.fewest or not (np.diff(time) > 0).all():
        return (np.empty(0),) * 3
    if np.isnan(velocity).any():
        per_latitude, per_longitude = metres_per_radian(position[:, 0], 0.0)
        north = np.gradient(position[:, 0], time) * per_latitude
        east = np.gradient(np.unwrap(position[:, 1]), time) * per_longitude
        velocity = np.column_stack((north, east))
    # Fixes more often than once in half a second show the course no better.
    step = max(1, round(0.5 / float(np.median(np.diff(time)))))
    time, velocity = time[::step], velocity[::step]
    fast = np.linalg.norm(velocity, axis=1) > LIMITS.speed
    turn = np.diff(np.arctan2(velocity[:, 1], velocity[:, 0]))
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    used = fast[1:] & fast[:-1] & (np.diff(time) < LIMITS.leg) & (np.abs(turn) < 1)
    return time[:-1][used], time[1:][used], turn[used]


def _refined(legs: _Legs, offset: float, rate: float, *, fixed: bool = False) -> tuple[float, float]:
    """Return the best offset and rate near some."""
    from scipy.optimize import minimize  # noqa: PLC0415 - takes a tenth of a second, and only this needs it

    scale = _OFFSET_STEP / float(legs.end[-1] - legs.start[0])

    def at(steps: FloatArray) -> tuple[float, float]:
        return offset + _OFFSET_STEP * float(steps[0]), rate if fixed else rate + scale * float(steps[1])

    def cost(steps: FloatArray) -> float:
        return legs.left(*at(steps))

    start = np.zeros(1 if fixed else 2)
    found = minimize(cost, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-9, "maxfev": 120})
    return at(found.x)


def _sigma(legs: _Legs, offset: float, rate: float) -> float:
    """Return σ of the rate from the curvature of the sum of squares."""
    h = _OFFSET_STEP
    k = h / float(legs.end[-1] - legs.start[0])

    def at(i: int, j: int) -> float:
        return legs.left(offset + i * h, rate + j * k)

    middle = at(0, 0)
    curvature = np.array(
        [
            [at(1, 0) + at(-1, 0) - 2 * middle, (at(1, 1) + at(-1, -1) - at(1, -1) - at(-1, 1)) / 4],
            [0.0, at(0, 1) + at(0, -1) - 2 * middle],
        ]
    )
    curvature[1, 0] = curvature[0, 1]
    if not (np.linalg.eigvalsh(curvature) > 0).all():
        return float("inf")
    variance = _CORRELATED * middle / max(legs.turn.size - _PARAMETERS, 1)
    return float(k * np.sqrt(2 * variance * np.linalg.inv(curvature)[1, 1]))
