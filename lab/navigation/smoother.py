"""Smoother: what the whole flight's fixes say of every sample, for post-processing of the linear filter.

Fixed-interval smoothing in the form of Bryson and Frazier, which gives what Rauch, Tung and Striebel's does
but inverts nothing except the innovations' covariance, so that states nobody doubts do no harm. Backwards
through the flight go λ and Λ, what later innovations say; the error of the filter's solution is then −P λ,
and its covariance loses P Λ P. P between the fixes is computed anew, one interval at a time.

References
----------
G. J. Bierman, *Fixed interval smoothing with discrete measurements*, Int. J. Control 18 (1973); H. E. Rauch,
F. Tung, C. T. Striebel, *Maximum likelihood estimates of linear dynamic systems*, AIAA J. 3 (1965).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.navigation import strapdown
from lab.navigation.compilation import SOURCES, entry_kernel, inline_kernel, kernel, rebound_throughout
from lab.navigation.error_models import PHI, with_states
from lab.navigation.kalman import MEASUREMENTS
from lab.navigation.propagation import BIASES, NAV
from lab.navigation.sigma_points import displace
from lab.navigation.solution import Belief, Imu, Solution
from lab.navigation.strapdown import GYRO_BIAS, GYRO_SCALE, LATITUDE, VELOCITY, get

FloatArray = NDArray[np.float64]

N = 15
"""Number of states the kernels are written for."""


class Used(NamedTuple):
    """The fixes a filter used, in order.

    Attributes
    ----------
    sample : (m,) array
        Sample after which each was used.
    innovation : (m, 6) array
        Innovations.
    precision : (m, 6, 6) array
        Inverse of their covariances.
    kept : (m, n, n) array
        I − K H, what each fix leaves of an error.
    covariance : (m, n, n) array
        P after each fix; becomes that of the smoothed error.
    """

    sample: NDArray[np.int64]
    innovation: FloatArray
    precision: FloatArray
    kept: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, solution: Solution, belief: Belief) -> Used:
        """Return the fixes of a solution; the gain is K = P Hᵀ R⁻¹ with P after the fix (Bierman 1973)."""
        used = np.flatnonzero(solution.fix_sample >= 0)
        P = solution.fix_covariance[used]
        kept = np.tile(np.eye(solution.states), (used.size, 1, 1))
        kept[:, :, :MEASUREMENTS] -= P[:, :, :MEASUREMENTS] @ np.linalg.inv(belief.fix_covariance(used))
        precision = np.asarray(np.linalg.inv(solution.innovation_covariance[used]), dtype=np.float64)
        return cls(solution.fix_sample[used], solution.innovation[used], precision, kept, P)


class Interval(NamedTuple):
    """Workspace for the samples between two fixes."""

    state: FloatArray
    F: FloatArray
    Phi: FloatArray  # (samples, n, n), transitions to the next sample
    P: FloatArray  # (samples + 1, n, n), covariances of the filter
    product: FloatArray
    back: FloatArray  # a transition, transposed

    @classmethod
    def of(cls, samples: int, n: int) -> Interval:
        """Return room for a number of samples of a filter with n states."""
        return cls(
            np.zeros(strapdown.LENGTH),
            np.zeros((n, n)),
            np.zeros((samples, n, n)),
            np.zeros((samples + 1, n, n)),
            np.zeros((n, n)),
            np.zeros((n, n)),
        )


def smooth(imu: Imu, solution: Solution, belief: Belief) -> Solution:
    """Smooth the solution of a linear filter over the whole flight.

    Parameters
    ----------
    imu
        The increments it was computed from.
    solution
        What `navigator.navigate` made of them, feedback or feedforward.
    belief
        What the filter assumed.

    Returns
    -------
    Solution
        Smoothed position, velocity, attitude, biases and scale factors at all samples with their variances,
        and smoothed covariances at the fixes; innovations remain the filter's.
    """
    of_fixes = (name for name in Solution._fields if name.startswith(("innovation", "fix")))
    kept = {name: getattr(solution, name).copy() for name in of_fixes}
    out = Solution.empty(imu.time.size, solution.fix_sample.size, solution.states)._replace(**kept)
    used = Used.of(solution, belief)
    stops = np.concatenate(([0], used.sample, [imu.dtheta.shape[0]]))
    room = Interval.of(int(np.diff(stops).max()), solution.states)
    # R is not needed there; one for each fix would compile the code anew.
    assumed = belief._replace(R=belief.R.reshape(-1, MEASUREMENTS))
    _backwards(solution.states)(imu, solution, used, room, assumed, out)
    out.fix_covariance[solution.fix_sample >= 0] = used.covariance
    return out


_write_phi = PHI.write


@inline_kernel
def _load(state: FloatArray, solution: Solution, k: int) -> None:
    """Put a navigator where a solution was at sample k."""
    strapdown.set_position(state, solution.position[k, 0], solution.position[k, 1], solution.position[k, 2])
    for i in range(3):
        state[VELOCITY + i] = solution.velocity_n[k, i]
    for i in range(BIASES):
        state[GYRO_BIAS + i] = solution.bias[k, i]
    for i in range(N - NAV - BIASES):
        state[GYRO_SCALE + i] = solution.scale[k, i]
    for i in range(4):
        state[strapdown.Q_NB + i] = solution.q_nb[k, i]


@kernel
def _multiply(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    """Write A B, of which A is sparse."""
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            out[i, j] = 0.0
        for k in range(A.shape[1]):
            a = A[i, k]
            if a != 0:
                for j in range(B.shape[1]):
                    out[i, j] += a * B[k, j]


@kernel
def _sandwich(A: FloatArray, M: FloatArray, product: FloatArray) -> None:
    """Replace a symmetric M by A M Aᵀ, of which A is sparse."""
    _multiply(A, M, product)
    # (A M)ᵀ = M Aᵀ, so that the sparse factor is on the left again.
    for i in range(M.shape[0]):
        for j in range(i):
            product[i, j], product[j, i] = product[j, i], product[i, j]
    _multiply(A, product, M)
    for i in range(M.shape[0]):
        for j in range(i):
            M[j, i] = M[i, j]


@kernel
def _copy(A: FloatArray, out: FloatArray) -> None:
    """Write A."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i, j] = A[i, j]


