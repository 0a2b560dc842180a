"""Prediction: how covariance and estimate of a filter, [P | x], go from one sample to the next.

At each sample with F to first order, or less often with the sum of F dt to third order.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.filters.error_models import ErrorModel
from lab.navigation.filters.filter import Filter
from lab.navigation.kernels.compilation import allocating_kernel, embedded_kernel, inline_kernel
from lab.navigation.kernels.generation import Slot, Written
from lab.navigation.kernels.propagation import (
    DRIVEN,
    NAV,
    PLACES,
    STATES,
    WIDTH,
    layout,
    propagate,
    propagate_over,
)
from lab.navigation.strapdown import get

kept_part = Slot("kept_part")
"""``kept_part(decay, dt, room)``: the factors of all driven states over a step; see `build_kept_part`."""
IN_REGISTERS = 16
"""Most factors that stay in registers: with 30 of them, a sample takes seven times as long as from memory."""


@inline_kernel
def add_noise(w: FloatArray, state: FloatArray, noise: FloatArray, dt: float) -> None:
    """Add the process noise of one step to P; white noise enters through C_nb."""
    for block in range(2):
        at = 6 - 3 * block  # gyro noise drives the attitude, accelerometer noise the velocity
        q0, q1, q2 = dt * noise[3 * block], dt * noise[3 * block + 1], dt * noise[3 * block + 2]
        for i in range(3):
            # C Q Cᵀ of a diagonal Q: only the upper triangle is computed.
            a, b, c = get(state, strapdown.C_NB + 3 * i)
            for j in range(i, 3):
                d, e, f = get(state, strapdown.C_NB + 3 * j)
                q = a * d * q0 + b * e * q1 + c * f * q2
                w[WIDTH * (at + i) + at + j] += q
                if j > i:
                    w[WIDTH * (at + j) + at + i] += q
    for b in range(DRIVEN):
        w[(WIDTH + 1) * (NAV + b)] += dt * noise[6 + b]


@inline_kernel
def add_noise_in_body(w: FloatArray, state: FloatArray, noise: FloatArray, dt: float) -> None:
    """Add the process noise of one step to P where velocity and attitude errors are resolved in b."""
    for i in range(3):
        w[(WIDTH + 1) * (6 + i)] += dt * noise[i]
        w[(WIDTH + 1) * (3 + i)] += dt * noise[3 + i]
    for b in range(DRIVEN):
        w[(WIDTH + 1) * (NAV + b)] += dt * noise[6 + b]


@inline_kernel
def decay_factor(rate: float, elapsed: float) -> float:
    """Return exp(−rate · elapsed) to third order, as in `second_order`."""
    x = rate * elapsed
    return 1 - x * (1 - x / 2 * (1 - x / 3))


@allocating_kernel
def second_order(A: FloatArray, elapsed: float, decay: FloatArray, E: FloatArray) -> None:
    """Write E = A + A²/2 + A³/6, so that exp(A) ≈ I + E, for the sum A of F dt over many samples.

    Parameters
    ----------
    A : (n, n) array
        Sum of F dt: the rows of the navigation states; those of the driven states are their decay.
    elapsed
        Time span of the sum [s].
    decay : (k,) array
        Decay rates of the driven states, which follow those of navigation [1/s].
    E : (n, n) array
        Receives the rows of the navigation states, and on the diagonal those of the driven states.
    """
    states = A.shape[0]  # not a constant: the compiler would unroll all products
    power, product = np.empty(states), np.empty(states)
    for b in range(decay.size):
        E[NAV + b, NAV + b] = decay_factor(decay[b], elapsed) - 1
    for r in range(NAV):
        for c in range(states):
            power[c] = A[r, c]
            E[r, c] = A[r, c]
        factor = 1.0
        for order in range(2, 4):
            # 1/2!, then 1/3!
            factor /= order
            for c in range(states):
                product[c] = 0.0
            for m in range(NAV):
                if power[m] != 0:  # F is sparse
                    for c in range(states):
                        product[c] += power[m] * A[m, c]
            # The rows of A below are diagonal: the driven states only decay.
            for b in range(decay.size):
                product[NAV + b] -= power[NAV + b] * decay[b] * elapsed
            for c in range(states):
                power[c] = product[c]
                E[r, c] += factor * power[c]


def build_kept_part(model: ErrorModel) -> Written:
    """Return the kernel `kept_part` of a model. A tuple stays in registers; many factors need the room."""
    count = layout(model.blocks).DRIVEN
    if count > IN_REGISTERS:
        body = f"for b in range({count}):\n        room[b] = 1 - dt * decay[b]\n    return room"
    else:
        body = f"return ({', '.join(f'1 - dt * decay[{b}]' for b in range(count))},)"
    return Written("kept_part", f"@inline_kernel\ndef kept_part(decay, dt, room):\n    {body}")


@embedded_kernel
def predict(run: Filter, dt: float, fix_due: bool, stride: int) -> None:
    """Propagate [P | x] over the sample with F to first order, then add the noise."""
    state, w, noise, kept = run.state, run.w, run.noise, kept_part(run.decay, dt, run.x)
    propagate(run.F, dt, kept, w)
    # Corrections already fed back decay like those still in x.
    for b in range(DRIVEN):
        state[PLACES[b]] *= kept[b]
    add_noise(w, state, noise, dt)


@embedded_kernel
def predict_over_sums(run: Filter, dt: float, fix_due: bool, stride: int) -> None:
    """Add the step to the sum of F dt; when due, propagate [P | x] over the whole sum.

    Half of the noise is added before and half after, which is accurate to second order in time.
    """
    state, w, F, F_sum, F_step = run.state, run.w, run.F, run.F_sum, run.F_step
    counts, clock, noise, decay = run.counts, run.clock, run.noise, run.decay
    due = fix_due or counts[1] + 1 >= stride
    counts[1] += 1
    clock[1] += dt
    for i in range(NAV):
        for j in range(STATES):
            F_sum[i, j] += dt * F[i, j]
    if due:
        elapsed = clock[1]
        second_order(F_sum, elapsed, decay, F_step)
        add_noise(w, state, noise, 0.5 * elapsed)
        propagate_over(F_step, w)
        add_noise(w, state, noise, 0.5 * elapsed)
        for b in range(DRIVEN):
            state[PLACES[b]] *= 1 + F_step[NAV + b, NAV + b]
        F_sum[:] = 0.0
        counts[1] = 0
        clock[1] = 0.0
