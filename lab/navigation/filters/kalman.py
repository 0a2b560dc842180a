"""Kalman: the update of the error state with a GPS fix; an implausible fix is rejected or gets less weight.

A fix is z = H x + v. It measures position and velocity of the antenna: H contains the errors of position and
velocity and, through the lever arm, those of the attitude and the gyros. The update is sequential: the
Cholesky factor of R makes the six measurements independent, and they are used one after the other. This needs
no matrix inverse, and it subtracts only products of the form k kᵀ / s from P, so that P stays symmetric and
positive.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 3.2.7
and 14.3; Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*,
ch. 5; P. J. Huber, *Robust Statistics*, 2nd ed., ch. 7; G. Chang, *Robust Kalman filtering based on
Mahalanobis distance as outlier judging criterion*, J. Geodesy 88 (2014); G. Agamennoni, J. I. Nieto, E. M.
Nebot, *Approximate inference in state-space models with heavy-tailed noise*, IEEE Trans. Signal Processing 60
(2012).
"""

from __future__ import annotations

import math

import numpy as np
from scipy import special

from lab.base.arrays import FloatArray
from lab.navigation.filters.schedule import Schedule
from lab.navigation.kernels.compilation import allocating_kernel, kernel
from lab.navigation.kernels.propagation import STATES, WIDTH, X

MEASUREMENTS = 6
"""Measurements: position north, east, down, then velocity, of the antenna."""

EVERY, HUBER, STUDENT_T = 0, 1, 2
"""Weight of a fix in an update: full, or decreasing with its NIS."""

HUBER_NIS = 12.6
"""NIS above which Huber's weight decreases: the 95 % quantile for good fixes with six measurements."""
STUDENT_DEGREES = 4.0
"""Degrees of freedom of Student's t: the usual choice for heavy tails, with finite variance."""

ATTITUDE_LIMIT = 0.5
"""Largest σ that a recovery adds to the attitude: 30°, for which a linear filter still works [rad]."""
BIAS_GROWTH = 4.0
"""Factor on the variance of biases and scale factors in a recovery: twice the σ."""

_GRAVITY = 9.8  # m/s²


def gate(probability: float, measurements: int = MEASUREMENTS) -> float:
    """Return the largest NIS of a fix that is used: the χ² quantile of a probability; 0 uses every fix.

    (Bar-Shalom, Li & Kirubarajan 5.4.2-3.)
    """
    return float(2 * special.gammaincinv(measurements / 2, probability)) if probability else math.inf


@allocating_kernel
def predict_fix(P: FloatArray, H: FloatArray, R: FloatArray, S: FloatArray) -> None:
    """Write the covariance S = H P Hᵀ + R (6, 6) of an innovation; P is (n, ≥ n), H is (6, n)."""
    n = H.shape[1]
    row = np.empty(n)
    for i in range(MEASUREMENTS):
        for c in range(n):
            row[c] = 0.0
        for d in range(n):
            h = H[i, d]
            if h != 0:
                for c in range(n):
                    row[c] += h * P[d, c]
        for j in range(i + 1):
            total = R[i, j]
            for c in range(n):
                if H[j, c] != 0:
                    total += row[c] * H[j, c]
            S[i, j] = total
            S[j, i] = total


@allocating_kernel
def normalised_square(nu: FloatArray, S: FloatArray) -> float:
    """Return νᵀ S⁻¹ ν, eliminating one measurement after the other."""
    A, v = S.copy(), nu.copy()
    total = 0.0
    for m in range(MEASUREMENTS):
        total += v[m] * v[m] / A[m, m]
        for i in range(m + 1, MEASUREMENTS):
            factor = A[i, m] / A[m, m]
            v[i] -= factor * v[m]
            for j in range(m + 1, MEASUREMENTS):
                A[i, j] -= factor * A[m, j]
    return total


