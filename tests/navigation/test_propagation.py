"""The generated propagation and the sequential update against dense matrices, and P over a whole flight."""

from __future__ import annotations

import numpy as np
import pytest
from flown import fly
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from sized_models import with_states

from lab.base.arrays import FloatArray
from lab.experiment.stages import start
from lab.navigation.belief import belief
from lab.navigation.filters import kalman
from lab.navigation.filters.error_models import ATT, PHI, VEL
from lab.navigation.filters.filter import Filter
from lab.navigation.filters.prediction import second_order
from lab.navigation.kernels.generation import Variant, generate_module
from lab.navigation.kernels.propagation import (
    build_propagate,
    layout,
    layout_constants,
    propagate,
    propagate_over,
)
from lab.navigation.navigator import Fixes, Schedule, Solution, advance
from lab.navigation.settings import NavigatorSettings
from lab.sensors import gps
from lab.sensors.suite import SensorSuite

MODELS = {n: with_states(PHI, n) for n in (15, 21)}
MADE = {
    n: generate_module(
        f"propagation {n}",
        "The propagation of a filter.",
        [propagate, propagate_over],
        Variant({propagate: build_propagate(model)}, layout_constants(model.blocks)),
    )
    for n, model in MODELS.items()
}
LAYOUTS = {n: layout(model.blocks) for n, model in MODELS.items()}
TYPICAL = np.repeat([1.0, 0.3, 0.01, 2e-3, 0.02], 3)
"""Sizes of the error states [m], [m/s], [rad], [rad/s], [m/s²]."""

seeds = st.integers(0, 2**32 - 1)


def random_covariance(rng: np.random.Generator, scale: FloatArray, condition: float = 1e4) -> FloatArray:
    """Return a full covariance of given sizes: the correlation's eigenvalues spread over the condition."""
    Q, _ = np.linalg.qr(rng.normal(size=(scale.size, scale.size)))
    spread = condition ** -rng.uniform(0, 1, scale.size)
    P = scale[:, None] * (Q * spread) @ Q.T * scale
    return (P + P.T) / 2


def workspace(P: FloatArray, x: FloatArray) -> FloatArray:
    """Return a workspace that holds [P | x]."""
    space = LAYOUTS[x.size]
    w = np.zeros(space.size)
    view = w[: space.product].reshape(space.STATES, space.WIDTH)
    view[:, : space.STATES], view[:, space.X] = P, x
    return w


def contents(w: FloatArray, states: int = 15) -> tuple[FloatArray, FloatArray]:
    """Return P and x."""
    space = LAYOUTS[states]
    view = w[: space.product].reshape(space.STATES, space.WIDTH)
    return view[:, :states].copy(), view[:, space.X].copy()


def relative(found: FloatArray, expected: FloatArray, sigma: FloatArray) -> float:
    """Return the largest difference of covariances, in units of the σ of both states."""
    return float(np.abs((found - expected) / np.outer(sigma, sigma)).max())


def assert_propagated(w: FloatArray, Phi: FloatArray, P: FloatArray, x: FloatArray) -> None:
    """Compare a workspace with Φ P Φᵀ and Φ x."""
    found, x_found = contents(w, x.size)
    expected = Phi @ P @ Phi.T
    np.testing.assert_array_equal(found, found.T)
    assert relative(found, expected, np.sqrt(np.diag(expected))) < 1e-13
    np.testing.assert_allclose(
        x_found, Phi @ x, rtol=0, atol=1e-13 * np.abs(x).max() * np.abs(Phi).sum(1).max()
    )


@pytest.mark.proof
@given(seeds, st.floats(1e-4, 1.0), st.sampled_from([15, 21]))
def test_generated_propagation_is_the_dense_product(seed: int, dt: float, n: int) -> None:
    rng = np.random.default_rng(seed)
    F = MODELS[n].pattern() * rng.normal(size=(n, n))
    P, x, decay = random_covariance(rng, np.ones(n)), rng.normal(size=n), rng.uniform(0.5, 1, 6)
    w = workspace(P, x)
    MADE[n][propagate](F, dt, tuple(decay.tolist()), w)
    Phi = np.eye(n) + F * dt
    Phi[9:15, 9:15] = np.diag(decay)
    assert_propagated(w, Phi, P, x)


