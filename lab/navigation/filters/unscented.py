"""Unscented: the nonlinear filter: sigma points through the exact strapdown kinematics, attitude on SO(3).

The navigator and its sigma points, two for each state, are propagated together through every IMU sample, in a
wander-azimuth frame (`wander`), which has no pole. Mean and covariance are computed from the points 50 times
a second. At each measurement, and once a second without any, new points are placed about the mean. Only the
propagation of the process noise between two placements is linearised, so the attitude error may be as large
as that of an unknown heading.

References
----------
E. Kraft, *A quaternion-based unscented Kalman filter for orientation tracking*, FUSION 2003; J. L. Crassidis,
F. L. Markley, *Unscented filtering for spacecraft attitude estimation*, JGCD 26 (2003); P. D. Groves,
*Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 3.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lab.base.histories import SINGLE
from lab.navigation import strapdown
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.filters import blocks, wander_models
from lab.navigation.filters.error_models import write_map
from lab.navigation.filters.kalman import (
    RECOVERED,
    REJECTED,
    USED,
)
from lab.navigation.filters.schedule import EVERY_FIX, SLACK, Schedule, Stretch
from lab.navigation.filters.sigma_points import displace, draw_sigma_points, gather
from lab.navigation.filters.unscented_aids import observe_aid
from lab.navigation.filters.unscented_filter import (
    UnscentedFilter,
    check,
    check_heading,
)
from lab.navigation.filters.unscented_noise import decay_errors, drive
from lab.navigation.filters.unscented_updates import is_rest_due, judge_fix, update_at_rest, update_by_fix
from lab.navigation.kernels.compilation import embedded_kernel, entry_kernel, inline_kernel, is_ready, kernel
from lab.navigation.kernels.flight_piece import FlightPiece
from lab.navigation.kernels.generation import Variant, generate_module
from lab.navigation.kernels.lane_points import MOST_TURN, step_abreast, step_kernel, view_point
from lab.navigation.kernels.lane_views import LANES
from lab.navigation.kernels.propagation import NAV
from lab.navigation.lever_arm import mean_rates_at_fixes
from lab.navigation.navigator import PIECE, navigate_segments
from lab.navigation.solution import Belief, Fixes, Imu, Solution, Start, read_only
from lab.navigation.strapdown import GYRO_BIAS, Vector, get, step
from lab.navigation.wander import difference, store_state

FORMED = 0.02
"""Shortest time between two computations of mean and covariance, except at fixes [s]."""
HELD = 1.0
"""Longest time before new sigma points are placed [s]."""


def navigate(
    imu: Imu,
    fixes: Fixes,
    start: Start,
    belief: Belief,
    schedule: Schedule = EVERY_FIX,
    stretches: Sequence[Stretch] = (),
    aids: Aids = NO_AIDS,
    names: Sequence[str] | None = None,
) -> Solution:
    """Navigate a whole flight with the unscented filter; arguments and result as for `navigator.navigate`.

    `names` are the further blocks of states; by default, the scale factors if the belief has 21 states.
    Between two computations of the covariance (`FORMED`, or `schedule.stride` samples if that is longer), the
    output variance is the last one.

    Raises
    ------
    SettingError
        If the schedule is not supported: feedforward, or corrections less often than at each fix.
    """
    check(schedule)
    check_heading(belief.P0)
    is_long = imu.time.size > SINGLE
    if names is None:
        names = blocks.SCALES if belief.P0.shape[0] > blocks.CORE else ()
    shown = np.float32 if is_long else np.float64
    solution = Solution.empty(imu.time.size, fixes.time.size, names, shown, aids.time.size)
    turned = mean_rates_at_fixes(imu, fixes.time, belief.lever_arm, estimated=blocks.LEVER_ARM in names)
    run = UnscentedFilter.begin(start, belief, float(imu.time[0]), turned, names, aids)

    def navigate_piece(imu: Imu, out: Solution, first: int, schedule: Schedule) -> None:
        if not is_long:
            advance(run, imu, fixes, out, first, schedule)
            return
        fix, aid, piece = int(run.counts[0]), int(run.counts[2]), FlightPiece.of(imu, out, first)
        advance(run, piece.imu, fixes, piece.out, piece.first, schedule)
        used = slice(fix, int(run.counts[0])), slice(aid, int(run.counts[2]))
        piece.keep(out, piece.imu.time.size, *used)

    navigate_segments(run.noise, imu, solution, schedule, stretches, navigate_piece, PIECE if is_long else 0)
    return solution


@embedded_kernel
def _write_output_covariance(run: UnscentedFilter) -> None:
    """Write the covariance of the output errors, T P Tᵀ."""
    T, n, half, shown = run.T, run.x.size, run.half, run.shown
    write_map(run.state, T)
    for i in range(NAV):
        for j in range(n):
            half[i, j] = 0.0
        for c in range(NAV):
            t = T[i, c]
            if t != 0:
                for j in range(n):
                    half[i, j] += t * run.P[c, j]
    for i in range(NAV):
        for j in range(i, NAV):
            total = 0.0
            for c in range(NAV):
                total += half[i, c] * T[j, c]
            shown[i, j] = shown[j, i] = total
        for j in range(NAV, n):
            shown[i, j] = shown[j, i] = half[i, j]
    for i in range(NAV, n):
        for j in range(NAV, n):
            shown[i, j] = run.P[i, j]


@embedded_kernel
def _form(run: UnscentedFilter) -> None:
    """Compute mean and covariance from the points and from the noise since they were placed."""
    decay_errors(run, run.clock[0])
    gather(run.state, run.points, run.deviations, run.attitudes, run.mean, run.P, run.places)
    drive(run, run.clock[0])
    for i in range(run.x.size):
        for j in range(i + 1):  # one triangle for both, because roundoff would make them differ
            p = run.P[i, j] + run.driven[i, j]
            run.P[i, j] = p
            run.P[j, i] = p
    run.counts[1] = 0
    run.clock[0] = 0.0
    _write_output_covariance(run)


@embedded_kernel
def _centre(run: UnscentedFilter) -> None:
    """Move the navigator to the mean, and mark its sigma points as outdated."""
    displace(run.state, run.mean, run.places)
    for i in range(run.x.size):
        run.mean[i] = 0.0
        for j in range(run.x.size):
            run.driven[i, j] = 0.0
    # The next step draws them: a measurement at this sample still changes the mean and P.
    run.clock[1] = -1.0


@inline_kernel
def _store(out: Solution, k: int, run: UnscentedFilter) -> None:
    """Write sample k of the solution: the navigator minus its last difference to the mean of the points."""
    mean = run.spare
    for i in range(mean.size):
        mean[i] = run.state[i]
    displace(mean, run.mean, run.places)
    store_state(out, k, mean)
    for i in range(6):
        out.bias[k, i] = mean[GYRO_BIAS + i]
    for i in range(out.scale.shape[1]):
        out.scale[k, i] = mean[strapdown.GYRO_SCALE + i]
    at = 6 + out.scale.shape[1]
    for i in range(out.further.shape[1]):
        out.further[k, i] = mean[run.places[at + i]]
    for i in range(run.x.size):
        out.variance[k, i] = run.shown[i, i]
    for block in range(2):
        at = 6 * block
        out.covariance[k, block, 0] = run.shown[at, at + 1]
        out.covariance[k, block, 1] = run.shown[at, at + 2]
        out.covariance[k, block, 2] = run.shown[at + 1, at + 2]


@embedded_kernel
def _store_fix(out: Solution, m: int, sample: int, run: UnscentedFilter) -> None:
    """Write the results of fix m."""
    out.fix_sample[m] = sample
    for i in range(run.x.size):
        for j in range(run.x.size):
            out.fix_covariance[m, i, j] = run.shown[i, j]


@embedded_kernel
def _step(run: UnscentedFilter, dtheta: Vector, dvelocity: Vector, dt: float) -> None:
    """Advance the navigator and its sigma points by one IMU sample."""
    if run.clock[1] < 0:
        draw_sigma_points(run.state, run.P, run.order, run.root, run.x, run.points, run.places)
        run.clock[1] = 0.0
    step(run.state, dtheta, dvelocity, dt)
    # Abreast, the rotation is a series, which holds for small angles alone.
    if dtheta[0] * dtheta[0] + dtheta[1] * dtheta[1] + dtheta[2] * dtheta[2] < MOST_TURN * MOST_TURN:
        step_abreast(run.points, dtheta, dvelocity, dt, LANES)
    else:
        for point in range(2 * run.x.size):
            step(view_point(run.points, point), dtheta, dvelocity, dt)
    run.counts[1] += 1
    run.clock[0] += dt
    run.clock[1] += dt


@inline_kernel
def aid_due(run: UnscentedFilter, time: float, dt: float) -> bool:
    """Return False: without aids, no measurement of theirs is ever due."""
    return False


@inline_kernel
def take_aids(
    run: UnscentedFilter, out: Solution, k: int, time: float, dt: float, schedule: Schedule
) -> None:
    """Do nothing: without aids, there are no measurements of theirs."""


@inline_kernel
def _aid_due(run: UnscentedFilter, time: float, dt: float) -> bool:
    """Return whether a measurement of the aids is due at a time."""
    a = run.counts[2]
    return bool(a < run.aids.time.size and run.aids.time[a] <= time + SLACK * dt)


@kernel
def _take_aids(
    run: UnscentedFilter, out: Solution, k: int, time: float, dt: float, schedule: Schedule
) -> None:
    """Apply the measurements of the aids that are due at sample k."""
    while _aid_due(run, time, dt):
        a = run.counts[2]
        age = time - run.aids.time[a]
        if age <= dt * (1 + SLACK) and observe_aid(run, a, age, dt, schedule, out):
            out.aid_sample[a] = k + 1
            _write_output_covariance(run)
        run.counts[2] = a + 1


@entry_kernel
def filter_all(
    run: UnscentedFilter, imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule
) -> None:
    """Advance a filter over `imu` from sample `first` on."""
    if first == 0:
        _write_output_covariance(run)
        _store(out, 0, run)
    for k in range(first, imu.dtheta.shape[0]):
        time = imu.time[k + 1]
        dt = time - imu.time[k]
        _step(run, get(imu.dtheta[k], 0), get(imu.dvelocity[k], 0), dt)
        m = run.counts[0]
        fix_due = m < fixes.time.size and fixes.time[m] <= time + SLACK * dt
        rest_due = is_rest_due(run, imu, k, dt)
        due = fix_due or rest_due or aid_due(run, time, dt)
        # Without the slack, rounding of the sum of steps would at times put it off by a sample.
        if due or (run.counts[1] >= schedule.stride and run.clock[0] >= FORMED - SLACK * dt):
            _form(run)
            if due or run.clock[1] >= HELD - SLACK * dt:
                _centre(run)
        if rest_due and update_at_rest(run):
            out.rest[k + 1] = True
            _write_output_covariance(run)
        take_aids(run, out, k, time, dt, schedule)
        while fix_due:
            age = time - fixes.time[m]
            # Only a fix from before the samples is older, and of its time there is no state.
            if age <= dt * (1 + SLACK):
                nu = out.innovation[m]
                difference(run.state, age, age / dt, fixes.position[m], fixes.velocity_n[m], nu)
                became = judge_fix(run, m, age, time, schedule, nu, out)
                if became == REJECTED:
                    out.fix_rejected[m] = True
                else:
                    update_by_fix(run, nu, schedule.hold_heading and became == USED, out.fix_held[m])
                    _write_output_covariance(run)
                    _store_fix(out, m, k + 1, run)
                    out.fix_recovered[m] = became == RECOVERED
            m += 1
            run.counts[0] = m
            fix_due = m < fixes.time.size and fixes.time[m] <= time + SLACK * dt
        _store(out, k + 1, run)


@functools.cache
def driver(*, aided: bool) -> Callable[[UnscentedFilter, Imu, Fixes, Solution, int, Schedule], None]:
    """Return the loop over samples, which is compiled, or loaded from the disk, when first called."""
    own: dict[Any, Any] = {**wander_models.PSI.variant.kernels, step_abreast: step_kernel()}
    name = "nonlinear"
    if aided:
        own[aid_due], own[take_aids] = _aid_due, _take_aids
        name = "nonlinear aids"
    made: Callable[[UnscentedFilter, Imu, Fixes, Solution, int, Schedule], None] = generate_module(
        name, "The unscented filter, in a wander-azimuth frame.", [filter_all], Variant(own)
    )[filter_all]
    return made


def advance(
    run: UnscentedFilter, imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule
) -> None:
    """Advance a filter over the samples of `imu` from number `first` on.

    The flight may be passed whole or in pieces: the result is the same.
    """
    go = driver(aided=bool(run.aids.time.size))
    go(run, read_only(imu), read_only(fixes), out, first, schedule)


def is_compiled(*, aided: bool = False) -> bool:
    """Return whether the driver waits for no compiler: compiled here, or on the disk."""
    return is_ready(driver(aided=aided))
