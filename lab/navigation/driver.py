"""Driver: strapdown and filter over IMU increments and GPS fixes, compiled once for each error model.

`driver` gives the one compiled loop: a batch run passes a whole flight, a live run passes one sample at a
time. The loop is written with the kernels of `phi`. For another model or the wander-azimuth mechanization,
their kernels replace these, and are compiled at their first use. The code for 15 states is compiled again for
other states (`blocks`).

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14;
A. Barrau, S. Bonnabel, *The invariant extended Kalman filter as a stable observer*, IEEE Trans. AC 62 (2017).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
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
from lab.navigation.kalman import MEASUREMENTS, RECOVERED, REJECTED
from lab.navigation.observation import (
    bent_speed,
    difference,
    observe,
    observe_aid,
    observe_rest,
    own_attitude_in_body,
    sight,
)
from lab.navigation.own_states import without_errors_of
from lab.navigation.prediction import prediction
from lab.navigation.propagation import (
    BIASES,
    NAV,
    PLACES,
    SCALES,
    STATES,
    WIDTH,
    WRITTEN_FOR,
    X,
    compile_projection,
    layout,
)
from lab.navigation.schedule import SLACK, Schedule
from lab.navigation.solution import Fixes, Imu, Solution
from lab.navigation.standstill import HELD, gather_rest, hold_attitude
from lab.navigation.strapdown import (
    GYRO_BIAS,
    GYRO_SCALE,
    LATITUDE,
    PREVIOUS_VELOCITY,
    VELOCITY,
    Vector,
    get,
    put,
)

FloatArray = NDArray[np.float64]
Kernel = Callable[..., Any]
Advance = Callable[[Filter, Imu, Fixes, Solution, int, Schedule], int]

SMALL = 1e-4
"""Square of an angle below which a series stands for sine and cosine [rad²]: it leaves out 1e-11."""


@kernel
def _correct(state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Correct the navigator by the estimated error, and set the estimate to zero."""
    x, y, z = w[X], w[WIDTH + X], w[2 * WIDTH + X]
    latitude = state[LATITUDE] - x * state[strapdown.MERIDIAN]
    longitude = state[strapdown.LONGITUDE] - y * state[strapdown.TRANSVERSE] / state[strapdown.COSINE]
    strapdown.set_position(state, latitude, longitude, state[strapdown.HEIGHT] + z)
    for i in range(3):
        state[VELOCITY + i] -= w[WIDTH * (3 + i) + X]
        # A second fix before the next sample interpolates between this one and the one before.
        state[PREVIOUS_VELOCITY + i] -= w[WIDTH * (3 + i) + X]
    for i in range(NAV, STATES):
        state[PLACES[i - NAV]] -= w[WIDTH * i + X]
    attitude = strapdown.rotation((w[WIDTH * 6 + X], w[WIDTH * 7 + X], w[WIDTH * 8 + X]))
    at = strapdown.Q_NB
    q = strapdown.product(attitude, (state[at], state[at + 1], state[at + 2], state[at + 3]))
    put(state, at, (q[0], q[1], q[2]))
    state[at + 3] = q[3]
    for i in range(STATES):
        w[WIDTH * i + X] = 0.0


