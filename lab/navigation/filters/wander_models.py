"""Wander models: the matrix F of each linear error model, its errors resolved in the wander-azimuth frame w.

As `error_models`, for the mechanization of `wander`. The computed frame is rotated from w by δθ = Θ δr, which
has no vertical component: of all frames that are horizontal at the true position, w is the one without a
rotation in azimuth. The models contain no tan L.

References
----------
D. O. Benson, *A comparison of two approaches to pure-inertial and Doppler-inertial error analysis*, IEEE
Trans. AES 11 (1975); D. Goshen-Meskin, I. Y. Bar-Itzhack, *Unified approach to inertial navigation system
error modeling*, JGCD 15 (1992).
"""

from __future__ import annotations

from typing import Any

from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.motion.frames import earth
from lab.navigation import strapdown, wander
from lab.navigation.filters import error_models, north_slaved
from lab.navigation.filters.correction import correct_frame, correct_in_wander
from lab.navigation.filters.error_models import (
    WANDER_AZIMUTH,
    A,
    B,
    D,
    ErrorModel,
    G,
    P,
    V,
    Write,
    attitude_matrix,
    gravity_gradient,
    invariant,
    skew,
)
from lab.navigation.kernels.compilation import inline_kernel, kernel
from lab.navigation.kernels.generation import Slot
from lab.navigation.strapdown import (
    HEIGHT,
    MERIDIAN,
    SINE,
    TRANSVERSE,
    VELOCITY,
    cross,
    get,
    matrix,
    plus,
    reset_rate,
)
from lab.navigation.wander import AXIS, BEND, quaternion, to_fix, to_north, turn_of
from lab.navigation.wander import frame_rate as _earth_rate

X, Y = 0, 1  # axes of w besides D


@inline_kernel
def _curvature(state: FloatArray) -> tuple[float, float, float]:
    """Return the elements xx, xy and yy of K."""
    t, k, x, y = state[TRANSVERSE], state[BEND], state[AXIS], state[AXIS + 1]
    return t + k * x * x, k * x * y, t + k * y * y


@inline_kernel
def _gravity_slope(state: FloatArray) -> tuple[float, float, float]:
    """Return the derivatives of gravity along x, y and down."""
    # The derivative with respect to latitude is proportional to cos L, which the Earth's axis already
    # contains.
    by_latitude, by_height = gravity_gradient(state[SINE], 1.0, state[HEIGHT])
    slope = by_latitude * state[MERIDIAN]
    return slope * state[AXIS], slope * state[AXIS + 1], -by_height


@inline_kernel
def psi(state: FloatArray, F: FloatArray) -> None:
    """Errors in the computer frame, as `error_models.psi`, with δθ × g = −g K δr."""
    omega_ie, omega_ew = _earth_rate(state), turn_of(state, get(state, VELOCITY))
    minus_in = plus((-omega_ie[0], -omega_ie[1], -omega_ie[2]), -1.0, omega_ew)

    skew(F, P, P, (-omega_ew[0], -omega_ew[1], -omega_ew[2]))
    F[P + X, V + X] = F[P + Y, V + Y] = F[P + D, V + D] = 1.0

    g = state[strapdown.GRAVITY]
    K_xx, K_xy, K_yy = _curvature(state)
    F[V + X, P + X], F[V + X, P + Y] = -g * K_xx, -g * K_xy
    F[V + Y, P + X], F[V + Y, P + Y] = -g * K_xy, -g * K_yy
    F[V + D, P + X], F[V + D, P + Y], F[V + D, P + D] = _gravity_slope(state)
    skew(F, V, V, plus(minus_in, -1.0, omega_ie))
    skew(F, V, A, get(state, strapdown.FORCE_N))
    attitude_matrix(F, V, B, -1.0, state)

    skew(F, A, A, plus(minus_in, 1.0, reset_rate(state)))
    attitude_matrix(F, A, G, 1.0, state)


@inline_kernel
def psi_map(state: FloatArray, T: FloatArray) -> None:
    """Write the errors in the computer frame: the model's own."""
    for i in range(9):
        T[i, i] = 1.0


