"""Lanes: eight runs of one filter abreast, with different measurements at the same times.

Strapdown and propagation of P, at each sample, are computed for the eight runs together (`lane_step`). At a
fix, each run in turn is copied into an ordinary filter, which takes the fix as in a single run, and back. No
histories are stored: the samples to store are given.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.filters.error_models import NORTH_SLAVED, ErrorModel
from lab.navigation.filters.filter import Filter, aligned_zeros, initial_state
from lab.navigation.filters.schedule import SLACK, Schedule
from lab.navigation.kernels.compilation import embedded_kernel, is_ready, kernel, loop_kernel
from lab.navigation.kernels.driver import steps, take_measurements
from lab.navigation.kernels.generation import Redecorated, Variant, generate_module
from lab.navigation.kernels.lane_propagation import arrive, fly, generate_flight
from lab.navigation.kernels.lane_step import COVARIANCE, INCREMENTS, WHITE, lane_layout, sum_increments
from lab.navigation.kernels.lane_views import LANES, numbers
from lab.navigation.kernels.propagation import NAV, STATES, WIDTH, X, layout
from lab.navigation.kernels.storage import store
from lab.navigation.solution import Belief, Fixes, Imu, Solution, Start, read_only

Samples = NDArray[np.int64]

MOTION = strapdown.GYRO_BIAS
"""Numbers of the motion in the state: position, velocity, attitude."""


class Lane(NamedTuple):
    """The input of one run.

    Attributes
    ----------
    position, velocity_n : (m, 3) arrays
        Its fixes, as of `Fixes`.
    start, belief : Start, Belief
        Its start, and the assumptions of its filter; R is that of all runs.
    """

    position: FloatArray
    velocity_n: FloatArray
    start: Start
    belief: Belief


class LaneSolution(NamedTuple):
    """The solution of one run at some samples.

    Attributes
    ----------
    solution : Solution
        Histories with a row for each stored sample, and all data of the fixes; `fix_sample` counts all
        samples.
    motion : (l, 10) array
        Position [rad], [m], velocity [m/s] and attitude at the samples of the path.
    force : (k, 3) array
        Sum of the velocity increments up to each stored sample, each resolved in n by the attitude after it
        [m/s].
    """

    solution: Solution
    motion: FloatArray
    force: FloatArray


class Counters(NamedTuple):
    """What each run of a block keeps of a `Filter` besides state and covariance."""

    counts: NDArray[np.int64]
    clock: FloatArray
    streak: FloatArray


@kernel
def _load_shown(run: Filter, buffer: FloatArray, lane: int) -> None:
    """Copy what is stored of a run of the block into a filter: its state, and a part of P."""
    for i in range(strapdown.LENGTH):
        run.state[i] = buffer[i * LANES + lane]
    for i in range(NAV):
        for j in range(NAV):
            run.w[WIDTH * i + j] = buffer[(COVARIANCE + STATES * i + j) * LANES + lane]
    for i in range(NAV, STATES):
        run.w[(WIDTH + 1) * i] = buffer[(COVARIANCE + (STATES + 1) * i) * LANES + lane]


@kernel
def _load(run: Filter, buffer: FloatArray, kept: Counters, lane: int) -> None:
    """Copy a run of the block into a filter without a pending estimate."""
    for i in range(strapdown.LENGTH):
        run.state[i] = buffer[i * LANES + lane]
    for i in range(STATES):
        for j in range(STATES):
            run.w[WIDTH * i + j] = buffer[(COVARIANCE + STATES * i + j) * LANES + lane]
        run.w[WIDTH * i + X] = 0.0
    for i in range(run.counts.size):
        run.counts[i] = kept.counts[lane, i]
    for i in range(run.clock.size):
        run.clock[i] = kept.clock[lane, i]
    for i in range(run.streak.size):
        run.streak[i] = kept.streak[lane, i]


@kernel
def _save(run: Filter, buffer: FloatArray, kept: Counters, lane: int) -> None:
    """Copy a filter back into its block."""
    for i in range(strapdown.LENGTH):
        buffer[i * LANES + lane] = run.state[i]
    for i in range(STATES):
        for j in range(STATES):
            buffer[(COVARIANCE + STATES * i + j) * LANES + lane] = run.w[WIDTH * i + j]
    for i in range(run.counts.size):
        kept.counts[lane, i] = run.counts[i]
    for i in range(run.clock.size):
        kept.clock[lane, i] = run.clock[i]
    for i in range(run.streak.size):
        kept.streak[lane, i] = run.streak[i]


@loop_kernel
def advance(
    run: Filter,
    buffer: FloatArray,
    kept: Counters,
    imu: Imu,
    increments: FloatArray,
    fixes: Fixes,
    schedule: Schedule,
    stops: Samples,
    stored: Samples,
    path: Samples,
    out: Solution,
    motion: FloatArray,
    force: FloatArray,
    pace: FloatArray,
    lanes: int,
) -> None:
    """Advance a block over all samples, stopping at those with a fix and at those to store."""
    at, r, s = 0, 0, 0
    for stop in stops:
        if stop > at:
            fly(buffer, imu.time, increments, at, stop, schedule.stride, pace, lanes)
            at = stop
            time, dt = imu.time[at], imu.time[at] - imu.time[at - 1]
            if fixes.time[kept.counts[0, 0]] <= time + SLACK * dt:
                arrive(buffer, pace)
                for lane in range(LANES):
                    _load(run, buffer, kept, lane)
                    take_measurements(run, imu, fixes, out, at - 1, schedule, False)
                    _save(run, buffer, kept, lane)
        if s < path.size and path[s] == at:
            for lane in range(LANES):
                for i in range(MOTION):
                    motion[lane, s, i] = buffer[i * LANES + lane]
            s += 1
        if r < stored.size and stored[r] == at:
            for lane in range(LANES):
                _load_shown(run, buffer, lane)
                given = numbers(buffer, INCREMENTS, lane)
                force[lane, r, 0], force[lane, r, 1], force[lane, r, 2] = sum_increments(run.state, given)
                store(out, lane * stored.size + r, run.state, run.w, run.T)
            r += 1


@functools.cache
def _advance(model: ErrorModel, *, summed: bool) -> Callable[..., None]:
    """Return the loop over all samples for a model, which is compiled, or loaded, when first called."""
    parts = steps(model, summed=summed)
    kernels, constants = parts.variant.kernels, parts.variant.constants
    flight = generate_flight(model, parts.variant, summed=summed)
    # Embedded: a call with so many arrays takes a third of the time of a fix.
    taking = Redecorated(take_measurements, embedded_kernel)
    variant = Variant({**kernels, **flight.variant.kernels, take_measurements: taking}, constants)
    name, title = f"lanes {model.label}{' sums' * summed}", f"Eight runs abreast of the filter {model.label}."
    made = generate_module(name, title, [advance], variant, [parts, flight])
    whole: Callable[..., None] = made[advance]
    return whole


def is_compiled(model: ErrorModel, *, summed: bool = False) -> bool:
    """Return whether runs abreast of a model wait for no compiler: compiled here, or on the disk."""
    return is_ready(_advance(model, summed=summed))


def can_batch(model: ErrorModel, schedule: Schedule, belief: Belief) -> bool:
    """Return whether a block of runs can be navigated abreast, with fixes and without other measurements.

    The estimate must be zero between the fixes, the frame north-slaved, and the antenna at the IMU. States
    come in threes.
    """
    return (
        model.mechanization == NORTH_SLAVED
        and schedule.feedback
        and schedule.correction_period == 0
        and model.states % 3 == 0
        and belief.R.ndim == 2
        and not belief.lever_arm.any()
    )


def navigate_lanes(
    time: FloatArray,
    increments: FloatArray,
    fix_time: FloatArray,
    runs: Sequence[Lane],
    schedule: Schedule,
    model: ErrorModel,
    stored: Samples,
    path: Samples,
) -> list[LaneSolution]:
    """Navigate up to eight runs abreast.

    Parameters
    ----------
    time : (n + 1,) array
        Times of the IMU samples of all runs [s].
    increments : (n, 6, LANES) array
        Angle [rad] and velocity increments [m/s] of each sample of each run; those of unused lanes repeat
        a run.
    fix_time : (m,) array
        Times of validity of the fixes of all runs [s].
    runs
        The runs.
    schedule, model
        Those of `navigator.navigate`; see `can_batch`.
    stored, path
        Samples, increasing, at which everything, and the motion only, is stored.
    """
    # Unused lanes repeat the last run.
    lanes = [*runs, *[runs[-1]] * (LANES - len(runs))]
    fixes = _all_fixes(fix_time, lanes)
    run = Filter.begin(lanes[0].start, lanes[0].belief, float(time[0]), model)
    buffer, kept = _block(run, lanes, model, fix_time.size + 1)
    out = Solution.empty(LANES * stored.size, fixes.time.size, model.blocks)
    motion = np.empty((LANES, path.size, MOTION))
    force = np.empty((LANES, stored.size, 3))
    none = np.empty((0, 3))
    # As the driver sees it: a fix that rounding puts just behind a sample belongs to that sample.
    fixed = np.searchsorted(time, fix_time - SLACK * float(time[1] - time[0]))
    last = time.size - 1
    stops = np.zeros(time.size, dtype=np.bool_)
    for samples in (stored, path, fixed[fixed <= last], last):
        stops[samples] = True
    _advance(model, summed=schedule.stride > 1)(
        run,
        buffer.reshape(-1),
        kept,
        read_only(Imu(time, none, none)),
        increments,
        fixes,
        schedule,
        np.flatnonzero(stops),
        stored,
        path,
        out,
        motion,
        force,
        np.zeros(2),
        LANES,
    )
    return [
        LaneSolution(_part(out, lane, stored.size, fix_time.size), motion[lane], force[lane])
        for lane in range(len(runs))
    ]


def _all_fixes(time: FloatArray, lanes: Sequence[Lane]) -> Fixes:
    """Return the fixes of all runs one after the other; after those of a run, one that is never due."""
    never = np.zeros((1, 3))
    return read_only(
        Fixes(
            np.tile(np.append(time, np.inf), len(lanes)),
            np.concatenate([part for lane in lanes for part in (lane.position, never)]),
            np.concatenate([part for lane in lanes for part in (lane.velocity_n, never)]),
        )
    )


def _block(run: Filter, lanes: Sequence[Lane], model: ErrorModel, fixes: int) -> tuple[FloatArray, Counters]:
    """Return the numbers of some runs side by side, and what else they keep; each has so many fixes.

    The filter is that of one of them at its start.
    """
    n, space, place = model.states, layout(model.blocks), lane_layout(model.blocks)
    buffer = aligned_zeros(LANES * place.END).reshape(-1, LANES)
    for own, lane in enumerate(lanes):
        state, P = initial_state(lane.start, lane.belief, model)
        for first, values in (
            (0, state[: strapdown.LENGTH]),
            (COVARIANCE, P[:n, :n].ravel()),
            (place.DECAY, lane.belief.decay[: space.DRIVEN]),
            (place.NOISE, lane.belief.noise[: WHITE + space.DRIVEN]),
        ):
            buffer[first : first + values.size, own] = values
    counts = np.tile(run.counts, (LANES, 1))
    # Where each run's own fixes begin among those of all.
    counts[:, 0] = fixes * np.arange(LANES)
    return buffer, Counters(counts, np.tile(run.clock, (LANES, 1)), np.tile(run.streak, (LANES, 1)))


_OF_FIXES = tuple(name for name in Solution._fields if name.startswith(("fix_", "innovation")))


def _part(out: Solution, lane: int, stored: int, fixes: int) -> Solution:
    """Return the solution of one run."""
    samples = slice(lane * stored, (lane + 1) * stored)
    own = slice(lane * (fixes + 1), lane * (fixes + 1) + fixes)
    taken = {
        name: values[own if name in _OF_FIXES else samples]
        for name, values in out._asdict().items()
        if not name.startswith("aid_")
    }
    return out._replace(**taken)
