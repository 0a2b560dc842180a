"""Further columns: F of a filter with further blocks of states (`blocks`), and the models that have them.

Scale factors, misalignments, g-sensitivity, drift and the user's own states act on attitude and velocity.
The errors of other sensors act on nothing: F has no element for them.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence

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
def scale_columns(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the scale factors, and those of the biases anew; see `strapdown.per_scale`."""
    omega, f = mean(state, strapdown.PREVIOUS_DTHETA), mean(state, strapdown.PREVIOUS_DVELOCITY)
    p, q = per_scale(state, strapdown.GYRO_SCALE), per_scale(state, strapdown.ACCEL_SCALE)
    for i in range(3):
        C = get(state, strapdown.C_NB + 3 * i)
        for j in range(3):
            rate, force = C[j] * p[j], -C[j] * q[j]
            F[A + i, G + j], F[A + i, GS + j] = rate, rate * omega[j]
            F[V + i, B + j], F[V + i, BS + j] = force, force * f[j]


@inline_kernel
def scale_columns_in_body(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the scale factors and of the biases for errors resolved in b."""
    omega, f = mean(state, strapdown.PREVIOUS_DTHETA), mean(state, strapdown.PREVIOUS_DVELOCITY)
    p, q = per_scale(state, strapdown.GYRO_SCALE), per_scale(state, strapdown.ACCEL_SCALE)
    for j in range(3):
        F[A + j, G + j], F[A + j, GS + j] = p[j], p[j] * omega[j]
        F[V + j, B + j], F[V + j, BS + j] = -q[j], -q[j] * f[j]


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
        x, y, z = get(state, strapdown.C_NB + 3 * i)
        u, v, w = of_other_axes(state, strapdown.PREVIOUS_DTHETA, strapdown.GYRO_SCALE)
        F[A + i, GM], F[A + i, GM + 1] = x * u[0], x * u[1]
        F[A + i, GM + 2], F[A + i, GM + 3] = y * v[0], y * v[1]
        F[A + i, GM + 4], F[A + i, GM + 5] = z * w[0], z * w[1]
        u, v, w = of_other_axes(state, strapdown.PREVIOUS_DVELOCITY, strapdown.ACCEL_SCALE)
        F[V + i, BM], F[V + i, BM + 1] = -x * u[0], -x * u[1]
        F[V + i, BM + 2], F[V + i, BM + 3] = -y * v[0], -y * v[1]
        F[V + i, BM + 4], F[V + i, BM + 5] = -z * w[0], -z * w[1]


@inline_kernel
def misalignment_columns_in_body(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the misalignments for errors resolved in b."""
    u, v, w = of_other_axes(state, strapdown.PREVIOUS_DTHETA, strapdown.GYRO_SCALE)
    F[A, GM], F[A, GM + 1] = u
    F[A + 1, GM + 2], F[A + 1, GM + 3] = v
    F[A + 2, GM + 4], F[A + 2, GM + 5] = w
    u, v, w = of_other_axes(state, strapdown.PREVIOUS_DVELOCITY, strapdown.ACCEL_SCALE)
    F[V, BM], F[V, BM + 1] = -u[0], -u[1]
    F[V + 1, BM + 2], F[V + 1, BM + 3] = -v[0], -v[1]
    F[V + 2, BM + 4], F[V + 2, BM + 5] = -w[0], -w[1]


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
        C = get(state, strapdown.C_NB + 3 * i)
        for j in range(3):
            F[A + i, GG + j] = C[j] * f[j]


@inline_kernel
def g_columns_in_body(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the g-sensitivity for errors resolved in b."""
    f = mean(state, strapdown.PREVIOUS_DVELOCITY)
    for j in range(3):
        F[A + j, GG + j] = f[j]


GD, BD = -1, -1
"""First state of the drift of gyros and accelerometers; a filter that has it sets these."""


@inline_kernel
def drift_columns(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the drift, which acts as the biases do."""
    p, q = per_scale(state, strapdown.GYRO_SCALE), per_scale(state, strapdown.ACCEL_SCALE)
    for i in range(3):
        C = get(state, strapdown.C_NB + 3 * i)
        for j in range(3):
            F[A + i, GD + j], F[V + i, BD + j] = C[j] * p[j], -C[j] * q[j]


@inline_kernel
def drift_columns_in_body(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the drift for errors resolved in b."""
    p, q = per_scale(state, strapdown.GYRO_SCALE), per_scale(state, strapdown.ACCEL_SCALE)
    for j in range(3):
        F[A + j, GD + j], F[V + j, BD + j] = p[j], -q[j]


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
            x, y, z = get(state, strapdown.C_NB + 3 * i)
            F[A + i, OWN + k] = x * state[at] + y * state[at + 1] + z * state[at + 2]
            F[V + i, OWN + k] = -x * state[at + 3] - y * state[at + 4] - z * state[at + 5]


@inline_kernel
def user_columns_in_body(state: FloatArray, F: FloatArray) -> None:
    """Write the columns of the states that a user declared for errors resolved in b."""
    for k in range(OWN_SIZE):
        at = own_room.EFFECTS + own_room.WIDTH * k
        for i in range(3):
            F[A + i, OWN + k], F[V + i, OWN + k] = state[at + i], -state[at + 3 + i]


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
    constants = tuple((name, *values) for name, values in found.items())
    writes = *model.writes, *_column_writers(names, in_body=model.in_body)
    return dataclasses.replace(model, writes=writes, blocks=names, constants=constants)


def _column_writers(names: Sequence[str], *, in_body: bool) -> Iterator[Write]:
    """Yield the functions that write the columns of further blocks."""
    if blocks.GYRO_SCALE in names:
        yield scale_columns_in_body if in_body else scale_columns
    if blocks.GYRO_MISALIGNMENT in names:
        yield misalignment_columns_in_body if in_body else misalignment_columns
    if blocks.GYRO_G in names:
        yield g_columns_in_body if in_body else g_columns
    if blocks.GYRO_DRIFT in names:
        yield drift_columns_in_body if in_body else drift_columns
    if any(name in blocks.OWN for name in names):
        yield user_columns_in_body if in_body else user_columns