@inline_kernel
def gravitation_gradient(F: FloatArray, state: FloatArray) -> None:
    """Write the block C_wbᵀ Γ C_wb of the velocity's rows, Γ = ∂g/∂r + [ω_ie×]² in w."""
    g = state[strapdown.GRAVITY]
    K_xx, K_xy, K_yy = _curvature(state)
    slope = _gravity_slope(state)
    rate = _earth_rate(state)
    square = rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]
    at = strapdown.C_NB
    for j in range(3):
        v = state[at + j], state[at + 3 + j], state[at + 6 + j]
        along = rate[0] * v[0] + rate[1] * v[1] + rate[2] * v[2]
        x = -g * (K_xx * v[0] + K_xy * v[1]) + along * rate[0] - square * v[0]
        y = -g * (K_xy * v[0] + K_yy * v[1]) + along * rate[1] - square * v[1]
        z = slope[0] * v[0] + slope[1] * v[1] + slope[2] * v[2] + along * rate[2] - square * v[2]
        for i in range(3):
            F[V + i, P + j] = state[at + i] * x + state[at + 3 + i] * y + state[at + 6 + i] * z


@inline_kernel
def invariant_map(state: FloatArray, T: FloatArray) -> None:
    """Write δr = C ρ_b, δv_c = C ν_b − ω_ie × δr and ψ = C ψ_b, with C = Ĉ_wb."""
    C = matrix(quaternion(state, strapdown.Q_NB))
    rate = _earth_rate(state)
    for j in range(3):
        column = C[0][j], C[1][j], C[2][j]
        swept = cross(rate, column)
        for i in range(3):
            T[P + i, P + j] = T[V + i, V + j] = T[A + i, A + j] = column[i]
            T[V + i, P + j] = -swept[i]


@inline_kernel
def _curvature_rate(state: FloatArray) -> tuple[float, float, float]:
    """Return the rates of the elements xx, xy and yy of K along the path."""
    s, height = state[SINE], state[HEIGHT]
    m, t, k = state[MERIDIAN], state[TRANSVERSE], state[BEND]
    x, y, z = get(state, AXIS)
    v = get(state, VELOCITY)
    omega_x, omega_y, _ = turn_of(state, v)
    # Relative rate of R_N; R_M and k's own R_N e² / (1 − e² sin² L) change three times as fast.
    s_rate = m * (x * v[0] + y * v[1])
    squared = earth.ECCENTRICITY_SQUARED
    curvature_rate = squared * s * s_rate / (1 - squared * s * s)
    m_rate = -m * (3 * curvature_rate * (1 - height * m) - v[2] * m)
    t_rate = -t * (curvature_rate * (1 - height * t) - v[2] * t)
    k_rate = k * (3 * curvature_rate + m_rate / m + t_rate / t)
    x_rate, y_rate = -omega_y * z, omega_x * z
    return (
        t_rate + k_rate * x * x + 2 * k * x * x_rate,
        k_rate * x * y + k * (x * y_rate + y * x_rate),
        t_rate + k_rate * y * y + 2 * k * y * y_rate,
    )


@inline_kernel
def phi(state: FloatArray, F: FloatArray) -> None:
    """Perturbation in the true frame w, as `error_models.phi`; column by column.

    The computed frame is rotated by δθ = Θ δr, so that both rates are in error,

        δω_ie = ω_ie × δθ,   δω_ew = δθ̇ + ω_ew × δθ,   δθ̇ = Θ δṙ + Θ̇ δr,

        δṙ = −ω_ew × δr + δv + δθ × v
        δv̇ = −(2 ω_ie + ω_ew) × δv + v × (2 δω_ie + δω_ew) + f × φ − C_wb δb_a + δg
        φ̇ = −(ω_ie + ω_ew) × φ + δω_ie + δω_ew + C_wb δb_g
    """
    v = get(state, VELOCITY)
    omega_ie, omega_ew = _earth_rate(state), turn_of(state, v)
    minus_in = plus((-omega_ie[0], -omega_ie[1], -omega_ie[2]), -1.0, omega_ew)
    slope = _gravity_slope(state)
    xx, xy, yy = _curvature_rate(state)

    minus_twice = plus(minus_in, -1.0, omega_ie)
    for j in range(3):
        unit = (1.0 if j == 0 else 0.0), (1.0 if j == 1 else 0.0), (1.0 if j == 2 else 0.0)
        # With the position.
        turn = turn_of(state, unit)
        moving = plus(cross(turn, v), -1.0, cross(omega_ew, unit))
        turning = turn_of(state, moving)
        turning = turning[0] + xy * unit[0] + yy * unit[1], turning[1] - xx * unit[0] - xy * unit[1], 0.0
        by_ie, by_ew = cross(omega_ie, turn), plus(turning, 1.0, cross(omega_ew, turn))
        coriolis = cross(v, plus(by_ew, 2.0, by_ie))
        # With the velocity: δθ̇ of itself.
        steered = plus(cross(v, turn), 1.0, cross(minus_twice, unit))
        for i in range(3):
            F[P + i, P + j] = moving[i]
            F[V + i, P + j] = coriolis[i]
            F[A + i, P + j] = by_ie[i] + by_ew[i]
            F[V + i, V + j] = steered[i]
            F[A + i, V + j] = turn[i]
        F[V + D, P + j] += slope[j]
        F[P + j, V + j] = 1.0
    skew(F, V, A, get(state, strapdown.FORCE_N))
    attitude_matrix(F, V, B, -1.0, state)

    skew(F, A, A, plus(minus_in, 1.0, reset_rate(state)))
    attitude_matrix(F, A, G, 1.0, state)


