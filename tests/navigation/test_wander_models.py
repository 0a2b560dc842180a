"""F in the wander frame against the derivative of the true nonlinear error propagation, over the pole too."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.base.arrays import ComplexArray, FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.motion.frames import earth
from lab.navigation import strapdown, wander
from lab.navigation.filters import error_models
from lab.navigation.filters.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, POS, VEL, ErrorModel
from lab.navigation.filters.wander_models import MODELS, linear_model
from lab.navigation.kernels.generation import Variant, interpret_kernel
from lab.navigation.settings import NavigatorSettings

LATITUDES = np.radians([-89.9999, -75.0, -45.0, -12.0, -0.5, 5.0, 33.0, 48.0, 89.0, 89.99999])
ZERO = 5e-14
"""Roundoff of five points in time; the smallest entry there is has 1e-12."""


class Vehicle(NamedTuple):
    """A navigator in a wander frame, and the inputs it feels; real, or complex to differentiate by it."""

    C_ew: ComplexArray
    height: complex
    velocity_w: ComplexArray
    C_wb: ComplexArray
    gyro_bias: ComplexArray
    accel_bias: ComplexArray
    omega_b: FloatArray
    f_b: FloatArray


def skew(v: ComplexArray) -> ComplexArray:
    """Return [v ×]."""
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def turn(M: ComplexArray) -> ComplexArray:
    """Return φ of a matrix I − [φ×]."""
    return -0.5 * np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])


def place(vehicle: Vehicle) -> ComplexArray:
    """Return r_e [m]: a sphere's, but for the ellipsoid's flatter way to the equator (Groves 2.112)."""
    up = -vehicle.C_ew[:, 2]
    radius = earth.SEMI_MAJOR_AXIS / np.sqrt(1 - earth.ECCENTRICITY_SQUARED * up[2] ** 2)
    shift = np.array([0, 0, earth.ECCENTRICITY_SQUARED * radius * up[2]])
    return (radius + vehicle.height) * up - shift


def transport_rate(vehicle: Vehicle) -> ComplexArray:
    """Return ω_ew from what it is: the rate at which the vertical turns, none of it about itself.

    The vertical is the gradient of the ellipsoid's equation at the foot of the height.
    """
    C, v_e = vehicle.C_ew, vehicle.C_ew @ vehicle.velocity_w
    up = -C[:, 2]
    foot = place(vehicle) - vehicle.height * up
    b_squared = earth.SEMI_MAJOR_AXIS**2 * (1 - earth.ECCENTRICITY_SQUARED)
    shape = np.diag(1 / np.array([earth.SEMI_MAJOR_AXIS**2, earth.SEMI_MAJOR_AXIS**2, b_squared]))
    gradient = shape @ foot
    size = np.sqrt(gradient @ gradient)
    # du/dt = (I − u uᵀ) shape d(foot)/dt / size, with d(foot)/dt = v − ḣ u − h du/dt.
    across = np.eye(3) - np.outer(up, up)
    bend = across @ shape / size
    up_rate = np.linalg.solve(np.eye(3) + vehicle.height * bend, bend @ (v_e - (up @ v_e) * up))
    return C.T @ np.cross(up, up_rate)


def moved(vehicle: Vehicle, seconds: float) -> Vehicle:
    """Return a vehicle moved along its present rates (Groves ch. 5.3)."""
    C, v = vehicle.C_ew, vehicle.velocity_w
    omega_ie, omega_ew = C.T @ np.array([0, 0, earth.RATE]), transport_rate(vehicle)
    g = np.array([0, 0, earth.gravity(-C[2, 2], vehicle.height)])
    push = vehicle.C_wb @ (vehicle.f_b - vehicle.accel_bias)
    turning = vehicle.C_wb @ skew(vehicle.omega_b - vehicle.gyro_bias)
    return vehicle._replace(
        C_ew=C + seconds * C @ skew(omega_ew),
        height=vehicle.height - seconds * v[2],
        velocity_w=v + seconds * (push + g - np.cross(2 * omega_ie + omega_ew, v)),
        C_wb=vehicle.C_wb + seconds * (turning - skew(omega_ie + omega_ew) @ vehicle.C_wb),
    )


def astray(truth: Vehicle, x: ComplexArray) -> Vehicle:
    """Return another navigator, by a small x of any kind."""
    return truth._replace(
        C_ew=truth.C_ew @ (np.eye(3) + skew(np.array([x[0], x[1], 0]) / 6.4e6)),
        height=truth.height + x[2],
        velocity_w=truth.velocity_w + x[VEL],
        C_wb=(np.eye(3) + skew(x[ATT])) @ truth.C_wb,
        gyro_bias=truth.gyro_bias + x[GYRO_BIAS],
        accel_bias=truth.accel_bias + x[ACCEL_BIAS],
    )


def own_error(model: ErrorModel, truth: Vehicle, estimate: Vehicle) -> ComplexArray:
    """Return the error in a model's own coordinates (15,), to first order, from its definition."""
    C_cw = estimate.C_ew.T @ truth.C_ew
    apart = place(estimate) - place(truth)
    x = np.zeros(15, dtype=np.complex128)
    x[POS] = estimate.C_ew.T @ apart
    x[VEL] = estimate.velocity_w - C_cw @ truth.velocity_w
    x[ATT] = turn(estimate.C_wb @ (C_cw @ truth.C_wb).T)
    if model.name == "phi":
        # The frame at the true place, turned to it from the computed one about a horizontal axis.
        delta = np.array([C_cw[1, 2], -C_cw[0, 2], 0])
        x[VEL] += np.cross(truth.velocity_w, delta)
        x[ATT] += delta
    if model.name == "invariant":
        omega = skew(np.array([0, 0, earth.RATE]))
        C_be, computed_be = (truth.C_ew @ truth.C_wb).T, (estimate.C_ew @ estimate.C_wb).T
        true_i, computed_i = (one.C_ew @ one.velocity_w + omega @ place(one) for one in (truth, estimate))
        x[POS], x[VEL] = C_be @ apart, C_be @ (computed_i - true_i)
        x[ATT] = turn(C_be @ computed_be.T)
    x[GYRO_BIAS] = estimate.gyro_bias - truth.gyro_bias
    x[ACCEL_BIAS] = estimate.accel_bias - truth.accel_bias
    return x


