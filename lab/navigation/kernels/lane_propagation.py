"""Lane propagation: eight runs abreast between two fixes, with P at each sample or over sums of many.

Strapdown and F are computed in a loop over the runs (`lane_step`). P ← Φ P Φᵀ only adds and multiplies: it is
that of a single run on `wide` numbers. Between the fixes, the estimate x is zero.
"""

from __future__ import annotations

from typing import Any

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.filters.error_models import ErrorModel
from lab.navigation.filters.prediction import add_noise, decay_factor
from lab.navigation.kernels.compilation import inline_kernel, kernel, separate_kernel
from lab.navigation.kernels.generation import Generated, Slot, Variant, Written, generate_module
from lab.navigation.kernels.lane_step import (
    COVARIANCE,
    DECAY,
    INCREMENTS,
    KEPT,
    NOISE,
    SQUARE,
    STEP,
    SUM,
    SYSTEM,
    lane_layout_constants,
    lane_step,
)
from lab.navigation.kernels.lane_views import LANES, wide, wide_vectors
from lab.navigation.kernels.propagation import (
    DRIVEN,
    NAV,
    PLACES,
    STATES,
    WIDTH,
    build_propagate,
    find_terms,
    propagate,
)

COUNT, ELAPSED = 0, 1
"""Samples since P was last propagated, and their length [s]."""

add_to_sum = Slot("add_to_sum")
"""``add_to_sum(F, dt, total)``: see `build_add_to_sum`."""


def build_add_to_sum(model: ErrorModel) -> Written:
    """Return the kernel `add_to_sum` of a model: it adds what can be non-zero of F dt to a sum."""
    lines = ["@inline_kernel", "def add_to_sum(F, dt, total):"]
    for row, columns in find_terms(model).items():
        lines += [f"    total[{model.states * row + c}] += dt * F[{model.states * row + c}]" for c in columns]
    return Written("add_to_sum", "\n".join(lines))


power_times = Slot("power_times")
"""``power_times(power, A, out)``: see `build_power_times`."""


def build_power_times(model: ErrorModel) -> Written:
    """Return the kernel `power_times` of a model.

    It writes the navigation rows of the product of a power of A with A, the sum of F dt, of which only the
    elements are multiplied that can be non-zero; without the decay of the driven states.
    """
    terms, n = find_terms(model), model.states
    lines = ["@kernel", "def power_times(power, A, out):", f"    for at in range(0, {NAV * n}, {n}):"]
    lines += [f"        p_{m} = power[at + {m}]" for m in range(NAV)]
    for c in range(n):
        products = [f"p_{m} * A[{n * m + c}]" for m in range(NAV) if c in terms[m]]
        lines.append(f"        out[at + {c}] = {' + '.join(products) or '0.0'}")
    return Written("power_times", "\n".join(lines))


@inline_kernel
def take_sample(buffer: FloatArray, increments: FloatArray, k: int) -> None:
    """Copy the increments of a sample into the block."""
    for i in range(6):
        for lane in range(LANES):
            buffer[(INCREMENTS + i) * LANES + lane] = increments[k, i, lane]


@inline_kernel
def fade(state: Any, kept: Any) -> None:
    """Let corrections that were fed back decay, as those still in x."""
    for b in range(DRIVEN):
        state[PLACES[b]] *= kept[b]


@separate_kernel
def fly(
    buffer: FloatArray,
    time: FloatArray,
    increments: FloatArray,
    first: int,
    last: int,
    stride: int,
    pace: FloatArray,
    lanes: int,
) -> None:
    """Advance a block from one sample to another, between fixes, with P at each sample.

    A kernel of its own: within a large one, the compiler no longer makes vectors of the loop over the runs.
    The number of `lanes` is a variable, because it would unroll a loop with a constant one.
    """
    wide_vectors()
    state, w, F = wide(buffer, 0), wide(buffer, COVARIANCE), wide(buffer, SYSTEM)
    kept, decay, noise = wide(buffer, KEPT), wide(buffer, DECAY), wide(buffer, NOISE)
    for k in range(first, last):
        take_sample(buffer, increments, k)
        dt = time[k + 1] - time[k]
        for lane in range(lanes):
            lane_step(buffer, lane, dt)
        for b in range(DRIVEN):
            kept[b] = 1.0 - dt * decay[b]
        propagate(F, dt, kept, w)
        fade(state, kept)
        add_noise(w, state, noise, dt)


