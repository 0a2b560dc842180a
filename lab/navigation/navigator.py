"""Navigator: strapdown and error-state Kalman filter run together over IMU increments and GPS fixes.

`advance` is the one compiled driver: a batch run hands it a whole flight, a live run hands it one sample at
a time.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.navigation import strapdown
from lab.navigation.compilation import SOURCES, entry_kernel, inline_kernel, interpreted, kernel
from lab.navigation.error_models import PHI
from lab.navigation.kalman import MEASUREMENTS, update
from lab.navigation.propagation import BIASES, NAV, STATES, WIDTH, WORKSPACE, X, compile_propagation
from lab.navigation.solution import EVERY_FIX, Belief, Fixes, Imu, Schedule, Solution, Start
from lab.navigation.strapdown import ACCEL_BIAS, GYRO_BIAS, LATITUDE, PREVIOUS_VELOCITY, VELOCITY, get, put

FloatArray = NDArray[np.float64]


class PolarError(ValueError):
    """The flight comes closer to a pole than a north-slaved navigation frame allows."""


class Filter(NamedTuple):
    """A navigator between two samples: the strapdown's state, the filter's workspace, and what both need."""

    state: FloatArray
    w: FloatArray
    F: FloatArray
    F_sum: FloatArray  # of F dt since P was last propagated
    counts: NDArray[np.int64]  # next fix; samples since P was last propagated
    clock: FloatArray  # time of the last feedback correction; seconds since P was last propagated
    R: FloatArray
    R_root: FloatArray
    noise: FloatArray
    bias_decay: FloatArray

    @classmethod
    def begin(cls, start: Start, belief: Belief, time: float) -> Filter:
        """Return a navigator that starts at a time [s]."""
        state = np.zeros(strapdown.LENGTH)
        interpreted(strapdown.set_position)(state, *start.position)
        state[VELOCITY : VELOCITY + 3] = start.velocity_n
        state[strapdown.Q_NB : strapdown.Q_NB + 4] = start.q_nb
        w = _aligned_zeros(WORKSPACE)
        w[: STATES * WIDTH].reshape(STATES, WIDTH)[:, :STATES] = belief.P0
        R = np.ascontiguousarray(belief.R)
        return cls(
            state,
            w,
            np.zeros((STATES, STATES)),
            np.zeros((STATES, STATES)),
            np.zeros(2, dtype=np.int64),
            np.array([time, 0.0]),
            R,
            np.asarray(np.linalg.cholesky(R), dtype=np.float64),
            np.ascontiguousarray(belief.noise),
            np.ascontiguousarray(belief.bias_decay),
        )


def _aligned_zeros(size: int) -> FloatArray:
    """Return zeros on a 64-byte boundary; vector loads that cross cache lines cost a tenth of a run."""
    buffer = np.zeros(size + 8)
    offset = (-buffer.ctypes.data // 8) % 8
    return buffer[offset : offset + size]


def navigate(
    imu: Imu, fixes: Fixes, start: Start, belief: Belief, schedule: Schedule = EVERY_FIX
) -> Solution:
    """Navigate a whole flight with the compiled filter.

    Parameters
    ----------
    imu, fixes
        The measurements.
    start
        Initial position, velocity and attitude; initial biases are zero.
    belief
        What the filter assumes.
    schedule
        When it propagates its covariance and corrects.

    Raises
    ------
    PolarError
        If the navigator comes closer than 0.1° to a pole.
    """
    solution = Solution.empty(imu.time.size, fixes.time.size)
    if abs(start.position[0]) > strapdown.MAX_LATITUDE:
        raise PolarError(_POLAR.format(time=imu.time[0]))
    run = Filter.begin(start, belief, imu.time[0])
    stopped = advance(run, imu, fixes, solution, 0, schedule)
    if stopped < imu.time.size:
        raise PolarError(_POLAR.format(time=imu.time[stopped - 1]))
    return solution


_POLAR = (
    "t = {time:.3f} s: closer than 0.1° to a pole, where a north-slaved navigation frame cannot follow; "
    "accepted are latitudes up to 89.9°"
)

_propagate_phi = compile_propagation(PHI)
_write_phi = PHI.write


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
def _predict(run: Filter, dt: float, elapsed: float) -> None:
    """Propagate [P | x] with F times dt, and with bias decay and noise over the time elapsed."""
    decay = (
        1 - elapsed * run.bias_decay[0],
        1 - elapsed * run.bias_decay[1],
        1 - elapsed * run.bias_decay[2],
        1 - elapsed * run.bias_decay[3],
        1 - elapsed * run.bias_decay[4],
        1 - elapsed * run.bias_decay[5],
    )
    _propagate_phi(run.F, dt, decay, run.w)
    _add_noise(run.w, run.state, run.noise, elapsed)


@inline_kernel
def _predict_summed(run: Filter, dt: float, due: bool) -> None:
    """Add the step to the sum of F dt; when due, propagate [P | x] over all steps since it last was."""
    run.counts[1] += 1
    run.clock[1] += dt
    for i in range(NAV):
        for j in range(STATES):
            run.F_sum[i, j] += dt * run.F[i, j]
            if due:
                run.F[i, j] = run.F_sum[i, j]
                run.F_sum[i, j] = 0.0
    if due:
        _predict(run, 1.0, run.clock[1])
        run.counts[1] = 0
        run.clock[1] = 0.0


@kernel
def _correct(state: FloatArray, w: FloatArray) -> None:
    """Take the estimated error out of the navigator, and set the estimate to zero."""
    x, y, z = w[X], w[WIDTH + X], w[2 * WIDTH + X]
    latitude = state[LATITUDE] - x * state[strapdown.MERIDIAN]
    longitude = state[strapdown.LONGITUDE] - y * state[strapdown.TRANSVERSE] / state[strapdown.COSINE]
    strapdown.set_position(state, latitude, longitude, state[strapdown.HEIGHT] + z)
    for i in range(3):
        state[VELOCITY + i] -= w[WIDTH * (3 + i) + X]
        # A second fix before the next sample interpolates between this one and the one before.
        state[PREVIOUS_VELOCITY + i] -= w[WIDTH * (3 + i) + X]
        state[GYRO_BIAS + i] -= w[WIDTH * (9 + i) + X]
        state[ACCEL_BIAS + i] -= w[WIDTH * (12 + i) + X]
    attitude = strapdown.rotation((w[WIDTH * 6 + X], w[WIDTH * 7 + X], w[WIDTH * 8 + X]))
    at = strapdown.Q_NB
    q = strapdown.product(attitude, (state[at], state[at + 1], state[at + 2], state[at + 3]))
    put(state, at, (q[0], q[1], q[2]))
    state[at + 3] = q[3]
    for i in range(STATES):
        w[WIDTH * i + X] = 0.0


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
def _store(out: Solution, k: int, state: FloatArray, w: FloatArray) -> None:
    """Write sample k of the solution."""
    for i in range(3):
        out.position[k, i] = state[LATITUDE + i]
        out.velocity_n[k, i] = state[VELOCITY + i]
    for i in range(4):
        out.q_nb[k, i] = state[strapdown.Q_NB + i]
    for i in range(6):
        out.bias[k, i] = state[GYRO_BIAS + i]
    for i in range(STATES):
        out.variance[k, i] = w[(WIDTH + 1) * i]
    for block in range(2):
        at = (WIDTH + 1) * 6 * block
        out.covariance[k, block, 0] = w[at + 1]
        out.covariance[k, block, 1] = w[at + 2]
        out.covariance[k, block, 2] = w[at + WIDTH + 2]


@kernel
def _store_fix(out: Solution, m: int, sample: int, w: FloatArray) -> None:
    """Write what is kept of fix m."""
    out.fix_sample[m] = sample
    for i in range(STATES):
        for j in range(STATES):
            out.fix_covariance[m, i, j] = w[WIDTH * i + j]


@kernel
def _has_estimate(w: FloatArray) -> bool:
    """Say whether an estimated error waits to be corrected."""
    estimate = False
    for i in range(STATES):
        estimate |= w[WIDTH * i + X] != 0
    return estimate


@kernel
def _store_corrected(
    out: Solution, k: int, state: FloatArray, w: FloatArray, x: FloatArray, spare: FloatArray
) -> None:
    """Write sample k of the solution with the estimated error taken out, leaving the navigator as it is."""
    for i in range(strapdown.LENGTH):  # a slice would compile its error messages too: a second
        spare[i] = state[i]
    for i in range(STATES):
        x[i] = w[WIDTH * i + X]
    _correct(spare, w)
    for i in range(STATES):
        w[WIDTH * i + X] = x[i]
    _store(out, k, spare, w)


def _compile_advance(
    sources: str, summed: bool
) -> Callable[[Filter, Imu, Fixes, Solution, int, Schedule], int]:
    """Compile the driver; `summed` for propagating P less often than at every sample."""

    @entry_kernel
    def advance(run: Filter, imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule) -> int:
        """Advance a navigator over the samples of `imu` from number `first` on; return where it stopped.

        It stops early, at the number of samples written, if it comes too close to a pole.
        """
        _ = sources
        state, w = run.state, run.w
        z = np.empty(MEASUREMENTS)
        x = np.empty(STATES)
        spare = np.empty(strapdown.LENGTH)
        pending = _has_estimate(w)
        if first == 0:
            _store(out, 0, state, w)
        for k in range(first, imu.dtheta.shape[0]):
            time = imu.time[k + 1]
            dt = time - imu.time[k]
            strapdown.step(state, get(imu.dtheta[k], 0), get(imu.dvelocity[k], 0), dt)
            if abs(state[LATITUDE]) > strapdown.MAX_LATITUDE:
                return k + 1
            m = run.counts[0]
            fix_due = m < fixes.time.size and fixes.time[m] <= time + 1e-6 * dt
            _write_phi(state, run.F)
            if summed:
                _predict_summed(run, dt, fix_due or run.counts[1] + 1 >= schedule.stride)
            else:
                _predict(run, dt, dt)
            while fix_due:
                age = time - fixes.time[m]
                if age <= dt * (1 + 1e-6):
                    _difference(state, age, age / dt, fixes.position[m], fixes.velocity_n[m], z)
                    update(w, z, run.R, run.R_root, out.innovation[m], out.innovation_covariance[m])
                    _store_fix(out, m, k + 1, w)
                    pending = True
                    if schedule.feedback and time - run.clock[0] >= schedule.correction_period - 1e-6 * dt:
                        _correct(state, w)
                        run.clock[0] = time
                        pending = False
                m += 1
                run.counts[0] = m
                fix_due = m < fixes.time.size and fixes.time[m] <= time + 1e-6 * dt
            if pending:
                _store_corrected(out, k + 1, state, w, x, spare)
            else:
                _store(out, k + 1, state, w)
        return imu.time.size

    return advance


_advance_each = _compile_advance(SOURCES, summed=False)
_advance_summed = _compile_advance(SOURCES, summed=True)


def advance(run: Filter, imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule) -> int:
    """Advance a navigator over the samples of `imu` from number `first` on.

    Returns the number of samples written: fewer than there are times in `imu` if the navigator comes too
    close to a pole. The flight may be handed over in one piece or piece by piece: the result is the same.
    """
    compiled = _advance_summed if schedule.stride > 1 else _advance_each
    return compiled(run, imu, fixes, out, first, schedule)


def is_compiled() -> bool:
    """Say whether the driver is ready in this process: compiled, or loaded from the disk."""
    return bool(_advance_each.signatures)  # type: ignore[attr-defined]
