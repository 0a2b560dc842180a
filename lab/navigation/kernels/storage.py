"""Storage: what a filter writes into a `Solution`, at each sample and at each fix.

The covariance of a model with its own coordinates is mapped by T, so that all models output the same errors.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.navigation.filters.error_models import ErrorModel, write_map
from lab.navigation.filters.north_slaved import store_state
from lab.navigation.kernels.compilation import allocating_kernel, embedded_kernel, inline_kernel, kernel
from lab.navigation.kernels.generation import Kernel
from lab.navigation.kernels.propagation import (
    BIASES,
    NAV,
    PLACES,
    SCALES,
    STATES,
    WIDTH,
    build_project,
    project,
)
from lab.navigation.solution import Solution
from lab.navigation.strapdown import GYRO_BIAS, GYRO_SCALE


@embedded_kernel
def _store_sensor_errors(out: Solution, k: int, state: FloatArray) -> None:
    """Write biases, scale factors and further estimates of sample k."""
    for i in range(BIASES):
        out.bias[k, i] = state[GYRO_BIAS + i]
    for i in range(SCALES):
        out.scale[k, i] = state[GYRO_SCALE + i]
    for i in range(STATES - NAV - BIASES - SCALES):
        out.further[k, i] = state[PLACES[BIASES + SCALES + i]]


@inline_kernel
def store(out: Solution, k: int, state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Write sample k of the solution."""
    store_state(out, k, state)
    _store_sensor_errors(out, k, state)
    for i in range(STATES):
        out.variance[k, i] = w[(WIDTH + 1) * i]
    for block in range(2):
        at = (WIDTH + 1) * 6 * block
        out.covariance[k, block, 0] = w[at + 1]
        out.covariance[k, block, 1] = w[at + 2]
        out.covariance[k, block, 2] = w[at + WIDTH + 2]


@kernel
def store_fix(P: FloatArray, state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Write the covariance after a fix into P (n, n) of the solution."""
    for i in range(STATES):
        for j in range(STATES):
            P[i, j] = w[WIDTH * i + j]


@inline_kernel
def store_mapped(out: Solution, k: int, state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Write sample k of the solution of a model with its own coordinates, mapped by T."""
    store_state(out, k, state)
    _store_sensor_errors(out, k, state)
    write_map(state, T)
    project(T, w, k, out.variance, out.covariance)


@allocating_kernel
def store_fix_mapped(P: FloatArray, state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Write the covariance after a fix of a model with its own coordinates, T P Tᵀ."""
    write_map(state, T)
    half = np.zeros((STATES, STATES))
    for i in range(STATES):
        for j in range(STATES):
            if i >= NAV:
                half[i, j] = w[WIDTH * i + j]
            else:
                for c in range(NAV):
                    half[i, j] += T[i, c] * w[WIDTH * c + j]
    for i in range(STATES):
        for j in range(i, STATES):
            P[i, j] = half[i, j]
            if j < NAV:
                P[i, j] = 0.0
                for c in range(NAV):
                    P[i, j] += half[i, c] * T[j, c]
            P[j, i] = P[i, j]


def storing(model: ErrorModel) -> dict[Kernel, object]:
    """Return the kernels of a model in place of those above."""
    found: dict[Kernel, object] = {}
    if model.write_map:
        found |= {store: store_mapped, store_fix: store_fix_mapped, project: build_project(model)}
    return found
