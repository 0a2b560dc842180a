"""Navigator: strapdown and error-state Kalman filter run together over IMU increments and GPS fixes.

`advance` is the navigator's only time step: a batch run passes a whole flight, a live run passes one sample
at a time.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lab.histories import SINGLE
from lab.navigation import strapdown
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.blocks import LEVER_ARM
from lab.navigation.driver import driver
from lab.navigation.error_models import PHI, WANDER_AZIMUTH, ErrorModel
from lab.navigation.filter import Filter
from lab.navigation.lever_arm import turns
from lab.navigation.piece import Piece
from lab.navigation.schedule import EVERY_FIX, Schedule, Stretch
from lab.navigation.solution import HISTORIES, Belief, Fixes, Imu, Solution, Start, read_only

FloatArray = NDArray[np.float64]


PIECE = 2**16
"""Samples of a long flight that are navigated in one call, with some 220 bytes each."""


class PolarError(ValueError):
    """The flight comes closer to a pole than a north-slaved navigation frame allows."""


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

    Raises
    ------
    PolarError
        If a north-slaved navigator comes closer than 0.1° to a pole.
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
    aids: Aids = NO_AIDS,
) -> Solution:
    """Navigate a whole long flight as `navigate` does, and keep only the data that explain its innovations.

    These are all data of the fixes, and velocity and attitude at all samples, in float32. The other histories
    have one row, the start. So the solution takes 30 bytes per sample; a whole one takes 240 with 21 states.

    Parameters
    ----------
    imu, fixes, start, belief, schedule, model, aids
        As of `navigate`.

    Raises
    ------
    PolarError
        If a north-slaved navigator comes closer than 0.1° to a pole.
    """
    samples = imu.time.size
    solution = Solution.empty(1, fixes.time.size, model.blocks, aids=aids.time.size)._replace(
        velocity_n=np.empty((samples, 3), dtype=np.float32),
        q_nb=np.empty((samples, 4), dtype=np.float32),
        rest=np.zeros(samples, dtype=np.bool_),
    )
    _fill(solution, imu, fixes, start, belief, schedule, model, aids=aids)
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
) -> None:
    """Navigate a whole flight, and write the solution."""
    is_long = imu.time.size > SINGLE
    turned = turns(imu, fixes.time, belief.lever_arm, estimated=LEVER_ARM in model.blocks)
    run = Filter.begin(start, belief, float(imu.time[0]), model, turned=turned, aids=aids)

    def onwards(imu: Imu, out: Solution, first: int, schedule: Schedule) -> int:
        go = advance_piece if is_long else advance
        return go(run, imu, fixes, out, first, schedule, model)

    polar = model.mechanization == WANDER_AZIMUTH
    longest = PIECE if is_long else 0
    go_through(run.state, run.noise, imu, solution, schedule, stretches, onwards, longest, polar=polar)


Onwards = Callable[[Imu, Solution, int, Schedule], int]
"""Advances a navigator from increment `first` on, writes the solution, and returns where it stopped."""


def go_through(
    state: FloatArray,
    noise: FloatArray,
    imu: Imu,
    out: Solution,
    schedule: Schedule,
    stretches: Sequence[Stretch],
    onwards: Onwards,
    longest: int = 0,
    *,
    polar: bool = False,
) -> None:
    """Advance a navigator through a whole flight, stretch by stretch.

    Parameters
    ----------
    state, noise
        The strapdown's state, and the filter's densities of the process noise; changed in place.
    imu, out, schedule, stretches
        As of `navigate`.
    onwards
        Advances the navigator.
    longest
        Largest number of samples per call; 0 for no limit.
    polar
        Whether its frame works at a pole.

    Raises
    ------
    PolarError
        If a north-slaved navigator comes closer than 0.1° to a pole.
    """
    if not polar and abs(state[strapdown.LATITUDE]) > strapdown.MAX_LATITUDE:
        raise PolarError(POLAR.format(time=imu.time[0]))
    samples, done = imu.dtheta.shape[0], 0
    for stretch in stretches or (Stretch(samples, schedule.gate, schedule.implausible, noise.copy()),):
        noise[:] = stretch.noise
        schedule = schedule._replace(gate=stretch.gate, implausible=stretch.implausible)
        while done < stretch.end:
            end = min(stretch.end, done + longest) if longest else stretch.end
            stopped = onwards(imu.until(end), out, done, schedule)
            if stopped < end + 1:
                raise PolarError(POLAR.format(time=imu.time[stopped - 1]))
            done = end


POLAR = (
    "t = {time:.3f} s: closer than 0.1° to a pole, where a north-slaved navigation frame fails; accepted "
    "are latitudes up to 89.9°, or navigator.mechanization = wander azimuth, which works over the poles"
)
"""Message of a `PolarError`."""


def advance(
    run: Filter,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    first: int,
    schedule: Schedule,
    model: ErrorModel = PHI,
) -> int:
    """Advance a navigator over the samples of `imu` from number `first` on.

    Returns the number of samples written: fewer than there are times in `imu` if the navigator comes too
    close to a pole. The flight may be passed whole or in pieces: the result is the same. The model must be
    the one with which the navigator began.
    """
    go = driver(model, summed=schedule.stride > 1, aided=bool(run.aids.time.size))
    return go(run, read_only(imu), read_only(fixes), out, first, schedule)


def freely(
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

    Raises
    ------
    PolarError
        If a north-slaved navigator comes closer than 0.1° to a pole.
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
        polar = model.mechanization == WANDER_AZIMUTH
        if not polar and abs(run.state[strapdown.LATITUDE]) > strapdown.MAX_LATITUDE:
            raise PolarError(POLAR.format(time=piece.time[0]))
        stopped = advance(run, piece, none, room, 0, schedule, model)
        if stopped < piece.time.size:
            raise PolarError(POLAR.format(time=piece.time[stopped - 1]))
        written = {name: getattr(room, name)[:stopped] for name in HISTORIES}
        yield first, room._replace(**written)


def load(belief: Belief, schedule: Schedule, model: ErrorModel = PHI) -> None:
    """Load, or compile, what advances a navigator, so that the first sample of a stream does not wait for it.

    Parameters
    ----------
    belief
        Any belief.
    schedule, model
        Those of the navigator.
    """
    start = Start(np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    imu = Imu(np.array([0.0, 0.01]), np.zeros((1, 3)), np.zeros((1, 3)))
    fixes = Fixes(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    P0 = belief.P0[: model.states, : model.states]
    run = Filter.begin(start, belief._replace(P0=P0), 0.0, model)
    advance(run, imu, fixes, Solution.empty(2, 0, model.blocks), 0, schedule, model)


def advance_piece(
    run: Filter,
    imu: Imu,
    fixes: Fixes,
    out: Solution,
    first: int,
    schedule: Schedule,
    model: ErrorModel,
) -> int:
    """Advance a navigator as `advance` does, over samples with histories that the kernel cannot write."""
    fix, aid = int(run.counts[0]), int(run.counts[2])
    piece = Piece.of(imu, out, first)
    stopped = advance(run, piece.imu, fixes, piece.out, piece.first, schedule, model)
    piece.keep(out, stopped, slice(fix, int(run.counts[0])), slice(aid, int(run.counts[2])))
    return piece.before + stopped


def is_compiled(model: ErrorModel = PHI, *, aided: bool = False) -> bool:
    """Return whether the driver of a model is ready in this process: compiled, or loaded from the disk."""
    return bool(driver(model, summed=False, aided=aided).signatures)  # type: ignore[attr-defined]
