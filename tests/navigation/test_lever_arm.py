"""The lever arm and the latency the filter is told: H against finite differences, and over seeds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.analysis.consistency import chi_square_interval, normalised_squares
from lab.analysis.errors import error_state
from lab.base.arrays import FloatArray
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE
from lab.motion.frames import earth
from lab.navigation import strapdown, wander
from lab.navigation.filters.blocks import SCALES, find_places
from lab.navigation.filters.sigma_points import displace
from lab.navigation.kernels.generation import Variant, interpret_kernel
from lab.navigation.lever_arm import WINDOW, mean_rates_at_fixes, predict_antenna
from lab.navigation.solution import Imu

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
DT = 0.005
SILENT = np.zeros(12)
NONE = -1
"""For a filter without states of the lever arm, or of misalignments."""


STEP = interpret_kernel(strapdown.step, Variant(wander.STEP))


def navigator(rng: np.random.Generator) -> FloatArray:
    """Return a navigator after a step of a turning flight; its wander frame is north, east, down."""
    state = np.zeros(wander.LENGTH)
    wander.place(state, 0.8, 0.3, 500.0)
    state[strapdown.VELOCITY : strapdown.VELOCITY + 3] = rng.normal(0, 30, 3)
    q = rng.normal(size=4)
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = q / np.linalg.norm(q)
    state[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 3] = rng.normal(0, 0.01, 3)
    state[strapdown.GYRO_SCALE : strapdown.GYRO_SCALE + 3] = rng.normal(0, 0.01, 3)
    STEP(state, tuple(rng.normal(0, 1, 3) * DT), (0.01, -0.02, -0.05), DT)
    return state


def antenna(state: FloatArray, rate_measured: FloatArray, arm: FloatArray, age: float) -> FloatArray:
    """Return where the antenna of a navigator is and how it moves against its IMU (6,), from the geometry."""
    C_nb = np.array(strapdown.matrix(tuple(state[strapdown.Q_NB : strapdown.Q_NB + 4])))
    scale, bias = (state[at : at + 3] for at in (strapdown.GYRO_SCALE, strapdown.GYRO_BIAS))
    rate = (rate_measured - bias) / (1 + scale)
    angle = np.linalg.norm(rate) * age
    K = np.cross(np.eye(3), rate / np.linalg.norm(rate))
    back = np.eye(3) - np.sin(angle) * K + (1 - np.cos(angle)) * K @ K  # Rodrigues, by −ω age
    C_nb = C_nb @ back
    sine = state[strapdown.SINE]
    omega_ie = earth.RATE * np.array([np.sqrt(1 - sine**2), 0, -sine])
    return np.concatenate((C_nb @ arm, C_nb @ np.cross(rate, arm) - np.cross(omega_ie, C_nb @ arm)))


@pytest.mark.proof
@given(st.integers(0, 2**32 - 1), st.floats(0, DT))
def test_what_a_fix_sees_is_the_derivative_of_where_the_antenna_is(seed: int, age: float) -> None:
    """Error by error: taken out of the navigator, it moves the antenna by −H x, to first order."""
    rng = np.random.default_rng(seed)
    state, arm = navigator(rng), rng.normal(0, 3, 3)
    rate = np.array(state[strapdown.PREVIOUS_DTHETA : strapdown.PREVIOUS_DTHETA + 3]) / DT
    scale, bias = (state[at : at + 3] for at in (strapdown.GYRO_SCALE, strapdown.GYRO_BIAS))
    measured = rate * (1 + scale) + bias
    z, H, R = np.zeros(6), np.eye(6, 24), np.zeros((6, 6))
    state[strapdown.LEVER_ARM : strapdown.LEVER_ARM + 3] = wrong = rng.normal(0, 0.3, 3)
    predict_antenna(
        state, arm - wrong, np.append(measured, DT), age, SILENT, IDENTITY, z, H, R, True, 21, NONE
    )
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
        displace(moved, x, np.array(find_places(SCALES)))
        there = antenna(moved, measured, arm, age)
        # H leaves out how the turn over the fix's age, 5 ms at most, changes with the bias.
        np.testing.assert_allclose((here - there) / size, H[:, column], atol=bound)
    for axis in range(3):
        there = antenna(state, measured, arm + size * np.eye(3)[axis], age)
        np.testing.assert_allclose((there - here) / size, H[:, 21 + axis], atol=1e-7)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_arm_along_one_axis_is_one(axis: int) -> None:
    """A turn about the arm, or along the velocity it gives, leaves these as they are."""
    state, z, H = navigator(np.random.default_rng(1)), np.zeros(6), np.eye(6, 15)
    C_nb = np.array(strapdown.matrix(tuple(state[strapdown.Q_NB : strapdown.Q_NB + 4])))
    turn = np.array([0.4, -0.7, 0.5, DT])
    predict_antenna(
        state, np.eye(3)[axis], turn, 0.01, SILENT, IDENTITY, z, H, np.zeros((6, 6)), False, NONE, NONE
    )
    np.testing.assert_allclose(z[:3], C_nb[:, axis], atol=0.02)  # turned by 0.01 s at 1 rad/s
    for first in (0, 3):
        block = H[first : first + 3, 6:9]
        np.testing.assert_array_equal(block, -block.T)


def test_the_noise_of_the_gyros_is_in_r() -> None:
    """Over many draws of the increments about a fix the antenna's velocity varies as R says."""
    rng = np.random.default_rng(1)
    state, arm, density = navigator(rng), np.array([3.0, -1.0, 0.5]), np.array([1e-4, 4e-4, 1e-5])
    noise = np.append(density, np.zeros(9))
    state[strapdown.GYRO_SCALE : strapdown.GYRO_SCALE + 3] = 0
    R, samples = np.zeros((6, 6)), 20
    time, still = np.arange(samples + 1) * DT, np.zeros((samples, 3))
    turn = mean_rates_at_fixes(Imu(time, still, still), np.array([0.05]), arm)[0]
    predict_antenna(state, arm, turn, 0.0, noise, IDENTITY, np.zeros(6), np.eye(6, 15), R, False, NONE, NONE)
    seen = []
    for _ in range(4000):
        noisy = Imu(time, rng.normal(size=(samples, 3)) * np.sqrt(density * DT), still)
        z = np.zeros(6)
        turn = mean_rates_at_fixes(noisy, np.array([0.05]), arm)[0]
        predict_antenna(
            state, arm, turn, 0.0, SILENT, IDENTITY, z, np.eye(6, 15), np.zeros((6, 6)), False, NONE, NONE
        )
        seen.append(z)
    found = np.cov(np.array(seen).T)
    sigma = np.sqrt(np.diag(R)[3:])
    np.testing.assert_allclose(
        found[3:, 3:] / np.outer(sigma, sigma), R[3:, 3:] / np.outer(sigma, sigma), atol=0.1
    )


