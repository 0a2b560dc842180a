"""Kalman: the update of the error state with a GPS fix, which may be refused as implausible.

Sequential: the six measurements are made independent by the Cholesky factor of R and taken one after the
other, which needs no matrix inverse and subtracts from P only products of the form k kᵀ / s, so that P
stays symmetric and positive.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd
ed., ch. 3.2.7; Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
Navigation*, ch. 5.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import special

from lab.navigation.compilation import kernel
from lab.navigation.propagation import NAV, STATES, WIDTH, X

FloatArray = NDArray[np.float64]

MEASUREMENTS = 6
"""Position north, east, down, then velocity: the first six error states, seen directly (H = [I₆ 0])."""


def gate(probability: float, measurements: int = MEASUREMENTS) -> float:
    """Return the largest NIS of a fix that is used: the χ² quantile of a probability; 0 uses every fix.

    (Bar-Shalom, Li & Kirubarajan 5.4.2-3.)
    """
    return float(2 * special.gammaincinv(measurements / 2, probability)) if probability else math.inf


@kernel
def update(
    w: FloatArray,
    z: FloatArray,
    R: FloatArray,
    R_root: FloatArray,
    nu: FloatArray,
    S: FloatArray,
    gate: float = math.inf,
) -> bool:
    """Update [P | x] in the workspace with one fix, unless it is implausible; return whether it was used.

    Parameters
    ----------
    w
        Workspace of the propagation, holding [P | x]; changed in place.
    z : (6,) array
        Navigator minus GPS: position [m] and velocity [m/s], north, east, down.
    R, R_root : (6, 6) arrays
        Covariance of the fix, and its lower Cholesky factor.
    nu : (6,) array
        Receives the innovation z − H x.
    S : (6, 6) array
        Receives the innovation's covariance H P Hᵀ + R.
    gate
        Largest νᵀ S⁻¹ ν (NIS) of a fix that is used.
    """
    for i in range(MEASUREMENTS):
        nu[i] = z[i] - w[WIDTH * i + X]
        for j in range(MEASUREMENTS):
            S[i, j] = w[WIDTH * i + j] + R[i, j]
    if gate < math.inf and _normalised_square(nu, S) > gate:
        return False
    gain = np.empty(STATES)
    row = np.zeros(MEASUREMENTS)
    for m in range(MEASUREMENTS):
        whitened = _whitening_row(R_root, m, row, z)
        _scalar_update(w, row[: m + 1], whitened, gain)
    return True


@kernel
def update_through(
    T: FloatArray,
    w: FloatArray,
    z: FloatArray,
    R: FloatArray,
    R_root: FloatArray,
    nu: FloatArray,
    S: FloatArray,
    gate: float,
) -> bool:
    """Update as `update` where the error states are seen through the first six rows of T (9, 9)."""
    H_P = np.zeros(NAV)
    for i in range(MEASUREMENTS):
        nu[i] = z[i]
        for c in range(NAV):
            nu[i] -= T[i, c] * w[WIDTH * c + X]
            H_P[c] = 0.0
            for d in range(NAV):
                H_P[c] += T[i, d] * w[WIDTH * d + c]
        for j in range(MEASUREMENTS):
            S[i, j] = R[i, j]
            for c in range(NAV):
                S[i, j] += H_P[c] * T[j, c]
    if gate < math.inf and _normalised_square(nu, S) > gate:
        return False
    gain = np.empty(STATES)
    row = np.zeros(MEASUREMENTS)
    h = np.empty(NAV)
    for m in range(MEASUREMENTS):
        whitened = _whitening_row(R_root, m, row, z)
        for c in range(NAV):
            h[c] = 0.0
            for i in range(m + 1):
                h[c] += row[i] * T[i, c]
        _scalar_update(w, h, whitened, gain)
    return True


@kernel
def _normalised_square(nu: FloatArray, S: FloatArray) -> float:
    """Return νᵀ S⁻¹ ν, by elimination of one measurement after the other."""
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
def _whitening_row(R_root: FloatArray, m: int, row: FloatArray, z: FloatArray) -> float:
    """Write row m of the inverse of the Cholesky factor, and return its product with z."""
    row[m] = 1 / R_root[m, m]
    for j in range(m - 1, -1, -1):
        total = 0.0
        for k in range(j + 1, m + 1):
            total += row[k] * R_root[k, j]
        row[j] = -total / R_root[j, j]
    total = 0.0
    for j in range(m + 1):
        total += row[j] * z[j]
    return total


@kernel
def _scalar_update(w: FloatArray, h: FloatArray, z: float, gain: FloatArray) -> None:
    """Update with one measurement z of unit variance, seeing the first states through h."""
    s = 1.0
    residual = z
    for i in range(STATES):
        gain[i] = 0.0
        for j in range(h.size):
            gain[i] += w[WIDTH * i + j] * h[j]
    for j in range(h.size):
        s += h[j] * gain[j]
        residual -= h[j] * w[WIDTH * j + X]
    per_s = 1 / s
    for i in range(STATES):
        k = gain[i] * per_s
        w[WIDTH * i + X] += k * residual
        for j in range(i, STATES):
            p = w[WIDTH * i + j] - k * gain[j]
            w[WIDTH * i + j] = p
            w[WIDTH * j + i] = p
