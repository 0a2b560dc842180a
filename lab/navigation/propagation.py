"""Propagation: P ← Φ P Φᵀ + Q and x ← Φ x, as straight-line code generated from an error model's pattern.

F is sparse and its pattern is fixed, so the products are written out once per model: only the elements that
can differ from zero are multiplied, and every multiplication runs over a whole row, which the compiler
turns into vector instructions. Rows are 16 wide; column 15 of the workspace carries the error estimate x,
which goes through Φ like a column of P. The bias rows of Φ are diagonal (first-order decay), so only the
nine navigation rows are multiplied out.

A model with coordinates of its own has its covariance projected, T P Tᵀ, by code made the same way.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lab.navigation.compilation import inline_kernel, named
from lab.navigation.error_models import ErrorModel

FloatArray = NDArray[np.float64]
Propagate = Callable[[FloatArray, float, tuple[float, ...], FloatArray], None]
Project = Callable[[FloatArray, FloatArray, int, FloatArray, FloatArray], None]

STATES = 15
NAV = 9
BIASES = 6
WIDTH = 16
X = 15  # the column of the error estimate

PRODUCT = STATES * WIDTH  # offset of Φ P in the workspace; [P | x] is at its start
WORKSPACE = PRODUCT + NAV * WIDTH


def compile_propagation(model: ErrorModel) -> Propagate:
    """Return the compiled ``propagate(F, dt, decay, w)`` of an error model.

    It replaces [P | x] in the workspace `w` by [Φ P Φᵀ | Φ x] with Φ = I + F dt in the navigation rows and
    the six factors `decay` on the biases.
    """
    namespace: dict[str, Propagate] = {}
    exec(compile(propagation_source(model), f"<propagation of {model.name}>", "exec"), namespace)
    return inline_kernel(named(model.label)(namespace["propagate"]))


def propagation_source(model: ErrorModel) -> str:
    """Return the source that `compile_propagation` compiles."""
    terms = {
        row: [int(c) for c in np.flatnonzero(columns)] for row, columns in enumerate(model.pattern()[:NAV])
    }
    lines = ["def propagate(F, dt, decay, w):"]
    lines += [f"    f_{row}_{c} = dt * F[{row}, {c}]" for row, columns in terms.items() for c in columns]
    lines += _navigation_rows(terms)
    lines += _navigation_block(terms)
    lines += _bias_columns()
    return "\n".join(lines)


def _navigation_rows(terms: dict[int, list[int]]) -> list[str]:
    """Write the rows of Φ P, three in one loop over the columns."""
    lines = []
    for first in range(0, NAV, 3):
        lines += [f"    for j in range({WIDTH}):"]
        for row in range(first, first + 3):
            total = f"w[{WIDTH * row} + j]"
            for column in terms[row]:
                total += f" + f_{row}_{column} * w[{WIDTH * column} + j]"
            lines += [f"        w[{PRODUCT + WIDTH * row} + j] = {total}"]
    return lines


def _navigation_block(terms: dict[int, list[int]]) -> list[str]:
    """Write (Φ P) Φᵀ for the navigation states.

    It is symmetric, so each pair of states is computed once, with the row of Φ that has fewer elements.
    """
    lines = []
    left = set(range(NAV))
    for j in sorted(terms, key=lambda row: len(terms[row])):
        for i in sorted(left):
            total = f"w[{PRODUCT + WIDTH * i + j}]"
            for column in terms[j]:
                total += f" + f_{j}_{column} * w[{PRODUCT + WIDTH * i + column}]"
            lines += [f"    p = {total}", f"    w[{WIDTH * i + j}] = p"]
            if i != j:
                lines += [f"    w[{WIDTH * j + i}] = p"]
        left.remove(j)
    return lines


def _bias_columns() -> list[str]:
    """Write the covariances of the biases, with the navigation states and each other, and the column of x."""
    lines = [f"    d_{b} = decay[{b}]" for b in range(BIASES)]
    for i in range(NAV):
        for b in range(BIASES):
            lines += [
                f"    p = d_{b} * w[{PRODUCT + WIDTH * i + NAV + b}]",
                f"    w[{WIDTH * i + NAV + b}] = p",
                f"    w[{WIDTH * (NAV + b) + i}] = p",
            ]
        lines += [f"    w[{WIDTH * i + X}] = w[{PRODUCT + WIDTH * i + X}]"]
    for b in range(BIASES):
        lines += [f"    w[{WIDTH * (NAV + b) + NAV + c}] *= d_{b} * d_{c}" for c in range(BIASES)]
        lines += [f"    w[{WIDTH * (NAV + b) + X}] *= d_{b}"]
    return lines


def compile_projection(model: ErrorModel) -> Project:
    """Return the compiled ``project(T, w, k, variance, covariance)`` of an error model.

    It writes row k of the histories `variance` (n, 15) and `covariance` (n, 2, 3) of a `Solution`: the
    diagonal of T P Tᵀ, and the off-diagonal elements of its position and attitude blocks. It uses the
    workspace beyond [P | x].
    """
    namespace: dict[str, Project] = {}
    exec(compile(projection_source(model), f"<projection of {model.name}>", "exec"), namespace)
    return inline_kernel(named(model.label)(namespace["project"]))


def projection_source(model: ErrorModel) -> str:
    """Return the source that `compile_projection` compiles."""
    pattern = model.map_pattern()
    terms = {row: [int(c) for c in np.flatnonzero(columns)] for row, columns in enumerate(pattern)}
    lines = ["def project(T, w, k, variance, covariance):"]
    for row, columns in terms.items():
        lines += [f"    t_{row}_{c} = T[{row}, {c}]" for c in columns]
        products = " + ".join(f"t_{row}_{c} * w[{WIDTH * c} + j]" for c in columns)
        # Four columns at a time, of which each block needs three.
        for first in sorted({3 * (c // 3) for c in columns}):
            lines += [f"    for j in range({first}, {first + 4}):"]
            lines += [f"        w[{PRODUCT + WIDTH * row} + j] = {products}"]

    def element(i: int, j: int) -> str:
        return " + ".join(f"t_{j}_{c} * w[{PRODUCT + WIDTH * i + c}]" for c in terms[j])

    lines += [f"    variance[k, {i}] = {element(i, i)}" for i in range(NAV)]
    lines += [f"    variance[k, {b}] = w[{(WIDTH + 1) * b}]" for b in range(NAV, STATES)]
    for block in range(2):
        at = 6 * block
        for e, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            lines += [f"    covariance[k, {block}, {e}] = {element(at + i, at + j)}"]
    return "\n".join(lines)