@given(st.floats(0, 0.05), st.floats(0.004, 0.2), st.floats(-1, 1))
def test_the_rate_about_a_fix_is_that_of_a_curve(time: float, step: float, growth: float) -> None:
    """Of a rate that grows evenly it is the rate at the fix, at the ends of the flight halfway to them."""
    stamps = np.arange(41) * step
    angle = 0.3 * stamps + growth / 2 * stamps**2
    imu = Imu(stamps, np.outer(np.diff(angle), (1, -2, 3)), np.zeros((40, 3)))
    times = np.array([0.0, stamps[-1] / 2 + time * step, stamps[-1] + 1])
    seen = mean_rates_at_fixes(imu, times, np.ones(3))
    window = max(WINDOW, 2 * step)
    middle = np.array([window / 4, times[1], stamps[-1] - window / 4])
    np.testing.assert_allclose(seen[:, 3], (window / 2, window, window / 2), rtol=1e-9)
    # The rate of the samples is a staircase: its mean is off by less than a step of it.
    off = abs(growth) * step / 4 + 1e-9
    np.testing.assert_allclose(seen[:, :3], np.outer(0.3 + growth * middle, (1, -2, 3)), atol=3 * off)


def test_the_rate_about_a_fix_does_not_jump() -> None:
    """With latency the time of a fix moves on: noise changes the rate by what comes into the window."""
    rng = np.random.default_rng(2)
    imu = Imu(np.arange(101) * DT, rng.normal(size=(100, 3)), np.zeros((100, 3)))
    times = np.linspace(0.2, 0.8, 601)  # a tenth of a sample apart
    change = np.abs(np.diff(mean_rates_at_fixes(imu, times, np.ones(3))[:, :3], axis=0)).max()
    assert change < 2 * np.abs(imu.dtheta).max() * (times[1] - times[0]) / DT / WINDOW + 1e-9


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


@pytest.mark.proof
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
