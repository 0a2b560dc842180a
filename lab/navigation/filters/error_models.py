"""Error models: the matrix F of ẋ = F x + w, declared block by block.

The error is estimate minus truth, in the order of `STATES`, of which a filter has the first 15 or all 21;
further blocks of states may follow (`further_columns`).
Position errors are metres north, east, down. The attitude error φ is the small rotation of the computed
navigation frame, Ĉ_nb = (I − [φ×]) C_nb. A model is a function that writes the non-zero elements of F.
Calling it gives the pattern of these elements, and the code that propagates the covariance is generated from
the pattern.

A model may use its own coordinates for position, velocity and attitude errors. It then also writes T, the
derivative of the errors above with respect to its own. All output of the filter is mapped by T, so that all
models output the same errors.

References
----------
P. D. Groves, *Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems*, 2nd ed., ch. 14.2;
D. H. Titterton, J. L. Weston, *Strapdown Inertial Navigation Technology*, 2nd ed., ch. 12;
D. O. Benson, *A comparison of two approaches to pure-inertial and Doppler-inertial error analysis*, IEEE
Trans. AES 11 (1975); D. Goshen-Meskin, I. Y. Bar-Itzhack, *Unified approach to inertial navigation system
error modeling*, JGCD 15 (1992); A. Barrau, S. Bonnabel, *The invariant extended Kalman filter as a stable
observer*, IEEE Trans. AC 62 (2017); Y. Luo, C. Guo, J. Liu, *Equivariant filtering framework for
inertial-integrated navigation*, Satellite Navigation 2 (2021).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lab.base.arrays import FloatArray
from lab.motion.frames import earth
from lab.navigation import strapdown
from lab.navigation.filters import blocks
from lab.navigation.kernels import own_room
from lab.navigation.kernels.compilation import inline_kernel
from lab.navigation.kernels.generation import (
    Kernel,
    Slot,
    Variant,
    Written,
    generate_module,
    interpret_kernel,
)
from lab.navigation.strapdown import Vector, earth_rate, get, matrix, plus, reset_rate, transport_rate

POS, VEL, ATT, GYRO_BIAS, ACCEL_BIAS, GYRO_SCALE, ACCEL_SCALE = (slice(i, i + 3) for i in range(0, 21, 3))
"""Slices of the error states."""

STATES = (
    *("position north", "position east", "position down"),
    *("velocity north", "velocity east", "velocity down"),
    *("attitude north", "attitude east", "attitude down"),
    *("gyro bias x", "gyro bias y", "gyro bias z"),
    *("accelerometer bias x", "accelerometer bias y", "accelerometer bias z"),
    *("gyro scale x", "gyro scale y", "gyro scale z"),
    *("accelerometer scale x", "accelerometer scale y", "accelerometer scale z"),
)
"""Names of the error states, in order; a filter has the first 15, or all 21, and further blocks."""

# First index of each block, for the declarations below.
P, V, A, G, B = 0, 3, 6, 9, 12
N, E, D = 0, 1, 2
"""North, east and down within a block."""

gravity_gradient = inline_kernel(earth.gravity_gradient)

Write = Callable[[FloatArray, FloatArray], None]

write_f = Slot("write_f")
"""``write_f(state, F)`` of the model."""
write_map, write_fix_map, write_frame_map = Slot("write_map"), Slot("write_fix_map"), Slot("write_frame_map")
"""``write_map(state, T)`` of the model, and the others of this kind; see `ErrorModel`."""

NORTH_SLAVED, WANDER_AZIMUTH = "north-slaved", "wander azimuth"
"""Mechanizations, as in the settings."""


@dataclass(frozen=True)
class ErrorModel:
    """An error model: its name, the functions that write F, and its coordinates.

    Attributes
    ----------
    name
        As in the settings.
    writes
        Functions ``write(state, F)``, which together write the non-zero elements of F for the navigator's
        `strapdown` state after a step. The first-order decay of the biases is not part of it.
    write_map
        ``write_map(state, T)`` writes the non-zero elements of T (9, 9), the derivative of the position,
        velocity and attitude errors with respect to the model's own; None if they are the same.
    write_fix_map, write_frame_map
        As `write_map`, but for errors along the axes of the last fix, and for errors in the form that the
        correction of the navigator takes. None if they are the same as `write_map`.
    in_body
        Whether the model's errors are those of the group, resolved in b. White noise of the sensors then
        enters them axis by axis, and the group's exponential corrects the navigator.
    mechanization
        Mechanization of the navigator, as in the settings.
    blocks
        Names of the further blocks of states, in the order of `blocks.BLOCKS`; see `further_columns`.
    kernels
        Kernels that these functions call, and those that they call in this model.
    constants
        Names of constants of these functions, their values there, and in this model.
    """

    name: str
    writes: tuple[Write, ...]
    write_map: Write | None = None
    write_fix_map: Write | None = None
    write_frame_map: Write | None = None
    in_body: bool = False
    mechanization: str = NORTH_SLAVED
    blocks: tuple[str, ...] = ()
    kernels: tuple[tuple[Kernel, Kernel], ...] = ()
    constants: tuple[tuple[str, int, int], ...] = ()

    @property
    def states(self) -> int:
        """Number n of error states."""
        return blocks.count(self.blocks)

    @property
    def label(self) -> str:
        """Name for the modules generated for this model."""
        return " ".join((self.name, self.mechanization, str(self.states), *self.blocks))

    @functools.cached_property
    def variant(self) -> Variant:
        """What kernels of this model have in place of those of the lab."""
        calls = [f"    {write.__name__}(state, F)" for write in self.writes]
        text = "\n".join(("@inline_kernel", "def write_f(state, F):", *calls))
        own = {
            write_f: Written("write_f", text, {write.__name__: write for write in self.writes}),
            write_map: self.write_map,
            write_fix_map: self.write_fix_map or self.write_map,
            write_frame_map: self.write_frame_map or self.write_map,
        }
        return Variant({**dict(self.kernels), **own}, {name: (old, new) for name, old, new in self.constants})

    @functools.cached_property
    def write(self) -> Write:
        """``write(state, F)``, which writes the non-zero elements of F."""
        title = f"The system matrix F of the filter {self.label}."
        return generate_module(f"F {self.label}", title, [write_f], self.variant)[write_f]  # type: ignore[no-any-return]

    def pattern(self) -> NDArray[np.bool_]:
        """Return the mask (n, n) of the elements of F that can be non-zero."""
        return _pattern(interpret_kernel(write_f, self.variant), self.states)

    def map_pattern(self) -> NDArray[np.bool_]:
        """Return the mask (9, 9) of the elements of T that can be non-zero."""
        return (
            _pattern(interpret_kernel(write_map, self.variant), 9)
            if self.write_map
            else np.eye(9, dtype=np.bool_)
        )

    def map(self, state: FloatArray) -> FloatArray:
        """Return the derivative of all errors with respect to the model's own, (n, n)."""
        T = np.eye(self.states)
        if self.write_map:
            interpret_kernel(write_map, self.variant)(state, T)
        return T


