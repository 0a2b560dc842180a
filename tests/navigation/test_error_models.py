"""F against the derivative of the true nonlinear error propagation, entry by entry."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from lab import earth
from lab.navigation import strapdown
from lab.navigation.error_models import ACCEL_BIAS, ATT, GYRO_BIAS, PHI, POS, STATES, VEL, ErrorModel

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

# Below this an entry is nothing: the turn rate of the body cancels among the attitudes, but for its roundoff.
ZERO = np.full((15, 15), 1e-20)
ZERO[ATT, ATT] = 1e-16

LATITUDES = np.radians([-89.0, -75.0, -45.0, -12.0, -0.5, 5.0, 33.0, 48.0, 70.0, 89.0])


class Vehicle(NamedTuple):
    """A navigator's whole state in time-continuous navigation, and the inputs it feels.

    Real or, to differentiate by it, complex: latitude, longitude [rad] and height [m]; v_n; C_nb; gyro and
    accelerometer biases; measured ω_ib,b and f_b.
    """

    position: ComplexArray
    velocity_n: ComplexArray
    C_nb: ComplexArray
    gyro_bias: ComplexArray
    accel_bias: ComplexArray
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
    f_n = vehicle.C_nb @ (vehicle.f_b - vehicle.accel_bias)
    g_n = np.array([0, 0, earth.gravity(s, height)])
    velocity = f_n + g_n - skew(2 * omega_ie + omega_en) @ v
    attitude = (
        vehicle.C_nb @ skew(vehicle.omega_b - vehicle.gyro_bias) - skew(omega_ie + omega_en) @ vehicle.C_nb
    )
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
    )


def error_rate(truth: Vehicle, x: ComplexArray) -> ComplexArray:
    """Return ẋ (15,) to first order in x, where the navigator obeys the same equations as the truth."""
    estimate = astray(truth, x)
    computed, true = rates(estimate), rates(truth)
    out = np.zeros(15, dtype=np.complex128)
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
    """Return ∂ẋ/∂x (15, 15) by complex steps: exact to roundoff, whatever the step."""
    columns = [error_rate(truth, 1e-30j * unit).imag / 1e-30 for unit in np.eye(15)]
    return np.stack(columns, axis=-1)


def random_vehicle(latitude: float) -> Vehicle:
    """Return a vehicle in hard manoeuvre at a latitude; what else there is, at random."""
    rng = np.random.default_rng(int(1e6 * (latitude + 2)))
    return Vehicle(
        position=np.array([latitude, rng.uniform(-np.pi, np.pi), rng.uniform(-100, 12000)]),
        velocity_n=rng.normal(0, 100, 3),
        C_nb=Rotation.random(rng=rng).as_matrix(),
        gyro_bias=rng.normal(0, 1e-2, 3),
        accel_bias=rng.normal(0, 0.1, 3),
        omega_b=rng.normal(0, 0.5, 3),
        f_b=rng.normal(0, 15, 3),
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
    dt = 1e-9
    strapdown.step(state, tuple(vehicle.omega_b * dt), tuple(vehicle.f_b * dt), dt)
    return state


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("model", [PHI], ids=lambda model: model.name)
def test_every_entry_is_the_derivative_of_the_true_error_propagation(
    model: ErrorModel, latitude: float
) -> None:
    vehicle = random_vehicle(latitude)
    F = np.zeros((15, 15))
    model.write(navigator_state(vehicle), F)
    expected = jacobian(vehicle)
    real = np.abs(expected) > ZERO
    worst = np.abs(F[real] / expected[real] - 1).max()
    print(f"\n{np.degrees(latitude):.1f}°: {real.sum()} entries, worst relative difference {worst:.1e}")
    wrong = np.abs(F - expected) > 1e-5 * np.abs(expected) + ZERO
    named = [
        f"∂({STATES[i]})˙/∂({STATES[j]}): {F[i, j]:.8g}, not {expected[i, j]:.8g}"
        for i, j in np.argwhere(wrong)
    ]
    assert not named, "\n".join(named)


def test_the_pattern_has_room_for_every_entry() -> None:
    seen = np.zeros((15, 15), dtype=np.bool_)
    for latitude in LATITUDES:
        seen |= np.abs(jacobian(random_vehicle(latitude))) > ZERO
    assert (PHI.pattern() == seen).all()


def test_biases_stay_without_the_decay() -> None:
    F = np.zeros((15, 15))
    PHI.write(navigator_state(random_vehicle(0.5)), F)
    assert not F[9:].any()
