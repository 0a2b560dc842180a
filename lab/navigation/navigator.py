"""Navigator: strapdown and error-state Kalman filter run together over IMU increments and GPS fixes.

`advance` is the navigator's only time step: a batch run passes a whole flight, a live run passes one sample
at a time.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from lab.base.arrays import FloatArray
from lab.base.histories import SINGLE
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.filters.blocks import LEVER_ARM, OF_AIDS
from lab.navigation.filters.error_models import PHI, ErrorModel
from lab.navigation.filters.filter import Filter
from lab.navigation.filters.kalman import MEASUREMENTS
from lab.navigation.filters.schedule import EVERY_FIX, Schedule, Stretch
from lab.navigation.frames import change, choose_model_here
from lab.navigation.kernels.compilation import is_ready
from lab.navigation.kernels.driver import driver
from lab.navigation.kernels.flight_piece import FlightPiece
from lab.navigation.lever_arm import mean_rates_at_fixes
from lab.navigation.solution import HISTORIES, Belief, Fixes, Imu, Solution, Start, read_only

PIECE = 2**14
"""Samples of a long flight that are navigated in one call, with some 420 bytes each at 21 states."""


Gather = Callable[[FlightPiece, slice], None]
"""Is given each piece of a flight with the samples in it that were written."""


def navigate(
    imu: Imu,
    fixes: Fixes,
    start: Start,
    belief: Belief,
    schedule: Schedule = EVERY_FIX,
    model: ErrorModel = PHI,
    stretches: Sequence[Stretch] = (),
    aids: Aids = NO_AIDS,
) -> Solution:
    """Navigate a whole flight with the compiled filter.

    Parameters
    ----------
    imu, fixes
        The measurements.
    start
        Initial position, velocity, attitude and gyro bias; other biases and scale factor errors are zero.
    belief
        The assumptions of the filter.
    schedule
        Times at which it propagates its covariance and corrects.
    model
        Error model of the filter, with as many states as the belief.
    stretches
        Stretches of a log, up to its end, if the conditions change.
    aids
        Measurements other than fixes.
    """
    shown = np.float32 if imu.time.size > SINGLE else np.float64
    solution = Solution.empty(imu.time.size, fixes.time.size, model.blocks, shown, aids.time.size)
    _fill(solution, imu, fixes, start, belief, schedule, model, stretches, aids)
    return solution


def navigate_to_fixes(
    imu: Imu,
    fixes: Fixes,
    start: Start,
    belief: Belief,
    schedule: Schedule,
    model: ErrorModel,
    aids: Aids,
    gather: Gather,
) -> Solution:
    """Navigate a whole long flight as `navigate` does, and keep only the data that explain its innovations.

    These are all data of the fixes, and the attitude at all samples, in float32. The other histories have one
    row, the start. So the solution takes 17 bytes per sample; a whole one takes 240 with 21 states.

    Parameters
    ----------
    imu, fixes, start, belief, schedule, model, aids
        As of `navigate`.
    gather
        Takes what else is wanted of each piece.
    """
    samples, count, n = imu.time.size, fixes.time.size, model.states
    solution = Solution.empty(1, count, model.blocks, aids=aids.time.size)._replace(
        q_nb=np.empty((samples, 4), dtype=np.float32),
        rest=np.zeros(samples, dtype=np.bool_),
        # Memory is taken only when it is written, so what is gathered may give it back.
        innovation_covariance=np.empty((count, MEASUREMENTS, MEASUREMENTS)),
        fix_covariance=np.empty((count, n, n)),
        fix_H=np.empty((count, MEASUREMENTS, n)),
        fix_R=np.empty((count, MEASUREMENTS, MEASUREMENTS)),
    )
    _fill(solution, imu, fixes, start, belief, schedule, model, aids=aids, gather=gather)
    return solution


def _fill(
    solution: Solution,
    imu: Imu,
    fixes: Fixes,
    start: Start,
    belief: Belief,
    schedule: Schedule,
    model: ErrorModel,
    stretches: Sequence[Stretch] = (),
    aids: Aids = NO_AIDS,
    gather: Gather | None = None,
) -> None:
    """Navigate a whole flight, and write the solution."""
    is_long = imu.time.size > SINGLE
    turned = mean_rates_at_fixes(imu, fixes.time, belief.lever_arm, estimated=LEVER_ARM in model.blocks)
    run = Filter.begin(start, belief, float(imu.time[0]), model, turned=turned, aids=aids)

    def navigate_piece(imu: Imu, out: Solution, first: int, schedule: Schedule) -> None:
        advance(run, imu, fixes, out, first, schedule, model, go)

    go = (
        partial(navigate_piece_within_frame, gather=gather) if is_long or gather is not None else within_frame
    )
    navigate_segments(run.noise, imu, solution, schedule, stretches, navigate_piece, PIECE if is_long else 0)


Onwards = Callable[[Imu, Solution, int, Schedule], None]
"""Advances a navigator from increment `first` on, and writes the solution."""


def navigate_segments(
    noise: FloatArray,
    imu: Imu,
    out: Solution,
    schedule: Schedule,
    stretches: Sequence[Stretch],
    onwards: Onwards,
    longest: int = 0,
) -> None:
    """Advance a navigator through a whole flight, stretch by stretch.

    Parameters
    ----------
    noise
        The filter's densities of the process noise; changed in place.
    imu, out, schedule, stretches
        As of `navigate`.
    onwards
        Advances the navigator.
    longest
        Largest number of samples per call; 0 for no limit.
    """
    samples, done = imu.dtheta.shape[0], 0
    for stretch in stretches or (Stretch(samples, schedule.gate, schedule.implausible, noise.copy()),):
        noise[:] = stretch.noise
        schedule = schedule._replace(gate=stretch.gate, implausible=stretch.implausible)
        while done < stretch.end:
            end = min(stretch.end, done + longest) if longest else stretch.end
            onwards(imu.until(end), out, done, schedule)
            done = end


def takes_aids(model: ErrorModel, aids: Aids) -> bool:
    """Return whether a filter is one for other measurements: it has some, or states for their errors.

    With such states, a run without measurements, as that for the observability, needs no second compilation.
    """
    return bool(aids.time.size) or not OF_AIDS.isdisjoint(model.blocks)


Go = Callable[[Filter, Imu, Fixes, Solution, int, Schedule, ErrorModel], int]
"""Advances a navigator as `within_frame` does."""


def within_frame(
    run: Filter, imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule, model: ErrorModel
) -> int:
    """Advance a navigator as `advance` does, as long as it stays in its frame.

    Returns the number of increments that were used.
    """
    model = choose_model_here(run.state, model)
    go = driver(model, summed=schedule.stride > 1, aided=takes_aids(model, run.aids))
    return go(run, read_only(imu), read_only(fixes), out, first, schedule)


def navigate_piece_within_frame(
    run: Filter,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    first: int,
    schedule: Schedule,
    model: ErrorModel,
    gather: Gather | None = None,
) -> int:
    """Advance a navigator as `within_frame` does, over histories that the kernel cannot write."""
    fix, aid = int(run.counts[0]), int(run.counts[2])
    piece = FlightPiece.of(imu, out, first)
    used = within_frame(run, piece.imu, fixes, piece.out, piece.first, schedule, model)
    piece.keep(out, used + 1, slice(fix, int(run.counts[0])), slice(aid, int(run.counts[2])))
    if gather is not None:
        gather(piece, piece.written(used + 1))
    return piece.before + used


def advance(
    run: Filter,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    first: int,
    schedule: Schedule,
    model: ErrorModel = PHI,
    go: Go = within_frame,
) -> None:
    """Advance a navigator over the increments of `imu` from number `first` on.

    The flight may be passed whole or in pieces: the result is the same. The model must be the one with which
    the navigator began. Over the poles, it goes on in another frame (`frames`).
    """
    while (first := go(run, imu, fixes, out, first, schedule, model)) < imu.dtheta.shape[0]:
        change(run.state, run.P, model)


def free_inertial(
    imu: Imu, start: Start, belief: Belief, schedule: Schedule = EVERY_FIX, model: ErrorModel = PHI
) -> Iterator[tuple[int, Solution]]:
    """Navigate a whole flight without fixes, piece by piece, so that no solution of all of it is needed.

    Parameters
    ----------
    imu, start, belief, schedule, model
        As of `navigate`; increments may be float32.

    Yields
    ------
    int, Solution
        Number of the first sample of a piece, and the solution there, which the next piece overwrites.
    """
    none = Fixes(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    run = Filter.begin(start, belief._replace(R=np.eye(6)), float(imu.time[0]), model)
    samples = imu.dtheta.shape[0]
    room = Solution.empty(min(PIECE, samples) + 1, 0, model.blocks)
    for first in range(0, samples, PIECE):
        last = min(first + PIECE, samples)
        piece = Imu(
            imu.time[first : last + 1],
            imu.dtheta[first:last].astype(np.float64, copy=False),
            imu.dvelocity[first:last].astype(np.float64, copy=False),
        )
        advance(run, piece, none, room, 0, schedule, model)
        written = {name: getattr(room, name)[: piece.time.size] for name in HISTORIES}
        yield first, room._replace(**written)


def load(belief: Belief, schedule: Schedule, model: ErrorModel = PHI, *, aided: bool = False) -> None:
    """Load, or compile, what advances a navigator, so that the first sample of a stream does not wait for it.

    Parameters
    ----------
    belief
        Any belief.
    schedule, model
        Those of the navigator.
    aided
        For measurements other than fixes.
    """
    start = Start(np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    imu = Imu(np.array([0.0, 0.01]), np.zeros((1, 3)), np.zeros((1, 3)))
    fixes = Fixes(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    P0 = belief.P0[: model.states, : model.states]
    later = NO_AIDS._replace(time=np.full(1, np.inf), kind=np.zeros(1, np.int64)) if aided else NO_AIDS
    run = Filter.begin(start, belief._replace(P0=P0), 0.0, model, aids=later)
    advance(run, imu, fixes, Solution.empty(2, 0, model.blocks, aids=later.time.size), 0, schedule, model)


def is_compiled(model: ErrorModel = PHI, *, aided: bool = False) -> bool:
    """Return whether the driver of a model waits for no compiler: compiled here, or on the disk."""
    return is_ready(driver(model, summed=False, aided=aided))