@kernel
def _correct_in_wander(state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Correct a navigator in a wander frame by the estimated error, and set the estimate to zero."""
    x = np.empty(STATES)
    for i in range(STATES):
        x[i] = w[WIDTH * i + X]
        w[WIDTH * i + X] = 0.0
    wander.displace(state, x)
    for i in range(NAV, STATES):
        state[PLACES[i - NAV]] -= x[i]


@inline_kernel
def _bend(psi: Vector, v: Vector) -> Vector:
    """Return J v with J the left Jacobian of the rotation ψ, as in the exponential of SE₂(3)."""
    square = psi[0] * psi[0] + psi[1] * psi[1] + psi[2] * psi[2]
    if square < SMALL:
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


@inline_kernel
def _store_state(out: Solution, k: int, state: FloatArray) -> None:
    """Write position, velocity and attitude of sample k."""
    for i in range(3):
        out.position[k, i] = state[LATITUDE + i]
        out.velocity_n[k, i] = state[VELOCITY + i]
    for i in range(4):
        out.q_nb[k, i] = state[strapdown.Q_NB + i]


@inline_kernel
def _store_sensor_errors(out: Solution, k: int, state: FloatArray) -> None:
    """Write biases, scale factors and further estimates of sample k."""
    for i in range(BIASES):
        out.bias[k, i] = state[GYRO_BIAS + i]
    for i in range(SCALES):
        out.scale[k, i] = state[GYRO_SCALE + i]
    for i in range(STATES - NAV - BIASES - SCALES):
        out.further[k, i] = state[PLACES[BIASES + SCALES + i]]


@inline_kernel
def _store(out: Solution, k: int, state: FloatArray, w: FloatArray, T: FloatArray) -> None:
    """Write sample k of the solution."""
    _store_state(out, k, state)
    _store_sensor_errors(out, k, state)
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
    """Return the kernels of a model with its own coordinates, which map all output of the filter by T."""
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

    @kernel
    @named(model.label)
    def own_row(state: FloatArray, T: FloatArray, H: FloatArray) -> None:
        write_map(state, T)
        row = np.empty(NAV)
        for c in range(NAV):
            row[c] = H[c]
        for c in range(NAV):
            H[c] = 0.0
            for d in range(NAV):
                H[c] += row[d] * T[d, c]

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
        _store_sensor_errors(out, k, state)
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
    # A pending estimate is linear like the fixes that it comes from: the exponential map would move it away
    # from them if it is large.
    corrected = _estimation(correction(bent=False) if in_body else correct, model)
    return {
        "through_map": through_map,
        "own_row": own_row,
        "_correct": correct,
        "_corrected": corrected,
        "_store": store,
        "_store_fix": store_fix,
    }


@kernel
def _has_estimate(w: FloatArray) -> bool:
    """Return whether an estimated error is pending."""
    estimate = False
    for i in range(STATES):
        estimate |= w[WIDTH * i + X] != 0
    return estimate


def _estimation(correct: Kernel, model: ErrorModel) -> Kernel:
    """Return the kernel that computes the state of a navigator corrected by its estimated error."""

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
def leaves_frame(state: FloatArray) -> bool:
    """Return whether the navigator came too close to a pole for its frame."""
    return bool(abs(state[LATITUDE]) > strapdown.MAX_LATITUDE)


# The kernels of `phi` at each sample; those of other models replace them.
_step = strapdown.step
_write = PHI.write
_predict = prediction(PHI, summed=False)
_corrected = _estimation(_correct, PHI)


@inline_kernel
def aid_due(run: Filter, time: float, dt: float) -> bool:
    """Return False: without aids, no measurement of theirs is ever due."""
    return False


@inline_kernel
def take_aids(
    run: Filter, out: Solution, k: int, time: float, dt: float, schedule: Schedule, pending: bool
) -> bool:
    """Return whether an estimated error is pending: without aids, it stays so."""
    return pending


@inline_kernel
def _aid_due(run: Filter, time: float, dt: float) -> bool:
    """Return whether a measurement of the aids is due at a time."""
    a = run.counts[2]
    return bool(a < run.aids.time.size and run.aids.time[a] <= time + SLACK * dt)


@kernel
def _take_aids(
    run: Filter, out: Solution, k: int, time: float, dt: float, schedule: Schedule, pending: bool
) -> bool:
    """Apply the measurements of the aids that are due at sample k; return whether an estimate is pending."""
    while _aid_due(run, time, dt):
        a = run.counts[2]
        age = time - run.aids.time[a]
        if age <= dt * (1 + SLACK) and observe_aid(run, a, age, dt, schedule, out):
            out.aid_sample[a] = k + 1
            pending = True
            if schedule.feedback and time - run.clock[0] >= schedule.correction_period - SLACK * dt:
                _correct(run.state, run.w, run.T)
                run.clock[0] = time
                pending = False
        run.counts[2] = a + 1
    return pending


SETTLED, PENDING = 0, 1
"""State of a navigator after measurements: corrected, or with an estimated error that is still pending."""


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
    """Apply the measurements due at sample k to a navigator; return `SETTLED` or `PENDING`.

    A loop over samples skips the call if no measurement is due: with so many arrays, a call takes half the
    time of a sample.
    """
    state, w, T = run.state, run.w, run.T
    time = imu.time[k + 1]
    dt = time - imu.time[k]
    m = run.counts[0]
    fix_due = m < fixes.time.size and fixes.time[m] <= time + SLACK * dt
    rests = imu.rest.size > 0 and imu.rest[k]
    if rests and gather_rest(state, run.rest_sums, dt) and observe_rest(run):
        out.rest[k + 1] = True
        pending = True
        if schedule.feedback and time - run.clock[0] >= schedule.correction_period - SLACK * dt:
            _correct(state, w, T)
            run.clock[0] = time
            pending = False
    while fix_due:
        age = time - fixes.time[m]
        if age <= dt * (1 + SLACK):
            difference(state, age, age / dt, fixes.position[m], fixes.velocity_n[m], z)
            became = observe(run, m, age, time, schedule, z, out)
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
    return PENDING if take_aids(run, out, k, time, dt, schedule, pending) else SETTLED


@functools.cache
def kernels(model: ErrorModel, *, summed: bool, aided: bool = False) -> Mapping[str, Kernel]:
    """Return the kernels that differ from those of `phi` at each sample, by their names in this module.

    They are made once for each model: the compiler does not compile them again for a second loop.
    """
    if model is PHI and not summed and not aided:
        return {}
    others: dict[str, Kernel] = {"_write": model.write, "_predict": prediction(model, summed=summed)}
    if model.mechanization == WANDER_AZIMUTH:
        others |= {
            "_step": wander.step,
            "leaves_frame": wander.leaves_frame,
            "difference": wander.difference,
            "fix_axes": wander.fix_axes,
            "north_axes": wander.north_axes,
            "frame_rate": wander.frame_rate,
        }
    if model.in_body:
        others["own_attitude"] = own_attitude_in_body
    if model.write_map:
        others |= _mapped(model)
    others["observe_rest"] = embedded_kernel(rebound(observe_rest, **others))
    others["sight"] = embedded_kernel(rebound(sight, **others))
    others["observe"] = embedded_kernel(rebound(observe, **others))
    if aided:
        others["bent_speed"] = kernel(rebound(bent_speed, **others))
        others["observe_aid"] = kernel(rebound(observe_aid, **others))
        others["aid_due"], others["take_aids"] = _aid_due, kernel(rebound(_take_aids, **others))
    others["take_measurements"] = kernel(rebound(take_measurements, **others))
    return others


def compiled_for(function: Kernel, model: ErrorModel, *, summed: bool, aided: bool = False) -> Kernel:
    """Return a loop over samples, written with the kernels of `phi`, compiled for another model.

    Parameters
    ----------
    function
        The loop; it calls kernels by their names in this module, such as `take_measurements`.
    model
        The error model.
    summed
        For propagating P less often than at every sample.
    aided
        For measurements other than fixes.
    """
    own = rebound(function, **kernels(model, summed=summed, aided=aided))
    written_for, values = dict(WRITTEN_FOR), layout(model.blocks)._asdict()
    stepping = without_errors_of(model.blocks)
    if stepping is not None:
        written_for["without_own_errors"] = strapdown.without_own_errors
        values["without_own_errors"] = stepping
    # Functions of a notebook may change, also those that they call, so nothing with them is kept on the disk.
    return entry_kernel(rebound_throughout(own, written_for, **values), kept=stepping is None)


def driver(model: ErrorModel, *, summed: bool, aided: bool = False) -> Advance:
    """Return the driver of a model, which is compiled, or loaded from the disk, when first called.

    Parameters
    ----------
    model
        The error model.
    summed
        For propagating P less often than at every sample.
    aided
        For measurements other than fixes.
    """
    return _driver(model, summed, aided)


@functools.cache
def _driver(model: ErrorModel, summed: bool, aided: bool) -> Advance:
    identity = SOURCES, model.name, model.mechanization, model.blocks, summed, aided

    def advance(run: Filter, imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule) -> int:
        """Advance a navigator over `imu` from increment `first` on; return the increment where it stopped.

        It stops early, between two samples, where it must go on in another frame (`frames`).
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
            # Sums over samples, and what is held at rest, are of the frame in which they began.
            if leaves_frame(state) and run.counts[1] == 0 and run.rest_sums[HELD] == 0:
                return k
            time, dt = imu.time[k + 1], imu.time[k + 1] - imu.time[k]
            _step(state, get(imu.dtheta[k], 0), get(imu.dvelocity[k], 0), dt)
            m = run.counts[0]
            due = m < fixes.time.size and fixes.time[m] <= time + SLACK * dt
            due |= aid_due(run, time, dt)
            if imu.rest.size > 0:
                hold_attitude(state, run.rest_sums, imu.rest[k])
            _write(state, run.F)
            _predict(run, dt, due, schedule.stride)
            if due or (imu.rest.size > 0 and imu.rest[k]):
                left = take_measurements(run, imu, fixes, out, k, schedule, z, x, spare, left == PENDING)
            if left == PENDING:
                _store(out, k + 1, _corrected(state, w, T, x, spare), w, T)
            else:
                _store(out, k + 1, state, w, T)
        return imu.time.size - 1

    return compiled_for(advance, model, summed=summed, aided=aided)
