"""F against the derivative of the true nonlinear error propagation, entry by entry."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pymap3d
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from sized_models import with_states

from lab.base.arrays import ComplexArray, FloatArray
from lab.motion.frames import earth
from lab.navigation import reference, strapdown
from lab.navigation.filters.error_models import (
    ACCEL_BIAS,
    ACCEL_SCALE,
    ATT,
    GYRO_BIAS,
    GYRO_SCALE,
    INVARIANT,
    NORTH_SLAVED,
    PHI,
    POS,
    PSI,
    STATES,
    VEL,
    WANDER_AZIMUTH,
    ErrorModel,
)
from lab.navigation.filters.wander_models import linear_model
from lab.navigation.kernels import own_room

# Below this an entry is nothing: the turn rate of the body cancels among the attitudes, but for its roundoff.
ZERO = np.full((21, 21), 1e-20)
ZERO[ATT, ATT] = 1e-16

LATITUDES = np.radians([-89.0, -75.0, -45.0, -12.0, -0.5, 5.0, 33.0, 48.0, 70.0, 89.0])


class Vehicle(NamedTuple):
    """A navigator's whole state in time-continuous navigation, and the inputs it feels.

    Real or, to differentiate by it, complex: latitude, longitude [rad] and height [m]; v_n; C_nb; gyro and
    accelerometer biases and scale factor errors; measured ω_ib,b and f_b.
    """

    position: ComplexArray
    velocity_n: ComplexArray
    C_nb: ComplexArray
    gyro_bias: ComplexArray
    accel_bias: ComplexArray
    gyro_scale: ComplexArray
    accel_scale: ComplexArray
    omega_b: FloatArray
    f_b: FloatArray


class Rates(NamedTuple):
    """Time derivatives of position, velocity and attitude."""

    position: ComplexArray
    velocity_n: ComplexArray
    C_nb: ComplexArray


def skew(v: ComplexArray) -> ComplexArray:
    """Return [v ×]."""
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def metres_per_radian(latitude: complex, height: complex) -> ComplexArray:
    """Return R_M + h and (R_N + h) cos L, from the definition of the ellipsoid."""
    a, b = earth.SEMI_MAJOR_AXIS, earth.SEMI_MAJOR_AXIS * (1 - earth.FLATTENING)
    w = (a * np.cos(latitude)) ** 2 + (b * np.sin(latitude)) ** 2
    return np.array([(a * b) ** 2 * w**-1.5 + height, (a * a * w**-0.5 + height) * np.cos(latitude)])


def rates(vehicle: Vehicle) -> Rates:
    """Return the navigation equations in continuous time (Groves 5.53, 5.39, 2.111)."""
    latitude, _, height = vehicle.position
    v = vehicle.velocity_n
    north, east = metres_per_radian(latitude, height)
    position = np.array([v[0] / north, v[1] / east, -v[2]])
    s, c = np.sin(latitude), np.cos(latitude)
    omega_ie = earth.RATE * np.array([c, 0, -s])
    omega_en = np.array([position[1] * c, -position[0], -position[1] * s])
    # What was felt, of a sensor that gives (1 + s) x + b.
    f_b = (vehicle.f_b - vehicle.accel_bias) / (1 + vehicle.accel_scale)
    omega_b = (vehicle.omega_b - vehicle.gyro_bias) / (1 + vehicle.gyro_scale)
    f_n = vehicle.C_nb @ f_b
    g_n = np.array([0, 0, earth.gravity(s, height)])
    velocity = f_n + g_n - skew(2 * omega_ie + omega_en) @ v
    attitude = vehicle.C_nb @ skew(omega_b) - skew(omega_ie + omega_en) @ vehicle.C_nb
    return Rates(position, velocity, attitude)


def astray(truth: Vehicle, x: ComplexArray) -> Vehicle:
    """Return the navigator that errs by x, the error in its nonlinear definition."""
    scale = np.append(1 / metres_per_radian(truth.position[0], truth.position[2]), -1)
    return truth._replace(
        position=truth.position + scale * x[POS],
        velocity_n=truth.velocity_n + x[VEL],
        C_nb=expm(-skew(x[ATT])) @ truth.C_nb,
        gyro_bias=truth.gyro_bias + x[GYRO_BIAS],
        accel_bias=truth.accel_bias + x[ACCEL_BIAS],
        gyro_scale=truth.gyro_scale + x[GYRO_SCALE],
        accel_scale=truth.accel_scale + x[ACCEL_SCALE],
    )


def error_rate(truth: Vehicle, x: ComplexArray) -> ComplexArray:
    """Return ẋ (21,) to first order in x, where the navigator obeys the same equations as the truth."""
    estimate = astray(truth, x)
    computed, true = rates(estimate), rates(truth)
    out = np.zeros(21, dtype=np.complex128)
    # d/dt of (L̂ − L)(R_M + h) and its like: the metres in a radian change along the way.
    per_radian = metres_per_radian(truth.position[0], truth.position[2])
    step = 0.01
    ahead, behind = (truth.position + sign * step * true.position for sign in (1, -1))
    stretch = (metres_per_radian(ahead[0], ahead[2]) - metres_per_radian(behind[0], behind[2])) / (2 * step)
    apart, parting = estimate.position - truth.position, computed.position - true.position
    out[:2] = parting[:2] * per_radian + apart[:2] * stretch
    out[2] = -parting[2]
    out[VEL] = computed.velocity_n - true.velocity_n
    # exp(−[φ×]) = Ĉ Cᵀ, so −[φ̇×] is its derivative to first order.
    turn = computed.C_nb @ truth.C_nb.T + estimate.C_nb @ true.C_nb.T
    out[ATT] = -0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return out


def jacobian(truth: Vehicle) -> FloatArray:
    """Return ∂ẋ/∂x (21, 21) by complex steps: exact to roundoff, whatever the step."""
    columns = [error_rate(truth, 1e-30j * unit).imag / 1e-30 for unit in np.eye(21)]
    return np.stack(columns, axis=-1)


def random_vehicle(latitude: float, states: int = 21) -> Vehicle:
    """Return a vehicle in hard manoeuvre at a latitude; what else there is, at random.

    A navigator with 15 states knows no scale factors: they are zero.
    """
    scale = 0.02 * (states > 15)
    rng = np.random.default_rng(int(1e6 * (latitude + 2)))
    return Vehicle(
        position=np.array([latitude, rng.uniform(-np.pi, np.pi), rng.uniform(-100, 12000)]),
        velocity_n=rng.normal(0, 100, 3),
        C_nb=Rotation.random(rng=rng).as_matrix(),
        gyro_bias=rng.normal(0, 1e-2, 3),
        accel_bias=rng.normal(0, 0.1, 3),
        omega_b=rng.normal(0, 0.5, 3),
        f_b=rng.normal(0, 15, 3),
        gyro_scale=rng.normal(0, 1, 3) * scale,
        accel_scale=rng.normal(0, 1, 3) * scale,
    )


def navigator_state(vehicle: Vehicle) -> FloatArray:
    """Return the strapdown's state of a vehicle, all that is derived filled in by a step of no length."""
    state = np.zeros(strapdown.LENGTH)
    strapdown.set_position(state, *vehicle.position)
    state[strapdown.VELOCITY : strapdown.VELOCITY + 3] = vehicle.velocity_n
    q_nb = Rotation.from_matrix(vehicle.C_nb).as_quat(scalar_first=True)
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = q_nb
    state[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 3] = vehicle.gyro_bias
    state[strapdown.ACCEL_BIAS : strapdown.ACCEL_BIAS + 3] = vehicle.accel_bias
    state[strapdown.GYRO_SCALE : strapdown.GYRO_SCALE + 3] = vehicle.gyro_scale
    state[strapdown.ACCEL_SCALE : strapdown.ACCEL_SCALE + 3] = vehicle.accel_scale
    dt = 1e-9
    strapdown.step(state, tuple(vehicle.omega_b * dt), tuple(vehicle.f_b * dt), dt)
    return state


