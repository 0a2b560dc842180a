"""Driver: strapdown and filter over IMU increments and GPS fixes, compiled once for each error model.

`driver` gives the one compiled loop: a batch run hands it a whole flight, a live run hands it one sample at a
time. The loop is written with the kernels of `phi`; for another model, its own stand in their place, and are
compiled when that model is first used; likewise those of the wander-azimuth mechanization. What is written
for 15 states is compiled anew for 21.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14;
A. Barrau, S. Bonnabel, *The invariant extended Kalman filter as a stable observer*, IEEE Trans. AC 62 (2017).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.navigation import strapdown, wander
from lab.navigation.compilation import (
    SOURCES,
    embedded_kernel,
    entry_kernel,
    inline_kernel,
    kernel,
    named,
    rebound,
    rebound_throughout,
)
from lab.navigation.error_models import PHI, WANDER_AZIMUTH, ErrorModel
from lab.navigation.filter import Filter
from lab.navigation.kalman import (
    EVERY,
    MEASUREMENTS,
    RECOVERED,
    REJECTED,
    normalised_square,
    plausibility,
    predict_fix,
    scalar_update,
    update,
    weight,
)
from lab.navigation.lever_arm import see_antenna
from lab.navigation.propagation import (
    BIASES,
    NAV,
    STATES,
    WIDTH,
    X,
    compile_projection,
    compile_propagation,
    layout,
)
from lab.navigation.schedule import SLACK, Schedule
from lab.navigation.solution import Fixes, Imu, Solution
from lab.navigation.standstill import GATE, gather_rest, hold_attitude, see_rest
from lab.navigation.strapdown import (
    GYRO_BIAS,
    GYRO_SCALE,
    LATITUDE,
    PREVIOUS_VELOCITY,
    VELOCITY,
    Matrix,
    Vector,
    get,
    put,
)

FloatArray = NDArray[np.float64]
Kernel = Callable[..., Any]
Advance = Callable[[Filter, Imu, Fixes, Solution, int, Schedule], int]


@inline_kernel
def _add_noise(w: FloatArray, state: FloatArray, noise: FloatArray, dt: float) -> None:
    """Add the process noise of one step to P; white noise enters through C_nb."""
    for block in range(2):
        at = 6 - 3 * block  # gyro noise drives the attitude, accelerometer noise the velocity
        q0, q1, q2 = dt * noise[3 * block], dt * noise[3 * block + 1], dt * noise[3 * block + 2]
        for i in range(3):
            a, b, c = get(state, strapdown.C_NB + 3 * i)
            for j in range(i, 3):
                d, e, f = get(state, strapdown.C_NB + 3 * j)
                q = a * d * q0 + b * e * q1 + c * f * q2
                w[WIDTH * (at + i) + at + j] += q
                if j > i:
                    w[WIDTH * (at + j) + at + i] += q
    for b in range(BIASES):
        w[(WIDTH + 1) * (NAV + b)] += dt * noise[6 + b]


@inline_kernel
def _add_noise_in_body(w: FloatArray, state: FloatArray, noise: FloatArray, dt: float) -> None:
    """Add the process noise of one step to P where velocity and attitude errors are resolved in b."""
    for i in range(3):
        w[(WIDTH + 1) * (6 + i)] += dt * noise[i]
        w[(WIDTH + 1) * (3 + i)] += dt * noise[3 + i]
    for b in range(BIASES):
        w[(WIDTH + 1) * (NAV + b)] += dt * noise[6 + b]


@kernel
def second_order(A: FloatArray, elapsed: float, bias_decay: FloatArray, E: FloatArray) -> None:
    """Write E = A + A²/2 + A³/6, so that exp(A) = I + E, for the sum A of F dt over many samples.

    Parameters
    ----------
    A : (n, n) array
        Sum of F dt: the rows of the navigation states; those of the biases are their decay.
    elapsed
        Time the sum is over [s].
    bias_decay : (6,) array
        Decay rates of the biases [1/s].
    E : (n, n) array
        Receives the rows of the navigation states.
    """
    states = A.shape[0]  # no constant: the compiler would write all products out
    power, product = np.empty(states), np.empty(states)
    for r in range(NAV):
        for c in range(states):
            power[c] = A[r, c]
            E[r, c] = A[r, c]
        factor = 1.0
        for order in range(2, 4):
            factor /= order
            for c in range(states):
                product[c] = 0.0
            for m in range(NAV):
                for c in range(states):
                    product[c] += power[m] * A[m, c]
            for b in range(BIASES):
                product[NAV + b] -= power[NAV + b] * bias_decay[b] * elapsed
            for c in range(states):
                power[c] = product[c]
                E[r, c] += factor * power[c]


@inline_kernel
def faded(rate: float, elapsed: float) -> float:
    """Return exp(−rate · elapsed) to third order, as `second_order` has it."""
    x = rate * elapsed
    return 1 - x * (1 - x / 2 * (1 - x / 3))


def _prediction(model: ErrorModel, *, summed: bool) -> Kernel:
    """Return the kernel that propagates [P | x] of a model, at each sample or with sums of F dt."""
    propagate = compile_propagation(model, summed=summed)
    label = f"{model.label} {summed}"
    add_noise = _add_noise_in_body if model.in_body else _add_noise

    @embedded_kernel
    @named(label)
    def predict(run: Filter, dt: float, fix_due: bool, stride: int) -> None:
        """Propagate [P | x] over the sample, with F to first order, and the noise after it."""
        decay = (
            1 - dt * run.bias_decay[0],
            1 - dt * run.bias_decay[1],
            1 - dt * run.bias_decay[2],
            1 - dt * run.bias_decay[3],
            1 - dt * run.bias_decay[4],
            1 - dt * run.bias_decay[5],
        )
        propagate(run.F, dt, decay, run.w)
        # What has been fed back decays as what is still in x.
        for b in range(BIASES):
            run.state[GYRO_BIAS + b] *= decay[b]
        add_noise(run.w, run.state, run.noise, dt)

    @embedded_kernel
    @named(label)
    def predict_summed(run: Filter, dt: float, fix_due: bool, stride: int) -> None:
        """Add the step to the sum of F dt; when due, propagate [P | x] over all steps since it last was.

        The noise enters half before and half after, which is of second order in the time.
        """
        due = fix_due or run.counts[1] + 1 >= stride
        run.counts[1] += 1
        run.clock[1] += dt
        for i in range(NAV):
            for j in range(STATES):
                run.F_sum[i, j] += dt * run.F[i, j]
        if due:
            elapsed = run.clock[1]
            second_order(run.F_sum, elapsed, run.bias_decay, run.F_step)
            decay = (
                faded(run.bias_decay[0], elapsed),
                faded(run.bias_decay[1], elapsed),
                faded(run.bias_decay[2], elapsed),
                faded(run.bias_decay[3], elapsed),
                faded(run.bias_decay[4], elapsed),
                faded(run.bias_decay[5], elapsed),
            )
            add_noise(run.w, run.state, run.noise, 0.5 * elapsed)
            propagate(run.F_step, 1.0, decay, run.w)
            add_noise(run.w, run.state, run.noise, 0.5 * elapsed)
            for b in range(BIASES):
                run.state[GYRO_BIAS + b] *= decay[b]
            run.F_sum[:] = 0.0
            run.counts[1] = 0
            run.clock[1] = 0.0

    return predict_summed if summed else predict


@kernel
def _correct(state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Take the estimated error out of the navigator, and set the estimate to zero."""
    x, y, z = w[X], w[WIDTH + X], w[2 * WIDTH + X]
    latitude = state[LATITUDE] - x * state[strapdown.MERIDIAN]
    longitude = state[strapdown.LONGITUDE] - y * state[strapdown.TRANSVERSE] / state[strapdown.COSINE]
    strapdown.set_position(state, latitude, longitude, state[strapdown.HEIGHT] + z)
    for i in range(3):
        state[VELOCITY + i] -= w[WIDTH * (3 + i) + X]
        # A second fix before the next sample interpolates between this one and the one before.
        state[PREVIOUS_VELOCITY + i] -= w[WIDTH * (3 + i) + X]
    for i in range(NAV, STATES):
        state[GYRO_BIAS - NAV + i] -= w[WIDTH * i + X]
    attitude = strapdown.rotation((w[WIDTH * 6 + X], w[WIDTH * 7 + X], w[WIDTH * 8 + X]))
    at = strapdown.Q_NB
    q = strapdown.product(attitude, (state[at], state[at + 1], state[at + 2], state[at + 3]))
    put(state, at, (q[0], q[1], q[2]))
    state[at + 3] = q[3]
    for i in range(STATES):
        w[WIDTH * i + X] = 0.0


