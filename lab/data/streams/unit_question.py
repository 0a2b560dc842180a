"""Unit question: in which of several units angular rates are, decided by the first turn of the device.

The direction of gravity moves in the axes of the device as its rates say: du/dt = u × ω for the direction up
u. The factor between the two, by least squares, is that from the unit assumed to the right one. A tilt by
20° decides; a rotation about the vertical shows nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lab.base.arrays import FloatArray


@dataclass(frozen=True)
class QuestionLimits:
    """Limits of the decision.

    Attributes
    ----------
    block : float
        Time over which the direction of gravity is averaged [s]: hands shake it by some degrees at 8 to
        12 Hz, and a tilt takes longer.
    memory : float
        Time after which a turn has lost 63 % of its weight [s]: vibration must not add up for hours.
    enough : float
        Sum of the squared turns of the direction that decides [rad²]: a tilt by 20° in a second has 0.024.
    correlated : float
        Least square of the correlation between the direction's turns and those of the rates: half of what
        moves the one moves the other.
    apart : float
        Largest ratio between the factor and that of the unit chosen. Rates and forces come up to 20 ms
        apart, and sums over blocks lose some per cent. Units that may be meant are at least twice apart.
    longest : float
        Longest time between samples over which rates are integrated [s].
    """

    block: float = 0.2
    memory: float = 10.0
    enough: float = 0.02
    correlated: float = 0.5
    apart: float = 1.3
    longest: float = 0.5


LIMITS = QuestionLimits()
"""The limits of all streams."""


class UnitQuestion:
    """Whether a stream's rates have the unit that was assumed, or another one.

    Attributes
    ----------
    units : tuple of str
        The units that they may have; the first is assumed.

    Parameters
    ----------
    units
        As above.
    scales
        Factors to SI of these units.
    """

    def __init__(self, units: Sequence[str], scales: Sequence[float]) -> None:
        self.units = tuple(units)
        self._factors = [scale / scales[0] for scale in scales]
        self._last: FloatArray | None = None  # time and rate of the last sample
        self._block: float = np.nan  # number of the block since time 0
        self._push = np.zeros(3)  # sum of the forces in the block
        self._turn = np.zeros(3)  # integral of the rates over the block
        self._before: tuple[FloatArray, FloatArray] | None = None  # direction and turn of the block before
        self._sums = np.zeros(3)  # both, squares of those said, squares of those made

    def add(self, time: FloatArray, rate: FloatArray, force: FloatArray) -> str:
        """Take samples; return the unit that a turn shows, empty while none does.

        Parameters
        ----------
        time : (n,) array
            Times [s].
        rate, force : (n, 3) arrays
            Angular rates, in the unit assumed, and specific forces, in SI and in the same axes.
        """
        if not len(time):
            return ""
        samples = np.column_stack((time, rate))
        joined = samples if self._last is None else np.vstack((self._last, samples))
        steps = np.diff(joined[:, 0])
        turns = joined[1:, 1:] * np.where((steps > 0) & (steps < LIMITS.longest), steps, 0.0)[:, None]
        if len(turns) < len(time):
            turns = np.vstack((np.zeros(3), turns))
        self._last = samples[-1]
        blocks = np.floor(time / LIMITS.block)
        edges = [0, *(np.flatnonzero(np.diff(blocks)) + 1).tolist(), len(time)]
        found = ""
        for begin, end in pairwise(edges):
            if blocks[begin] != self._block:
                found = self._end_block(blocks[begin] == self._block + 1) or found
                self._block = float(blocks[begin])
            self._turn += turns[begin:end].sum(axis=0)
            self._push += np.nan_to_num(force[begin:end]).sum(axis=0)
        return found

    def _end_block(self, follows: bool) -> str:
        """Compare a block with the one before; return the unit that they show."""
        (turn, push), self._turn, self._push = (self._turn, self._push), np.zeros(3), np.zeros(3)
        length = float(np.linalg.norm(push))
        if not length > 0 or not np.isfinite(turn).all():
            self._before = None
            return ""
        up = push / length
        before, self._before = self._before, (up, turn) if follows else None
        if before is None:
            return ""
        # Between the middles of two blocks, half of each block's turn is made.
        said = np.cross((before[0] + up) / 2, (before[1] + turn) / 2)
        made = up - before[0]
        self._sums *= np.exp(-LIMITS.block / LIMITS.memory)
        self._sums += (said @ made, said @ said, made @ made)
        return self._decision()

    def _decision(self) -> str:
        both, said, made = self._sums
        if made < LIMITS.enough or both <= 0 or both**2 <= LIMITS.correlated * said * made:
            return ""
        ratios = [max(one * said / both, both / said / one) for one in self._factors]
        best = int(np.argmin(ratios))
        return self.units[best] if ratios[best] < LIMITS.apart else ""


def format_question(doubt: tuple[str, ...]) -> str:
    """Return the doubt about the unit of the angular rates in a sentence; empty without one."""
    if not doubt:
        return ""
    others = " or ".join(f"--unit rate={unit}" for unit in doubt[1:])
    return (
        f"The unit of the angular rates is unknown: {doubt[0]} is used, and {' or '.join(doubt[1:])} is "
        f"possible. {others} says so; a tilt by 20° decides, too."
    )