SIZES = (15, 21)


def both_sizes(*models: ErrorModel) -> pytest.MarkDecorator:
    """Run a test with 15 and 21 states of each model."""
    sized = [with_states(model, states) for model in models for states in SIZES]
    return pytest.mark.parametrize("model", sized, ids=lambda model: f"{model.name}-{model.states}")


@pytest.mark.parametrize("latitude", LATITUDES)
@both_sizes(PHI)
def test_every_entry_is_the_derivative_of_the_true_error_propagation(
    model: ErrorModel, latitude: float
) -> None:
    n = model.states
    vehicle = random_vehicle(latitude, n)
    F = np.zeros((n, n))
    model.write(navigator_state(vehicle), F)
    expected, zero = jacobian(vehicle)[:n, :n], ZERO[:n, :n]
    real = np.abs(expected) > zero
    worst = np.abs(F[real] / expected[real] - 1).max()
    print(f"\n{np.degrees(latitude):.1f}°: {real.sum()} entries, worst relative difference {worst:.1e}")
    wrong = np.abs(F - expected) > 1e-5 * np.abs(expected) + zero
    named = [
        f"∂({STATES[i]})˙/∂({STATES[j]}): {F[i, j]:.8g}, not {expected[i, j]:.8g}"
        for i, j in np.argwhere(wrong)
    ]
    assert not named, "\n".join(named)