@kernel
def weight(robust: int, nis: float) -> float:
    """Return the weight w of a fix in a robust update; R is divided by it.

    Huber's is √(c / NIS) beyond c = `HUBER_NIS`, Student's t (ν + 6) / (ν + NIS), at most one, with ν =
    `STUDENT_DEGREES` (Huber ch. 7; Agamennoni et al. 2012, eq. 23).
    """
    if robust == HUBER and nis > HUBER_NIS:
        return math.sqrt(HUBER_NIS / nis)
    if robust == STUDENT_T:
        return min(1.0, (STUDENT_DEGREES + MEASUREMENTS) / (STUDENT_DEGREES + nis))
    return 1.0


@allocating_kernel
def is_outlier(
    streak: FloatArray, nu: FloatArray, S: FloatArray, nis: float, agreeing: int, any_of: int
) -> bool:
    """Count an implausible fix; return whether the filter must be wrong, not the fixes.

    Chance rejects good fixes one at a time, and outliers scatter. Consecutive fixes whose innovations have
    the same direction (within 60° in the metric of S), or a long row in any directions, indicate a wrong
    filter.

    Parameters
    ----------
    streak : (8,) array
        Number of consecutive implausible fixes, how many of them agree with the previous one, and the last
        innovation.
    nu, S, nis
        Innovation, its covariance, and its NIS.
    agreeing, any_of
        Number of consecutive fixes that indicate a wrong filter, if they agree, and if they do not.
    """
    both = np.empty(MEASUREMENTS)
    for i in range(MEASUREMENTS):
        both[i] = streak[2 + i]
    before = normalised_square(both, S)
    for i in range(MEASUREMENTS):
        both[i] += nu[i]
        streak[2 + i] = nu[i]
    # The product aᵀ S⁻¹ b from three squares: (|a + b|² − |a|² − |b|²) / 2.
    along = 0.5 * (normalised_square(both, S) - before - nis)
    # 0.5 is cos 60°.
    agrees = streak[0] > 0 and along > 0.5 * math.sqrt(before * nis)
    streak[0] += 1
    # One that disagrees is itself the first of the next row.
    streak[1] = streak[1] + 1 if agrees else 1.0
    return bool(streak[1] >= agreeing or streak[0] >= any_of)


@kernel
def inflate(P: FloatArray, nu: FloatArray, elapsed: float, n: int) -> None:
    """Increase P by the errors that agreeing implausible fixes imply.

    Position and velocity may be wrong by the innovation, the attitude by the tilt that gives such a velocity
    in the elapsed time. The variance of all other states grows by `BIAS_GROWTH`. All of it is added to the
    diagonal, so that P stays positive, and equally along all axes, so that it holds in any frame.

    Parameters
    ----------
    P : (n, ≥ n) array
        Covariance, changed in place.
    nu : (6,) array
        Innovation [m], [m/s].
    elapsed
        Time since the last fix that was used [s].
    n
        Number of states.
    """
    away = (nu[0] * nu[0] + nu[1] * nu[1] + nu[2] * nu[2]) / 3
    fast = (nu[3] * nu[3] + nu[4] * nu[4] + nu[5] * nu[5]) / 3
    # At least a second: over a shorter time, the noise of a velocity would look like a large tilt.
    tilt = min(math.sqrt(fast) / (_GRAVITY * max(elapsed, 1.0)), ATTITUDE_LIMIT)
    for i in range(9, n):
        P[i, i] *= BIAS_GROWTH
    for i in range(3):
        P[i, i] += away
        P[3 + i, 3 + i] += fast
        P[6 + i, 6 + i] += tilt * tilt


REJECTED, USED, RECOVERED = 0, 1, 2
"""Outcome of a fix: rejected, used, or used after P was raised."""


