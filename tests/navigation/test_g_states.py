"""States for g-sensitivity: derivatives, and the correction of rates."""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis.verdicts.imu_causes import _system_matrix
from lab.base.arrays import FloatArray
from lab.navigation import strapdown
from lab.navigation.filters import blocks
from lab.navigation.filters.error_models import ATT, GYRO_BIAS, MODELS
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.observation import felt_by_gyro
from lab.navigation.solution import Belief

ALL = (*blocks.SCALES, *blocks.MISALIGNMENTS, blocks.GYRO_G)


def after_a_step(sensitivity: FloatArray, scale: FloatArray) -> FloatArray:
    """Return a navigator after a millisecond of a hard manoeuvre, with estimates of its gyros' errors."""
    rng = np.random.default_rng(5)
    state = np.zeros(strapdown.LENGTH)
    strapdown.set_position(state, 0.8, 0.3, 900.0)
    q = rng.normal(size=4)
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = q / np.linalg.norm(q)
    state[strapdown.GYRO_G : strapdown.GYRO_G + 3] = sensitivity
    state[strapdown.GYRO_SCALE : strapdown.GYRO_SCALE + 3] = scale
    dtheta, dvelocity = rng.normal(0, 0.5, 3) * 1e-3, rng.normal(0, 15, 3) * 1e-3
    strapdown.step(state, tuple(dtheta), tuple(dvelocity), 1e-3)
    return state


def rate(state: FloatArray) -> FloatArray:
    """Return the corrected rate of the last step."""
    return state[strapdown.PREVIOUS_DTHETA :][:3] * state[strapdown.PER_STEP]


@pytest.mark.parametrize("model", list(MODELS))
def test_columns_are_derivatives_of_the_corrected_rate(model: str) -> None:
    """φ̇ is minus the error of the rate, in n or b: the step is linear in the sensitivity, so halves do."""
    whole, size = with_blocks(MODELS[model], ALL), np.array([1e-3, -2e-3, 3e-3])
    scale = np.array([0.02, -0.01, 0.03])
    state = after_a_step(size, scale)
    F = np.zeros((whole.states, whole.states))
    whole.write(state, F)
    C_nb = np.eye(3) if whole.in_body else state[strapdown.C_NB :][:9].reshape(3, 3)
    first = blocks.first_state(ALL, blocks.GYRO_G)
    for k, step in enumerate(0.5e-3 * np.eye(3)):
        change = (rate(after_a_step(size + step, scale)) - rate(after_a_step(size - step, scale))) / 1e-3
        np.testing.assert_allclose(F[ATT, first + k], -C_nb @ change, rtol=1e-9, atol=1e-9)
        assert not np.delete(F[:, first + k], np.r_[ATT]).any()
        # A bias that acts alike is as much larger, which gives the rows of H.
        as_bias = F[ATT, GYRO_BIAS][:, k] * felt_by_gyro(state, k)
        np.testing.assert_allclose(as_bias, F[ATT, first + k], rtol=1e-12)


def test_a_gyro_that_feels_the_force_is_corrected() -> None:
    """What the simulated gyro adds is what the navigator takes off."""
    size, scale = np.array([1e-3, -2e-3, 3e-3]), np.array([0.02, -0.01, 0.03])
    with_it, without = after_a_step(size, scale), after_a_step(np.zeros(3), scale)
    force = with_it[strapdown.PREVIOUS_DVELOCITY :][:3] * with_it[strapdown.PER_STEP]
    np.testing.assert_allclose(rate(without) - rate(with_it), size * force, rtol=1e-9)


def test_what_explains_innovations_has_the_columns_of_the_filter() -> None:
    """Scale factors, misalignments and g-sensitivity act between the fixes as in F of the model `phi`."""
    state = after_a_step(np.array([1e-3, -2e-3, 3e-3]), np.zeros(3))
    F = np.zeros((blocks.count(ALL), blocks.count(ALL)))
    with_blocks(MODELS["phi"], ALL).write(state, F)
    C_nb = state[strapdown.C_NB :][:9].reshape(1, 3, 3)
    force = state[strapdown.PREVIOUS_DVELOCITY :][:3] * state[strapdown.PER_STEP]
    nothing = Belief(np.zeros((0, 0)), np.zeros((6, 6)), np.zeros(0), np.zeros(6), np.zeros(3))
    shown = _system_matrix(ALL, C_nb, np.zeros((1, 3)), rate(state)[None], force[None], nothing)[0]
    np.testing.assert_allclose(shown[:, blocks.CORE :], F[:, blocks.CORE :], rtol=1e-12, atol=1e-15)