@separate_kernel
def fly_over_sums(
    buffer: FloatArray,
    time: FloatArray,
    increments: FloatArray,
    first: int,
    last: int,
    stride: int,
    pace: FloatArray,
    lanes: int,
) -> None:
    """Advance a block as `fly` does, with P over the sums of F dt over `stride` samples."""
    wide_vectors()
    F, total = wide(buffer, SYSTEM), wide(buffer, SUM)
    for k in range(first, last):
        take_sample(buffer, increments, k)
        dt = time[k + 1] - time[k]
        for lane in range(lanes):
            lane_step(buffer, lane, dt)
        add_to_sum(F, dt, total)
        pace[COUNT] += 1.0
        pace[ELAPSED] += dt
        if pace[COUNT] >= stride:
            propagate_sum(buffer, pace)


@inline_kernel
def arrive(buffer: FloatArray, pace: FloatArray) -> None:
    """Propagate P to a fix: nothing is left where it is propagated at each sample."""


@inline_kernel
def arrive_with_sum(buffer: FloatArray, pace: FloatArray) -> None:
    """Propagate P to a fix over the sum that is left."""
    if pace[COUNT] > 0:
        propagate_sum(buffer, pace)


@separate_kernel
def propagate_sum(buffer: FloatArray, pace: FloatArray) -> None:
    """Propagate P over the sum of F dt, and begin a new one; see `prediction.predict_over_sums`."""
    wide_vectors()
    state, w, product = wide(buffer, 0), wide(buffer, COVARIANCE), wide(buffer, COVARIANCE + STATES * STATES)
    total, E, kept, noise = wide(buffer, SUM), wide(buffer, STEP), wide(buffer, KEPT), wide(buffer, NOISE)
    elapsed = pace[ELAPSED]
    transition(buffer, elapsed)
    # Half before and half after: noise that came evenly is propagated over half of the sum.
    add_noise(w, state, noise, 0.5 * elapsed)
    # E lacks the unit matrix: the product begins with P itself, so that no ones are multiplied.
    for k in range(NAV * STATES):
        product[k] = w[k]
    for i in range(0, NAV, 3):
        for j in range(0, STATES, 3):
            add_product(product, STATES * i + j, E, STATES * i, w, j, STATES, 1, STATES)
    for i in range(NAV):
        for j in range(NAV):
            w[STATES * i + j] = product[STATES * i + j]
    for i in range(0, NAV, 3):
        # Blocks of three on the diagonal and below it: `put_other_states` mirrors them.
        for j in range(0, i + 1, 3):
            add_product(w, STATES * i + j, product, STATES * i, E, STATES * j, 1, STATES, STATES)
    put_other_states(w, product, kept)
    add_noise(w, state, noise, 0.5 * elapsed)
    fade(state, kept)
    for k in range(NAV * STATES):
        total[k] = 0.0
    pace[COUNT] = 0.0
    pace[ELAPSED] = 0.0


@inline_kernel
def put_other_states(w: Any, product: Any, kept: Any) -> None:
    """Write the covariances of the other states, and those above the diagonal."""
    for i in range(NAV):
        for j in range(i):
            w[STATES * j + i] = w[STATES * i + j]
        # The other states have no rows in E: of them, decay alone acts, once for each side that is driven.
        for c in range(NAV, NAV + DRIVEN):
            p = kept[c - NAV] * product[STATES * i + c]
            w[STATES * i + c] = p
            w[STATES * c + i] = p
        for c in range(NAV + DRIVEN, STATES):
            p = product[STATES * i + c]
            w[STATES * i + c] = p
            w[STATES * c + i] = p
    for b in range(NAV, NAV + DRIVEN):
        for c in range(NAV, NAV + DRIVEN):
            w[STATES * b + c] *= kept[b - NAV] * kept[c - NAV]
        for c in range(NAV + DRIVEN, STATES):
            p = kept[b - NAV] * w[STATES * b + c]
            w[STATES * b + c] = p
            w[STATES * c + b] = p


