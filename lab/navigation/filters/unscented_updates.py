"""Unscented updates: how fixes and the rates at rest correct the nonlinear filter.

H is linear except for the lever arm, which is small compared with relevant position errors. For a linear H,
the unscented transform is exact, and the update is that of the Kalman filter.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., 3.2.7.
"""

from __future__ import annotations

import numpy as np

from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.filters.heading_observability import (
    put_back_covariance,
    remove_directions,
    shows_heading,
    take_covariance,
    write_directions,
)
from lab.navigation.filters.held_heading import in_body
from lab.navigation.filters.kalman import (
    MEASUREMENTS,
    RECOVERED,
    REJECTED,
    cholesky_of_fix,
    gate_fix,
    normalised_square,
    predict_fix,
    weight,
)
from lab.navigation.filters.observation import felt_by_gyro, see_latency
from lab.navigation.filters.schedule import Schedule
from lab.navigation.filters.sigma_points import displace, transport
from lab.navigation.filters.unscented_filter import (
    GPS_DRIFT,
    GYRO_DRIFT,
    GYRO_G,
    LATENCY,
    LEVER_ARM,
    MISALIGNMENT,
    SCALE,
    UnscentedFilter,
)
from lab.navigation.filters.vertical_bias import raise_vertical_bias
from lab.navigation.kernels.compilation import embedded_kernel, inline_kernel, kernel
from lab.navigation.kernels.propagation import NAV
from lab.navigation.lever_arm import predict_antenna
from lab.navigation.solution import Imu, Solution
from lab.navigation.standstill import GATE, gather_rest, hold_attitude, predict_rest
from lab.navigation.strapdown import Matrix, get, put
from lab.navigation.wander import back, fix_axes, frame_rate


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
def judge_fix(
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
            # From the axes of the fix to those of w, in which the filter's errors are.
            put(H[i], at, back(axes, get(H[i], at)))
    predict_fix(run.P, H, R, S)
    nis = normalised_square(nu, S)
    became = gate_fix(run.P, run.streak, run.clock, nu, S, nis, time, schedule, n)
    if became != REJECTED:
        # P was just raised by this very innovation, which is why it counts in full.
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
def update_by_fix(run: UnscentedFilter, nu: FloatArray, may_hold: bool, held: FloatArray) -> None:
    """Update P with an innovation, and correct the navigator by the estimated error.

    `held` (3,) receives the vertical in b if heading and vertical gyro bias kept their estimates, which they
    do only if they `may_hold`.

    With S = L Lᵀ and W = P Hᵀ L⁻ᵀ, the estimate is W L⁻¹ ν, and P is reduced by W Wᵀ.
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
        # Forward substitution: L⁻¹ ν, and below, row by row, P Hᵀ L⁻ᵀ.
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
    vertical = (0.0, 0.0, 1.0)
    raise_vertical_bias(P, vertical, in_body(run.state, vertical))
    displace(run.state, x, run.places)
    transport(P, (x[6], x[7], x[8]))


@inline_kernel
def is_rest_due(run: UnscentedFilter, imu: Imu, k: int, dt: float) -> bool:
    """Process the rest flag of sample k; return whether an update at rest is due."""
    if imu.rest.size == 0:
        return False
    hold_attitude(run.state, run.rest_sums, imu.rest[k])
    return bool(imu.rest[k] and gather_rest(run.state, run.rest_sums, dt))


@embedded_kernel
def update_at_rest(run: UnscentedFilter) -> bool:
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