def north_error(truth: Vehicle, estimate: Vehicle) -> ComplexArray:
    """Return the error that leaves the filter (9,), to first order: in n, north-slaved."""
    (one, C_en), (other, C_ec) = (geodetic(vehicle) for vehicle in (truth, estimate))
    s, c = np.sin(one[0]), np.cos(one[0])
    w = 1 - earth.ECCENTRICITY_SQUARED * s * s
    transverse = earth.SEMI_MAJOR_AXIS / np.sqrt(w)
    meridian = transverse * (1 - earth.ECCENTRICITY_SQUARED) / w
    scale = np.array([meridian + truth.height, (transverse + truth.height) * c, -1])
    v_n, v_c = C_en.T @ truth.C_ew @ truth.velocity_w, C_ec.T @ estimate.C_ew @ estimate.velocity_w
    C_nb, C_cb = C_en.T @ truth.C_ew @ truth.C_wb, C_ec.T @ estimate.C_ew @ estimate.C_wb
    return np.concatenate((scale * (other - one), v_c - v_n, turn(C_cb @ C_nb.T)))


def geodetic(vehicle: Vehicle) -> tuple[ComplexArray, ComplexArray]:
    """Return latitude, longitude and height, and C_en, of a vehicle near one in the longitudes of ±90°."""
    up = -vehicle.C_ew[:, 2]
    latitude, longitude = np.arctan(up[2] / np.sqrt(up[0] ** 2 + up[1] ** 2)), np.arctan(up[1] / up[0])
    (s, c), (sl, cl) = ((np.sin(angle), np.cos(angle)) for angle in (latitude, longitude))
    C_en = np.array([[-s * cl, -sl, -c * cl], [-s * sl, cl, -c * sl], [c, 0, -s]])
    return np.array([latitude, longitude, vehicle.height]), C_en


def random_vehicle(latitude: float) -> Vehicle:
    """Return a vehicle in hard manoeuvre at a latitude; what else there is, at random."""
    rng = np.random.default_rng(int(1e6 * (latitude + 2)))
    about_axis = Rotation.from_rotvec([0, 0, rng.uniform(-1.4, 1.4)])
    C_en = about_axis * Rotation.from_rotvec([0, -(latitude + np.pi / 2), 0])
    return Vehicle(
        C_ew=(C_en * Rotation.from_rotvec([0, 0, rng.uniform(-np.pi, np.pi)])).as_matrix(),
        height=rng.uniform(-100, 12000),
        velocity_w=rng.normal(0, 100, 3),
        C_wb=Rotation.random(rng=rng).as_matrix(),
        gyro_bias=rng.normal(0, 1e-2, 3),
        accel_bias=rng.normal(0, 0.1, 3),
        omega_b=rng.normal(0, 0.5, 3),
        f_b=rng.normal(0, 15, 3),
    )