@inline_kernel
def transition(buffer: FloatArray, elapsed: float) -> None:
    """Write the transition over a sum A, without the unit matrix, as `prediction.second_order` does."""
    A, E, square = wide(buffer, SUM), wide(buffer, STEP), wide(buffer, SQUARE)
    kept, decay = wide(buffer, KEPT), wide(buffer, DECAY)
    power_times(A, A, square)
    decay_in_power(A, square, decay, elapsed)
    power_times(square, A, E)
    decay_in_power(square, E, decay, elapsed)
    for k in range(NAV * STATES):
        E[k] = A[k] + square[k] * (1 / 2) + E[k] * (1 / 6)
    for b in range(DRIVEN):
        kept[b] = decay_factor(decay[b], elapsed)


@inline_kernel
def decay_in_power(power: Any, out: Any, decay: Any, elapsed: float) -> None:
    """Add to the product of a power of A with A that the driven states decay in A."""
    for i in range(NAV):
        for b in range(NAV, NAV + DRIVEN):
            out[STATES * i + b] -= power[STATES * i + b] * decay[b - NAV] * elapsed


@kernel
def add_product(
    out: Any, at: int, left: Any, i: int, right: Any, j: int, down: int, across: int, count: int
) -> None:
    """Add a product of matrices to three rows and columns of one: nine sums stay in registers.

    Parameters
    ----------
    out, at
        The matrix, and where the first of the nine is; its rows are as long as P's.
    left, i
        The left factor, and where the first of three rows begins.
    right, j, down, across
        The right factor, where the first of three columns begins, and the steps to its next number and to the
        next column.
    count
        Number of products in a sum.
    """
    a0, a1, a2 = out[at], out[at + 1], out[at + 2]
    b0, b1, b2 = out[at + STATES], out[at + STATES + 1], out[at + STATES + 2]
    c0, c1, c2 = out[at + 2 * STATES], out[at + 2 * STATES + 1], out[at + 2 * STATES + 2]
    for m in range(count):
        x, y, z = left[i + m], left[i + STATES + m], left[i + 2 * STATES + m]
        first = j + down * m
        p, q, r = right[first], right[first + across], right[first + 2 * across]
        a0, a1, a2 = a0 + x * p, a1 + x * q, a2 + x * r
        b0, b1, b2 = b0 + y * p, b1 + y * q, b2 + y * r
        c0, c1, c2 = c0 + z * p, c1 + z * q, c2 + z * r
    out[at], out[at + 1], out[at + 2] = a0, a1, a2
    out[at + STATES], out[at + STATES + 1], out[at + STATES + 2] = b0, b1, b2
    out[at + 2 * STATES], out[at + 2 * STATES + 1], out[at + 2 * STATES + 2] = c0, c1, c2


def generate_flight(model: ErrorModel, own: Variant, *, summed: bool) -> Generated:
    """Return the kernels `fly` and `arrive` of a north-slaved model.

    Parameters
    ----------
    model
        The model.
    own
        Its kernels at each sample, those of a single run.
    summed
        For propagating P less often than at every sample.
    """
    kernels: dict[Any, Any] = {
        **own.kernels,
        propagate: build_propagate(model, abreast=True),
        add_to_sum: build_add_to_sum(model),
        power_times: build_power_times(model),
        strapdown.rotation: strapdown.small_rotation,
    }
    if summed:
        kernels |= {fly: fly_over_sums, arrive: arrive_with_sum}
    rows = {"WIDTH": (WIDTH, model.states)}
    name = f"fly {model.label}{' sums' * summed}"
    title = f"Eight runs abreast of the filter {model.label}, between fixes."
    constants = {**own.constants, **lane_layout_constants(model.blocks), **rows}
    return generate_module(name, title, [fly, arrive], Variant(kernels, constants))
