"""Fix causes: the effects of latency and lever arm on the errors of fixes and on the innovations.

References
----------
A. S. Willsky, H. L. Jones, *A Generalized Likelihood Ratio Approach to the Detection and Estimation of Jumps
in Linear Systems*, IEEE Trans. Automatic Control 21 (1976): the response of the innovations to an error.
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray, of_kernel
from lab.motion.frames.rotation import C_nb_from_euler, euler_from_quaternion
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL
from lab.navigation.kernels.compilation import entry_kernel, kernel
from lab.navigation.solution import Belief, Imu, Solution
from lab.navigation.strapdown import matrix, rotate
from lab.sensors.imu_errors import OFF_DIAGONAL

CAUSES = 4
"""Regressors: latency [s], then the lever arm forward, right, down [m]."""
AT_ONCE = 2**14
"""Samples that are summed in one block, with some 250 bytes each."""
FIXES_AT_ONCE = 1024
"""Fixes whose transitions or gains are computed together, with some 20 kB each at 21 states."""
RATE_WINDOW = 0.1
"""Time over which angular rate and acceleration at a fix are averaged [s]."""
_ROWS, _COLUMNS = (["xyz".index(pair[k]) for pair in OFF_DIAGONAL] for k in (0, 1))
"""The sensor that each misalignment concerns, and the axis that it measures too."""


class MotionAtFixes(NamedTuple):
    """The estimated motion at the m used fixes: all (m, 3), and C_nb (m, 3, 3)."""

    velocity: FloatArray
    acceleration: FloatArray
    rate_b: FloatArray
    force_n: FloatArray
    C_nb: FloatArray


Ends = tuple[FloatArray, FloatArray]
"""Values at the ends of the window before each fix."""


def motion_at_fixes(
    solution: Solution, samples: NDArray[np.intp], imu: Imu, velocity: Ends | None = None
) -> MotionAtFixes:
    """Return the motion at the fixes, from the samples before each, before its correction.

    Parameters
    ----------
    solution, imu
        Solution and input of the navigator.
    samples : (m,) array
        Samples of the fixes.
    velocity
        Estimated velocities (m, 3) at the ends of `windows` [m/s]; by default, from the solution.
    """
    window = windows(samples, imu.time)
    ends = np.append(samples, imu.time.size - 1)
    return motion_of(
        imu.time,
        window,
        (solution.velocity_n[window[0]], solution.velocity_n[window[1]]) if velocity is None else velocity,
        solution.q_nb[window[1]],
        sums_between(imu.dtheta, *window),
        ends,
        _sum_velocity_increments(solution, ends, imu),
    )


def windows(samples: NDArray[np.intp], time: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first and the last sample (m,) of the window before each of some samples (m,)."""
    last = np.maximum(samples - 1, 0)
    return np.maximum(last - window_width(time), 0), last


def window_width(time: FloatArray) -> int:
    """Return the number of samples in `RATE_WINDOW`, given their times (n + 1,) [s]."""
    return max(1, round(RATE_WINDOW / _step(time)))


def _step(time: FloatArray) -> float:
    return float(time[-1] - time[0]) / (time.size - 1) if time.size > 1 else 1.0


def motion_of(
    time: FloatArray,
    window: tuple[NDArray[np.intp], NDArray[np.intp]],
    velocity: tuple[FloatArray, FloatArray],
    q_nb: FloatArray,
    turned: FloatArray,
    ends: NDArray[np.intp],
    gained: FloatArray,
) -> MotionAtFixes:
    """Return the motion at m fixes from the values at some samples, of a run or of some runs.

    Parameters
    ----------
    time : (n + 1,) array
        Times of all samples [s].
    window
        First and last sample (m,) of the window before each fix.
    velocity
        Estimated velocities (…, m, 3) at both [m/s].
    q_nb : (…, m, 4) array
        Estimated attitude at the last.
    turned : (…, m, 3) array
        Sums of the angular increments in the window, as from `sums_between` [rad].
    ends : (m + 1,) array
        Samples of the fixes, and the last of all.
    gained : (…, m + 1, 3) array
        Sums of the velocity increments, resolved in n, up to these samples [m/s].
    """
    first, last = window
    span = np.maximum(time[last] - time[first], _step(time))[:, None]
    flown = np.maximum(time[ends[1:]] - time[ends[:-1]], 1e-9)[:, None]
    return MotionAtFixes(
        velocity=velocity[1],
        acceleration=(velocity[1] - velocity[0]) / span,
        rate_b=turned / span,
        force_n=np.diff(gained, axis=-2) / flown,
        C_nb=C_nb_from_euler(euler_from_quaternion(q_nb)),
    )


