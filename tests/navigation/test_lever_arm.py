"""The lever arm and the latency the filter is told: H against finite differences, and over seeds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lab import earth
from lab.analysis.consistency import chi_square_interval, normalised_squares
from lab.analysis.errors import error_state
from lab.experiment import CACHE, Experiment
from lab.navigation import strapdown
from lab.navigation.lever_arm import see_antenna
from lab.navigation.sigma_points import displace
from lab.result import Result

FloatArray = NDArray[np.float64]

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
DT = 0.005
SILENT = np.zeros(12)


def navigator(rng: np.random.Generator) -> FloatArray:
    """Return a navigator after a step of a turning flight."""
    state = np.zeros(strapdown.LENGTH)
    strapdown.set_position(state, 0.8, 0.3, 500.0)
    state[strapdown.VELOCITY : strapdown.VELOCITY + 3] = rng.normal(0, 30, 3)
    q = rng.normal(size=4)
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = q / np.linalg.norm(q)
    state[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 3] = rng.normal(0, 0.01, 3)
    state[strapdown.GYRO_SCALE : strapdown.GYRO_SCALE + 3] = rng.normal(0, 0.01, 3)
    strapdown.step(state, tuple(rng.normal(0, 1, 3) * DT), (0.01, -0.02, -0.05), DT)
    return state


def antenna(state: FloatArray, rate_measured: FloatArray, arm: FloatArray, age: float) -> FloatArray:
    """Return where the antenna of a navigator is and how it moves against its IMU (6,), from the geometry."""
    C_nb = np.array(strapdown.matrix(tuple(state[strapdown.Q_NB : strapdown.Q_NB + 4])))
    scale, bias = (state[at : at + 3] for at in (strapdown.GYRO_SCALE, strapdown.GYRO_BIAS))
    rate = rate_measured / (1 + scale) - bias
    angle = np.linalg.norm(rate) * age
    K = np.cross(np.eye(3), rate / np.linalg.norm(rate))
    back = np.eye(3) - np.sin(angle) * K + (1 - np.cos(angle)) * K @ K  # Rodrigues, by −ω age
    C_nb = C_nb @ back
    sine = state[strapdown.SINE]
    omega_ie = earth.RATE * np.array([np.sqrt(1 - sine**2), 0, -sine])
    return np.concatenate((C_nb @ arm, C_nb @ np.cross(rate, arm) - np.cross(omega_ie, C_nb @ arm)))


@given(st.integers(0, 2**32 - 1), st.floats(0, DT))
def test_what_a_fix_sees_is_the_derivative_of_where_the_antenna_is(seed: int, age: float) -> None:
    """Error by error: taken out of the navigator, it moves the antenna by −H x, to first order."""
    rng = np.random.default_rng(seed)
    state, arm = navigator(rng), rng.normal(0, 3, 3)
    rate = np.array(state[strapdown.PREVIOUS_DTHETA : strapdown.PREVIOUS_DTHETA + 3]) / DT
    scale, bias = (state[at : at + 3] for at in (strapdown.GYRO_SCALE, strapdown.GYRO_BIAS))
    measured = (rate + bias) * (1 + scale)
    z, H, R = np.zeros(6), np.eye(6, 21), np.zeros((6, 6))
    see_antenna(state, arm, age, SILENT, IDENTITY, z, H, R)
    here = antenna(state, measured, arm, age)
    np.testing.assert_allclose(z, here, atol=1e-9)
    np.testing.assert_array_equal(R, 0)
    np.testing.assert_array_equal(H[:3, 3:6], -age * np.eye(3))
    size = 1e-6
    # Left out beside: how the small ω_ie × l turns with the attitude.
    bound = (2 * earth.RATE + 2 * age * (1 + np.linalg.norm(rate)) ** 2) * np.linalg.norm(arm) + 1e-6
    for column in (*range(6, 12), *range(15, 18)):
        x = np.zeros(21)
        x[column] = size
        moved = state.copy()
        displace(moved, x)
        there = antenna(moved, measured, arm, age)
        # H leaves out how the turn over the fix's age, 5 ms at most, changes with the bias.
        np.testing.assert_allclose((here - there) / size, H[:, column], atol=bound)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_arm_along_one_axis_is_one(axis: int) -> None:
    """A turn about the arm, or along the velocity it gives, leaves these as they are."""
    state, z, H = navigator(np.random.default_rng(1)), np.zeros(6), np.eye(6, 15)
    C_nb = np.array(strapdown.matrix(tuple(state[strapdown.Q_NB : strapdown.Q_NB + 4])))
    see_antenna(state, np.eye(3)[axis], 0.01, SILENT, IDENTITY, z, H, np.zeros((6, 6)))
    np.testing.assert_allclose(z[:3], C_nb[:, axis], atol=0.02)  # turned by 0.01 s at 1 rad/s
    for first in (0, 3):
        block = H[first : first + 3, 6:9]
        np.testing.assert_array_equal(block, -block.T)


def test_the_noise_of_the_gyros_is_in_r() -> None:
    """Over many draws of the last increment the antenna's velocity varies as R says."""
    rng = np.random.default_rng(1)
    state, arm, density = navigator(rng), np.array([3.0, -1.0, 0.5]), np.array([1e-4, 4e-4, 1e-5])
    noise = np.append(density, np.zeros(9))
    R = np.zeros((6, 6))
    see_antenna(state, arm, 0.0, noise, IDENTITY, np.zeros(6), np.eye(6, 15), R)
    seen = []
    for _ in range(4000):
        noisy = state.copy()
        at = slice(strapdown.PREVIOUS_DTHETA, strapdown.PREVIOUS_DTHETA + 3)
        noisy[at] += rng.normal(size=3) * np.sqrt(density * DT)
        z = np.zeros(6)
        see_antenna(noisy, arm, 0.0, SILENT, IDENTITY, z, np.eye(6, 15), np.zeros((6, 6)))
        seen.append(z)
    found = np.cov(np.array(seen).T)
    sigma = np.sqrt(np.diag(R)[3:])
    np.testing.assert_allclose(
        found[3:, 3:] / np.outer(sigma, sigma), R[3:, 3:] / np.outer(sigma, sigma), atol=0.1
    )


