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

from lab.base.arrays import FloatArray
from lab.base.histories import SINGLE
from lab.navigation import strapdown
from lab.navigation.aids import NO_AIDS, Aids
from lab.navigation.filters import blocks, wander_models
from lab.navigation.filters.error_models import write_map
from lab.navigation.filters.heading_observability import (
    put_back_covariance,
    remove_directions,
    shows_heading,
    take_covariance,
    write_directions,
)
from lab.navigation.filters.kalman import (
    MEASUREMENTS,
    RECOVERED,
    REJECTED,
    USED,
    cholesky_of_fix,
    gate_fix,
    normalised_square,
    predict_fix,
    weight,
)
from lab.navigation.filters.observation import felt_by_gyro, in_body, see_latency
from lab.navigation.filters.schedule import EVERY_FIX, SLACK, Schedule, Stretch
from lab.navigation.filters.sigma_points import displace, gather, spread, transport
from lab.navigation.filters.unscented_aids import observe_aid
from lab.navigation.filters.unscented_filter import (
    GPS_DRIFT,
    GYRO_DRIFT,
    GYRO_G,
    LATENCY,
    LEVER_ARM,
    MISALIGNMENT,
    SCALE,
    UnscentedFilter,
    check,
    check_heading,
)
from lab.navigation.filters.unscented_noise import decay_errors, drive
from lab.navigation.filters.vertical_bias import apparent_vertical, raise_vertical_bias
from lab.navigation.kernels.compilation import embedded_kernel, entry_kernel, inline_kernel, is_ready, kernel
from lab.navigation.kernels.flight_piece import FlightPiece
from lab.navigation.kernels.generation import Variant, generated
from lab.navigation.kernels.lane_points import MOST_TURN, point_of, step_abreast, step_kernel
from lab.navigation.kernels.lane_step import LANES
from lab.navigation.kernels.propagation import NAV
from lab.navigation.lever_arm import mean_rates_at_fixes, predict_antenna
from lab.navigation.navigator import PIECE, navigate_segments
from lab.navigation.solution import Belief, Fixes, Imu, Solution, Start, read_only
from lab.navigation.standstill import GATE, gather_rest, hold_attitude, predict_rest
from lab.navigation.strapdown import GYRO_BIAS, Matrix, Vector, get, put, step
from lab.navigation.wander import back, difference, fix_axes, frame_rate, store_state

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

    def onwards(imu: Imu, out: Solution, first: int, schedule: Schedule) -> None:
        if not is_long:
            advance(run, imu, fixes, out, first, schedule)
            return
        fix, aid, piece = int(run.counts[0]), int(run.counts[2]), FlightPiece.of(imu, out, first)
        advance(run, piece.imu, fixes, piece.out, piece.first, schedule)
        used = slice(fix, int(run.counts[0])), slice(aid, int(run.counts[2]))
        piece.keep(out, piece.imu.time.size, *used)

    navigate_segments(run.noise, imu, solution, schedule, stretches, onwards, PIECE if is_long else 0)
    return solution


@embedded_kernel
def _show(run: UnscentedFilter) -> None:
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
    _show(run)


@embedded_kernel
def _centre(run: UnscentedFilter) -> None:
    """Move the navigator to the mean, and mark its sigma points as outdated."""
    displace(run.state, run.mean, run.places)
    for i in range(run.x.size):
        run.mean[i] = 0.0
        for j in range(run.x.size):
            run.driven[i, j] = 0.0
    run.clock[1] = -1.0


@embedded_kernel
def _see_slow_errors(run: UnscentedFilter, axes: Matrix, nu: FloatArray, H: FloatArray) -> None:
    """Add latency, GPS drift, gyro drift and g-sensitivity to the innovation of a fix and to its H.

    Those that are states.
    """
    felt = run.first[GYRO_G]
    latency, gps_drift, gyro_drift = run.first[LATENCY], run.first[GPS_DRIFT], run.first[GYRO_DRIFT]
    if latency >= 0:
        see_latency(run.state, axes, latency, nu, H)
    if gps_drift >= 0:
        for i in range(3):
            nu[i] += run.state[strapdown.GPS_DRIFT + i]
            H[i, gps_drift + i] = 1.0
    if gyro_drift >= 0:
        for i in range(MEASUREMENTS):
            for j in range(3):
                H[i, gyro_drift + j] = H[i, 9 + j]
    if felt >= 0:  # the rate about the fix is one as measured
        for i in range(MEASUREMENTS):
            for j in range(3):
                H[i, felt + j] = H[i, 9 + j] * felt_by_gyro(run.state, j)
                nu[i] += H[i, felt + j] * run.state[strapdown.GYRO_G + j]