@kernel
def gate_fix(
    P: FloatArray,
    streak: FloatArray,
    clock: FloatArray,
    nu: FloatArray,
    S: FloatArray,
    nis: float,
    time: float,
    schedule: Schedule,
    n: int,
) -> int:
    """Return the outcome of a fix by its NIS; raise P if the filter must be wrong.

    Parameters
    ----------
    P : (n, ≥ n) array
        Covariance.
    streak : (8,) array
        Data of implausible fixes, as for `is_outlier`.
    clock : (3,) array
        Its last element is the time of the last plausible fix [s].
    nu, S, nis
        Innovation, its covariance, and its NIS.
    time
        Current time [s].
    schedule
        The limits.
    n
        Number of states.
    """
    if nis <= schedule.implausible:
        streak[0] = 0.0
        clock[2] = time
    elif is_outlier(streak, nu, S, nis, schedule.agreeing, schedule.any_of):
        inflate(P, nu, time - clock[2], n)
        streak[0] = 0.0
        clock[2] = time
        return RECOVERED
    return REJECTED if nis > schedule.gate else USED


@kernel
def cholesky_of_fix(R: FloatArray, root: FloatArray) -> None:
    """Write the lower Cholesky factor of R (6, 6)."""
    for j in range(MEASUREMENTS):
        for i in range(j, MEASUREMENTS):
            total = R[i, j]
            for k in range(j):
                total -= root[i, k] * root[j, k]
            root[i, j] = math.sqrt(total) if i == j else total / root[j, j]


@allocating_kernel
def update(w: FloatArray, z: FloatArray, H: FloatArray, R: FloatArray, scalars: FloatArray) -> None:
    """Update [P | x] in the workspace with one fix.

    Parameters
    ----------
    w
        Workspace of the propagation, holding [P | x]; changed in place.
    z : (6,) array
        Navigator minus GPS: position [m] and velocity [m/s], north, east, down.
    H : (6, n) array
        Measurement matrix of the fix.
    R : (6, 6) array
        Covariance of the fix.
    scalars : (6, 2 n + 2) array
        Receives the six scalar updates: row of H (n,), gain (n,), innovation and its variance.
    """
    root = np.zeros((MEASUREMENTS, MEASUREMENTS))
    cholesky_of_fix(R, root)
    row = np.zeros(MEASUREMENTS)
    for m in range(MEASUREMENTS):
        whitened = _whitening_row(root, m, row, z)
        done = scalars[m]
        for c in range(STATES):
            total = 0.0
            for i in range(m + 1):
                total += row[i] * H[i, c]
            done[c] = total
        scalar_update(w, whitened, done)


@kernel
def _whitening_row(R_root: FloatArray, m: int, row: FloatArray, z: FloatArray) -> float:
    """Write row m of the inverse of the Cholesky factor, and return its product with z."""
    row[m] = 1 / R_root[m, m]
    for j in range(m - 1, -1, -1):
        total = 0.0
        for k in range(j + 1, m + 1):
            total += row[k] * R_root[k, j]
        # From the diagonal to the left: a row of L⁻¹ needs only its own elements and L.
        row[j] = -total / R_root[j, j]
    total = 0.0
    for j in range(m + 1):
        total += row[j] * z[j]
    return total


@kernel
def scalar_update(w: FloatArray, z: float, done: FloatArray) -> None:
    """Update with one measurement z of unit variance; `done` holds its row of H, and receives the rest."""
    # R of the whitened measurement.
    s = 1.0
    residual = z
    for i in range(STATES):
        done[STATES + i] = 0.0
    for j in range(STATES):
        h = done[j]
        if h != 0:  # H is sparse
            for i in range(STATES):
                done[STATES + i] += w[WIDTH * j + i] * h
    for j in range(STATES):
        s += done[j] * done[STATES + j]
        residual -= done[j] * w[WIDTH * j + X]
    per_s = 1 / s
    for i in range(STATES):
        along = done[STATES + i]
        w[WIDTH * i + X] += along * per_s * residual
        for j in range(STATES):
            # The product of both first: so P stays symmetric to the last bit, in whole rows.
            w[WIDTH * i + j] -= along * done[STATES + j] * per_s
    for i in range(STATES):
        done[STATES + i] *= per_s
    done[2 * STATES] = residual
    done[2 * STATES + 1] = s
