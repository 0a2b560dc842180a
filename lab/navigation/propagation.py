"""Propagation: P ← Φ P Φᵀ + Q and x ← Φ x, as straight-line code generated from an error model's pattern.

F is sparse with a fixed pattern, so the products are written out once per model. Only the elements that can
be non-zero are multiplied, and each multiplication runs over a whole row, which the compiler converts to
vector instructions. Rows are 16 wide for 15 states, 24 for 21. The column after those of P holds the error
estimate x, which Φ transforms like a column of P. The bias rows of Φ are diagonal (first-order decay), and
those of the scale factors, which are random constants, are rows of the unit matrix. So only the nine
navigation rows are multiplied out.

For a model with its own coordinates, similar generated code projects the covariance, T P Tᵀ.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.navigation.compilation import inline_kernel, named
from lab.navigation.error_models import ErrorModel

FloatArray = NDArray[np.float64]
Propagate = Callable[[FloatArray, float, tuple[float, ...], FloatArray], None]
Project = Callable[[FloatArray, FloatArray, int, FloatArray, FloatArray], None]

NAV = 9
"""States of position, velocity and attitude."""
BIASES = 6
"""States of the two biases."""


class Layout(NamedTuple):
    """The workspace of a filter: [P | x], then Φ P; the kernels use these names as constants."""

    STATES: int
    WIDTH: int  # of a row: whole vectors of eight numbers
    X: int  # the column of the error estimate

    @property
    def product(self) -> int:
        """Offset of Φ P."""
        return self.STATES * self.WIDTH

    @property
    def size(self) -> int:
        """Numbers in the workspace."""
        return self.product + NAV * self.WIDTH


def layout(states: int) -> Layout:
    """Return the workspace layout of a filter with a number of states."""
    return Layout(states, 8 * (states // 8 + 1), states)


STATES, WIDTH, X = layout(15)
"""Layout for which the kernels are written; see `compilation.rebound_throughout` for others."""


def compile_propagation(model: ErrorModel, *, summed: bool = False) -> Propagate:
    """Return the compiled ``propagate(F, dt, decay, w)`` of an error model.

    It replaces [P | x] in the workspace `w` by [Φ P Φᵀ | Φ x] with Φ = I + F dt in the navigation rows and
    the six factors `decay` on the biases.

    Parameters
    ----------
    model
        The error model.
    summed
        Whether F is the sum over many samples from `second_order`, with the elements of its square.
    """
    namespace: dict[str, Propagate] = {}
    exec(
        compile(propagation_source(model, summed=summed), f"<propagation of {model.name}>", "exec"), namespace
    )
    return inline_kernel(named(f"{model.label} {summed}")(namespace["propagate"]))


def propagation_source(model: ErrorModel, *, summed: bool = False) -> str:
    """Return the source that `compile_propagation` compiles."""
    pattern = model.pattern()
    if summed:
        pattern = np.linalg.matrix_power(pattern | np.eye(pattern.shape[0], dtype=np.bool_), 3)
    terms = {row: [int(c) for c in np.flatnonzero(columns)] for row, columns in enumerate(pattern[:NAV])}
    space = layout(model.states)
    lines = ["def propagate(F, dt, decay, w):"]
    lines += [f"    f_{row}_{c} = dt * F[{row}, {c}]" for row, columns in terms.items() for c in columns]
    lines += _navigation_rows(terms, space)
    lines += _navigation_block(terms, space)
    lines += _sensor_columns(space)
    return "\n".join(lines)


def _navigation_rows(terms: dict[int, list[int]], space: Layout) -> list[str]:
    """Write the rows of Φ P, three in one loop over the columns."""
    lines, width = [], space.WIDTH
    for first in range(0, NAV, 3):
        lines += [f"    for j in range({width}):"]
        for row in range(first, first + 3):
            total = f"w[{width * row} + j]"
            for column in terms[row]:
                total += f" + f_{row}_{column} * w[{width * column} + j]"
            lines += [f"        w[{space.product + width * row} + j] = {total}"]
    return lines


def _navigation_block(terms: dict[int, list[int]], space: Layout) -> list[str]:
    """Write (Φ P) Φᵀ for the navigation states.

    The product is symmetric, so each pair of states is computed once, with the row of Φ that has fewer
    elements.
    """
    lines, width = [], space.WIDTH
    left = set(range(NAV))
    for j in sorted(terms, key=lambda row: len(terms[row])):
        for i in sorted(left):
            total = f"w[{space.product + width * i + j}]"
            for column in terms[j]:
                total += f" + f_{j}_{column} * w[{space.product + width * i + column}]"
            lines += [f"    p = {total}", f"    w[{width * i + j}] = p"]
            if i != j:
                lines += [f"    w[{width * j + i}] = p"]
        left.remove(j)
    return lines


def _sensor_columns(space: Layout) -> list[str]:
    """Write the covariances of biases and scale factors, with the navigation states and each other, and x."""
    width = space.WIDTH
    biases, others = range(NAV, NAV + BIASES), range(NAV + BIASES, space.STATES)
    lines = [f"    d_{b} = decay[{b - NAV}]" for b in biases]
    for i in range(NAV):
        for c in (*biases, *others):
            factor = f"d_{c} * " if c in biases else ""
            lines += [
                f"    p = {factor}w[{space.product + width * i + c}]",
                f"    w[{width * i + c}] = p",
                f"    w[{width * c + i}] = p",
            ]
        lines += [f"    w[{width * i + space.X}] = w[{space.product + width * i + space.X}]"]
    for b in biases:
        lines += [f"    w[{width * b + c}] *= d_{b} * d_{c}" for c in biases]
        for c in others:
            lines += [f"    w[{width * b + c}] *= d_{b}", f"    w[{width * c + b}] = w[{width * b + c}]"]
        lines += [f"    w[{width * b + space.X}] *= d_{b}"]
    return lines


def compile_projection(model: ErrorModel) -> Project:
    """Return the compiled ``project(T, w, k, variance, covariance)`` of an error model.

    It writes row k of the histories `variance` (n, states) and `covariance` (n, 2, 3) of a `Solution`: the
    diagonal of T P Tᵀ, and the off-diagonal elements of its position and attitude blocks. It uses the
    workspace beyond [P | x].
    """
    namespace: dict[str, Project] = {}
    exec(compile(projection_source(model), f"<projection of {model.name}>", "exec"), namespace)
    return inline_kernel(named(model.label)(namespace["project"]))


def projection_source(model: ErrorModel) -> str:
    """Return the source that `compile_projection` compiles."""
    pattern, space = model.map_pattern(), layout(model.states)
    width = space.WIDTH
    terms = {row: [int(c) for c in np.flatnonzero(columns)] for row, columns in enumerate(pattern)}
    lines = ["def project(T, w, k, variance, covariance):"]
    for row, columns in terms.items():
        lines += [f"    t_{row}_{c} = T[{row}, {c}]" for c in columns]
        products = " + ".join(f"t_{row}_{c} * w[{width * c} + j]" for c in columns)
        # Four columns at a time; each block needs three of them.
        for first in sorted({3 * (c // 3) for c in columns}):
            lines += [f"    for j in range({first}, {first + 4}):"]
            lines += [f"        w[{space.product + width * row} + j] = {products}"]

    def element(i: int, j: int) -> str:
        return " + ".join(f"t_{j}_{c} * w[{space.product + width * i + c}]" for c in terms[j])

    lines += [f"    variance[k, {i}] = {element(i, i)}" for i in range(NAV)]
    lines += [f"    variance[k, {b}] = w[{(width + 1) * b}]" for b in range(NAV, space.STATES)]
    for block in range(2):
        at = 6 * block
        for e, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            lines += [f"    covariance[k, {block}, {e}] = {element(at + i, at + j)}"]
    return "\n".join(lines)