@kernel
def _transpose(A: FloatArray, out: FloatArray) -> None:
    """Write Aᵀ."""
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i, j] = A[j, i]


@kernel
def _forward(
    imu: Imu,
    solution: Solution,
    first: int,
    last: int,
    belief: Belief,
    room: Interval,
) -> None:
    """Write the transitions and covariances from sample `first`, where P is given, to sample `last`."""
    for k in range(first, last):
        dt = imu.time[k + 1] - imu.time[k]
        _load(room.state, solution, k)
        strapdown.step(room.state, get(imu.dtheta[k], 0), get(imu.dvelocity[k], 0), dt)
        _write_phi(room.state, room.F)
        Phi, P = room.Phi[k - first], room.P[k - first + 1]
        for i in range(N):
            for j in range(N):
                Phi[i, j] = dt * room.F[i, j]
                P[i, j] = room.P[k - first, i, j]
            Phi[i, i] += 1 - (dt * belief.bias_decay[i - NAV] if NAV <= i < NAV + BIASES else 0.0)
        _sandwich(Phi, P, room.product)
        _add_noise(room.state, belief.noise, dt, P)


@inline_kernel
def _add_noise(state: FloatArray, noise: FloatArray, dt: float, P: FloatArray) -> None:
    """Add the process noise of one step to P; white noise enters through C_nb."""
    for block in range(2):
        at = 6 - 3 * block  # gyro noise drives the attitude, accelerometer noise the velocity
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    c = state[strapdown.C_NB + 3 * i + k] * state[strapdown.C_NB + 3 * j + k]
                    P[at + i, at + j] += dt * noise[3 * block + k] * c
    for b in range(6):
        P[NAV + b, NAV + b] += dt * noise[6 + b]