def earth_axes(position: ComplexArray) -> ComplexArray:
    """Return C_en, from the ECEF axes of north, east and down (Groves 2.150)."""
    (s, c), (sl, cl) = ((np.sin(angle), np.cos(angle)) for angle in position[:2])
    return np.array([[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, 0, -s]])


def from_the_centre(position: ComplexArray) -> ComplexArray:
    """Return r_e [m] (Groves 2.112)."""
    latitude, longitude, height = position
    s, c = np.sin(latitude), np.cos(latitude)
    radius = earth.SEMI_MAJOR_AXIS / np.sqrt(1 - earth.ECCENTRICITY_SQUARED * s * s)
    out = (radius + height) * c
    up = ((1 - earth.ECCENTRICITY_SQUARED) * radius + height) * s
    return np.array([out * np.cos(longitude), out * np.sin(longitude), up])


def turn(M: ComplexArray) -> ComplexArray:
    """Return φ of a matrix I − [φ×]."""
    return -0.5 * np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])


def own_error(model: ErrorModel, truth: Vehicle, estimate: Vehicle) -> ComplexArray:
    """Return the error in a model's own coordinates (21,), to first order, from its definition in ECEF."""
    C_en, C_ec = earth_axes(truth.position), earth_axes(estimate.position)
    r_e, r_c = from_the_centre(truth.position), from_the_centre(estimate.position)
    C_eb, computed_eb = C_en @ truth.C_nb, C_ec @ estimate.C_nb
    out = np.zeros(21, dtype=np.complex128)
    if model.name == "psi":
        C_cn = C_ec.T @ C_en
        out[POS] = C_en.T @ (r_c - r_e)
        out[VEL] = estimate.velocity_n - C_cn @ truth.velocity_n
        out[ATT] = turn(estimate.C_nb @ (C_cn @ truth.C_nb).T)
    else:
        omega = skew(np.array([0, 0, earth.RATE]))
        v_i, computed_i = C_en @ truth.velocity_n + omega @ r_e, C_ec @ estimate.velocity_n + omega @ r_c
        out[POS] = C_eb.T @ (r_c - r_e)
        out[VEL] = C_eb.T @ (computed_i - v_i)
        out[ATT] = turn(C_eb.T @ computed_eb)
    out[GYRO_BIAS], out[ACCEL_BIAS] = (
        estimate.gyro_bias - truth.gyro_bias,
        estimate.accel_bias - truth.accel_bias,
    )
    out[GYRO_SCALE] = estimate.gyro_scale - truth.gyro_scale
    out[ACCEL_SCALE] = estimate.accel_scale - truth.accel_scale
    return out


def later(vehicle: Vehicle, seconds: float) -> Vehicle:
    """Return a vehicle moved along its present rates."""
    rate = rates(vehicle)
    return vehicle._replace(
        position=vehicle.position + seconds * rate.position,
        velocity_n=vehicle.velocity_n + seconds * rate.velocity_n,
        C_nb=vehicle.C_nb + seconds * rate.C_nb,
    )


