"""Propagation: P ← Φ P Φᵀ and x ← Φ x, at each sample as code written from an error model's pattern.

F is sparse with a fixed pattern, so the products are written out once per model. Only the elements that can
be non-zero are multiplied, and each multiplication runs over a whole row, which the compiler converts to
vector instructions. Rows are 16 wide for 15 states, 24 for 21. The column after those of P holds the error
estimate x, which Φ transforms like a column of P. The other rows of Φ are diagonal: those of the biases, and
of further blocks, have a first-order decay; those of the scale factors, if no other block follows, are rows
of the unit matrix. So only the nine navigation rows are multiplied out.

The transition over many samples has few zeros: `propagate_over` multiplies all of its elements.

For a model with its own coordinates, similar generated code projects the covariance, T P Tᵀ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numba.extending import intrinsic

from lab.base.arrays import FloatArray
from lab.base.compiling.compiled_cache import DISABLE_JIT
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ErrorModel
from lab.navigation.kernels.compilation import inline_kernel, kernel
from lab.navigation.kernels.generation import Slot, Written


def _number(context: Any, values: Any, at: Any) -> Any:
    """Return number `at` of a contiguous array, counted through all its rows."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_pointer(context, builder, signature, arguments))

    return values.dtype(values, types.intp), generate


def _put_number(context: Any, values: Any, at: Any, number: Any) -> Any:
    """Write number `at` of a contiguous array, counted through all its rows."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _pointer(context, builder, signature, arguments))
        return context.get_dummy_value()

    return types.void(values, types.intp, values.dtype), generate


def _pointer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Return the place of a number in memory."""
    assert signature.args[0].layout == "C", "the numbers must be contiguous"
    data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
    return builder.gep(data, [arguments[1]], inbounds=True)


# What these return is for kernels; the compiler passes the context, and not its callers.
number: Callable[..., Any] = intrinsic(_number)
put_number: Callable[..., Any] = intrinsic(_put_number)

if DISABLE_JIT:  # the same for a debugger

    def number(values: FloatArray, at: int) -> float:
        """Return number `at` of a contiguous array, counted through all its rows."""
        return float(values.reshape(-1)[at])

    def put_number(values: FloatArray, at: int, number: float) -> None:
        """Write number `at` of a contiguous array, counted through all its rows."""
        values.reshape(-1)[at] = number


NAV = 9
"""States of position, velocity and attitude."""
BIASES = 6
"""States of the two biases."""


class Layout(NamedTuple):
    """The states of a filter, and its workspace, [P | x], then Φ P; kernels use these names as constants."""

    STATES: int
    WIDTH: int  # of a row: whole vectors of eight numbers
    X: int  # the column of the error estimate
    DRIVEN: int  # states after those of navigation with decay and process noise; constants follow
    SCALES: int  # states of scale factors
    PLACES: tuple[int, ...]  # of the states after those of navigation in the state of the navigator
    OWN: int  # first state of those that a user declared, and how many
    OWN_SIZE: int

    @property
    def product(self) -> int:
        """Offset of Φ P."""
        return self.STATES * self.WIDTH

    @property
    def size(self) -> int:
        """Numbers in the workspace."""
        return self.product + NAV * self.WIDTH