@embedded_kernel
def _judge(
    run: UnscentedFilter, m: int, age: float, time: float, schedule: Schedule, nu: FloatArray, out: Solution
) -> int:
    """Write H and R of fix m, move its innovation to the antenna, and return its outcome."""
    H, R, S, n = run.H, run.R_fix, out.innovation_covariance[m], run.x.size
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            R[i, j] = run.R[min(m, run.R.shape[0] - 1), i, j]
        for j in range(n):
            H[i, j] = 1.0 if i == j else 0.0
    axes = fix_axes(run.state)
    turn = run.turns[min(m, run.turns.shape[0] - 1)]
    predict_antenna(
        run.state,
        run.lever_arm,
        turn,
        age,
        run.noise,
        axes,
        nu,
        H,
        R,
        run.first[SCALE] >= 0,
        run.first[LEVER_ARM],
        run.first[MISALIGNMENT],
    )
    _see_slow_errors(run, axes, nu, H)
    for i in range(MEASUREMENTS):
        for j in range(n):
            out.fix_H[m, i, j] = H[i, j]
        for at in range(0, 9, 3):
            put(H[i], at, back(axes, get(H[i], at)))
    predict_fix(run.P, H, R, S)
    nis = normalised_square(nu, S)
    became = gate_fix(run.P, run.streak, run.clock, nu, S, nis, time, schedule, n)
    if became != REJECTED:
        if became == RECOVERED:
            nis = 0.0
        per_weight = 1 / weight(schedule.robust, nis)
        for i in range(MEASUREMENTS):
            for j in range(MEASUREMENTS):
                R[i, j] *= per_weight
    for i in range(MEASUREMENTS):
        for j in range(MEASUREMENTS):
            out.fix_R[m, i, j] = R[i, j]
    return became


@kernel
def _keeps_heading(run: UnscentedFilter) -> bool:
    """Return whether a fix shows the heading by chance at most; write what its update must keep."""
    vertical, D = (0.0, 0.0, 1.0), run.directions
    write_directions(vertical, in_body(run.state, vertical), run.P, D)
    if shows_heading(run.P, run.H, run.R_fix, MEASUREMENTS, vertical, D):
        return False
    take_covariance(run.P, D, run.kept)
    return True


@embedded_kernel
def _update(run: UnscentedFilter, nu: FloatArray, may_hold: bool, held: FloatArray) -> None:
    """Update P with an innovation, and correct the navigator by the estimated error.

    `held` (3,) receives the vertical in b if heading and vertical gyro bias kept their estimates, which they
    do only if they `may_hold`.

    H is linear except for the lever arm, which is small compared with relevant position errors. For a linear
    H, the unscented transform is exact, and the update is that of the Kalman filter (Groves 3.2.7). With S =
    L Lᵀ and W = P Hᵀ L⁻ᵀ, the estimate is W L⁻¹ ν, and P is reduced by W Wᵀ.
    """
    P, x, H, S, D = run.P, run.x, run.H, run.S, run.directions
    root = np.zeros((MEASUREMENTS, MEASUREMENTS))
    predict_fix(P, H, run.R_fix, S)
    keeps = may_hold and _keeps_heading(run)
    cholesky_of_fix(S, root)
    W = np.empty((x.size, MEASUREMENTS))
    white = np.empty(MEASUREMENTS)
    for m in range(MEASUREMENTS):
        white[m] = nu[m]
        for k in range(m):
            white[m] -= root[m, k] * white[k]
        white[m] /= root[m, m]
    for i in range(x.size):
        x[i] = 0.0
        for m in range(MEASUREMENTS):
            W[i, m] = 0.0
            for j in range(x.size):
                W[i, m] += P[i, j] * H[m, j]
            for k in range(m):
                W[i, m] -= root[m, k] * W[i, k]
            W[i, m] /= root[m, m]
            x[i] += W[i, m] * white[m]
    for i in range(x.size):
        for j in range(x.size):
            total = 0.0
            for m in range(MEASUREMENTS):
                total += W[i, m] * W[j, m]
            P[i, j] -= total
    if keeps:
        put_back_covariance(P, D, run.kept)
        remove_directions(x, D)
        for i in range(3):
            held[i] = D[1, NAV + i]
    vertical, down = apparent_vertical(run.state)
    raise_vertical_bias(P, vertical, down)
    displace(run.state, x, run.places)
    transport(P, (x[6], x[7], x[8]))