def _pattern(write: Write, size: int) -> NDArray[np.bool_]:
    """Return the mask of the elements of a matrix to which a function can write non-zero values."""
    rng = np.random.default_rng(0)
    matrix = np.zeros((size, size))
    seen = np.zeros((size, size), dtype=np.bool_)
    # More than one draw: single elements may vanish by chance.
    for _ in range(3):
        # Other mechanizations and the user's own states need longer ones.
        state = rng.uniform(0.1, 0.5, own_room.END)
        state[strapdown.HEIGHT] = 1000.0
        write(state, matrix)
        seen |= matrix != 0
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
    curvature_slope = earth.ECCENTRICITY_SQUARED * sl * cl / (1 - earth.ECCENTRICITY_SQUARED * (sl * sl)) * m
    # R_M / (R_M + h) = 1 − h m: the latitude changes the radius, and not the height above it.
    dm, dt = 3 * curvature_slope * (1 - height * m), curvature_slope * (1 - height * t)
    ie_n, ie_d = earth.RATE * cl, -earth.RATE * sl
    en_n, en_e, en_d = v_e * t, -v_n * m, -v_e * tl * t

    # Rates of ω_ie and ω_en with the position north and down, and with the velocity.
    ie_n_n, ie_d_n = ie_d * m, -ie_n * m
    # North, a rate falls as its radius grows; down, it grows as R + h becomes shorter.
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

    # φ̇ = −ω_in × φ + δω_in + C δb_g, with δω_in by position and by velocity.
    F[A + N, P + N], F[A + N, P + D], F[A + N, V + E] = ie_n_n + en_n_n, en_n_d, t
    F[A + E, P + N], F[A + E, P + D], F[A + E, V + N] = en_e_n, en_e_d, -m
    F[A + D, P + N], F[A + D, P + D], F[A + D, V + E] = ie_d_n + en_d_n, en_d_d, -tl * t
    skew(F, A, A, plus((-ie_n - en_n, -en_e, -ie_d - en_d), 1.0, reset_rate(state)))
    attitude_matrix(F, A, G, 1.0, state)