def run(seed: int, **settings: object) -> Result:
    experiment = Experiment(mission="los_angeles", seed=seed)
    for name, value in settings.items():
        experiment.set(name.replace("__", "."), value)
    return experiment.run()


TOLD = {
    "phi": {},
    "invariant": {"navigator__model": "invariant"},
    "wander azimuth": {"navigator__mechanization": "wander azimuth"},
    "nonlinear": {"navigator__model": "nonlinear"},
}
RTK = {
    "sensors__gps__lever_arm": (3.0, 0.5, -1.0),
    "sensors__gps__latency": 0.15,
    "sensors__gps__position_variance": 0.02**2,
    "sensors__gps__velocity_variance": 0.03**2,
}


@pytest.mark.parametrize("settings", TOLD.values(), ids=TOLD)
def test_accurate_fixes_of_an_antenna_three_metres_off_are_consistent(settings: dict[str, object]) -> None:
    """With an RTK receiver, at 2 cm, a lever arm that is not in H shows at once."""
    seeds = range(1, 7)
    nis, squares = [], []
    for seed in seeds:
        result = run(seed, **RTK, **settings)
        solution = result.solution_arrays
        used = np.flatnonzero(solution.fix_sample >= 0)[20:]
        nis.append(normalised_squares(solution.innovation[used], solution.innovation_covariance[used]))
        x = error_state(solution, solution.fix_sample[used], result.known_truth("errors"), result.true_bias)
        squares.append(x[:, :9] ** 2 / np.diagonal(solution.fix_covariance[used], axis1=1, axis2=2)[:, :9])
    CACHE.clear()
    count = sum(values.size for values in nis)
    low, high = chi_square_interval(6, count, 0.999)
    mean = float(np.concatenate(nis).mean())
    ratio = np.sqrt(np.concatenate(squares).mean())
    print(f"\nNIS {mean:.2f} ({low:.2f} to {high:.2f}), errors {ratio:.2f} σ")
    assert low * 0.95 < mean < high * 1.05
    assert 0.8 < ratio < 1.2


def test_with_an_arm_the_heading_is_known_better() -> None:
    """The velocity of an antenna that swings shows the heading, beside what the accelerations show."""
    settings = {**RTK, "sensors__gps__latency": 0.0}
    with_arm = run(1, **settings).solution_arrays
    without = run(1, **(settings | {"sensors__gps__lever_arm": 0.0})).solution_arrays
    sigma = [np.sqrt(solution.variance[2000:, 8]).mean() for solution in (with_arm, without)]
    print(f"\nheading σ {np.degrees(sigma[0]):.3f}° with the arm, {np.degrees(sigma[1]):.3f}° without")
    assert sigma[0] < sigma[1]


def test_what_the_filter_is_not_told_it_does_not_know() -> None:
    told, untold = (
        run(1, **RTK, **settings)
        for settings in ({}, {"navigator__lever_arm": 0.0, "navigator__latency": 0.0})
    )
    assert np.nanmax(np.abs(untold.errors.position.values)) > 10 * np.nanmax(
        np.abs(told.errors.position.values[2000:])
    )
    given = run(1, **RTK, navigator__lever_arm=(3.0, 0.5, -1.0), navigator__latency=0.15)
    np.testing.assert_array_equal(given.solution_arrays.position, told.solution_arrays.position)