@inline_kernel
def _rests(run: UnscentedFilter, imu: Imu, k: int, dt: float) -> bool:
    """Process the rest flag of sample k; return whether an update at rest is due."""
    if imu.rest.size == 0:
        return False
    hold_attitude(run.state, run.rest_sums, imu.rest[k])
    return bool(imu.rest[k] and gather_rest(run.state, run.rest_sums, dt))


@embedded_kernel
def _update_at_rest(run: UnscentedFilter) -> bool:
    """Update with the mean rate about the vertical at rest; return False if the vehicle turns."""
    P, x, state, drift, felt = run.P, run.x, run.state, run.first[GYRO_DRIFT], run.first[GYRO_G]
    H, gain = np.empty(6), np.empty(x.size)
    z = predict_rest(state, frame_rate(state), run.noise, run.rest_sums, H)
    s = 1.0
    for i in range(x.size):
        gain[i] = 0.0
        for j in range(6):
            gain[i] += P[i, 6 + j] * H[j]
        for j in range(3 if drift >= 0 else 0):
            gain[i] += P[i, drift + j] * H[3 + j]
        for j in range(3 if felt >= 0 else 0):
            gain[i] += P[i, felt + j] * H[3 + j] * felt_by_gyro(state, j)
    for j in range(6):
        s += H[j] * gain[6 + j]
    for j in range(3 if drift >= 0 else 0):
        s += H[3 + j] * gain[drift + j]
    for j in range(3 if felt >= 0 else 0):
        s += H[3 + j] * felt_by_gyro(state, j) * gain[felt + j]
    if z * z > GATE * s:
        return False
    for i in range(x.size):
        x[i] = gain[i] / s * z
        for j in range(x.size):
            P[i, j] -= gain[i] * gain[j] / s
    displace(state, x, run.places)
    transport(P, (x[6], x[7], x[8]))
    return True


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
        spread(run.state, run.P, run.order, run.root, run.x, run.points, run.places)
        run.clock[1] = 0.0
    step(run.state, dtheta, dvelocity, dt)
    if dtheta[0] * dtheta[0] + dtheta[1] * dtheta[1] + dtheta[2] * dtheta[2] < MOST_TURN * MOST_TURN:
        step_abreast(run.points, dtheta, dvelocity, dt, LANES)
    else:
        for point in range(2 * run.x.size):
            step(point_of(run.points, point), dtheta, dvelocity, dt)
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
            _show(run)
        run.counts[2] = a + 1


@entry_kernel
def filter_all(
    run: UnscentedFilter, imu: Imu, fixes: Fixes, out: Solution, first: int, schedule: Schedule
) -> None:
    """Advance a filter over `imu` from sample `first` on."""
    if first == 0:
        _show(run)
        _store(out, 0, run)
    for k in range(first, imu.dtheta.shape[0]):
        time = imu.time[k + 1]
        dt = time - imu.time[k]
        _step(run, get(imu.dtheta[k], 0), get(imu.dvelocity[k], 0), dt)
        m = run.counts[0]
        fix_due = m < fixes.time.size and fixes.time[m] <= time + SLACK * dt
        rest_due = _rests(run, imu, k, dt)
        due = fix_due or rest_due or aid_due(run, time, dt)
        if due or (run.counts[1] >= schedule.stride and run.clock[0] >= FORMED - SLACK * dt):
            _form(run)
            if due or run.clock[1] >= HELD - SLACK * dt:
                _centre(run)
        if rest_due and _update_at_rest(run):
            out.rest[k + 1] = True
            _show(run)
        take_aids(run, out, k, time, dt, schedule)
        while fix_due:
            age = time - fixes.time[m]
            if age <= dt * (1 + SLACK):
                nu = out.innovation[m]
                difference(run.state, age, age / dt, fixes.position[m], fixes.velocity_n[m], nu)
                became = _judge(run, m, age, time, schedule, nu, out)
                if became == REJECTED:
                    out.fix_rejected[m] = True
                else:
                    _update(run, nu, schedule.hold_heading and became == USED, out.fix_held[m])
                    _show(run)
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
    made: Callable[[UnscentedFilter, Imu, Fixes, Solution, int, Schedule], None] = generated(
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