def put_quaternion(state: FloatArray, at: int, C: FloatArray) -> None:
    state[at : at + 4] = Rotation.from_matrix(C.real).as_quat(scalar_first=True)


STEP = interpret_kernel(strapdown.step, Variant(wander.STEP))


def navigator_state(vehicle: Vehicle) -> FloatArray:
    """Return the strapdown's state of a vehicle, all that is derived filled in by a step of no length."""
    state = np.zeros(wander.LENGTH)
    put_quaternion(state, wander.Q_EW, vehicle.C_ew)
    put_quaternion(state, strapdown.Q_NB, vehicle.C_wb)
    state[wander.AXIS : wander.AXIS + 3] = vehicle.C_ew[2]
    state[strapdown.SINE], state[strapdown.HEIGHT] = -vehicle.C_ew[2, 2], vehicle.height
    state[strapdown.VELOCITY : strapdown.VELOCITY + 3] = vehicle.velocity_w
    state[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 3] = vehicle.gyro_bias
    state[strapdown.ACCEL_BIAS : strapdown.ACCEL_BIAS + 3] = vehicle.accel_bias
    dt = 1e-9
    STEP(state, tuple(vehicle.omega_b * dt), tuple(vehicle.f_b * dt), dt)
    return state


def jacobians(model: ErrorModel, truth: Vehicle) -> tuple[FloatArray, FloatArray]:
    """Return F and T: complex steps in the error, five points in time."""
    step, weights = 0.3, {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
    own, own_rate, left = np.zeros((15, 15)), np.zeros((15, 15)), np.zeros((9, 15))
    for i, unit in enumerate(np.eye(15)):
        estimate = astray(truth, 1e-30j * unit)
        own[:, i] = own_error(model, truth, estimate).imag / 1e-30
        left[:, i] = north_error(truth, estimate).imag / 1e-30
        for n, weight in weights.items():
            later = own_error(model, moved(truth, n * step), moved(estimate, n * step))
            own_rate[:, i] += weight / step * later.imag / 1e-30
    return own_rate @ np.linalg.inv(own), left @ np.linalg.inv(own)


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_every_entry_is_the_derivative_of_the_true_error_propagation(
    model: ErrorModel, latitude: float
) -> None:
    vehicle = random_vehicle(latitude)
    state = navigator_state(vehicle)
    F = np.zeros((15, 15))
    interpret_kernel(model.write)(state, F)
    expected, T = jacobians(model, vehicle)
    real = np.abs(expected) > ZERO
    worst = np.abs(F[real] / expected[real] - 1).max()
    print(
        f"\n{model.name}, {np.degrees(latitude):.5f}°: {real.sum()} entries from "
        f"{np.abs(expected[real]).min():.1e} on, worst relative difference {worst:.1e}"
    )
    assert (np.abs(F - expected) <= 1e-5 * np.abs(expected) + np.where(real, 1e-15, ZERO)).all()
    assert (model.pattern() >= real).all()
    # Within a few metres of the pole its tan L takes most digits from north and east.
    digits = 1e-5 if abs(latitude) < np.radians(89.5) else 1e-3
    np.testing.assert_allclose(
        model.map(state)[:9], T, rtol=digits, atol=1e-12 * max(1.0, np.abs(np.tan(latitude)))
    )
    assert (model.map_pattern() >= (np.abs(T[:, :9]) > 1e-12)).all()


def test_every_linear_model_of_the_settings_is_written_for_both_mechanizations() -> None:
    named = [name for name in NavigatorSettings.param["model"].objects if name != "nonlinear"]
    assert list(MODELS) == list(error_models.MODELS) == named
    for mechanization in NavigatorSettings.param["mechanization"].objects:
        for name in named:
            assert linear_model(name, mechanization).mechanization == mechanization


def test_a_model_that_is_not_written_for_the_mechanization_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(error_models.MODELS, "new", error_models.PHI)
    assert linear_model("new", error_models.NORTH_SLAVED) is error_models.PHI
    with pytest.raises(SettingError, match=r"navigator\.model: the model new .* phi, psi, invariant$"):
        linear_model("new", error_models.WANDER_AZIMUTH)