def layout(names: Sequence[str]) -> Layout:
    """Return the layout of a filter with some further blocks."""
    states = blocks.count(names)
    scales = sum(blocks.block(name).size for name in names if name in blocks.SCALES)
    own = blocks.user_states(names)
    ends = [blocks.find_states(names, name).stop for name in names if not blocks.block(name).constant]
    return Layout(
        states,
        # One column more than P has, for x, and up to whole vectors.
        8 * (states // 8 + 1),
        states,
        max([blocks.CORE, *ends]) - NAV,
        scales,
        blocks.find_places(names),
        own.start,
        own.stop - own.start,
    )


_FIFTEEN = layout(())
STATES, WIDTH, X, DRIVEN, SCALES, PLACES, OWN, OWN_SIZE = _FIFTEEN
"""Sizes of the layout for which the kernels are written; see `Layout`."""


def layout_constants(names: Sequence[str]) -> dict[str, tuple[object, object]]:
    """Return the layout of a filter with some further blocks as constants of a `generation.Variant`.

    The first state of the block "GPS drift" is the constant GPS_DRIFT, and so on. The kernels are written for
    a filter without these blocks: a module whose kernels use the constant sets it to `NO_STATE`.
    """
    old, new = _FIFTEEN._asdict(), layout(names)._asdict()
    firsts = {
        name.upper().replace(" ", "_").replace("-", "_"): (blocks.NO_STATE, blocks.first_state(names, name))
        for name in blocks.BLOCKS
    }
    return {name: (old[name], new[name]) for name in old} | firsts


ACCESS: dict[str, object] = {"number": number, "put_number": put_number}
"""What the code written here uses."""

propagate = Slot("propagate")
"""``propagate(F, dt, decay, w)``: see `build_propagate`."""
project = Slot("project")
"""``project(T, w, k, variance, covariance)``: see `build_project`."""


@inline_kernel
def element(values: Any, at: int) -> Any:
    """Return number `at` of an array that has one dimension."""
    return values[at]


@inline_kernel
def put_element(values: Any, at: int, number: Any) -> None:
    """Write number `at` of an array that has one dimension."""
    values[at] = number


ACCESS_ABREAST: dict[str, object] = {"number": element, "put_number": put_element}
"""The same for numbers of eight runs (`lane_views.wide`)."""


def find_terms(model: ErrorModel) -> dict[int, list[int]]:
    """Return the columns of the elements of F that can be non-zero, for each navigation row."""
    pattern = model.pattern()[:NAV]
    return {row: [int(c) for c in np.flatnonzero(columns)] for row, columns in enumerate(pattern)}


def build_propagate(model: ErrorModel, *, abreast: bool = False) -> Written:
    """Return the kernel `propagate` of an error model.

    It replaces [P | x] in the workspace `w` by [Φ P Φᵀ | Φ x] with Φ = I + F dt in the navigation rows and
    the factors `decay` on the driven states.

    Parameters
    ----------
    model
        The error model.
    abreast
        For numbers of eight runs, without x: the rows of P are as long as it has states.
    """
    terms, space = find_terms(model), layout(model.blocks)
    if abreast:
        space = space._replace(WIDTH=space.STATES)
    lines = ["@inline_kernel", "def propagate(F, dt, decay, w):"]
    lines += [
        f"    f_{row}_{c} = dt * number(F, {space.STATES * row + c})"
        for row, columns in terms.items()
        for c in columns
    ]
    lines += _navigation_rows(terms, space)
    lines += _navigation_block(terms, space)
    lines += _sensor_columns(space)
    access = ACCESS
    if abreast:
        # The column of x would be that of the next row.
        lines, access = [line for line in lines if f"+ {space.X}]" not in line], ACCESS_ABREAST
    return Written("propagate", "\n".join(lines), access)


def _navigation_rows(terms: dict[int, list[int]], space: Layout) -> list[str]:
    """Write the rows of Φ P, three in one loop over the columns."""
    lines, width = [], space.WIDTH
    for first in range(0, NAV, 3):
        rows = range(first, first + 3)
        lines += [f"    for j in range({width}):"]
        lines += [
            f"        w_{c} = number(w, {width * c} + j)"
            for c in sorted({*rows, *(c for r in rows for c in terms[r])})
        ]
        for row in rows:
            total = " + ".join([f"w_{row}", *(f"f_{row}_{c} * w_{c}" for c in terms[row])])
            lines += [f"        put_number(w, {space.product + width * row} + j, {total})"]
    return lines


def _navigation_block(terms: dict[int, list[int]], space: Layout) -> list[str]:
    """Write (Φ P) Φᵀ for the navigation states.

    The product is symmetric, so each pair of states is computed once, with the row of Φ that has fewer
    elements.
    """
    lines, width = [], space.WIDTH
    order = sorted(terms, key=lambda row: len(terms[row]))
    for i in range(NAV):
        partners = order[: order.index(i) + 1]
        needed = sorted({*partners, *(c for j in partners for c in terms[j])})
        lines += [f"    p_{c} = number(w, {space.product + width * i + c})" for c in needed]
        for j in partners:
            total = " + ".join([f"p_{j}", *(f"f_{j}_{c} * p_{c}" for c in terms[j])])
            lines += [f"    p = {total}", f"    put_number(w, {width * i + j}, p)"]
            if i != j:
                lines += [f"    put_number(w, {width * j + i}, p)"]
    return lines


def _sensor_columns(space: Layout) -> list[str]:
    """Write the covariances of the other states, with the navigation states and each other, and x."""
    width, ends = space.WIDTH, NAV + space.DRIVEN
    lines = [
        f"    for i in range({NAV}):",
        f"        for c in range({NAV}, {ends}):",
        f"            p = decay[c - {NAV}] * w[{space.product} + {width} * i + c]",
        f"            w[{width} * i + c] = p",
        f"            w[{width} * c + i] = p",
    ]
    if ends < space.STATES:
        lines += [
            f"        for c in range({ends}, {space.STATES}):",
            f"            p = w[{space.product} + {width} * i + c]",
            f"            w[{width} * i + c] = p",
            f"            w[{width} * c + i] = p",
        ]
    lines += [
        f"        w[{width} * i + {space.X}] = w[{space.product} + {width} * i + {space.X}]",
        f"    for b in range({NAV}, {ends}):",
        f"        for c in range({NAV}, {ends}):",
        f"            w[{width} * b + c] *= decay[b - {NAV}] * decay[c - {NAV}]",
    ]
    if ends < space.STATES:
        lines += [
            f"        for c in range({ends}, {space.STATES}):",
            f"            p = decay[b - {NAV}] * w[{width} * b + c]",
            f"            w[{width} * b + c] = p",
            f"            w[{width} * c + b] = p",
        ]
    lines += [f"        w[{width} * b + {space.X}] *= decay[b - {NAV}]"]
    return lines


@kernel
def propagate_over(E: FloatArray, w: FloatArray) -> None:
    """Replace [P | x] in the workspace by [Φ P Φᵀ | Φ x] with Φ = I + E, without regard to a pattern.

    Parameters
    ----------
    E : (n, n) array
        Transition over many samples without the unit matrix, from `prediction.second_order`.
    w
        The workspace.
    """
    for i in range(NAV):
        row, product = WIDTH * i, WIDTH * (STATES + i)
        for j in range(WIDTH):
            w[product + j] = w[row + j]
        for c in range(STATES):
            for j in range(WIDTH):
                w[product + j] += E[i, c] * w[WIDTH * c + j]
    for i in range(NAV):
        row, product = WIDTH * i, WIDTH * (STATES + i)
        for j in range(i, NAV):
            p = w[product + j]
            for c in range(STATES):
                p += E[j, c] * w[product + c]
            w[row + j] = p
            w[WIDTH * j + i] = p
        for c in range(NAV, STATES):
            p = (1 + E[c, c]) * w[product + c]
            w[row + c] = p
            w[WIDTH * c + i] = p
        w[row + X] = w[product + X]
    for b in range(NAV, STATES):
        for c in range(NAV, STATES):
            w[WIDTH * b + c] *= (1 + E[b, b]) * (1 + E[c, c])
        w[WIDTH * b + X] *= 1 + E[b, b]


def build_project(model: ErrorModel) -> Written:
    """Return the kernel `project` of an error model.

    It writes row k of the histories `variance` (n, states) and `covariance` (n, 2, 3) of a `Solution`: the
    diagonal of T P Tᵀ, and the off-diagonal elements of its position and attitude blocks. It uses the
    workspace beyond [P | x].
    """
    pattern, space = model.map_pattern(), layout(model.blocks)
    width = space.WIDTH
    terms = {row: [int(c) for c in np.flatnonzero(columns)] for row, columns in enumerate(pattern)}
    lines = ["@inline_kernel", "def project(T, w, k, variance, covariance):"]
    for row, columns in terms.items():
        lines += [f"    t_{row}_{c} = number(T, {NAV * row + c})" for c in columns]
        products = " + ".join(f"t_{row}_{c} * number(w, {width * c} + j)" for c in columns)
        # The blocks of three columns that are needed, in whole vectors of four numbers.
        needed = 4 * (3 * (max(columns) // 3 + 1) // 4 + 1)
        lines += [f"    for j in range({needed}):"]
        lines += [f"        put_number(w, {space.product + width * row} + j, {products})"]

    def element(i: int, j: int) -> str:
        return " + ".join(f"t_{j}_{c} * number(w, {space.product + width * i + c})" for c in terms[j])

    lines += [f"    variance[k, {i}] = {element(i, i)}" for i in range(NAV)]
    lines += [
        f"    for b in range({NAV}, {space.STATES}):",
        f"        variance[k, b] = w[{width + 1} * b]",
    ]
    for block in range(2):
        at = 6 * block
        for e, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            lines += [f"    covariance[k, {block}, {e}] = {element(at + i, at + j)}"]
    return Written("project", "\n".join(lines), ACCESS)
