"""Smoother: every sample estimated from all fixes of the flight, for post-processing of a linear filter.

Fixed-interval smoothing in the form of Bryson and Frazier. Its result is that of Rauch, Tung and Striebel's
form, but it inverts no matrix, so that states without variance do no harm. The backward pass propagates λ and
Λ, the information of later innovations. The error of the navigator is then x − P λ, and its covariance P − P
Λ P.

The backward pass uses the filter's own steps: the filter's kernels advance copies of the filter from the
forward pass again, a block of samples at a time, and the changes of [P | x] are kept. So Φ, P, gains and
linearisation are those of the filter, with all its corrections, weights, rejected fixes and gaps.

References
----------
G. J. Bierman, *Fixed interval smoothing with discrete measurements*, Int. J. Control 18 (1973); H. E. Rauch,
F. Tung, C. T. Striebel, *Maximum likelihood estimates of linear dynamic systems*, AIAA J. 3 (1965).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.base.histories import SINGLE
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.filters.blocks import LEVER_ARM
from lab.navigation.filters.correction import has_estimate, write_corrected_state
from lab.navigation.filters.error_models import ATT, PHI, ErrorModel, write_f
from lab.navigation.filters.filter import Filter
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.heading_observability import LINEAR
from lab.navigation.filters.held_heading import straighten
from lab.navigation.filters.prediction import predict
from lab.navigation.filters.schedule import EVERY_FIX, SLACK, Schedule, Stretch
from lab.navigation.filters.wander_models import linear_model
from lab.navigation.frames import change, choose_model_here
from lab.navigation.kernels.compilation import inline_kernel, kernel, loop_kernel
from lab.navigation.kernels.driver import PENDING, SETTLED, aid_due, loop, take_measurements
from lab.navigation.kernels.flight_piece import FlightPiece
from lab.navigation.kernels.propagation import DRIVEN, NAV, STATES, WIDTH, X
from lab.navigation.kernels.storage import store, store_fix
from lab.navigation.lever_arm import mean_rates_at_fixes
from lab.navigation.navigator import navigate_piece_within_frame, navigate_segments, takes_aids, within_frame
from lab.navigation.solution import HISTORIES, Belief, Fixes, Imu, Solution, Start, read_only
from lab.navigation.standstill import hold_attitude
from lab.navigation.strapdown import get, step

GO = 1024
"""Samples kept in memory in the backward pass, with some 6 kB each at 21 states. For a long flight, these are
twice as many: at the start of each block, a copy of the filter is kept, with 12 kB."""
SHARED = ("P", "F_sum", "F_step", "scalars", "R", "decay", "lever_arm", "turns", "aids", "aid_scalars")
"""Arrays of a filter that are not copied: P is a part of `w`, sums of F serve a covariance that is propagated
less often, updates by fixes are kept for all fixes, the others do not change. R and the angular rates about
the fixes may be as long as the flight."""


class _Copy(NamedTuple):
    """A filter before a block of samples, the schedule for the block, and the change of its frame there."""

    first: int
    run: Filter
    schedule: Schedule
    changed: FloatArray | None = None  # as of `frames.change`


class _Kept(NamedTuple):
    """The data of a block of samples for the backward pass."""

    state: FloatArray  # (samples + 1, length), navigators at the ends of the samples, then the one before
    w: FloatArray  # (samples + 1, n · width), [P | x], likewise
    Phi: FloatArray  # (samples, 9, n), rows of the transitions that differ from the unit matrix
    rest: FloatArray  # (samples, 1, 2 n + 2), updates at rest
    fixes: NDArray[np.int64]  # (samples + 1,), next fix before each sample, and after the last
    aids: NDArray[np.int64]  # (samples + 1,), likewise
    half: FloatArray  # (n, n), a product of matrices
    P: FloatArray  # (n, n), covariance of the filter at a sample
    decay: FloatArray  # of the driven states in a sample, as a factor

    @classmethod
    def room(cls, run: Filter, samples: int, *, at_rest: bool) -> Self:
        """Return room for a block of samples of a filter, with updates at rest if there may be any."""
        n = run.P.shape[0]
        return cls(
            np.zeros((samples + 1, run.state.size)),
            np.zeros((samples + 1, run.P.size)),
            np.zeros((samples, NAV, n)),
            np.zeros((samples if at_rest else 1, 1, 2 * n + 2)),
            np.zeros(samples + 1, dtype=np.int64),
            np.zeros(samples + 1, dtype=np.int64),
            np.zeros((n, n)),
            np.zeros((n, n)),
            np.zeros(run.decay.size),
        )


def navigate(
    imu: Imu,
    fixes: Fixes,
    start: Start,
    belief: Belief,
    schedule: Schedule = EVERY_FIX,
    model: ErrorModel = PHI,
    stretches: Sequence[Stretch] = (),
    aids: Aids = NO_AIDS,
    used: Callable[[int], None] | None = None,
) -> Solution:
    """Navigate a whole flight, and smooth the solution over all its fixes.

    Parameters
    ----------
    imu, fixes, start, belief, schedule, model, stretches, aids
        As of `navigator.navigate`; P is propagated at every sample (`schedule.stride` is 1).
    used
        Called after each block of the backward pass, with the number of the increment from which on all
        have been used.

    Returns
    -------
    Solution
        Smoothed position, velocity, attitude, biases and scale factors at all samples with their variances,
        and smoothed covariances at the fixes; innovations remain the filter's.
    """
    assert schedule.stride == 1
    imu, fixes = read_only(imu), read_only(fixes)
    is_long = imu.time.size > SINGLE
    shown = np.float32 if is_long else np.float64
    out = Solution.empty(imu.time.size, fixes.time.size, model.blocks, shown, aids.time.size)
    turned = mean_rates_at_fixes(imu, fixes.time, belief.lever_arm, estimated=LEVER_ARM in model.blocks)
    kept_aids = aids.time.size

    def forward_pass(schedule: Schedule, model: ErrorModel) -> list[_Copy]:
        run = Filter.begin(start, belief, float(imu.time[0]), model, fixes.time.size, turned, aids, kept_aids)
        return _forward_pass(run, imu, fixes, out, schedule, stretches, model, is_long=is_long)

    copies = forward_pass(schedule, model)
    if out.fix_held.any():
        copies.clear()
        _forget_forward_pass(out)
        if model.in_body and np.diag(belief.P0)[ATT].max() < LINEAR**2:
            model = with_blocks(linear_model("phi", model.mechanization), model.blocks)
        elif model.in_body:  # the heading is none of its states, and phi does not hold for such a start
            out.fix_held[:] = 0.0
        copies = forward_pass(schedule._replace(hold_heading=False), model)
    n = model.states
    later, Later = np.zeros(n), np.zeros((n, n))
    end = imu.dtheta.shape[0]
    while copies:
        copy = copies.pop()
        _smooth_block(copy, end, imu, fixes, out, model, later, Later, is_long=is_long)
        if copy.changed is not None:
            # A filter's errors were changed by x ← C x here; backwards, λ ← Cᵀ λ and Λ ← Cᵀ Λ C.
            later[:NAV] = copy.changed.T @ later[:NAV]
            Later[:NAV] = copy.changed.T @ Later[:NAV]
            Later[:, :NAV] = Later[:, :NAV] @ copy.changed
        if used is not None:
            used(copy.first)
        end = copy.first
    return out


def _forget_forward_pass(out: Solution) -> None:
    """Forget what a forward pass did, but not which fixes did not show the heading."""
    out.fix_sample[:], out.aid_sample[:] = -1, -1
    for flags in (out.fix_rejected, out.fix_recovered, out.rest):
        flags[:] = False
    for values in (out.aid_innovation, out.aid_variance, out.aid_H, out.aid_gain):
        values[:] = np.nan


def _forward_pass(
    run: Filter,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    schedule: Schedule,
    stretches: Sequence[Stretch],
    model: ErrorModel,
    *,
    is_long: bool,
) -> list[_Copy]:
    """Filter the whole flight; return copies of the filter from before each block of samples."""
    copies: list[_Copy] = []
    go = navigate_piece_within_frame if is_long else within_frame
    passing = out
    if is_long:  # the backward pass writes the histories, while it gives up the increments
        row = out.room(1)
        passing = out._replace(**{name: getattr(row, name) for name in HISTORIES if name != "rest"})

    def navigate_piece(imu: Imu, out: Solution, first: int, schedule: Schedule) -> None:
        changed = None
        while first < imu.dtheta.shape[0]:
            copies.append(_Copy(first, _copy_filter(run), schedule, changed))
            first = go(run, imu, fixes, out, first, schedule, model)
            if first < imu.dtheta.shape[0]:
                changed = change(run.state, run.P, model)

    navigate_segments(run.noise, imu, passing, schedule, stretches, navigate_piece, 2 * GO if is_long else GO)
    return copies


def _smooth_block(
    copy: _Copy,
    end: int,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    model: ErrorModel,
    later: FloatArray,
    Later: FloatArray,
    *,
    is_long: bool,
) -> None:
    """Write the smoothed solution of the samples from a copy of the filter to number `end`."""
    first, own, there, _ = copy
    back = backward_pass(choose_model_here(own.state, model), aided=takes_aids(model, own.aids))
    kept = _Kept.room(own, end - first, at_rest=bool(imu.rest.any()))
    if not is_long:
        back(own, imu.until(end), fixes, out, first, there, kept, later, Later)
        return
    piece = FlightPiece.of(imu.until(end), out, first)
    back(own, piece.imu, fixes, piece.out, piece.first, there, kept, later, Later)
    taken = (slice(int(counts[0]), int(counts[-1])) for counts in (kept.fixes, kept.aids))
    piece.keep(out, piece.imu.time.size, *taken)


def _copy_filter(run: Filter) -> Filter:
    """Return a copy of a filter, which shares the updates by fixes and what does not change."""
    copied = Filter(
        **{name: values if name in SHARED else values.copy() for name, values in run._asdict().items()}
    )
    w = np.empty(run.w.size + 8)
    # To the begin of a cache line of 64 bytes, as `filter` aligns its workspace.
    offset = (-w.ctypes.data // 8) % 8
    w = w[offset : offset + run.w.size]
    w[:] = run.w
    return copied._replace(w=w, P=w[: run.P.size].reshape(run.P.shape))


@inline_kernel
def _copy(values: FloatArray, out: FloatArray) -> None:
    """Copy as many values as both have; a slice would also compile its error messages, for seconds."""
    for i in range(min(values.size, out.size)):
        out[i] = values[i]


@kernel
def _multiply(A: FloatArray, B: FloatArray, out: FloatArray) -> None:
    """Write A B."""
    for i in range(STATES):
        for j in range(STATES):
            out[i, j] = 0.0
        for k in range(STATES):
            a = A[i, k]
            if a != 0:
                for j in range(STATES):
                    out[i, j] += a * B[k, j]


@kernel
def _before_step(
    Phi: FloatArray, decay: FloatArray, later: FloatArray, Later: FloatArray, half: FloatArray
) -> None:
    """Propagate λ and Λ back over a step: λ ← Φᵀ λ, Λ ← Φᵀ Λ Φ."""
    row = half[0]
    for c in range(STATES):
        row[c] = _column(Phi, decay, later, c)
    for c in range(STATES):
        later[c] = row[c]
    for i in range(STATES):
        for c in range(STATES):
            half[i, c] = _column(Phi, decay, Later[i], c)  # Λ Φ
    for c in range(STATES):
        for i in range(STATES):
            total = half[i, c] * _kept_part(decay, i)
            for m in range(NAV):
                total += Phi[m, i] * half[m, c]
            Later[i, c] = total
    for i in range(STATES):
        for c in range(i):
            # Rounding makes Λ unsymmetric, and each further step would add to it.
            mean = 0.5 * (Later[i, c] + Later[c, i])
            Later[i, c], Later[c, i] = mean, mean


@inline_kernel
def _kept_part(decay: FloatArray, c: int) -> Any:
    """Return the element of Φ on the diagonal below the navigation rows; zero in these."""
    if NAV <= c < NAV + DRIVEN:
        return decay[c - NAV]
    return 0.0 if c < NAV else 1.0


@inline_kernel
def _column(Phi: FloatArray, decay: FloatArray, v: FloatArray, c: int) -> Any:
    """Return element c of Φᵀ v."""
    total = v[c] * _kept_part(decay, c)
    for m in range(NAV):
        total += Phi[m, c] * v[m]
    return total


@kernel
def _before_update(scalars: FloatArray, later: FloatArray, Later: FloatArray, product: FloatArray) -> None:
    """Propagate λ and Λ back over an update, scalar by scalar, the last one first.

    With h, gain k, innovation ν and its variance s: λ ← (I − k hᵀ)ᵀ λ − h ν / s and
    Λ ← (I − k hᵀ)ᵀ Λ (I − k hᵀ) + h hᵀ / s (Bierman 1973).
    """
    for scalar in range(scalars.shape[0] - 1, -1, -1):
        done = scalars[scalar]
        residual, s = done[2 * STATES], done[2 * STATES + 1]
        along, square = 0.0, 0.0
        for i in range(STATES):
            along += done[STATES + i] * later[i]
            total = 0.0
            for j in range(STATES):
                total += Later[i, j] * done[STATES + j]
            product[i] = total
            square += done[STATES + i] * total
        for i in range(STATES):
            later[i] -= done[i] * (along + residual / s)
            for j in range(STATES):
                Later[i, j] += (
                    done[i] * done[j] * (square + 1 / s) - done[i] * product[j] - product[i] * done[j]
                )


@kernel
def _before_aids(
    run: Filter,
    out: Solution,
    first: int,
    end: int,
    sample: int,
    later: FloatArray,
    Later: FloatArray,
    product: FloatArray,
) -> None:
    """Propagate λ and Λ back over the updates by the measurements of the aids of one sample."""
    for a in range(end - 1, first - 1, -1):
        if out.aid_sample[a] == sample:
            _before_update(run.aid_scalars[a], later, Later, product)


@kernel
def _smooth(w: FloatArray, later: FloatArray, Later: FloatArray, half: FloatArray, P: FloatArray) -> None:
    """Replace [P | x] by those of the smoothed error: P − P Λ P, x − P λ."""
    for i in range(STATES):
        for j in range(STATES):
            P[i, j] = w[WIDTH * i + j]
            w[WIDTH * i + X] -= P[i, j] * later[j]
    _multiply(P, Later, half)
    for i in range(STATES):
        for j in range(i, STATES):
            total = P[i, j]
            for k in range(STATES):
                total -= half[i, k] * P[k, j]
            w[WIDTH * i + j] = total
            w[WIDTH * j + i] = total


@loop_kernel
def smooth_backwards(
    run: Filter,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    first: int,
    schedule: Schedule,
    kept: _Kept,
    later: FloatArray,
    Later: FloatArray,
) -> None:
    """Write the smoothed solution of the samples of `imu` from number `first` on.

    The filter's covariances at the fixes are written first, and replaced afterwards.
    """
    x, spare, last = run.x, run.spare, imu.dtheta.shape[0]
    half, P, decay = kept.half, kept.P, kept.decay
    _copy(run.state, kept.state[last - first])
    _copy(run.w, kept.w[last - first])
    left = PENDING if has_estimate(run.w) else SETTLED
    kept.fixes[0], kept.aids[0] = run.counts[0], run.counts[2]
    for k in range(first, last):
        at, dt = k - first, imu.time[k + 1] - imu.time[k]
        step(run.state, get(imu.dtheta[k], 0), get(imu.dvelocity[k], 0), dt)
        m = run.counts[0]
        due = m < fixes.time.size and fixes.time[m] <= imu.time[k + 1] + SLACK * dt
        due |= aid_due(run, imu.time[k + 1], dt)
        if imu.rest.size > 0:
            hold_attitude(run.state, run.rest_sums, imu.rest[k])
        write_f(run.state, run.F)
        straighten(out.fix_held, m, run.state, run.P, run.F, dt)
        predict(run, dt, due, schedule.stride)
        if due or (imu.rest.size > 0 and imu.rest[k]):
            left = take_measurements(run, imu, fixes, out, k, schedule, left == PENDING)
        kept.fixes[at + 1], kept.aids[at + 1] = run.counts[0], run.counts[2]
        _copy(run.state, kept.state[at])
        _copy(run.w, kept.w[at])
        if out.rest[k + 1]:
            _copy(run.rest_scalars[0], kept.rest[at, 0])
        for i in range(NAV):
            for j in range(STATES):
                kept.Phi[at, i, j] = dt * run.F[i, j] + (1.0 if i == j else 0.0)
    for k in range(last - 1, first - 1, -1):
        at, dt = k - first, imu.time[k + 1] - imu.time[k]
        _copy(kept.w[at], run.w)
        _smooth(run.w, later, Later, half, P)
        state = write_corrected_state(kept.state[at], run.w, run.T, x, spare)
        store(out, k + 1, state, run.w, run.T)
        for m in range(kept.fixes[at + 1] - 1, kept.fixes[at] - 1, -1):
            if out.fix_sample[m] == k + 1:
                store_fix(out.fix_covariance[m], state, run.w, run.T)
                _before_update(run.scalars[m], later, Later, x)
        _before_aids(run, out, kept.aids[at], kept.aids[at + 1], k + 1, later, Later, x)
        if out.rest[k + 1]:
            _before_update(kept.rest[at], later, Later, x)
        for b in range(DRIVEN):
            decay[b] = 1 - dt * run.decay[b]
        _before_step(kept.Phi[at], decay, later, Later, half)
    if first == 0:
        _copy(kept.w[last], run.w)
        _smooth(run.w, later, Later, half, P)
        store(out, 0, write_corrected_state(kept.state[last], run.w, run.T, x, spare), run.w, run.T)


@functools.cache
def backward_pass(model: ErrorModel, *, aided: bool) -> Callable[..., None]:
    """Return the backward pass over some samples, compiled, or loaded from the disk, when first called."""
    return loop(smooth_backwards, model, aided=aided)