@given(seeds, st.sampled_from([15, 21]))
def test_propagation_over_many_samples_is_the_dense_product(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    E = np.zeros((n, n))
    E[:9] = rng.normal(size=(9, n))
    E[np.arange(9, 15), np.arange(9, 15)] = rng.uniform(-0.5, 0, 6)
    P, x = random_covariance(rng, np.ones(n)), rng.normal(size=n)
    w = workspace(P, x)
    MADE[n][propagate_over](E, w)
    assert_propagated(w, np.eye(n) + E, P, x)


@pytest.mark.proof
@given(seeds, st.sampled_from([15, 21]))
def test_transition_over_many_samples_is_the_matrix_exponential(seed: int, n: int) -> None:
    """To third order: it leaves less than a fifth of the error to second order."""
    rng = np.random.default_rng(seed)
    A = 0.03 * MODELS[n].pattern() * rng.uniform(-1, 1, size=(n, n))
    rates, elapsed = rng.uniform(0, 0.5, 6), 0.1
    E = np.zeros((n, n))
    second_order(A, elapsed, rates, E)
    A[9:15, 9:15] -= elapsed * np.diag(rates)
    to_second_order = np.abs(np.eye(n) + A + A @ A / 2 - expm(A)).max()
    assert np.abs(np.eye(n) + E - expm(A)).max() < 0.2 * to_second_order


@given(seeds, st.sampled_from([1.0, 100.0, 1e-2]), st.booleans())
def test_update_is_the_textbook_one(seed: int, r_scale: float, diagonal: bool) -> None:
    rng = np.random.default_rng(seed)
    P, x = random_covariance(rng, TYPICAL), TYPICAL * rng.normal(size=15)
    R = r_scale * random_covariance(rng, np.repeat([0.7, 0.45], 3))
    R = np.diag(np.diag(R)) if diagonal else R
    z = np.repeat([3.0, 1.0], 3) * rng.normal(size=6)
    H = np.eye(6, 15)
    H[:, 6:12] = 0.3 * rng.normal(size=(6, 6))  # as a lever arm gives it
    w, S, scalars = workspace(P, x), np.zeros((6, 6)), np.zeros((6, 32))
    kalman.predict_fix(P, H, R, S)
    kalman.update(w, z, H, R, scalars)
    found, x_found = contents(w)

    # Joseph form with the whole fix at once (Groves 3.58).
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    left = np.eye(15) - K @ H
    sigma = np.sqrt(np.diag(P))
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_allclose(S, H @ P @ H.T + R, rtol=1e-12, atol=1e-13 * np.diag(S).max())
    assert relative(found, left @ P @ left.T + K @ R @ K.T, sigma) < 1e-9
    np.testing.assert_allclose((x_found - x - K @ (z - H @ x)) / sigma, 0, atol=1e-8)
    assert np.linalg.eigvalsh(found / np.outer(sigma, sigma)).min() > 0


@given(seeds)
def test_one_fix_after_another_is_their_information_summed(seed: int) -> None:
    """Without motion, P⁻¹ grows by Hᵀ R⁻¹ H with each fix, and the order of the fixes is of no account."""
    rng = np.random.default_rng(seed)
    P, R = random_covariance(rng, TYPICAL, 100), random_covariance(rng, np.repeat([0.7, 0.45], 3), 100)
    fixes = rng.normal(size=(4, 6))
    results = []
    for order in (fixes, fixes[::-1]):
        w = workspace(P, np.zeros(15))
        for z in order:
            kalman.update(w, z, np.eye(6, 15), R, np.zeros((6, 32)))
        results.append(contents(w))
    scaled = np.outer(TYPICAL, TYPICAL)
    information = np.linalg.inv(P / scaled)
    information[:6, :6] += 4 * np.linalg.inv(R / scaled[:6, :6])
    np.testing.assert_allclose(results[0][0] / scaled, np.linalg.inv(information), atol=1e-9)
    for one, other in zip(*results, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * np.abs(one).max())


def noisy_fixes(name: str, rate: float) -> tuple[Fixes, SensorSuite]:
    """Return fixes of a mission with the default receiver's errors."""
    sensors = SensorSuite()
    flight = fly(name, rate)
    times = gps.fix_times(sensors.gps, flight.trajectory.duration)
    found = gps.measure(flight.trajectory.at(times), sensors.gps, gps.GpsDraws.of(1, times.size))
    return Fixes(found.time, found.position, found.velocity_n), sensors


@pytest.mark.proof
@pytest.mark.parametrize("name", ["montreal", "los_angeles"])
@pytest.mark.parametrize(
    "scales", [{}, {"q_scale": 1e6}, {"r_scale": 1e-6}, {"p0_scale": 1e6}, {"q_scale": 1e-6}]
)
def test_covariance_stays_symmetric_and_positive_over_a_whole_flight(
    name: str, scales: dict[str, float]
) -> None:
    flight, (fixes, sensors) = fly(name), noisy_fixes(name, 200.0)
    settings = NavigatorSettings(**scales)
    assumed = belief(sensors, settings)
    begin = start(flight.truth, settings, 1)
    out = Solution.empty(flight.imu.time.size, fixes.time.size)
    run = Filter.begin(begin, assumed, 0.0)
    smallest, step = np.inf, 167
    for first in range(0, flight.imu.dtheta.shape[0], step):
        part = flight.imu._replace(
            time=flight.imu.time[: first + step + 1],
            dtheta=flight.imu.dtheta[: first + step],
            dvelocity=flight.imu.dvelocity[: first + step],
        )
        advance(run, part, fixes, out, first, Schedule())
        P, _ = contents(run.w)
        np.testing.assert_array_equal(P, P.T)
        sigma = np.sqrt(np.diag(P))
        smallest = min(smallest, np.linalg.eigvalsh(P / np.outer(sigma, sigma)).min())
    for P in out.fix_covariance:
        np.testing.assert_array_equal(P, P.T)
    assert (out.variance > 0).all()
    print(f"\n{name} {scales}: smallest eigenvalue of the correlation {smallest:.2e}")
    assert smallest > 0


def test_covariance_at_rest_is_the_integral_of_the_riccati_equation() -> None:
    """Steps of 5 ms come to what the matrix exponential (Van Loan) gives for the whole second."""
    flight = fly("montreal")
    assumed = belief(SensorSuite(), NavigatorSettings())
    second = flight.imu._replace(
        time=flight.imu.time[:201], dtheta=flight.imu.dtheta[:200], dvelocity=flight.imu.dvelocity[:200]
    )
    no_fixes = Fixes(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    run = Filter.begin(start(flight.truth, NavigatorSettings(), 1), assumed, 0.0)
    out = Solution.empty(201, 0)
    advance(run, second, no_fixes, out, 0, Schedule())
    found, _ = contents(run.w)
    F = run.F.copy()
    F[9:, 9:] -= np.diag(assumed.decay)
    C_nb = F[ATT, 9:12]
    G = np.zeros((15, 12))
    G[ATT, :3], G[VEL, 3:6], G[9:, 6:] = C_nb, C_nb, np.eye(6)
    block = np.block([[-F, G @ np.diag(assumed.noise) @ G.T], [np.zeros((15, 15)), F.T]])
    exponential = expm(block)
    Phi = exponential[15:, 15:].T
    expected = Phi @ assumed.P0 @ Phi.T + Phi @ exponential[:15, 15:]
    assert relative(found, expected, np.sqrt(np.diag(expected))) < 5e-4
    np.testing.assert_allclose(np.diag(found), np.diag(expected), rtol=1e-3)
