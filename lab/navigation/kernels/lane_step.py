"""Lane step: one sample of the navigator for a run in a block of eight: strapdown, and F of the filter.

The numbers of eight runs lie side by side: number k of run o is element 8 k + o of one buffer. The loop over
the runs is the innermost one, so that the compiler computes the same number of all runs with one vector
instruction. This needs code without branches and without inner loops, on one buffer. The strapdown and the
functions that write F are those of a single run, on views into the buffer. What follows for P only adds and
multiplies, and is written with `wide` numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.filters.error_models import write_f
from lab.navigation.kernels.compilation import inline_kernel
from lab.navigation.kernels.lane_views import numbers, rows
from lab.navigation.kernels.propagation import NAV, STATES, layout

INCREMENTS = strapdown.LENGTH
"""Where the increments of the sample begin in the buffer, after the state: angles, then velocities."""
FORCE = INCREMENTS + 6
"""Where the sum of the velocity increments before the last begins, each resolved in n by the attitude after
it; the last increment follows, whose attitude a fix may correct."""
COVARIANCE = FORCE + 6
"""Where P begins, row by row; the navigation rows of Φ P follow it."""
WHITE = 6
"""Densities of white noise, of gyros and accelerometers; those of the driven states follow."""


class LaneLayout(NamedTuple):
    """Where further numbers of a run begin in the buffer; kernels use these names as constants."""

    SYSTEM: int  # navigation rows of F
    SUM: int  # of F dt since P was last propagated
    STEP: int  # transition over the sum, without the unit matrix
    SQUARE: int  # of the sum
    KEPT: int  # factors by which the driven states fade
    DECAY: int  # their decay rates
    NOISE: int  # process noise densities
    END: int


def lane_layout(names: Sequence[str]) -> LaneLayout:
    """Return the layout of a filter with some further blocks."""
    space = layout(names)
    part = NAV * space.STATES
    system = COVARIANCE + space.STATES**2 + part
    kept = system + 4 * part
    noise = kept + 2 * space.DRIVEN
    return LaneLayout(
        system,
        system + part,
        system + 2 * part,
        system + 3 * part,
        kept,
        kept + space.DRIVEN,
        noise,
        noise + WHITE + space.DRIVEN,
    )


_FIFTEEN = lane_layout(())
SYSTEM, SUM, STEP, SQUARE, KEPT, DECAY, NOISE, END = _FIFTEEN
"""The layout for which the kernels are written."""


def lane_layout_constants(names: Sequence[str]) -> dict[str, tuple[object, object]]:
    """Return the layout of a filter with some further blocks as constants of a `generation.Variant`."""
    old, new = _FIFTEEN._asdict(), lane_layout(names)._asdict()
    return {name: (old[name], new[name]) for name in old}


@inline_kernel
def sum_increments(state: FloatArray, given: FloatArray) -> strapdown.Vector:
    """Return the sum of all velocity increments up to a sample, from the numbers from `INCREMENTS` on."""
    at = strapdown.Q_NB
    C_nb = strapdown.matrix((state[at], state[at + 1], state[at + 2], state[at + 3]))
    last = strapdown.rotate(C_nb, strapdown.get(given, 9))
    return strapdown.plus(strapdown.get(given, 6), 1.0, last)


@inline_kernel
def lane_step(buffer: Any, lane: int, dt: float) -> None:
    """Advance one run of the block by one sample, and write F. A rotation must be below 0.5 rad."""
    state, given = numbers(buffer, 0, lane), numbers(buffer, INCREMENTS, lane)
    strapdown.put(given, 6, sum_increments(state, given))
    force = given[3], given[4], given[5]
    strapdown.step(state, (given[0], given[1], given[2]), force, dt)
    write_f(state, rows(buffer, SYSTEM, STATES, lane))
    strapdown.put(given, 9, force)
