"""Correction: a navigator is corrected by the estimated error [P | x] of its filter.

The errors of a model with its own coordinates are mapped by T first; those of a group by its exponential.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14;
A. Barrau, S. Bonnabel, *The invariant extended Kalman filter as a stable observer*, IEEE Trans. AC 62 (2017).
"""

from __future__ import annotations

import math

import numpy as np

from lab.base.arrays import FloatArray
from lab.navigation import strapdown, wander
from lab.navigation.filters.error_models import ErrorModel, write_frame_map
from lab.navigation.kernels.compilation import allocating_kernel, inline_kernel, kernel
from lab.navigation.kernels.generation import Kernel, Slot
from lab.navigation.kernels.propagation import NAV, PLACES, STATES, WIDTH, X
from lab.navigation.strapdown import LATITUDE, PREVIOUS_VELOCITY, VELOCITY, Vector, get, put

SMALL = 1e-4
"""Square of an angle below which a series stands for sine and cosine [rad²]: it leaves out 1e-11."""


@kernel
def correct(state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Correct the navigator by the estimated error, and set the estimate to zero."""
    x, y, z = w[X], w[WIDTH + X], w[2 * WIDTH + X]
    # Estimate minus truth is taken off; the error of the height is positive down, hence its plus below.
    latitude = state[LATITUDE] - x * state[strapdown.MERIDIAN]
    longitude = state[strapdown.LONGITUDE] - y * state[strapdown.TRANSVERSE] / state[strapdown.COSINE]
    strapdown.set_position(state, latitude, longitude, state[strapdown.HEIGHT] + z)
    for i in range(3):
        state[VELOCITY + i] -= w[WIDTH * (3 + i) + X]
        # A second fix before the next sample interpolates between this one and the one before.
        state[PREVIOUS_VELOCITY + i] -= w[WIDTH * (3 + i) + X]
    for i in range(NAV, STATES):
        state[PLACES[i - NAV]] -= w[WIDTH * i + X]
    turn = w[WIDTH * 6 + X], w[WIDTH * 7 + X], w[WIDTH * 8 + X]
    strapdown.note_correction(state, turn)
    # Ĉ = (I − [φ×]) C, so the truth is exp(+[φ×]) Ĉ.
    attitude = strapdown.rotation(turn)
    at = strapdown.Q_NB
    q = strapdown.product(attitude, (state[at], state[at + 1], state[at + 2], state[at + 3]))
    put(state, at, (q[0], q[1], q[2]))
    state[at + 3] = q[3]
    for i in range(STATES):
        w[WIDTH * i + X] = 0.0


@allocating_kernel
def correct_in_wander(state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Correct a navigator in a wander frame by the estimated error, and set the estimate to zero."""
    x = np.empty(STATES)
    for i in range(STATES):
        x[i] = w[WIDTH * i + X]
        w[WIDTH * i + X] = 0.0
    wander.displace(state, x)
    for i in range(NAV, STATES):
        state[PLACES[i - NAV]] -= x[i]


@inline_kernel
def _apply_left_jacobian(psi: Vector, v: Vector) -> Vector:
    """Return J v with J the left Jacobian of the rotation ψ, as in the exponential of SE₂(3)."""
    square = psi[0] * psi[0] + psi[1] * psi[1] + psi[2] * psi[2]
    # J = I + (1 − cos ψ)/ψ² [ψ×] + (ψ − sin ψ)/ψ³ [ψ×]².
    if square < SMALL:
        a, b = 1 / 2 - square / 24, 1 / 6 - square / 120
    else:
        angle = math.sqrt(square)
        a, b = (1 - math.cos(angle)) / square, (angle - math.sin(angle)) / (square * angle)
    once = strapdown.cross(psi, v)
    return strapdown.plus(strapdown.plus(v, a, once), b, strapdown.cross(psi, once))


@kernel
def apply_group_exponential(x: FloatArray) -> None:
    """Apply the group's Jacobian to the position and velocity of an error estimate, x ≥ (9,), in place."""
    psi = get(x, 6)
    put(x, 0, _apply_left_jacobian(psi, get(x, 0)))
    put(x, 3, _apply_left_jacobian(psi, get(x, 3)))


correct_frame = Slot("correct_frame")
"""The correction by errors in the form that the frame takes: `correct`, or `correct_in_wander`."""
correct_linearly = Slot("correct_linearly")
"""`correct` by a pending estimate, which is linear like the fixes that it comes from: the exponential map
would move a large one away from them."""


@allocating_kernel
def correct_mapped(state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Correct the navigator of a model with its own coordinates."""
    write_frame_map(state, T)
    x = np.empty(NAV)
    for c in range(NAV):
        x[c] = w[WIDTH * c + X]
    for r in range(NAV):
        w[WIDTH * r + X] = 0.0
        for c in range(NAV):
            w[WIDTH * r + X] += T[r, c] * x[c]
    correct_frame(state, w, T)


@allocating_kernel
def correct_group(state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Correct the navigator of a model whose errors are those of the group."""
    write_frame_map(state, T)
    x = np.empty(NAV)
    for c in range(NAV):
        x[c] = w[WIDTH * c + X]
    apply_group_exponential(x)
    for r in range(NAV):
        w[WIDTH * r + X] = 0.0
        for c in range(NAV):
            w[WIDTH * r + X] += T[r, c] * x[c]
    correct_frame(state, w, T)


@kernel
def has_estimate(w: FloatArray) -> bool:
    """Return whether an estimated error is pending."""
    estimate = False
    for i in range(STATES):
        estimate |= w[WIDTH * i + X] != 0
    return estimate


@kernel
def write_corrected_state(
    state: FloatArray, w: FloatArray, T: FloatArray, x: FloatArray, spare: FloatArray
) -> FloatArray:
    """Write the state of the navigator corrected by its estimated error into `spare`, leaving it as it is."""
    for i in range(state.size):  # a slice would compile its error messages too: a second
        spare[i] = state[i]
    for i in range(STATES):
        x[i] = w[WIDTH * i + X]
    correct_linearly(spare, w, T)
    for i in range(STATES):
        w[WIDTH * i + X] = x[i]
    return spare


def corrections(model: ErrorModel) -> dict[Kernel, Kernel]:
    """Return the kernels of a model in place of those above."""
    if model.write_map is None:
        return {correct_linearly: correct}
    return {
        correct: correct_group if model.in_body else correct_mapped,
        correct_linearly: correct_mapped,
        correct_frame: correct,
    }
