"""Unscented noise: the covariance from process noise between two placements of the sigma points.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.2.
"""

from __future__ import annotations

import math

from lab.navigation import strapdown
from lab.navigation.filters.unscented_filter import GYRO_DRIFT, UnscentedFilter
from lab.navigation.kernels.compilation import inline_kernel
from lab.navigation.kernels.lane_points import view_point
from lab.navigation.strapdown import Matrix, get, plus, put
from lab.navigation.wander import quaternion


@inline_kernel
def decay_errors(run: UnscentedFilter, elapsed: float) -> None:
    """Let slow errors decay: those of the navigator and of all points, and the covariance from noise."""
    for b in range(run.decay.size):
        if run.decay[b] > 0:
            kept, place = math.exp(-run.decay[b] * elapsed), run.places[b]
            run.state[place] *= kept
            for point in range(2 * run.x.size):
                view_point(run.points, point)[place] *= kept
            for i in range(run.x.size):
                run.driven[9 + b, i] *= kept
            for i in range(run.x.size):
                run.driven[i, 9 + b] *= kept


@inline_kernel
def _add_noise(run: UnscentedFilter, C_nb: Matrix, elapsed: float) -> None:
    """Add the process noise of some time; white noise enters through C_nb."""
    for block in range(2):
        at = 6 - 3 * block  # gyro noise drives the attitude, accelerometer noise the velocity
        for i in range(3):
            for j in range(3):
                total = 0.0
                for k in range(3):
                    total += C_nb[i][k] * C_nb[j][k] * run.noise[3 * block + k]
                run.driven[at + i, at + j] += elapsed * total
    for b in range(run.noise.size - 6):
        run.driven[9 + b, 9 + b] += elapsed * run.noise[6 + b]


@inline_kernel
def drive(run: UnscentedFilter, elapsed: float) -> None:
    """Propagate the covariance from noise over the elapsed time, and add the noise of that time.

    Half of the noise is added before and half after, which is accurate to second order in that time. The
    covariance is small and lasts for a second at most, so only these error rates matter: δṙ = δv, δv̇ = f × φ
    − C_nb δb_a and φ̇ = C_nb δb_g.
    """
    D, n, drift = run.driven, run.x.size, run.first[GYRO_DRIFT]
    C_nb = strapdown.matrix(quaternion(run.state, strapdown.Q_NB))
    force = get(run.state, strapdown.FORCE_N)
    _add_noise(run, C_nb, 0.5 * elapsed)
    # Φ D, column by column; then (Φ D) Φᵀ, row by row.
    for i in range(n):
        v, phi = (D[3, i], D[4, i], D[5, i]), (D[6, i], D[7, i], D[8, i])
        gyro, accel = (D[9, i], D[10, i], D[11, i]), (D[12, i], D[13, i], D[14, i])
        if drift >= 0:
            gyro = gyro[0] + D[drift, i], gyro[1] + D[drift + 1, i], gyro[2] + D[drift + 2, i]
            accel = accel[0] + D[drift + 3, i], accel[1] + D[drift + 4, i], accel[2] + D[drift + 5, i]
        acceleration_error = plus(strapdown.cross(force, phi), -1.0, strapdown.rotate(C_nb, accel))
        turn = strapdown.rotate(C_nb, gyro)
        for j in range(3):
            D[j, i] += elapsed * v[j]
            D[3 + j, i] += elapsed * acceleration_error[j]
            D[6 + j, i] += elapsed * turn[j]
    for i in range(n):
        v, phi, gyro, accel = get(D[i], 3), get(D[i], 6), get(D[i], 9), get(D[i], 12)
        if drift >= 0:
            gyro = plus(gyro, 1.0, get(D[i], drift))
            accel = plus(accel, 1.0, get(D[i], drift + 3))
        acceleration_error = plus(strapdown.cross(force, phi), -1.0, strapdown.rotate(C_nb, accel))
        put(D[i], 0, plus(get(D[i], 0), elapsed, v))
        put(D[i], 3, plus(v, elapsed, acceleration_error))
        put(D[i], 6, plus(phi, elapsed, strapdown.rotate(C_nb, gyro)))
    _add_noise(run, C_nb, 0.5 * elapsed)