@inline_kernel
def phi_map(state: FloatArray, T: FloatArray) -> None:
    """Write δr, δv_c = δv + δθ × v and ψ = φ − δθ."""
    v = get(state, VELOCITY)
    for j in range(3):
        unit = (1.0 if j == 0 else 0.0), (1.0 if j == 1 else 0.0), (1.0 if j == 2 else 0.0)
        turn = turn_of(state, unit)
        swept = cross(turn, v)
        T[P + j, P + j] = T[V + j, V + j] = T[A + j, A + j] = 1.0
        for i in range(3):
            T[V + i, P + j], T[A + i, P + j] = swept[i], -turn[i]


@inline_kernel
def _clear(T: FloatArray) -> None:
    """Write zeros into the block of position, velocity and attitude errors."""
    for i in range(9):
        for j in range(9):
            T[i, j] = 0.0


own_map = Slot("own_map")
"""The map of the model's own errors to those of the computer frame."""


@kernel
def _frame_map(state: FloatArray, T: FloatArray) -> None:
    """Write the map of the model's own errors to those of the computer frame."""
    _clear(T)
    own_map(state, T)


@kernel
def _fix_map(state: FloatArray, T: FloatArray) -> None:
    """Write the map of the model's own errors to those along the axes of the fix."""
    _clear(T)
    own_map(state, T)
    to_fix(state, T)


@kernel
def _north_map(state: FloatArray, T: FloatArray) -> None:
    """Write the map of the model's own errors to the output errors of the filter."""
    _clear(T)
    own_map(state, T)
    to_north(state, T)


IN_WANDER: dict[Any, Any] = {
    **wander.STEP,
    north_slaved.leaves_frame: wander.leaves_frame,
    north_slaved.store_state: wander.store_state,
    north_slaved.difference: wander.difference,
    north_slaved.fix_axes: wander.fix_axes,
    north_slaved.north_axes: wander.north_axes_before,
    north_slaved.north_variance: wander.north_variance,
    north_slaved.frame_rate: wander.frame_rate,
    correct_frame: correct_in_wander,
}
"""All that the frame changes besides the models: kernels of `wander` in place of the north-slaved ones."""


def _model(name: str, write: Write, map_: Write, *, in_body: bool = False) -> ErrorModel:
    """Return a model, given its F and the map of its errors to those of the computer frame."""
    kernels = {**IN_WANDER, own_map: map_, error_models.gravitation_gradient: gravitation_gradient}
    maps = _north_map, _fix_map, _frame_map
    return ErrorModel(name, (write,), *maps, in_body, WANDER_AZIMUTH, kernels=tuple(kernels.items()))


PHI = _model("phi", phi, phi_map)
PSI = _model("psi", psi, psi_map)
INVARIANT = _model("invariant", invariant, invariant_map, in_body=True)
MODELS = {model.name: model for model in (PHI, PSI, INVARIANT)}
"""The models by name."""


def linear_model(name: str, mechanization: str) -> ErrorModel:
    """Return the linear error model by its name and mechanization, both as in the settings.

    Raises
    ------
    SettingError
        If the model is not written for the mechanization.
    """
    models = MODELS if mechanization == WANDER_AZIMUTH else error_models.MODELS
    if name not in models:
        raise SettingError(
            f"navigator.model: the model {name} is not written for navigator.mechanization = "
            f"{mechanization}; accepted with it are the models {', '.join(models)}"
        )
    return models[name]