@kernel
def _correct_in_wander(state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Take the estimated error out of a navigator in a wander frame, and set the estimate to zero."""
    x = np.empty(STATES)
    for i in range(STATES):
        x[i] = w[WIDTH * i + X]
        w[WIDTH * i + X] = 0.0
    wander.displace(state, x)


@inline_kernel
def _bend(psi: Vector, v: Vector) -> Vector:
    """Return J v with J the left Jacobian of the rotation ψ, the exponential's of SE₂(3)."""
    square = psi[0] * psi[0] + psi[1] * psi[1] + psi[2] * psi[2]
    if square < 1e-4:
        a, b = 1 / 2 - square / 24, 1 / 6 - square / 120
    else:
        angle = math.sqrt(square)
        a, b = (1 - math.cos(angle)) / square, (angle - math.sin(angle)) / (square * angle)
    once = strapdown.cross(psi, v)
    return strapdown.plus(strapdown.plus(v, a, once), b, strapdown.cross(psi, once))


@kernel
def bend_estimate(x: FloatArray) -> None:
    """Apply the group's Jacobian to the position and velocity of an error estimate, x ≥ (9,), in place."""
    psi = get(x, 6)
    put(x, 0, _bend(psi, get(x, 0)))
    put(x, 3, _bend(psi, get(x, 3)))


@kernel
def _difference(
    state: FloatArray, age: float, fraction: float, position: FloatArray, velocity: FloatArray, z: FloatArray
) -> None:
    """Write navigator minus fix, the navigator interpolated to `age` seconds (`fraction` of a step) ago."""
    v = get(state, VELOCITY)
    before = get(state, strapdown.PREVIOUS_VELOCITY)
    mean = (0.5 * (v[0] + before[0]), 0.5 * (v[1] + before[1]), 0.5 * (v[2] + before[2]))
    east = state[strapdown.LONGITUDE] - position[1]
    east -= 2 * math.pi * math.floor(east / (2 * math.pi) + 0.5)
    z[0] = (state[LATITUDE] - position[0]) / state[strapdown.MERIDIAN] - age * mean[0]
    z[1] = east * state[strapdown.COSINE] / state[strapdown.TRANSVERSE] - age * mean[1]
    z[2] = position[2] - state[strapdown.HEIGHT] - age * mean[2]
    for i in range(3):
        z[3 + i] = v[i] - fraction * (v[i] - before[i]) - velocity[i]


@inline_kernel
def _fix_axes(state: FloatArray) -> Matrix:
    """Return north, east and down of the last fix in the navigation frame: its own axes, north-slaved."""
    return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@inline_kernel
def _through_map(state: FloatArray, T: FloatArray, H: FloatArray) -> None:
    """Turn H of the errors into H of the model's own: the same, of `phi`."""


@embedded_kernel
def _sight(run: Filter, m: int, age: float, z: FloatArray, out: Solution) -> None:
    """Write H and R of fix m, `age` seconds old, and move z from the IMU to the antenna."""
    H, R = run.H, run.R_fix
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            R[i, j] = run.R[min(m, run.R.shape[0] - 1), i, j]
        for j in range(STATES):
            H[i, j] = 1.0 if i == j else 0.0
    turn = run.turns[min(m, run.turns.shape[0] - 1)]
    see_antenna(run.state, run.lever_arm, turn, age, run.noise, _fix_axes(run.state), z, H, R)
    for i in range(MEASUREMENTS):
        for j in range(STATES):
            out.fix_H[m, i, j] = H[i, j]


@embedded_kernel
def _observe(
    run: Filter, m: int, age: float, time: float, schedule: Schedule, z: FloatArray, out: Solution
) -> int:
    """Update [P | x] with fix m, `age` seconds before the sample at `time`; say what became of it.

    z is navigator minus fix, the antenna taken for the IMU.
    """
    _sight(run, m, age, z, out)
    H, R, nu, S = run.H, run.R_fix, out.innovation[m], out.innovation_covariance[m]
    _through_map(run.state, run.T, H)
    for i in range(MEASUREMENTS):
        nu[i] = z[i]
        for j in range(STATES):
            nu[i] -= H[i, j] * run.w[WIDTH * j + X]
    predict_fix(run.P, H, R, S)
    nis = normalised_square(nu, S)
    became = plausibility(run.P, run.streak, run.clock, nu, S, nis, time, schedule, STATES)
    if became == REJECTED:
        return REJECTED
    if schedule.robust != EVERY:
        if became == RECOVERED:
            raised = np.empty((MEASUREMENTS, MEASUREMENTS))
            predict_fix(run.P, H, R, raised)
            nis = normalised_square(nu, raised)
        per_weight = 1 / weight(schedule.robust, nis)
        for i in range(MEASUREMENTS):
            for j in range(MEASUREMENTS):
                R[i, j] *= per_weight
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            out.fix_R[m, i, j] = R[i, j]
    update(run.w, z, H, R, run.scalars[min(m, run.scalars.shape[0] - 1)])
    return became


@inline_kernel
def _frame_rate(state: FloatArray) -> Vector:
    """Return the Earth's rate in the navigation frame."""
    sine = state[strapdown.SINE]
    return strapdown.earth_rate(sine, math.sqrt(1 - sine * sine))


@inline_kernel
def _own_attitude(state: FloatArray, seen: Vector) -> Vector:
    """Return how the model's own attitude error is seen where that of the navigation frame is seen so."""
    return seen


@inline_kernel
def _own_attitude_in_body(state: FloatArray, seen: Vector) -> Vector:
    """Return how an attitude error in b is seen where that of the navigation frame is seen so."""
    at = strapdown.Q_NB
    C = strapdown.matrix((state[at], state[at + 1], state[at + 2], state[at + 3]))
    return (
        C[0][0] * seen[0] + C[1][0] * seen[1] + C[2][0] * seen[2],
        C[0][1] * seen[0] + C[1][1] * seen[1] + C[2][1] * seen[2],
        C[0][2] * seen[0] + C[1][2] * seen[1] + C[2][2] * seen[2],
    )


@embedded_kernel
def _observe_rest(run: Filter) -> bool:
    """Update [P | x] with the mean rate about the vertical at rest, unless the vehicle turns; say whether."""
    H = np.empty(6)
    z = see_rest(run.state, _frame_rate(run.state), run.noise, run.rest_sums, H)
    done = run.rest_scalars[0]
    for c in range(STATES):
        done[c] = 0.0
    seen = _own_attitude(run.state, (H[0], H[1], H[2]))
    for i in range(3):
        done[6 + i] = seen[i]
        done[NAV + i] = H[3 + i]
    residual, s = z, 1.0
    for i in range(6, NAV + 3):
        residual -= done[i] * run.w[WIDTH * i + X]
        for j in range(6, NAV + 3):
            s += done[i] * done[j] * run.w[WIDTH * i + j]
    if residual * residual > GATE * s:
        return False
    scalar_update(run.w, z, done)
    return True


@inline_kernel
def _store_state(out: Solution, k: int, state: FloatArray) -> None:
    """Write position, velocity, attitude, biases and scale factors of sample k."""
    for i in range(3):
        out.position[k, i] = state[LATITUDE + i]
        out.velocity_n[k, i] = state[VELOCITY + i]
    for i in range(4):
        out.q_nb[k, i] = state[strapdown.Q_NB + i]
    for i in range(BIASES):
        out.bias[k, i] = state[GYRO_BIAS + i]
    for i in range(STATES - NAV - BIASES):
        out.scale[k, i] = state[GYRO_SCALE + i]


@inline_kernel
def _store(out: Solution, k: int, state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Write sample k of the solution."""
    _store_state(out, k, state)
    for i in range(STATES):
        out.variance[k, i] = w[(WIDTH + 1) * i]
    for block in range(2):
        at = (WIDTH + 1) * 6 * block
        out.covariance[k, block, 0] = w[at + 1]
        out.covariance[k, block, 1] = w[at + 2]
        out.covariance[k, block, 2] = w[at + WIDTH + 2]


@kernel
def _store_fix(out: Solution, m: int, state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Write the covariance after fix m."""
    for i in range(STATES):
        for j in range(STATES):
            out.fix_covariance[m, i, j] = w[WIDTH * i + j]


def _mapped(model: ErrorModel) -> dict[str, Kernel]:
    """Return the kernels of a model with coordinates of its own, which do all that leaves the filter by T."""
    write_map, project, in_body = model.write_map, compile_projection(model), model.in_body
    assert write_map is not None
    write_fix_map, write_frame_map = model.write_fix_map or write_map, model.write_frame_map or write_map
    in_wander = model.mechanization == WANDER_AZIMUTH
    correct_state = _correct_in_wander if in_wander else _correct
    store_state = wander.store_state if in_wander else _store_state

    @kernel
    @named(model.label)
    def through_map(state: FloatArray, T: FloatArray, H: FloatArray) -> None:
        write_fix_map(state, T)
        row = np.empty(NAV)
        for i in range(MEASUREMENTS):
            for c in range(NAV):
                row[c] = H[i, c]
            for c in range(NAV):
                H[i, c] = 0.0
                for d in range(NAV):
                    H[i, c] += row[d] * T[d, c]

    def correction(*, bent: bool) -> Kernel:
        @kernel
        @named(f"{model.label} {bent}")
        def correct(state: FloatArray, w: FloatArray, T: FloatArray) -> None:
            write_frame_map(state, T)
            x = np.empty(NAV)
            for c in range(NAV):
                x[c] = w[WIDTH * c + X]
            if bent:
                bend_estimate(x)
            for r in range(NAV):
                w[WIDTH * r + X] = 0.0
                for c in range(NAV):
                    w[WIDTH * r + X] += T[r, c] * x[c]
            correct_state(state, w, T)

        return correct

    @inline_kernel
    @named(model.label)
    def store(out: Solution, k: int, state: FloatArray, w: FloatArray, T: FloatArray) -> None:
        store_state(out, k, state)
        write_map(state, T)
        project(T, w, k, out.variance, out.covariance)

    @kernel
    @named(model.label)
    def store_fix(out: Solution, m: int, state: FloatArray, w: FloatArray, T: FloatArray) -> None:
        write_map(state, T)
        P = out.fix_covariance[m]
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

    correct = correction(bent=in_body)
    # An estimate that waits is as linear as the fixes that made it: bent, it would leave them, far off.
    corrected = _estimation(correction(bent=False) if in_body else correct, model)
    return {
        "_through_map": through_map,
        "_correct": correct,
        "_corrected": corrected,
        "_store": store,
        "_store_fix": store_fix,
    }


@kernel
def _has_estimate(w: FloatArray) -> bool:
    """Say whether an estimated error waits to be corrected."""
    estimate = False
    for i in range(STATES):
        estimate |= w[WIDTH * i + X] != 0
    return estimate


def _estimation(correct: Kernel, model: ErrorModel) -> Kernel:
    """Return the kernel that says what a navigator would be with its estimated error taken out."""

    @kernel
    @named(model.label)
    def corrected(
        state: FloatArray, w: FloatArray, T: FloatArray, x: FloatArray, spare: FloatArray
    ) -> FloatArray:
        """Write the corrected state into `spare`, leaving the navigator as it is."""
        for i in range(state.size):  # a slice would compile its error messages too: a second
            spare[i] = state[i]
        for i in range(STATES):
            x[i] = w[WIDTH * i + X]
        correct(spare, w, T)
        for i in range(STATES):
            w[WIDTH * i + X] = x[i]
        return spare

    return corrected


@inline_kernel
def _lost(state: FloatArray) -> bool:
    """Say whether the navigator came too close to a pole for its frame."""
    return bool(abs(state[LATITUDE]) > strapdown.MAX_LATITUDE)


# The kernels of `phi` at each sample, in whose place those of other models stand.
_step = strapdown.step
_write = PHI.write
_predict = _prediction(PHI, summed=False)
_corrected = _estimation(_correct, PHI)

SETTLED, PENDING = 0, 1
"""How measurements leave it: corrected, or with an estimated error that is not yet taken out."""


@kernel
def take_measurements(
    run: Filter,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    k: int,
    schedule: Schedule,
    z: FloatArray,
    x: FloatArray,
    spare: FloatArray,
    pending: bool,
) -> int:
    """Let a navigator take what is due at sample k; say how it is left.

    Where nothing is due a loop over samples leaves it out: with so many arrays a call costs half a sample.
    """
    state, w, T = run.state, run.w, run.T
    time = imu.time[k + 1]
    dt = time - imu.time[k]
    m = run.counts[0]
    fix_due = m < fixes.time.size and fixes.time[m] <= time + SLACK * dt
    rests = imu.rest.size > 0 and imu.rest[k]
    if rests and gather_rest(state, run.rest_sums, dt) and _observe_rest(run):
        out.rest[k + 1] = True
        pending = True
        if schedule.feedback and time - run.clock[0] >= schedule.correction_period - SLACK * dt:
            _correct(state, w, T)
            run.clock[0] = time
            pending = False
    while fix_due:
        age = time - fixes.time[m]
        if age <= dt * (1 + SLACK):
            _difference(state, age, age / dt, fixes.position[m], fixes.velocity_n[m], z)
            became = _observe(run, m, age, time, schedule, z, out)
            if became == REJECTED:
                out.fix_rejected[m] = True
            else:
                out.fix_sample[m] = k + 1
                out.fix_recovered[m] = became == RECOVERED
                pending = True
                if schedule.feedback and time - run.clock[0] >= schedule.correction_period - SLACK * dt:
                    _correct(state, w, T)
                    run.clock[0] = time
                    pending = False
                if pending:
                    _store_fix(out, m, _corrected(state, w, T, x, spare), w, T)
                else:
                    _store_fix(out, m, state, w, T)
        m += 1
        run.counts[0] = m
        fix_due = m < fixes.time.size and fixes.time[m] <= time + SLACK * dt
    return PENDING if pending else SETTLED


def kernels(model: ErrorModel, *, summed: bool) -> dict[str, Kernel]:
    """Return the kernels that differ from those of `phi` at each sample, by their names here."""
    if model is PHI and not summed:
        return {}
    others: dict[str, Kernel] = {"_write": model.write, "_predict": _prediction(model, summed=summed)}
    if model.mechanization == WANDER_AZIMUTH:
        others |= {
            "_step": wander.step,
            "_lost": wander.lost,
            "_difference": wander.difference,
            "_fix_axes": wander.fix_axes,
            "_frame_rate": wander.frame_rate,
        }
    if model.in_body:
        others["_own_attitude"] = _own_attitude_in_body
    if model.write_map:
        others |= _mapped(model)
    return others


def compiled_for(function: Kernel, model: ErrorModel, *, summed: bool) -> Kernel:
    """Return a loop over samples, written with the kernels of `phi`, compiled for another model.

    Parameters
    ----------
    function
        The loop: it calls kernels by their names here, such as `take_measurements`.
    model
        The error model.
    summed
        For propagating P less often than at every sample.
    """
    others = kernels(model, summed=summed)
    if others:
        others["_observe_rest"] = embedded_kernel(rebound(_observe_rest, **others))
        others["_sight"] = embedded_kernel(rebound(_sight, **others))
        others["_observe"] = embedded_kernel(rebound(_observe, **others))
        others["take_measurements"] = kernel(rebound(take_measurements, **others))
    own = rebound(function, **others)
    return entry_kernel(rebound_throughout(own, **layout(model.states)._asdict()))


@functools.cache
def driver(model: ErrorModel, *, summed: bool) -> Advance:
    """Return the driver of a model, which is compiled, or loaded from the disk, when first called.

    Parameters
    ----------
    model
        The error model.
    summed
        For propagating P less often than at every sample.
    """
    identity = SOURCES, model.name, model.mechanization, model.states, summed

    def advance(run: Filter, imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule) -> int:
        """Advance a navigator over the samples of `imu` from number `first` on; return where it stopped.

        It stops early, at the number of samples written, if it comes too close to a pole.
        """
        _ = identity
        state, w, T = run.state, run.w, run.T
        z = np.empty(MEASUREMENTS)
        x = np.empty(STATES)
        spare = np.empty(state.size)
        left = PENDING if _has_estimate(w) else SETTLED
        if first == 0:
            _store(out, 0, state, w, T)
        for k in range(first, imu.dtheta.shape[0]):
            time, dt = imu.time[k + 1], imu.time[k + 1] - imu.time[k]
            _step(state, get(imu.dtheta[k], 0), get(imu.dvelocity[k], 0), dt)
            if _lost(state):
                return k + 1
            m = run.counts[0]
            fix_due = m < fixes.time.size and fixes.time[m] <= time + SLACK * dt
            if imu.rest.size > 0:
                hold_attitude(state, run.rest_sums, imu.rest[k])
            _write(state, run.F)
            _predict(run, dt, fix_due, schedule.stride)
            if fix_due or (imu.rest.size > 0 and imu.rest[k]):
                left = take_measurements(run, imu, fixes, out, k, schedule, z, x, spare, left == PENDING)
            if left == PENDING:
                _store(out, k + 1, _corrected(state, w, T, x, spare), w, T)
            else:
                _store(out, k + 1, state, w, T)
        return imu.time.size

    return compiled_for(advance, model, summed=summed)
