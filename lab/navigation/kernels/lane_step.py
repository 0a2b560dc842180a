"""Lane step: one sample of the filter for a run in a block of eight, as code generated for an error model.

The numbers of eight runs lie side by side: number k of run o is element 8 k + o of one buffer. The loop over
the runs is the innermost one, so that the compiler computes the same number of all runs with one vector
instruction. This needs code without branches and without inner loops, on one buffer. The strapdown and the
functions that write F are those of a single run, on views into the buffer; the propagation of P is written
out here, for the upper triangle of P alone.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic

from lab.base.arrays import FloatArray
from lab.base.compiling.compiled_cache import DISABLE_JIT
from lab.navigation import strapdown
from lab.navigation.filters.error_models import ErrorModel, write_f
from lab.navigation.kernels.compilation import inline_kernel
from lab.navigation.kernels.generation import Slot, Written
from lab.navigation.kernels.propagation import NAV, STATES, layout

LANES = 8
"""Runs in a block: the float64 numbers in a cache line, and in the widest vector of today's processors."""
INCREMENTS = strapdown.LENGTH
"""Where the increments of the sample begin in the buffer, after the state: angles, then velocities."""
FORCE = INCREMENTS + 6
"""Where the sum of the velocity increments before the last begins, each resolved in n by the attitude after
it; the last increment follows, whose attitude a fix may correct."""
COVARIANCE = FORCE + 6
"""Where the upper triangle of P begins, row by row; the rows of F follow it."""

Kernel = Callable[..., Any]
Terms = dict[int, list[int]]


