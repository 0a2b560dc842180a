"""Error models: the matrix F of ẋ = F x + w, declared block by block.

The error is estimate minus truth, in the order `STATES`; position errors are metres north, east, down; the
attitude error φ is the small rotation of the computed navigation frame, Ĉ_nb = (I − [φ×]) C_nb. A model is
a function that writes the non-zero elements of F; which elements those are is found by calling it, and the
code that propagates the covariance is generated from that pattern.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.2;
D. H. Titterton, J. L. Weston, *Strapdown Inertial Navigation Technology*, 2nd ed., ch. 12.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab import earth
from lab.navigation import strapdown
from lab.navigation.compilation import inline_kernel, interpreted
from lab.navigation.strapdown import Vector, get

FloatArray = NDArray[np.float64]

POS, VEL, ATT, GYRO_BIAS, ACCEL_BIAS = (slice(i, i + 3) for i in range(0, 15, 3))

STATES = (
    *("position north", "position east", "position down"),
    *("velocity north", "velocity east", "velocity down"),
    *("attitude north", "attitude east", "attitude down"),
    *("gyro bias x", "gyro bias y", "gyro bias z"),
    *("accelerometer bias x", "accelerometer bias y", "accelerometer bias z"),
)
"""Names of the error states, in order."""

# First index of each block, for the declarations below.
P, V, A, G, B = 0, 3, 6, 9, 12
N, E, D = 0, 1, 2

gravity_gradient = inline_kernel(earth.gravity_gradient)


@dataclass(frozen=True)
class ErrorModel:
    """An error model: its name and the function that writes F.

    Attributes
    ----------
    name
        As in the settings.
    write
        ``write(state, F)`` writes the non-zero elements of F for the navigator's `strapdown` state after a
        step. The first-order decay of the biases is not part of it.
    """

    name: str
    write: Callable[[FloatArray, FloatArray], None]

    def pattern(self) -> NDArray[np.bool_]:
        """Return which elements of F can differ from zero, (15, 15)."""
        write = interpreted(self.write)
        rng = np.random.default_rng(0)
        F = np.zeros((15, 15))
        seen = np.zeros((15, 15), dtype=np.bool_)
        for _ in range(3):
            state = rng.uniform(0.1, 0.5, strapdown.LENGTH)
            state[strapdown.HEIGHT] = 1000.0
            write(state, F)
            seen |= F != 0
        return seen


@inline_kernel
def skew(F: FloatArray, row: int, column: int, v: Vector) -> None:
    """Write the block [v ×]."""
    F[row, column + 1], F[row, column + 2] = -v[2], v[1]
    F[row + 1, column], F[row + 1, column + 2] = v[2], -v[0]
    F[row + 2, column], F[row + 2, column + 1] = -v[1], v[0]


@inline_kernel
def attitude_matrix(F: FloatArray, row: int, column: int, sign: float, state: FloatArray) -> None:
    """Write the block ± C_nb."""
    for i in range(3):
        for j in range(3):
            F[row + i, column + j] = sign * state[strapdown.C_NB + 3 * i + j]


@inline_kernel
def phi(state: FloatArray, F: FloatArray) -> None:
    """Perturbation in the true navigation frame with all Earth and transport terms (Groves 14.54-14.63).

    Differs from Groves in that position errors are metres along the axes of n, so that the change of the
    radii along the path cancels exactly in the position rows.
    """
    sl, cl, height = state[strapdown.SINE], state[strapdown.COSINE], state[strapdown.HEIGHT]
    v_n, v_e, v_d = get(state, strapdown.VELOCITY)
    m, t = state[strapdown.MERIDIAN], state[strapdown.TRANSVERSE]  # 1/(R_M + h), 1/(R_N + h)
    per_cl = state[strapdown.PER_COSINE]
    tl = sl * per_cl
    # Relative change of each radius per metre north.
    swell = earth.ECCENTRICITY_SQUARED * sl * cl / (1 - earth.ECCENTRICITY_SQUARED * (sl * sl)) * m
    dm, dt = 3 * swell * (1 - height * m), swell * (1 - height * t)
    ie_n, ie_d = earth.RATE * cl, -earth.RATE * sl
    en_n, en_e, en_d = v_e * t, -v_n * m, -v_e * tl * t

    # Rates of ω_ie and ω_en with the position north and down, and with the velocity.
    ie_n_n, ie_d_n = ie_d * m, -ie_n * m
    en_n_n, en_n_d = -en_n * dt, en_n * t
    en_e_n, en_e_d = -en_e * dm, en_e * m
    en_d_n, en_d_d = -en_n * per_cl * per_cl * m - en_d * dt, en_d * t

    F[P + N, P + N], F[P + N, P + D] = -v_d * m, v_n * m
    F[P + E, P + N], F[P + E, P + E], F[P + E, P + D] = -en_d, -(v_n * tl + v_d) * t, v_e * t
    F[P + N, V + N] = F[P + E, V + E] = F[P + D, V + D] = 1.0

    # v̇ = C f + g − c × v with c = 2 ω_ie + ω_en: c's change with position, with velocity, then v's own.
    c_n, c_e, c_d = 2 * ie_n + en_n, en_e, 2 * ie_d + en_d
    c_n_n, c_d_n = 2 * ie_n_n + en_n_n, 2 * ie_d_n + en_d_n
    g_latitude, g_height = gravity_gradient(sl, cl, height)
    g_n, g_d = g_latitude * m, -g_height
    F[V + N, P + N], F[V + N, P + D] = -en_e_n * v_d + c_d_n * v_e, -en_e_d * v_d + en_d_d * v_e
    F[V + E, P + N], F[V + E, P + D] = -c_d_n * v_n + c_n_n * v_d, -en_d_d * v_n + en_n_d * v_d
    F[V + D, P + N], F[V + D, P + D] = -c_n_n * v_e + en_e_n * v_n + g_n, -en_n_d * v_e + en_e_d * v_n + g_d
    F[V + N, V + N], F[V + N, V + E], F[V + N, V + D] = v_d * m, c_d + en_d, -c_e
    F[V + E, V + N], F[V + E, V + E], F[V + E, V + D] = -c_d, (v_d + v_n * tl) * t, c_n
    F[V + D, V + N], F[V + D, V + E] = c_e + en_e, -c_n - en_n
    skew(F, V, A, get(state, strapdown.FORCE_N))
    attitude_matrix(F, V, B, -1.0, state)

    F[A + N, P + N], F[A + N, P + D], F[A + N, V + E] = ie_n_n + en_n_n, en_n_d, t
    F[A + E, P + N], F[A + E, P + D], F[A + E, V + N] = en_e_n, en_e_d, -m
    F[A + D, P + N], F[A + D, P + D], F[A + D, V + E] = ie_d_n + en_d_n, en_d_d, -tl * t
    skew(F, A, A, (-ie_n - en_n, -en_e, -ie_d - en_d))
    attitude_matrix(F, A, G, 1.0, state)


PHI = ErrorModel("phi", phi)
MODELS = {model.name: model for model in (PHI,)}
"""The models by name."""
