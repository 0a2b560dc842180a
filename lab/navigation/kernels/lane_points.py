"""Lane points: sigma points side by side in blocks of eight, so that one vector instruction advances eight.

Number k of point p is element 8 (k + b LENGTH) + l of one buffer, with the block b = p div 8 and the place in
it l = p mod 8; see `lane_step`. The last block is filled with points that nothing reads.
"""

from __future__ import annotations

import functools
from typing import Any

from lab.base.arrays import FloatArray
from lab.base.compiling.compiled_cache import DISABLE_JIT
from lab.navigation import strapdown, wander
from lab.navigation.filters.filter import aligned_zeros
from lab.navigation.kernels.compilation import embedded_kernel, separate_kernel
from lab.navigation.kernels.generation import Variant, generate_module
from lab.navigation.kernels.lane_views import LANES, numbers, wide_vectors
from lab.navigation.strapdown import Vector
from lab.navigation.wander import LENGTH

MOST_TURN = 0.4
"""Largest measured rotation of a sample that the points take abreast [rad]: `strapdown.small_rotation` holds
to 0.5 rad, and the biases and scale factors of a point make its rotation a little larger."""


def allocate_points(points: int) -> FloatArray:
    """Return a buffer for some sigma points, zeros."""
    return aligned_zeros(-(-points // LANES) * LANES * LENGTH)


@embedded_kernel
def view_point(points: FloatArray, number: int) -> FloatArray:
    """Return the sigma point with a number, a view: a navigator's state.

    Embedded, because the compiler lets no kernel return a view.
    """
    view: FloatArray = numbers(points, number // LANES * LENGTH, number % LANES)
    return view


@separate_kernel
def step_abreast(points: FloatArray, dtheta: Vector, dvelocity: Vector, dt: float, lanes: int) -> None:
    """Advance all points by one IMU sample with a rotation of `MOST_TURN` at most.

    A kernel of its own, with the number of `lanes` as a variable, for the reasons that `lanes` names.
    """
    wide_vectors()
    for first in range(0, points.size // LANES, LENGTH):
        for lane in range(lanes):
            strapdown.step(numbers(points, first, lane), dtheta, dvelocity, dt)


@functools.cache
def step_kernel() -> Any:
    """Return `step_abreast` for the wander-azimuth frame, without branches; a debugger needs no such form."""
    if DISABLE_JIT:
        return step_abreast
    own = {**wander.STEP, strapdown.rotation: strapdown.small_rotation}
    title = "One sample of the sigma points of the unscented filter, eight abreast."
    return generate_module("nonlinear points", title, [step_abreast], Variant(own))[step_abreast]
