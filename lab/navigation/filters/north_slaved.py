"""North-slaved: what depends on the frame of a navigator besides its step, in the north-slaved frame.

A model in another frame has the kernels of `wander` in their place (`wander_models.IN_WANDER`), so that the
kernels which call them do not ask for the frame.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from lab.base.arrays import FloatArray
from lab.navigation.kernels.compilation import embedded_kernel, inline_kernel, kernel
from lab.navigation.strapdown import (
    COSINE,
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    MAX_LATITUDE,
    MERIDIAN,
    PREVIOUS_VELOCITY,
    Q_NB,
    SINE,
    TRANSVERSE,
    VELOCITY,
    Matrix,
    Vector,
    earth_rate,
    get,
)

if TYPE_CHECKING:
    from lab.navigation.solution import Solution


@inline_kernel
def leaves_frame(state: FloatArray) -> bool:
    """Return whether the navigator came too close to a pole for its frame."""
    return bool(abs(state[LATITUDE]) > MAX_LATITUDE)


@embedded_kernel
def store_state(out: Solution, k: int, state: FloatArray) -> None:
    """Write position, velocity and attitude of sample k."""
    for i in range(3):
        out.position[k, i] = state[LATITUDE + i]
        out.velocity_n[k, i] = state[VELOCITY + i]
    for i in range(4):
        out.q_nb[k, i] = state[Q_NB + i]


@kernel
def difference(
    state: FloatArray, age: float, fraction: float, position: FloatArray, velocity: FloatArray, z: FloatArray
) -> None:
    """Write navigator minus fix, the navigator interpolated to `age` seconds (`fraction` of a step) ago."""
    v = get(state, VELOCITY)
    before = get(state, PREVIOUS_VELOCITY)
    mean = (0.5 * (v[0] + before[0]), 0.5 * (v[1] + before[1]), 0.5 * (v[2] + before[2]))
    east = state[LONGITUDE] - position[1]
    east -= 2 * math.pi * math.floor(east / (2 * math.pi) + 0.5)
    z[0] = (state[LATITUDE] - position[0]) / state[MERIDIAN] - age * mean[0]
    z[1] = east * state[COSINE] / state[TRANSVERSE] - age * mean[1]
    z[2] = position[2] - state[HEIGHT] - age * mean[2]
    for i in range(3):
        z[3 + i] = v[i] - fraction * (v[i] - before[i]) - velocity[i]


@inline_kernel
def fix_axes(state: FloatArray) -> Matrix:
    """Return north, east and down of the last fix in the navigation frame: its own axes, north-slaved."""
    return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@inline_kernel
def north_axes(state: FloatArray, age: float) -> Matrix:
    """Return north, east and down `age` seconds ago in the navigation frame: its own axes, north-slaved."""
    return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@inline_kernel
def north_variance(state: FloatArray, variance: float) -> float:
    """Return 0: a north-slaved navigator is so far from the poles that north is almost linear in position.

    For another frame, see `wander.north_variance`.
    """
    return 0.0


@inline_kernel
def frame_rate(state: FloatArray) -> Vector:
    """Return the Earth's rate in the navigation frame."""
    sine = state[SINE]
    return earth_rate(sine, math.sqrt(1 - sine * sine))