@kernel
def _add_fix(used: Used, m: int, later: FloatArray, Later: FloatArray, room: Interval) -> None:
    """Take fix m into λ and Λ: λ ← (I − K H)ᵀ λ − Hᵀ S⁻¹ ν, Λ ← (I − K H)ᵀ Λ (I − K H) + Hᵀ S⁻¹ H."""
    _transpose(used.kept[m], room.back)
    _turn(room.back, later, room.product[0])
    _sandwich(room.back, Later, room.product)
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            later[i] -= used.precision[m, i, j] * used.innovation[m, j]
            Later[i, j] += used.precision[m, i, j]


@kernel
def _turn(A: FloatArray, later: FloatArray, before: FloatArray) -> None:
    """Replace λ by A λ; `before` is workspace."""
    for i in range(N):
        before[i] = later[i]
    for i in range(N):
        later[i] = 0.0
        for j in range(N):
            later[i] += A[i, j] * before[j]


@kernel
def _write(
    solution: Solution,
    k: int,
    P: FloatArray,
    later: FloatArray,
    Later: FloatArray,
    room: Interval,
    out: Solution,
) -> None:
    """Write sample k of the smoothed solution, and replace P by the covariance of its error."""
    _load(room.state, solution, k)
    error = np.zeros(N)
    for i in range(N):
        for j in range(N):
            error[i] -= P[i, j] * later[j]
    displace(room.state, error)
    for i in range(3):
        out.position[k, i] = room.state[LATITUDE + i]
        out.velocity_n[k, i] = room.state[VELOCITY + i]
    for i in range(4):
        out.q_nb[k, i] = room.state[strapdown.Q_NB + i]
    for i in range(BIASES):
        out.bias[k, i] = room.state[GYRO_BIAS + i]
    for i in range(N - NAV - BIASES):
        out.scale[k, i] = room.state[GYRO_SCALE + i]
    _multiply(Later, P, room.product)
    _multiply(P, room.product, room.back)
    for i in range(N):
        for j in range(N):
            P[i, j] -= 0.5 * (room.back[i, j] + room.back[j, i])
        out.variance[k, i] = P[i, i]
    for block in range(2):
        at = 6 * block
        out.covariance[k, block, 0] = P[at, at + 1]
        out.covariance[k, block, 1] = P[at, at + 2]
        out.covariance[k, block, 2] = P[at + 1, at + 2]


@functools.cache
def _backwards(states: int) -> Callable[[Imu, Solution, Used, Interval, Belief, Solution], None]:
    """Return the way back through a flight, which is compiled, or loaded from the disk, when first called."""
    identity = SOURCES, states

    def backwards(
        imu: Imu, solution: Solution, used: Used, room: Interval, belief: Belief, out: Solution
    ) -> None:
        """Write the smoothed solution, interval by interval from the last fix to the start."""
        _ = identity
        later, Later = np.zeros(N), np.zeros((N, N))
        fixes = used.sample.size
        for m in range(fixes, -1, -1):  # from fix m − 1 to fix m
            first = used.sample[m - 1] if m > 0 else 0
            last = used.sample[m] if m < fixes else imu.dtheta.shape[0]
            _copy(used.covariance[m - 1] if m > 0 else belief.P0, room.P[0])
            _forward(imu, solution, first, last, belief, room)
            if m < fixes:
                _add_fix(used, m, later, Later, room)
            else:
                _write(solution, last, room.P[last - first], later, Later, room, out)
            for k in range(last - 1, first - 1, -1):
                _transpose(room.Phi[k - first], room.back)
                _turn(room.back, later, room.product[0])
                _sandwich(room.back, Later, room.product)
                _write(solution, k, room.P[k - first], later, Later, room, out)
            if m > 0:
                # A second fix after the same sample leaves no samples between: what is known is the same.
                shared = m < fixes and first == last
                _copy(used.covariance[m] if shared else room.P[0], used.covariance[m - 1])

    write = with_states(PHI, states).write
    return entry_kernel(rebound_throughout(backwards, N=states, _write_phi=write))