def _sum_velocity_increments(solution: Solution, ends: NDArray[np.intp], imu: Imu) -> FloatArray:
    """Return the sums of the velocity increments, resolved in n, up to some samples (m,) [m/s]."""
    sums, running = np.zeros((ends.size, 3)), np.zeros((AT_ONCE + 1, 3))
    for first in range(0, imu.dvelocity.shape[0], AT_ONCE):
        part = slice(first, first + AT_ONCE)
        last = first + len(imu.dvelocity[part])
        _add_resolved(of_kernel(solution.q_nb[1:][part]), of_kernel(imu.dvelocity[part]), running)
        here = (ends >= first) & (ends <= last)
        sums[here] = running[ends[here] - first]
        # The next block goes on with the sum of this one.
        running[0] = running[last - first]
    return sums


@entry_kernel
def _add_resolved(q_nb: FloatArray, vectors_b: FloatArray, running: FloatArray) -> None:
    """Write the sums (m + 1, 3) of vectors (m, 3) of b, resolved in n by their attitudes (m, 4).

    The first sum is that of the vectors before these.
    """
    for k in range(len(q_nb)):
        q, v = q_nb[k], vectors_b[k]
        rotated = rotate(matrix((q[0], q[1], q[2], q[3])), (v[0], v[1], v[2]))
        for axis in range(3):
            running[k + 1, axis] = running[k, axis] + rotated[axis]


def sums_between(values: FloatArray, first: NDArray[np.intp], last: NDArray[np.intp]) -> FloatArray:
    """Return the sums (m, …) of values (n, …) from each first sample (m,) to that before the last (m,)."""
    samples = first[:, None] + np.arange(np.max(last - first, initial=0))
    inside = samples < last[:, None]
    there = values[np.minimum(samples, values.shape[0] - 1)]
    if not inside.all():
        there[~inside] = 0.0
    return np.asarray(np.sum(there, axis=1, dtype=np.float64))


def error_per_cause(motion: MotionAtFixes) -> FloatArray:
    """Return the error (…, m, 6, CAUSES) of the fixes for each second of latency and metre of lever arm.

    A fix with the latency τ reports p(t − τ) and v(t − τ). A fix of an antenna at l reports p + C_nb l and v
    + C_nb (ω × l) (Groves 14.3).
    """
    causes = np.empty((*motion.velocity.shape[:-1], 6, CAUSES))
    # A late fix shows where the vehicle was before.
    causes[..., POS, 0], causes[..., VEL, 0] = -motion.velocity, -motion.acceleration
    causes[..., POS, 1:] = motion.C_nb
    # ω × l.
    causes[..., VEL, 1:] = motion.C_nb @ _skew(motion.rate_b)
    return causes


