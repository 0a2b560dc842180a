"""Pairing: angular rates and specific forces of two streams become samples of one IMU."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from lab.data.protocols.samples import UNKNOWN, Vector

_HELD = 512
"""Most samples of each stream that wait for the other: a second at the fastest rate of a phone, 500 Hz."""
_LONGEST_GAP = 0.25
"""Longest step of a stream across which it is interpolated [s]: phones offer rates from 5 Hz."""

Sample = tuple[float, Vector]


class Pairing:
    """Interpolates specific forces at the times of angular rates, linearly.

    Each phone's sensor has its own times. An angular rate waits until a later specific force has come. If
    none comes, it goes on without one.
    """

    def __init__(self) -> None:
        self._rates: deque[Sample] = deque()
        self._forces: deque[Sample] = deque()

    @property
    def held(self) -> int:
        """Number of angular rates that wait."""
        return len(self._rates)

    def add_force(self, time: float, force: Vector) -> None:
        """Take a specific force [m/s²] at a time [s]; one that is not later than the last is left out."""
        if self._forces and time <= self._forces[-1][0]:
            if time > self._forces[-1][0] - _LONGEST_GAP:
                return
            self._forces.clear()  # a clock that was set back: what was before says nothing any more
        self._forces.append((time, force))
        if len(self._forces) > _HELD:
            self._forces.popleft()

    def add_rate(self, time: float, rate: Vector) -> None:
        """Take an angular rate [rad/s] at a time [s]."""
        self._rates.append((time, rate))

    def samples(self, last: bool = False) -> Iterator[tuple[float, Vector, Vector]]:
        """Give time [s], angular rate [rad/s] and specific force [m/s²] of the samples that are complete.

        Parameters
        ----------
        last
            Whether nothing follows: then none waits.
        """
        forces, rates = self._forces, self._rates
        while rates:
            time, rate = rates[0]
            while len(forces) > 1 and forces[1][0] <= time:
                forces.popleft()
            waits = not forces or (forces[-1][0] < time)
            if waits and not last and len(rates) <= _HELD:
                return
            rates.popleft()
            yield time, rate, self._interpolate_force(time)

    def _interpolate_force(self, time: float) -> Vector:
        if not self._forces:
            return UNKNOWN
        (before, force), *others = (
            self._forces if len(self._forces) < 2 else (self._forces[0], self._forces[1])
        )
        if before == time:
            return force
        if before > time or not others:
            return UNKNOWN
        after, later = others[0]
        if after - before > _LONGEST_GAP:
            return UNKNOWN
        part = (time - before) / (after - before)
        return [one + part * (two - one) for one, two in zip(force, later, strict=True)]
