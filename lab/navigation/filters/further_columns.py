"""Further columns: F of a filter with further blocks of states (`blocks`), and the models that have them.

Scale factors, misalignments, g-sensitivity, drift and the user's own states act on attitude and velocity.
The errors of other sensors act on nothing: F has no element for them.
"""

from __future__ import annotations

import dataclasses
import functools

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import A, B, ErrorModel, G, V, Write
from lab.navigation.kernels import own_room
from lab.navigation.kernels.compilation import inline_kernel
from lab.navigation.strapdown import Vector, get, per_scale

GS, BS = 15, 18
"""First scale factor of gyros and accelerometers among the states."""


@inline_kernel
def sensor_axes(state: FloatArray, i: int) -> Vector:
    """Return row i of the matrix that takes b to the axes of the filter's errors: C_nb."""
    return get(state, strapdown.C_NB + 3 * i)


@inline_kernel
def sensor_axes_in_body(state: FloatArray, i: int) -> Vector:
    """Return the same for errors resolved in b: a row of the unit matrix."""
    return 1.0 if i == 0 else 0.0, 1.0 if i == 1 else 0.0, 1.0 if i == 2 else 0.0


@inline_kernel
def scale_columns(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the scale factors, and those of the biases anew; see `strapdown.per_scale`."""
    omega, f = mean(state, strapdown.PREVIOUS_DTHETA), mean(state, strapdown.PREVIOUS_DVELOCITY)
    p, q = per_scale(state, strapdown.GYRO_SCALE), per_scale(state, strapdown.ACCEL_SCALE)
    for i in range(3):
        C = sensor_axes(state, i)
        for j in range(3):
            rate, force = C[j] * p[j], -C[j] * q[j]
            F[A + i, G + j], F[A + i, GS + j] = rate, rate * omega[j]
            F[V + i, B + j], F[V + i, BS + j] = force, force * f[j]


@inline_kernel
def mean(state: FloatArray, previous: int) -> Vector:
    """Return the mean rate or specific force of the last step, from its increments."""
    x, y, z = get(state, previous)
    return x * state[strapdown.PER_STEP], y * state[strapdown.PER_STEP], z * state[strapdown.PER_STEP]


GM, BM = -1, -1
"""First misalignment of gyros and accelerometers among the states; a filter that has them sets these."""


@inline_kernel
def misalignment_columns(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the misalignments; see `strapdown.per_scale`."""
    for i in range(3):
        x, y, z = sensor_axes(state, i)
        u, v, w = of_other_axes(state, strapdown.PREVIOUS_DTHETA, strapdown.GYRO_SCALE)
        F[A + i, GM], F[A + i, GM + 1] = x * u[0], x * u[1]
        F[A + i, GM + 2], F[A + i, GM + 3] = y * v[0], y * v[1]
        F[A + i, GM + 4], F[A + i, GM + 5] = z * w[0], z * w[1]
        u, v, w = of_other_axes(state, strapdown.PREVIOUS_DVELOCITY, strapdown.ACCEL_SCALE)
        F[V + i, BM], F[V + i, BM + 1] = -x * u[0], -x * u[1]
        F[V + i, BM + 2], F[V + i, BM + 3] = -y * v[0], -y * v[1]
        F[V + i, BM + 4], F[V + i, BM + 5] = -z * w[0], -z * w[1]


@inline_kernel
def of_other_axes(
    state: FloatArray, previous: int, scale: int
) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Return the means of the last step along the other two axes of each axis, divided by its scale."""
    x, y, z = mean(state, previous)
    p, q, r = per_scale(state, scale)
    return (p * y, p * z), (q * x, q * z), (r * x, r * y)


GG = -1
"""First g-sensitivity of the gyros among the states; a filter that has it sets this."""


@inline_kernel
def g_columns(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the g-sensitivity; see `strapdown.without_g`."""
    f = mean(state, strapdown.PREVIOUS_DVELOCITY)
    for i in range(3):
        C = sensor_axes(state, i)
        for j in range(3):
            F[A + i, GG + j] = C[j] * f[j]


GD, BD = -1, -1
"""First state of the drift of gyros and accelerometers; a filter that has it sets these."""


@inline_kernel
def drift_columns(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the drift, which acts as the biases do."""
    p, q = per_scale(state, strapdown.GYRO_SCALE), per_scale(state, strapdown.ACCEL_SCALE)
    for i in range(3):
        C = sensor_axes(state, i)
        for j in range(3):
            F[A + i, GD + j], F[V + i, BD + j] = C[j] * p[j], -C[j] * q[j]


OWN = blocks.CORE
"""First state of the blocks that a user declared; a filter that has them sets this."""
OWN_SIZE = 0
"""How many there are."""


@inline_kernel
def user_columns(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the states that a user declared: their effects on gyros and accelerometers."""
    for k in range(OWN_SIZE):
        at = own_room.EFFECTS + own_room.WIDTH * k
        for i in range(3):
            x, y, z = sensor_axes(state, i)
            F[A + i, OWN + k] = x * state[at] + y * state[at + 1] + z * state[at + 2]
            F[V + i, OWN + k] = -x * state[at + 3] - y * state[at + 4] - z * state[at + 5]


_COLUMNS: dict[str, Write] = {
    blocks.GYRO_SCALE: scale_columns,
    blocks.GYRO_MISALIGNMENT: misalignment_columns,
    blocks.GYRO_G: g_columns,
    blocks.GYRO_DRIFT: drift_columns,
}
"""What writes the columns of a block, and of the one of the accelerometers that comes with it."""


@functools.cache
def with_blocks(model: ErrorModel, names: tuple[str, ...]) -> ErrorModel:
    """Return a model of 15 states as one with further blocks."""
    names = blocks.in_order(names)
    if names == model.blocks:
        return model
    own = blocks.user_states(names)
    found = {
        "GM": (GM, blocks.first_state(names, blocks.GYRO_MISALIGNMENT)),
        "BM": (BM, blocks.first_state(names, blocks.ACCEL_MISALIGNMENT)),
        "GG": (GG, blocks.first_state(names, blocks.GYRO_G)),
        "GD": (GD, blocks.first_state(names, blocks.GYRO_DRIFT)),
        "BD": (BD, blocks.first_state(names, blocks.ACCEL_DRIFT)),
        "OWN": (OWN, own.start),
        "OWN_SIZE": (OWN_SIZE, own.stop - own.start),
    }
    writes = [write for name, write in _COLUMNS.items() if name in names]
    return dataclasses.replace(
        model,
        writes=(*model.writes, *writes, *([user_columns] if own.stop > own.start else [])),
        blocks=names,
        constants=tuple((name, *values) for name, values in found.items()),
        kernels=(*model.kernels, *([(sensor_axes, sensor_axes_in_body)] if model.in_body else [])),
    )