def matrices(solution: Solution, belief: Belief, fixes: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    """Return H (m, 6, n) of some fixes and their assumed R (m, 6, 6), before any robust weight."""
    R = np.broadcast_to(belief.fix_covariance(fixes), (fixes.size, 6, 6))
    return of_fixes(solution.fix_H, fixes), R


def of_fixes(values: FloatArray, fixes: NDArray[np.intp]) -> FloatArray:
    """Return the rows of some fixes, in their order; all rows are not copied: P of four hours takes 50 MB."""
    return values if fixes.size == len(values) else values[fixes]


def gains(solution: Solution, fixes: NDArray[np.intp]) -> FloatArray:
    """Return the gains (m, n, 6) of some fixes; zero for rejected ones.

    K = P Hᵀ R⁻¹ with P after the fix, except along heading and vertical gyro bias where these were held.
    """
    H, R = of_fixes(solution.fix_H, fixes), of_fixes(solution.fix_R, fixes)
    used = solution.fix_sample[fixes] >= 0
    K = np.zeros((fixes.size, solution.states, 6))
    for first in range(0, fixes.size, FIXES_AT_ONCE):
        part = slice(first, first + FIXES_AT_ONCE)
        here = first + np.flatnonzero(used[part])
        own, inverse = R[here], np.zeros((1, 6, 6))
        if here.size and (own == own[0]).all():  # as of most receivers
            inverse = np.asarray(np.linalg.inv(own[:1]))
        elif here.size:
            inverse = np.zeros((used[part].size, 6, 6))
            inverse[here - first] = np.linalg.inv(own)
        P = of_fixes(solution.fix_covariance, fixes)[part]
        _gain(of_kernel(P), of_kernel(H[part]), of_kernel(inverse), used[part], K[part])
        hold_heading(K, here, np.array([0.0, 0.0, 1.0]), solution.fix_held[fixes[here]])
    return K


@entry_kernel
def _gain(P: FloatArray, H: FloatArray, inverse: FloatArray, used: NDArray[np.bool_], K: FloatArray) -> None:
    """Add P Hᵀ R⁻¹ to gains (m, n, 6) of used fixes; there is one inverse of R for all, or one for each."""
    for k in range(len(K)):
        at = min(k, len(inverse) - 1)
        for m in range(P.shape[1]) if used[k] else range(0):
            for d in range(H.shape[1]):
                for c in range(H.shape[1]) if H[k, d, m] != 0 else range(0):
                    weight = H[k, d, m] * inverse[at, d, c]
                    for i in range(P.shape[1]) if weight != 0 else range(0):
                        K[k, i, c] += P[k, i, m] * weight


def hold_heading(K: FloatArray, part: NDArray[np.intp], vertical: FloatArray, held: FloatArray) -> None:
    """Remove heading and vertical gyro bias from the gains of fixes that left them as they were.

    Parameters
    ----------
    K : (m, n, 6) array
        Gains, changed in place.
    part : (k,) array
        Numbers of some of these fixes.
    vertical : (3,) or (k, 3) array
        The vertical in the axes of the attitude errors.
    held : (k, 3) array
        As `Solution.fix_held`.
    """
    is_held = held.any(axis=1)
    for block, axis in ((ATT, np.broadcast_to(vertical, held.shape)), (GYRO_BIAS, held)):
        along, gain = axis[is_held, :, None], K[part[is_held], block]
        K[part[is_held], block] = gain - along * (along * gain).sum(axis=1, keepdims=True)


def response(
    gains: FloatArray,
    solution: Solution,
    belief: Belief,
    fixes: NDArray[np.intp],
    samples: NDArray[np.intp],
    time: FloatArray,
    motion: MotionAtFixes,
    causes: FloatArray,
    names: tuple[str, ...] = (),
) -> FloatArray:
    """Return the response of the innovations (m, 6, CAUSES) to the causes, through the gains of the filter.

    From fix to fix, the error is propagated by the short-term terms of F only: velocity, specific force,
    errors of the IMU.

    Parameters
    ----------
    gains : (m, n, 6) array
        Of the fixes.
    solution, belief
        Solution and assumptions of the navigator.
    fixes, samples : (m,) arrays
        Indices of the offered fixes, and their samples.
    time : (n + 1,) array
        Times of the IMU samples [s].
    motion, causes
        Motion and causes at these fixes.
    names
        The further blocks of the filter.
    """
    dt = np.diff(time[samples], append=time[-1])
    # The first step ends at the first fix; before it, there is no error.
    transitions = _transitions(motion, dt[:-1], solution.states, names)
    nothing = np.zeros((FIXES_AT_ONCE, solution.states, causes.shape[2]))
    onwards = (
        (Phi, nothing[: len(Phi)]) for Phi in itertools.chain([np.eye(solution.states)[None]], transitions)
    )
    return respond(gains, matrices(solution, belief, fixes)[0], onwards, causes)


def _transitions(
    motion: MotionAtFixes, dt: FloatArray, n: int, names: tuple[str, ...]
) -> Iterator[FloatArray]:
    """Iterate over the transitions (k, n, n) of the error from some fixes to the next, `dt` later [s]."""
    for first in range(0, dt.size, FIXES_AT_ONCE):
        part = slice(first, min(first + FIXES_AT_ONCE, dt.size))
        yield transitions(MotionAtFixes(*(values[part] for values in motion)), dt[part], n, names)


def transitions(motion: MotionAtFixes, dt: FloatArray, n: int, names: tuple[str, ...]) -> FloatArray:
    """Return the transitions (k, n, n) of the error from some fixes, with motion (k, …), until dt later."""
    step, T = np.zeros((dt.size, n, n)), dt[:, None, None]
    step[:, POS, VEL] = np.eye(3)
    step[:, VEL, ATT] = _skew(motion.force_n)
    step[:, VEL, ACCEL_BIAS] = -motion.C_nb
    step[:, ATT, GYRO_BIAS] = motion.C_nb
    force_b = np.einsum("mji,mj->mi", motion.C_nb, motion.force_n)
    write_imu_columns(step, names, motion.C_nb, motion.rate_b, force_b)
    step *= T
    # The exponential has no more terms: velocity changes by attitude, and position by velocity.
    turning = step[:, VEL, ATT] @ step[:, ATT]
    faster = step[:, VEL] / 2 + turning / 6
    step[:, VEL] += turning / 2
    step[:, POS] += T * faster
    step[:, range(n), range(n)] += 1.0
    return step


def write_imu_columns(
    F: FloatArray, names: tuple[str, ...], C_nb: FloatArray, rate_b: FloatArray, force_b: FloatArray
) -> None:
    """Write the columns of scale factors, misalignments and g-sensitivity that a filter has into F (m, n, n).

    Parameters
    ----------
    F : (m, n, n) array
        System matrices.
    names
        The further blocks of the filter.
    C_nb : (m, 3, 3) array
        Attitudes.
    rate_b, force_b : (m, 3) arrays
        Angular rates [rad/s] and specific forces [m/s²] in b.
    """
    for rows, sign, shown, scale, misalignment in (
        (ATT, 1, rate_b, blocks.GYRO_SCALE, blocks.GYRO_MISALIGNMENT),
        (VEL, -1, force_b, blocks.ACCEL_SCALE, blocks.ACCEL_MISALIGNMENT),
    ):
        if scale in names:
            F[:, rows, blocks.find_states(names, scale)] = sign * C_nb * shown[:, None, :]
        if misalignment in names:
            F[:, rows, blocks.find_states(names, misalignment)] = (
                sign * C_nb[:, :, _ROWS] * shown[:, None, _COLUMNS]
            )
    if blocks.GYRO_G in names:
        F[:, ATT, blocks.find_states(names, blocks.GYRO_G)] = C_nb * force_b[:, None, :]


def respond(
    gains: FloatArray,
    H: FloatArray,
    onwards: Iterable[tuple[FloatArray, FloatArray]],
    fixes: FloatArray,
) -> FloatArray:
    """Return the response of the innovations (m, 6, p) to causes.

    Parameters
    ----------
    gains, H : (m, n, 6), (m, 6, n) arrays
        Of the fixes.
    onwards
        Of some fixes after the others: transition (k, n, n) of the error to each fix from the previous one,
        and what the causes add (k, n, p) in between.
    fixes : (m, 6, p) array
        Error of each fix per unit of each cause.
    """
    error, answer = np.zeros((gains.shape[1], fixes.shape[2])), np.empty(fixes.shape)
    first = 0
    for transition, forced in onwards:
        part = slice(first, first + len(transition))
        gain, shown, move = of_kernel(gains[part]), of_kernel(H[part]), of_kernel(transition)
        _respond(gain, shown, move, of_kernel(fixes[part]), of_kernel(forced), error, answer[part])
        first = part.stop
    return answer


@entry_kernel
def _respond(
    gains: FloatArray,
    H: FloatArray,
    transition: FloatArray,
    fixes: FloatArray,
    forced: FloatArray,
    error: FloatArray,
    answer: FloatArray,
) -> None:
    """Continue the error (n, p) after one fix to that after the last of some, and write their answers."""
    before = np.empty(error.shape)
    for k in range(len(gains)):
        _copy(forced[k], 1.0, before)
        add_product(transition[k], error, 1.0, before)
        # The innovation is H e − v, and e⁺ = e − K (H e − v).
        _copy(fixes[k], -1.0, answer[k])
        add_product(H[k], before, 1.0, answer[k])
        _copy(before, 1.0, error)
        add_product(gains[k], answer[k], -1.0, error)


@kernel
def _copy(values: FloatArray, factor: float, out: FloatArray) -> None:
    for i in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[i, c] = factor * values[i, c]


@kernel
def add_product(left: FloatArray, right: FloatArray, factor: float, out: FloatArray) -> None:
    """Add a product of matrices, of which the left one has many zeros."""
    for i in range(left.shape[0]):
        for m in range(left.shape[1]):
            entry = factor * left[i, m]
            if entry != 0:
                for c in range(out.shape[1]):
                    out[i, c] += entry * right[m, c]


def _skew(vectors: FloatArray) -> FloatArray:
    """Return [v ×] (…, 3, 3) of vectors (…, 3)."""
    found = np.zeros((*vectors.shape, 3))
    for row, column, axis in ((2, 1, 0), (0, 2, 1), (1, 0, 2)):
        found[..., row, column], found[..., column, row] = vectors[..., axis], -vectors[..., axis]
    return found