@inline_kernel
def write_frame_turn(T: FloatArray, row: int, state: FloatArray) -> None:
    """Write [δθ / δr]: δθ is the rotation of the navigation frame from the true to the computed position."""
    m, t = state[strapdown.MERIDIAN], state[strapdown.TRANSVERSE]
    T[row + N, P + E] = t
    T[row + E, P + N] = -m
    T[row + D, P + E] = -state[strapdown.SINE] * state[strapdown.PER_COSINE] * t


@inline_kernel
def turned_velocity(T: FloatArray, state: FloatArray) -> None:
    """Write [v × δθ / δr] of the velocity rows."""
    v_n, v_e, v_d = get(state, strapdown.VELOCITY)
    m, t = state[strapdown.MERIDIAN], state[strapdown.TRANSVERSE]
    tl = state[strapdown.SINE] * state[strapdown.PER_COSINE]
    T[V + N, P + N], T[V + N, P + E] = v_d * m, -v_e * tl * t
    T[V + E, P + E] = (v_d + v_n * tl) * t
    T[V + D, P + N], T[V + D, P + E] = -v_n * m, -v_e * t


@inline_kernel
def psi(state: FloatArray, F: FloatArray) -> None:
    """Errors in the computer frame c, the navigation frame at the computed position (Benson 1975).

    c is rotated from n by δθ, to first order δr_E / (R_N + h) north, −δr_N / (R_M + h) east and −δr_E tan L /
    (R_N + h) down. With ψ = φ − δθ and δv_c = v̂ − C_cn v = δv + δθ × v, the errors are those of the
    navigator's matrices and vectors in e, resolved in n; the transport rate is not in error:

        δṙ = −ω_en × δr + δv_c
        δv̇_c = −(2 ω_ie + ω_en) × δv_c + f × ψ − C_nb δb_a + δg + δθ × g
        ψ̇ = −(ω_ie + ω_en) × ψ + C_nb δb_g

    (Goshen-Meskin & Bar-Itzhack 1992, with the signs of φ here.)
    """
    sl, cl, height = state[strapdown.SINE], state[strapdown.COSINE], state[strapdown.HEIGHT]
    m, t = state[strapdown.MERIDIAN], state[strapdown.TRANSVERSE]
    ie_n, _, ie_d = earth_rate(sl, cl)
    tl = sl * state[strapdown.PER_COSINE]
    en_n, en_e, en_d = transport_rate(get(state, strapdown.VELOCITY), m, t, tl)

    skew(F, P, P, (-en_n, -en_e, -en_d))
    F[P + N, V + N] = F[P + E, V + E] = F[P + D, V + D] = 1.0

    g = state[strapdown.GRAVITY]
    g_latitude, g_height = gravity_gradient(sl, cl, height)
    F[V + N, P + N], F[V + E, P + E] = -g * m, -g * t
    F[V + D, P + N], F[V + D, P + D] = g_latitude * m, -g_height
    skew(F, V, V, (-2 * ie_n - en_n, -en_e, -2 * ie_d - en_d))
    skew(F, V, A, get(state, strapdown.FORCE_N))
    attitude_matrix(F, V, B, -1.0, state)

    skew(F, A, A, plus((-ie_n - en_n, -en_e, -ie_d - en_d), 1.0, reset_rate(state)))
    attitude_matrix(F, A, G, 1.0, state)


@inline_kernel
def psi_map(state: FloatArray, T: FloatArray) -> None:
    """Write δr, δv = δv_c + v × δθ and φ = ψ + δθ."""
    for i in range(9):
        T[i, i] = 1.0
    turned_velocity(T, state)
    write_frame_turn(T, A, state)