def _wide_vectors(context: Any) -> Any:
    """Let the compiler use the widest vectors for the calling function.

    On some processors it prefers half of their width, for code that is not made of vectors alone.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        # llvmlite checks the names of attributes against a list without this one.
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        builder.function.attributes.alignstack = 64
        return context.get_dummy_value()

    return types.void(), generate


def _numbers(context: Any, buffer: Any, first: Any, lane: Any) -> Any:
    """Return the numbers of one run from `first` on as an array; its stride is a constant."""
    view = types.Array(buffer.dtype, 1, "A")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _view(context, builder, signature, arguments, [1])

    return view(buffer, types.intp, types.intp), generate


def _rows(context: Any, buffer: Any, first: Any, width: Any, lane: Any) -> Any:
    """Return the numbers of one run from `first` on as a matrix with rows of a `width`, a constant."""
    view = types.Array(buffer.dtype, 2, "A")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        buffer, first, width, lane = arguments
        return _view(context, builder, signature, (buffer, first, lane), [width, 1])

    return view(buffer, types.intp, types.intp, types.intp), generate


_pack: Callable[..., Any] = cgutils.pack_array


def _view(context: Any, builder: Any, signature: Any, arguments: Any, steps: list[Any]) -> Any:
    """Return a view into the buffer, with strides given in numbers of a run."""
    kind, word = signature.args[0], context.get_value_type(types.intp)
    size = kind.dtype.bitwidth // 8
    base = context.make_array(kind)(context, builder, arguments[0])
    at = builder.add(builder.mul(arguments[1], word(LANES)), arguments[2])
    strides = [
        builder.mul(word(step) if isinstance(step, int) else step, word(LANES * size)) for step in steps
    ]
    view = context.make_array(signature.return_type)(context, builder)
    context.populate_array(
        view,
        data=builder.gep(base.data, [at], inbounds=True),
        # Constants as indices are within any shape.
        shape=_pack(builder, [word(2**30)] * len(steps)),
        strides=_pack(builder, strides),
        itemsize=word(size),
        meminfo=None,
        parent=None,
    )
    return view._getvalue()


def plain_wide_vectors() -> None:
    """Do nothing: without a compiler, there are no vectors."""


def plain_numbers(buffer: FloatArray, first: int, lane: int) -> FloatArray:
    """Return the numbers of one run from `first` on, to the end of the buffer."""
    view: FloatArray = buffer[first * LANES + lane :: LANES]
    return view


def plain_rows(buffer: FloatArray, first: int, width: int, lane: int) -> FloatArray:
    """Return the numbers of one run from `first` on, to the end of the buffer, as a matrix."""
    found = plain_numbers(buffer, first, lane)
    matrix: FloatArray = found[: found.size // width * width].reshape(-1, width)
    return matrix


# What these return is for kernels; the compiler passes the context, and not its callers. A debugger has the
# functions above.
wide_vectors: Kernel = plain_wide_vectors if DISABLE_JIT else intrinsic(_wide_vectors)
numbers: Kernel = plain_numbers if DISABLE_JIT else intrinsic(_numbers)
rows: Kernel = plain_rows if DISABLE_JIT else intrinsic(_rows)


def size_of_lane(states: int) -> int:
    """Return how many numbers a run has in the buffer."""
    return COVARIANCE + states * (states + 1) // 2 + NAV * states


@inline_kernel
def gained(state: FloatArray, given: FloatArray) -> strapdown.Vector:
    """Return the sum of all velocity increments up to a sample, from the numbers from `INCREMENTS` on."""
    at = strapdown.Q_NB
    C_nb = strapdown.matrix((state[at], state[at + 1], state[at + 2], state[at + 3]))
    last = strapdown.rotate(C_nb, strapdown.get(given, 9))
    return strapdown.plus(strapdown.get(given, 6), 1.0, last)


propagate = Slot("propagate")
"""``propagate(state, F, dt, kept, noise, p)``: see `propagation_of`."""
lane_constants = Slot("lane_constants")
"""``lane_constants(decay, noise, dt)``: see `constants_of`."""


@inline_kernel
def lane_step(buffer: Any, lane: int, dt: float, kept: Any, noise: Any) -> None:
    """Advance one run of the block by one sample: strapdown, F, P.

    `kept` and `noise` are those of `lane_constants`. Rotations within a sample must be below 0.5 rad.
    """
    state, given = numbers(buffer, 0, lane), numbers(buffer, INCREMENTS, lane)
    F = rows(buffer, COVARIANCE + STATES * (STATES + 1) // 2, STATES, lane)
    strapdown.put(given, 6, gained(state, given))
    force = given[3], given[4], given[5]
    strapdown.step(state, (given[0], given[1], given[2]), force, dt)
    write_f(state, F)
    propagate(state, F, dt, kept, noise, numbers(buffer, COVARIANCE, lane))
    strapdown.put(given, 9, force)


def lane_kernels(model: ErrorModel) -> dict[Any, Any]:
    """Return the kernels of a north-slaved model in place of those above, and of those of the strapdown."""
    own: dict[Any, Any] = {
        propagate: propagation_of(model),
        lane_constants: constants_of(model),
        strapdown.rotation: strapdown.small_rotation,
    }
    return own if model.blocks else own | strapdown.UNSCALED


def constants_of(model: ErrorModel) -> Written:
    """Return the kernel `lane_constants` of a model: what is the same for all runs, as two tuples.

    The factors by which the driven states fade over a sample, and the variances that it adds.
    """
    driven = layout(model.blocks).DRIVEN
    fading = ", ".join(f"1 - dt * decay[{b}]" for b in range(driven))
    added = ", ".join(f"dt * noise[{b}]" for b in range(6 + driven))
    text = f"@inline_kernel\ndef lane_constants(decay, noise, dt):\n    return ({fading},), ({added},)"
    return Written("lane_constants", text)


def propagation_of(model: ErrorModel) -> Written:
    """Return the kernel `propagate` of a model.

    It replaces the upper triangle `p` of P by that of Φ P Φᵀ plus the noise, and lets the estimates of the
    driven states fade, as the propagation of a single run does.
    """
    pattern, space = model.pattern(), layout(model.blocks)
    terms = {row: [int(c) for c in np.flatnonzero(columns)] for row, columns in enumerate(pattern[:NAV])}
    lines = ["@inline_kernel", "def propagate(state, F, dt, kept, noise, p):"]
    lines += [f"    f_{row}_{c} = dt * F[{row}, {c}]" for row, columns in terms.items() for c in columns]
    lines += _products(terms, space.STATES)
    lines += _fading(space.STATES, NAV + space.DRIVEN)
    lines += [f"    state[{place}] *= kept[{b}]" for b, place in enumerate(space.PLACES[: space.DRIVEN])]
    lines += _noise(space.STATES, space.DRIVEN, in_body=model.in_body)
    return Written("propagate", "\n".join(lines))


def _at(i: int, j: int, states: int) -> str:
    """Return the element of the upper triangle that holds P[i, j]."""
    i, j = min(i, j), max(i, j)
    return f"p[{i * states - i * (i - 1) // 2 + j - i}]"


def _products(terms: Terms, states: int) -> list[str]:
    """Write the navigation rows of Φ P, then (Φ P) Φᵀ for the navigation states."""
    lines = []
    for i in range(NAV):
        for j in range(states):
            parts = [_at(i, j, states), *(f"f_{i}_{c} * {_at(c, j, states)}" for c in terms[i])]
            lines.append(f"    a_{i}_{j} = " + " + ".join(parts))
    order = sorted(terms, key=lambda row: len(terms[row]))
    for i in range(NAV):
        # As for a single run: each pair once, with the row of Φ that has fewer elements.
        for j in order[: order.index(i) + 1]:
            total = " + ".join([f"a_{i}_{j}", *(f"f_{j}_{c} * a_{i}_{c}" for c in terms[j])])
            lines.append(f"    {_at(i, j, states)} = {total}")
    return lines


def _fading(states: int, ends: int) -> list[str]:
    """Write the covariances of the other states; those before `ends` fade."""
    lines = []
    for i in range(NAV):
        for c in range(NAV, states):
            factor = f"kept[{c - NAV}] * " if c < ends else ""
            lines.append(f"    {_at(i, c, states)} = {factor}a_{i}_{c}")
    for b in range(NAV, ends):
        for c in range(b, states):
            factor = f" * kept[{c - NAV}]" if c < ends else ""
            lines.append(f"    {_at(b, c, states)} *= kept[{b - NAV}]{factor}")
    return lines


def _noise(states: int, driven: int, *, in_body: bool) -> list[str]:
    """Write the noise of a sample; white noise enters through C_nb unless the errors are resolved in b."""
    lines = [f"    {_at(NAV + b, NAV + b, states)} += noise[{6 + b}]" for b in range(driven)]
    for source, at in ((0, 6), (3, 3)):  # gyros drive the attitude, accelerometers the velocity
        if in_body:
            lines += [f"    {_at(at + i, at + i, states)} += noise[{source + i}]" for i in range(3)]
            continue
        for i in range(3):
            for j in range(i, 3):
                C_i, C_j = (strapdown.C_NB + 3 * row for row in (i, j))
                total = " + ".join(
                    f"state[{C_i + k}] * state[{C_j + k}] * noise[{source + k}]" for k in range(3)
                )
                lines.append(f"    {_at(at + i, at + j, states)} += {total}")
    return lines