def own_jacobians(model: ErrorModel, truth: Vehicle) -> tuple[FloatArray, FloatArray]:
    """Return F in a model's own coordinates, and T: complex steps in the error, five points in time."""
    step, weights = 0.3, {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
    own, own_rate = np.zeros((21, 21)), np.zeros((21, 21))
    for i, unit in enumerate(np.eye(21)):
        estimate = astray(truth, 1e-30j * unit)
        own[:, i] = own_error(model, truth, estimate).imag / 1e-30
        for n, weight in weights.items():
            moved = own_error(model, later(truth, n * step), later(estimate, n * step))
            own_rate[:, i] += weight / step * moved.imag / 1e-30
    n = model.states
    return (own_rate @ np.linalg.inv(own))[:n, :n], np.linalg.inv(own)[:n, :n]


OWN_ZERO = 5e-14
"""Roundoff of the five points in time: the smallest entry there is has 1e-10."""


@pytest.mark.parametrize("latitude", LATITUDES)
@both_sizes(PSI, INVARIANT)
def test_own_coordinates_follow_their_definitions(model: ErrorModel, latitude: float) -> None:
    vehicle = random_vehicle(latitude, model.states)
    state = navigator_state(vehicle)
    F = np.zeros((model.states, model.states))
    model.write(state, F)
    expected, T = own_jacobians(model, vehicle)
    real = np.abs(expected) > OWN_ZERO
    worst = np.abs(F[real] / expected[real] - 1).max()
    print(
        f"\n{model.name}, {np.degrees(latitude):.1f}°: {real.sum()} entries from "
        f"{np.abs(expected[real]).min():.1e} on, worst relative difference {worst:.1e}"
    )
    assert ((F != 0) == real).all()
    assert worst <= 1e-5
    state[strapdown.VELOCITY : strapdown.VELOCITY + 3] = vehicle.velocity_n
    q_nb = Rotation.from_matrix(vehicle.C_nb).as_quat(scalar_first=True)
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = q_nb
    np.testing.assert_allclose(model.map(state), T, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("degrees", [0.01, 60.0, 150.0])
def test_the_group_error_is_taken_out_exactly(latitude: float, degrees: float) -> None:
    """The navigator errs by the matrix exponential of an error of any size; the correction leaves nothing."""
    vehicle = random_vehicle(latitude)
    rng = np.random.default_rng(5)
    psi = rng.normal(size=3)
    x = np.concatenate((rng.normal(0, 3, 6), np.radians(degrees) * psi / np.linalg.norm(psi), np.zeros(6)))
    # χ̂ = χ exp(ξ) with χ = (C_eb, v_i, r_e), which is (C_ib, v_i, r_i) seen from the Earth.
    omega = skew(np.array([0, 0, earth.RATE]))
    C_en, r_e = earth_axes(vehicle.position), from_the_centre(vehicle.position)
    chi = np.eye(5)
    chi[:3, :3], chi[:3, 3], chi[:3, 4] = C_en @ vehicle.C_nb, C_en @ vehicle.velocity_n + omega @ r_e, r_e
    xi = np.zeros((5, 5))
    xi[:3, :3], xi[:3, 3], xi[:3, 4] = -skew(x[ATT]), x[VEL], x[POS]
    computed = chi @ expm(xi)
    latitude_c, longitude_c, height_c = pymap3d.ecef2geodetic(*computed[:3, 4], deg=False)
    position = np.array([float(latitude_c), float(longitude_c), float(height_c)])
    C_ec = earth_axes(position)
    state = navigator_state(
        vehicle._replace(
            position=position,
            velocity_n=C_ec.T @ (computed[:3, 3] - omega @ computed[:3, 4]),
            C_nb=C_ec.T @ computed[:3, :3],
        )
    )
    reference.correct(state, x, INVARIANT)
    scale = metres_per_radian(vehicle.position[0], vehicle.position[2])
    off = (state[:2] - vehicle.position[:2]) * scale
    velocity = state[strapdown.VELOCITY : strapdown.VELOCITY + 3] - vehicle.velocity_n
    attitude = Rotation.from_quat(state[strapdown.Q_NB : strapdown.Q_NB + 4], scalar_first=True)
    left = (attitude * Rotation.from_matrix(vehicle.C_nb).inv()).magnitude()
    print(
        f"\n{degrees:g}°, {np.degrees(latitude):.1f}°: left are {np.abs(off).max():.1e} m, "
        f"{np.abs(velocity).max():.1e} m/s, {left:.1e} rad"
    )
    # Ten metres are taken as straight on the Earth: 10⁻⁶ of them, times tan L.
    assert np.abs(off).max() < 1e-4
    assert state[strapdown.HEIGHT] == pytest.approx(vehicle.position[2], abs=1e-4)
    assert np.abs(velocity).max() < 2e-4
    assert left < 5e-5


@both_sizes(PSI, INVARIANT)
def test_the_patterns_of_own_coordinates_have_room_for_every_entry(model: ErrorModel) -> None:
    n = model.states
    seen, seen_map = np.zeros((n, n), dtype=np.bool_), np.zeros((9, 9), dtype=np.bool_)
    for latitude in LATITUDES:
        F, T = own_jacobians(model, random_vehicle(latitude))
        seen |= np.abs(F) > OWN_ZERO
        seen_map |= np.abs(T[:9, :9]) > 1e-12
    assert (model.pattern() == seen).all()
    assert (model.map_pattern() == seen_map).all()


@pytest.mark.parametrize("n", SIZES)
def test_the_pattern_has_room_for_every_entry(n: int) -> None:
    seen = np.zeros((n, n), dtype=np.bool_)
    for latitude in LATITUDES:
        seen |= (np.abs(jacobian(random_vehicle(latitude))) > ZERO)[:n, :n]
    assert (with_states(PHI, n).pattern() == seen).all()


@both_sizes(PHI, PSI, INVARIANT)
def test_biases_stay_without_the_decay_and_scale_factors_for_ever(model: ErrorModel) -> None:
    F = np.zeros((model.states, model.states))
    model.write(navigator_state(random_vehicle(0.5)), F)
    assert not F[9:].any()


@pytest.mark.parametrize("mechanization", [NORTH_SLAVED, WANDER_AZIMUTH])
@pytest.mark.parametrize("name", ["phi", "psi"])
def test_attitude_errors_turn_by_half_of_a_correction(name: str, mechanization: str) -> None:
    """The error φ' left by a correction x is that of exp(−φ') = exp(x) exp(−φ), with SciPy's rotations."""
    model, rate, x = linear_model(name, mechanization), 50.0, np.array([0.02, -0.03, 0.05])
    F = np.zeros((2, model.states, model.states))
    state = np.random.default_rng(3).uniform(0.1, 0.5, own_room.END)
    state[strapdown.HEIGHT], state[strapdown.PER_STEP] = 1000.0, rate
    for correction, written in zip((np.zeros(3), x), F, strict=True):
        state[strapdown.CORRECTION : strapdown.CORRECTION + 3] = correction
        model.write(state, written)
    found = np.eye(3) + (F[1] - F[0])[ATT, ATT] / rate
    small = 1e-6
    left = Rotation.from_rotvec(x) * Rotation.from_rotvec(-(x + small * np.eye(3)))
    np.testing.assert_allclose(found, -left.as_rotvec().T / small, atol=x @ x / 4)
    assert np.count_nonzero(F[1] != F[0]) == 6


def test_a_correction_counts_in_the_step_after_it() -> None:
    """Two corrections between two steps add; the second step after them has none."""
    state = np.zeros(strapdown.LENGTH)
    state[strapdown.PER_STEP] = 10.0
    shown = []
    for corrections in ([(0.1, 0.0, 0.0), (0.0, 0.2, 0.0)], [], []):
        for one in corrections:
            strapdown.note_correction(state, one)
        strapdown.age_correction(state)
        shown.append(strapdown.reset_rate(state))
    np.testing.assert_allclose(shown, [(0.5, 1.0, 0.0), (0, 0, 0), (0, 0, 0)])