@inline_kernel
def invariant(state: FloatArray, F: FloatArray) -> None:
    """Left-invariant error on SE₂(3) of attitude, velocity and position in inertial space.

    The group element is χ = (C_ib, v_i, r_i), with v_i = v_e + ω_ie × r the velocity in inertial space, for
    which the navigation equations are group affine (Luo et al. 2021). Its error χ⁻¹ χ̂ = exp(−ψ_b, ν_b, ρ_b)
    is

        exp(−[ψ_b×]) = C_ibᵀ Ĉ_ib,   J ν_b = C_ibᵀ (v̂_i − v_i),   J ρ_b = C_ibᵀ (r̂ − r)

    with J the group's Jacobian at −ψ_b, and obeys, for any size except for the biases and the change of
    gravity, (Barrau & Bonnabel 2017, theorem 2),

        ρ̇_b = −ω_ib × ρ_b + ν_b
        ν̇_b = −ω_ib × ν_b + f_b × ψ_b − δb_a + C_nbᵀ Γ C_nb ρ_b
        ψ̇_b = −ω_ib × ψ_b + δb_g

    in which only ω_ib and f_b as measured appear, and no attitude, velocity or position but in the gradient Γ
    of gravitation, 10⁻⁶/s².
    """
    per_dt = state[strapdown.PER_STEP]
    x, y, z = get(state, strapdown.PREVIOUS_DTHETA)
    to_minus_rate = (-x * per_dt, -y * per_dt, -z * per_dt)
    x, y, z = get(state, strapdown.PREVIOUS_DVELOCITY)

    skew(F, P, P, to_minus_rate)
    F[P + 0, V + 0] = F[P + 1, V + 1] = F[P + 2, V + 2] = 1.0

    skew(F, V, V, to_minus_rate)
    skew(F, V, A, (x * per_dt, y * per_dt, z * per_dt))
    F[V + 0, B + 0] = F[V + 1, B + 1] = F[V + 2, B + 2] = -1.0
    gravitation_gradient(F, state)

    skew(F, A, A, to_minus_rate)
    F[A + 0, G + 0] = F[A + 1, G + 1] = F[A + 2, G + 2] = 1.0


@inline_kernel
def gravitation_gradient(F: FloatArray, state: FloatArray) -> None:
    """Write the block C_nbᵀ Γ C_nb of the velocity's rows, Γ = ∂g/∂r + [ω_ie×]² in n."""
    sl, cl, height = state[strapdown.SINE], state[strapdown.COSINE], state[strapdown.HEIGHT]
    m, t = state[strapdown.MERIDIAN], state[strapdown.TRANSVERSE]
    g = state[strapdown.GRAVITY]
    g_latitude, g_height = gravity_gradient(sl, cl, height)
    ie_n, _, ie_d = earth_rate(sl, cl)
    # [ω_ie×]² = ω_ie ω_ieᵀ − |ω_ie|² I, and ω_ie has no part to the east.
    n_n, n_d = -g * m - ie_d * ie_d, ie_n * ie_d
    e_e = -g * t - ie_n * ie_n - ie_d * ie_d
    d_n, d_d = g_latitude * m + ie_n * ie_d, -g_height - ie_n * ie_n
    north, east = get(state, strapdown.C_NB), get(state, strapdown.C_NB + 3)
    down = get(state, strapdown.C_NB + 6)
    for j in range(3):
        to_n, to_e, to_d = n_n * north[j] + n_d * down[j], e_e * east[j], d_n * north[j] + d_d * down[j]
        for i in range(3):
            F[V + i, P + j] = north[i] * to_n + east[i] * to_e + down[i] * to_d


@inline_kernel
def invariant_map(state: FloatArray, T: FloatArray) -> None:
    """Write δr = C ρ_b, δv = C ν_b − ω_ie × δr + v × δθ and φ = C ψ_b + δθ, with C = Ĉ_nb.

    The velocity in n differs from that in inertial space by the Earth's rotation and by the rotation of the
    navigation frame, as for `psi`.
    """
    at = strapdown.Q_NB
    C = matrix((state[at], state[at + 1], state[at + 2], state[at + 3]))
    v_n, v_e, v_d = get(state, strapdown.VELOCITY)
    m, t = state[strapdown.MERIDIAN], state[strapdown.TRANSVERSE]
    tl = state[strapdown.SINE] * state[strapdown.PER_COSINE]
    ie_n, _, ie_d = earth_rate(state[strapdown.SINE], state[strapdown.COSINE])
    for j in range(3):
        north, east, down = C[0][j], C[1][j], C[2][j]
        T[P + N, P + j] = T[V + N, V + j] = T[A + N, A + j] = north
        T[P + E, P + j] = T[V + E, V + j] = T[A + E, A + j] = east
        T[P + D, P + j] = T[V + D, V + j] = T[A + D, A + j] = down
        T[V + N, P + j] = v_d * m * north + (ie_d - v_e * tl * t) * east
        T[V + E, P + j] = -ie_d * north + (v_d + v_n * tl) * t * east + ie_n * down
        T[V + D, P + j] = -v_n * m * north - (ie_n + v_e * t) * east
        T[A + N, P + j], T[A + E, P + j], T[A + D, P + j] = t * east, -m * north, -tl * t * east


PHI = ErrorModel("phi", (phi,))
PSI = ErrorModel("psi", (psi,), psi_map)
INVARIANT = ErrorModel("invariant", (invariant,), invariant_map, in_body=True)
MODELS = {model.name: model for model in (PHI, PSI, INVARIANT)}
"""The models with 15 states by name."""
