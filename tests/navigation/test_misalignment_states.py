"""States for misalignments: derivatives, the correction of measurements, and cards as loaded."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.stats import chi2

from lab import Experiment, card
from lab.analysis.errors import error_state
from lab.base.arrays import FloatArray
from lab.experiment.stages import CACHE
from lab.navigation import strapdown
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import (
    ACCEL_BIAS,
    ACCEL_SCALE,
    ATT,
    GYRO_BIAS,
    GYRO_SCALE,
    MODELS,
    VEL,
)
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.lever_arm import predict_antenna
from lab.sensors.imu_errors import OFF_DIAGONAL

ROWS, COLUMNS = (tuple("xyz".index(pair[k]) for pair in OFF_DIAGONAL) for k in (0, 1))
ALL = (*blocks.SCALES, *blocks.MISALIGNMENTS)
GYRO = (strapdown.GYRO_BIAS, strapdown.GYRO_SCALE, strapdown.GYRO_MISALIGNMENT)
ACCELEROMETER = (strapdown.ACCEL_BIAS, strapdown.ACCEL_SCALE, strapdown.ACCEL_MISALIGNMENT)


def mixing(scale: FloatArray, off: FloatArray) -> FloatArray:
    """Return I + S + M, complex where an element is."""
    C = np.diag(1 + scale).astype(np.result_type(scale, off))
    C[ROWS, COLUMNS] = off
    return C


def moving(rng: np.random.Generator, off: float = 0.0) -> FloatArray:
    """Return a navigator after a step in a hard manoeuvre, with misalignments of some size [rad]."""
    state = np.zeros(strapdown.LENGTH)
    strapdown.set_position(state, 0.8, 0.3, 900.0)
    state[strapdown.VELOCITY : strapdown.VELOCITY + 3] = rng.normal(0, 50, 3)
    q = rng.normal(size=4)
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = q / np.linalg.norm(q)
    for bias, scale, pairs in (GYRO, ACCELEROMETER):
        state[bias : bias + 3] = rng.normal(0, 0.01, 3)
        state[scale : scale + 3] = rng.normal(0, 0.02, 3)
        state[pairs : pairs + 6] = rng.normal(0, off, 6)
    dt = 1e-9
    strapdown.step(state, tuple(rng.normal(0, 0.5, 3) * dt), tuple(rng.normal(0, 15, 3) * dt), dt)
    return state


@pytest.mark.proof
@pytest.mark.parametrize("model", list(MODELS))
@pytest.mark.parametrize("names", [ALL, (*blocks.MISALIGNMENTS, blocks.LEVER_ARM)], ids=["33", "30"])
def test_columns_are_derivatives(model: str, names: tuple[str, ...]) -> None:
    """X = (I + S + M)⁻¹ (y − b) by complex steps; the error of a rate turns, that of a force accelerates."""
    whole = with_blocks(MODELS[model], names)
    for seed in range(3):
        state = moving(np.random.default_rng(seed))
        F = np.zeros((whole.states, whole.states))
        whole.write(state, F)
        C_nb = np.eye(3) if whole.in_body else state[strapdown.C_NB :][:9].reshape(3, 3)
        kinds = (
            (GYRO, strapdown.PREVIOUS_DTHETA, ATT, -1.0, blocks.GYRO_MISALIGNMENT),
            (ACCELEROMETER, strapdown.PREVIOUS_DVELOCITY, VEL, 1.0, blocks.ACCEL_MISALIGNMENT),
        )
        for (bias, scale, _), previous, rows, sign, name in kinds:
            mean = state[previous : previous + 3] * state[strapdown.PER_STEP]
            size = state[scale : scale + 3]
            y = mixing(size, np.zeros(6)) @ mean + state[bias : bias + 3]
            there = C_nb @ np.linalg.inv(mixing(size, np.zeros(6)))
            if blocks.GYRO_SCALE in names:  # otherwise no scale factor is estimated: all are zero
                own, first = (GYRO_BIAS, GYRO_SCALE) if rows == ATT else (ACCEL_BIAS, ACCEL_SCALE)
                np.testing.assert_allclose(F[rows, own], -sign * there, rtol=1e-12)
                np.testing.assert_allclose(F[rows, first], -sign * there * mean, rtol=1e-12)
            for k, column in enumerate(np.eye(6)):
                unbiased = y - state[bias : bias + 3]
                change = np.linalg.solve(mixing(size, 1e-30j * column), unbiased).imag / 1e-30
                found = F[rows, blocks.first_state(names, name) + k]
                np.testing.assert_allclose(found, sign * C_nb @ change, rtol=1e-9, atol=1e-12)


SIZES = st.floats(-0.02, 0.02)


@given(
    arrays.arrays(np.float64, 3, elements=st.floats(-5, 5)),
    arrays.arrays(np.float64, 3, elements=SIZES),
    arrays.arrays(np.float64, 6, elements=SIZES),
)
def test_the_correction_is_the_inverse_of_the_sensor(
    rate: FloatArray, scale: FloatArray, off: FloatArray
) -> None:
    state, bias, dt = np.zeros(strapdown.LENGTH), np.array([0.01, -0.02, 0.03]), 0.01
    for at, values in zip(GYRO, (bias, scale, off), strict=True):
        state[at : at + values.size] = values
    measured = (mixing(scale, off) @ rate + bias) * dt
    found = np.array(strapdown.corrected(state, tuple(measured), dt, *GYRO)) / dt
    # Third order: at most 2 · 0.02 in each row, to the third power.
    assert np.abs(found - rate).max() <= 1.1 * (2 * 0.0205) ** 3 * (np.abs(rate).max() + 0.03) + 1e-12


def test_h_of_a_lever_arm_is_a_derivative() -> None:
    rng = np.random.default_rng(1)
    state, turn = moving(rng), np.array([0.3, -0.2, 0.5, 0.1])
    axes = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    first = blocks.first_state(ALL, blocks.GYRO_MISALIGNMENT)

    def seen(state: FloatArray) -> tuple[FloatArray, FloatArray]:
        z, H = np.zeros(6), np.zeros((6, blocks.count(ALL)))
        arm, noise = np.array([2.0, 1.0, -1.0]), np.zeros(12)
        predict_antenna(state, arm, turn, 0.0, noise, axes, z, H, np.zeros((6, 6)), True, -1, first)
        return z, H

    H = seen(state)[1]
    for k in range(6):
        step = np.zeros(strapdown.LENGTH)
        step[strapdown.GYRO_MISALIGNMENT + k] = 1e-4
        change = (seen(state + step)[0] - seen(state - step)[0]) / 2e-4
        np.testing.assert_allclose(H[:, first + k], change, rtol=1e-3, atol=1e-6)


def nees_per_state(experiment: Experiment, runs: int) -> float:
    """Return the mean NEES per state over the fixes of some runs: an ensemble judges each too, for longer."""
    squares = []
    for seed in range(1, runs + 1):
        result = experiment.copy().update({"seed": seed}).run()
        squares.append(float(result.consistency["nees"].mean()) / result.solution_arrays.states)
    CACHE.clear()
    return float(np.mean(squares))


@pytest.mark.proof
@pytest.mark.parametrize("name", ["LSM6DSO", "ADIS16470", "STIM300", "HG9900"])
def test_the_filter_that_a_card_brings_tells_the_truth(name: str) -> None:
    """One card of each grade, as loaded: NEES of all states is near one, and far above it without these."""
    nees = {}
    for as_loaded in (False, True):
        experiment = Experiment(mission="montreal")
        experiment.trajectory.imu_rate = 50
        card(name).load(experiment)
        if not as_loaded:
            experiment.navigator.estimate_misalignments = False
            experiment.navigator.estimate_g_sensitivity = False
        nees[as_loaded] = nees_per_state(experiment, 8)
    print(f"\n{name}: NEES per state {nees[False]:.2f} without the states, {nees[True]:.2f} as loaded")
    assert 0.7 < nees[True] < 1.35
    assert nees[False] > 3 * nees[True]


@pytest.mark.proof
def test_a_flight_of_turns_needs_the_states_that_a_card_brings() -> None:
    """On pacific, 0.04 °/s/g of a consumer part are 7 σ of the gyro bias if no state stands for them."""
    nees = {}
    for wanted in (False, True):
        experiment = Experiment(mission="pacific")
        experiment.trajectory.imu_rate = 50
        card("BMI270").load(experiment)
        if not wanted:
            experiment.navigator.estimate_g_sensitivity = False
        nees[wanted] = nees_per_state(experiment, 6)
    print(f"\nBMI270: NEES per state {nees[False]:.2f} without, {nees[True]:.2f} as loaded")
    assert 0.7 < nees[True] < 1.35
    assert nees[False] > 3 * nees[True]


def quiet(name: str, seed: int) -> Experiment:
    """Return a flight with a card and states for all its constant errors."""
    experiment = Experiment(mission="montreal", seed=seed)
    experiment.trajectory.imu_rate = 50
    card(name).load(experiment)
    return experiment


def test_what_gravity_shows_of_bias_and_scale_factor_has_its_sigma() -> None:
    """The mix of b_z and s_z that is known best, to some µg, does not turn with the estimates.

    With the bias inside the scale factor, (1 + s) (f + b), the square over the variance was 18.
    """
    squares = []
    for seed in range(1, 21):
        result = quiet("ADIS16465-1", seed).run()
        solution, last = result.solution_arrays, np.array([result.solution_arrays.fix_sample[-1]])
        x = error_state(
            solution,
            last,
            result.truth_arrays,
            result.true_bias,
            result.true_scale,
            result.true_further(),
        )[0]
        pair = np.array([ACCEL_BIAS.stop - 1, ACCEL_SCALE.stop - 1])
        P, unit = solution.fix_covariance[-1][np.ix_(pair, pair)], np.array([1e-3, 1e-3])
        variance, directions = np.linalg.eigh(P / np.outer(unit, unit))
        squares.append((directions[:, 0] @ (x[pair] / unit)) ** 2 / variance[0])
    print(f"\nerror²/σ² of the mix known best: {np.mean(squares):.2f}")
    low, high = chi2.ppf([0.0005, 0.9995], len(squares))
    assert low < np.sum(squares) < high


@pytest.mark.proof
def test_cards_with_large_biases_and_scale_factors_tell_the_truth() -> None:
    """Accelerometers of 60 to 80 mg and 3 %, gyros of 5 °/s and 3 %; with the biases inside, NEES was 1.3."""
    nees = nees_per_state(quiet("MPU-9250", 1), 40)
    print(f"\nMPU-9250: NEES per state {nees:.2f}")
    assert 0.9 < nees < 1.12


def test_the_remark_names_the_remedy_and_then_stays_silent() -> None:
    experiment = Experiment(mission="los_angeles")
    experiment.navigator.states = 21
    experiment.sensors.gyro.misalignment = 0.2
    assert "navigator.estimate_misalignments" in " ".join(experiment.run().remarks)
    experiment.navigator.estimate_misalignments = True
    experiment.navigator.estimate_g_sensitivity = True  # so that this filter is that of cards
    result = experiment.run()
    assert "misalignment" not in " ".join(result.remarks)
    states = result.further_states
    assert list(states.state.values[:1]) == ["gyro misalignment xy"]
    assert float(states.truth.sel(state="gyro misalignment zy")[0]) == pytest.approx(0.2)
