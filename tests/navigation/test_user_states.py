"""States that a user declares, and the drift of the biases: their columns of F, filterpy, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import lab
from lab import Experiment, run_ensemble
from lab.analysis.consistency import normalised_squares
from lab.analysis.error_sources import left_out
from lab.analysis.errors import error_state
from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.navigation import strapdown, wander
from lab.navigation.filters import blocks, user_states
from lab.navigation.filters.error_models import ATT, MODELS, VEL
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.user_states import declared_states
from lab.navigation.kernels import own_room
from lab.navigation.kernels.generation import interpret_kernel

STEP = 1e-30


@pytest.fixture(autouse=True)
def own() -> Iterator[None]:
    """Forget after each test what it declared."""
    yield
    user_states._DECLARED.clear()
    blocks.OWN.clear()


def g_sensitivity(rate: Any, force: Any, E: Any) -> None:
    """Write gyros that feel the specific force along their own axis."""
    for i in range(3):
        E[i, i] = force[i]


def bent(rate: Any, force: Any, E: Any) -> None:
    """Write a gyro that reads more in right turns, and a quadratic accelerometer."""
    E[2, 0], E[3, 1] = abs(rate[2]), force[0] * force[0]


def declare(**changes: Any) -> None:
    """Declare a g-sensitivity with some other arguments."""
    given: dict[str, Any] = {"sigma": 3e-4, "drift_sigma": 1e-4, "correlation_time": 60.0}
    names = ["gyro g x", "gyro g y", "gyro g z"]
    lab.declare_states("g-sensitivity", names, g_sensitivity, **given | {"unit": "rad/s/(m/s²)"} | changes)


def moving(own_size: int = 0) -> FloatArray:
    """Return a navigator after a step in a hard manoeuvre."""
    rng = np.random.default_rng(1)
    state = np.zeros(own_room.END)
    strapdown.set_position(state, 0.8, 0.3, 900.0)
    state[strapdown.VELOCITY : strapdown.VELOCITY + 3] = rng.normal(0, 50, 3)
    q = rng.normal(size=4)
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = q / np.linalg.norm(q)
    state[own_room.EFFECTS : own_room.EFFECTS + own_room.WIDTH * own_size] = rng.normal(
        size=own_room.WIDTH * own_size
    )
    strapdown.step(state, tuple(rng.normal(0, 0.005, 3)), tuple(rng.normal(0, 0.15, 3)), 0.01)
    return state


@pytest.mark.parametrize("model", list(MODELS))
def test_columns_of_the_drift_are_derivatives_of_the_corrected_output(model: str) -> None:
    names = (*blocks.SCALES, *blocks.DRIFTS)
    whole, state = with_blocks(MODELS[model], names), moving()
    F = np.zeros((whole.states, whole.states))
    whole.write(state, F)
    C_nb = np.eye(3) if whole.in_body else state[strapdown.C_NB :][:9].reshape(3, 3)
    correct = interpret_kernel(strapdown.corrected)
    for name, rows, sign, of in (
        (
            blocks.GYRO_DRIFT,
            ATT,
            -1.0,
            (strapdown.GYRO_BIAS, strapdown.GYRO_SCALE, strapdown.GYRO_MISALIGNMENT),
        ),
        (
            blocks.ACCEL_DRIFT,
            VEL,
            1.0,
            (strapdown.ACCEL_BIAS, strapdown.ACCEL_SCALE, strapdown.ACCEL_MISALIGNMENT),
        ),
    ):
        for k in range(3):
            tilted = state.astype(complex)
            tilted[blocks.BLOCKS[name].place + k] += 1j * STEP
            change = np.imag(correct(tilted, (0.1, 0.2, 0.3), 1.0, *of)) / STEP
            column = F[:, blocks.first_state(names, name) + k]
            np.testing.assert_allclose(column[rows], sign * C_nb @ change, atol=1e-14)
            column[rows] = 0.0
            assert not column.any()


@pytest.mark.parametrize("model", list(MODELS))
def test_columns_of_own_states_are_their_effects(model: str) -> None:
    declare()
    lab.declare_states("bent", ["bent gyro", "bent accelerometer"], bent, sigma=[0.003, 1e-5])
    found = declared_states("g-sensitivity, bent", "navigator.own_states")
    names = tuple(one.block for one in found)
    whole, state = with_blocks(MODELS[model], names), moving(5)
    F = np.zeros((whole.states, whole.states))
    whole.write(state, F)
    E = state[own_room.EFFECTS :][:30].reshape(5, 6).T
    C_nb = np.eye(3) if whole.in_body else state[strapdown.C_NB :][:9].reshape(3, 3)
    np.testing.assert_allclose(F[ATT, 15:], C_nb @ E[:3], atol=1e-15)
    np.testing.assert_allclose(F[VEL, 15:], -C_nb @ E[3:], atol=1e-15)


def flight(seed: int = 1, **settings: Any) -> Experiment:
    """Return a flight at a low rate, with an antenna away from the IMU."""
    made = Experiment(mission="los_angeles", seed=seed)
    made.set("trajectory.imu_rate", 50.0)
    made.set("sensors.gps.lever_arm", (1.0, 0.4, -0.6))
    for path, value in settings.items():
        made.set(path.replace("__", "."), value)
    return made


def assert_agrees_with_filterpy(**estimated: Any) -> None:
    """Compare all parts of a solution, relative to the largest value of each column."""
    a = flight(**estimated).run().solution_arrays
    b = flight(**estimated, navigator__engine="filterpy").run().solution_arrays
    for part in ("velocity_n", "q_nb", "bias", "further", "variance", "innovation"):
        found, expected = getattr(a, part), getattr(b, part)
        scale = np.maximum(np.nanmax(np.abs(expected), axis=0, initial=0.0), 1e-12)
        assert np.nanmax(np.abs(found - expected) / scale, initial=0.0) < 1e-9, part


@pytest.mark.proof
def test_beside_misalignments_of_2_degrees_a_filter_agrees_with_filterpy() -> None:
    """Both take misalignments off to third order."""
    declare()
    sizes = {f"sensors__{triad}__misalignment": 2.0 for triad in ("gyro", "accelerometer")}
    names = dict.fromkeys(("sensors__own_errors", "navigator__own_states"), "g-sensitivity")
    assert_agrees_with_filterpy(**names, **sizes, navigator__estimate_misalignments=True)


@pytest.mark.proof
def test_a_filter_with_own_states_agrees_with_filterpy_and_tells_the_truth() -> None:
    """Unit and scale are of this declaration alone; σ is 3·10⁻⁴ and 10⁻⁴ rad/s/(m/s²)."""
    declare(shown_unit="mrad/s/(m/s²)", shown_scale=1e3)
    estimated = {"sensors__own_errors": "g-sensitivity", "navigator__own_states": "g-sensitivity"}
    assert_agrees_with_filterpy(**estimated)
    nees, own = [], []
    for seed in range(16):
        result = flight(seed, **estimated).run()
        solution, used = result.solution_arrays, result.solution_arrays.fix_sample >= 0
        x = error_state(
            solution,
            solution.fix_sample[used],
            result.known_truth("errors"),
            result.true_bias,
            further=result.true_further(),
        )
        P = solution.fix_covariance[used]
        nees.append(normalised_squares(x, P).mean() / 18)
        own.append(normalised_squares(x[:, 15:], P[:, 15:, 15:]).mean() / 3)
    print(f"\nNEES per state {np.mean(nees):.2f}, of the own states {np.mean(own):.2f}")
    for squares in (nees, own):
        assert np.mean(squares) == pytest.approx(1, abs=4 * np.std(squares) / 4 + 0.05)
    assert result.verdict.consistent, result.verdict
    shown = result.observability.sel(quantity="gyro g x")
    assert shown.unit.item() == "mrad/s/(m/s²)"
    np.testing.assert_allclose(shown.sigma[0], np.hypot(0.3, 0.1), rtol=1e-9)
    assert run_ensemble(flight(**estimated), 3).verdict.consistent
    assert [one.model for one in lab.compare(flight(**estimated), ["phi"], seeds=2)] == ["phi"]
    states = result.further_states
    assert list(states.state.values) == ["gyro g x", "gyro g y", "gyro g z"]
    assert np.ptp(states.truth.values) > 0
    blind = flight(3, sensors__own_errors="g-sensitivity").run()
    assert not blind.verdict.consistent
    assert left_out(blind.experiment) == ["sensors.own_errors (errors that a notebook declared)"]


def test_user_states_have_room_behind_all_others() -> None:
    assert max(strapdown.LENGTH, wander.LENGTH) <= own_room.VALUES


def test_another_declaration_takes_the_place_of_the_first_one() -> None:
    declare()
    (before,) = declared_states("g-sensitivity", "navigator.own_states")
    declare(sigma=1e-3)
    (after,) = declared_states("g-sensitivity", "navigator.own_states")
    assert before.block != after.block
    assert blocks.OWN[before.block].place == blocks.OWN[after.block].place
    lab.declare_states("bent", ["bent gyro", "bent accelerometer"], bent, sigma=0.0)
    (other,) = declared_states("bent", "navigator.own_states")
    assert blocks.OWN[other.block].place >= blocks.OWN[after.block].place + 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": -1.0}, "one number from 0"),
        ({"sigma": (1.0, 2.0)}, "each of the 3 states"),
        ({"correlation_time": 0.0}, "positive time"),
        ({"sigma": "much"}, "one number from 0"),
        ({"correlation_time": "60"}, "positive time"),
    ],
)
def test_numbers_that_mean_nothing_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        declare(**change)


def outside(rate: Any, force: Any, E: Any) -> None:
    """Write beyond the states."""
    E[0, 7] = 1.0


def nothing(rate: Any, force: Any, E: Any) -> None:
    """Write nothing."""


def text(rate: Any, force: Any, E: Any) -> None:
    """Write what is no number."""
    E[0, 0] = float(str(rate[0]))


@pytest.mark.parametrize(
    ("states", "effect", "message"),
    [
        (["a"], outside, "cannot be computed"),
        (["a"], nothing, "is zero"),
        (["a"], text, "arithmetic and math"),
        ([], bent, "1 to 12 names"),
        ("ab", bent, "as a list"),
        (["latency", "b"], bent, "already a state 'latency'"),
        (["a", "a"], bent, "already a state 'a'"),
        (["position north", "b"], bent, "already a state 'position north'"),
        (["heading"], bent, "already a state 'heading'"),
        ([3], bent, "accepted are names"),  # type: ignore[list-item]
        (["a", " "], bent, "accepted are names"),
        ([str(k) for k in range(13)], bent, "1 to 12 names"),
    ],
)
def test_declarations_that_cannot_be_used_are_refused(
    states: list[str], effect: Callable[..., None], message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        lab.declare_states("mine", states, effect, sigma=1.0)


def saturated(rate: Any, force: Any, E: Any) -> None:
    """Write what begins at 4 rad/s."""
    E[2, 0] = max(0.0, rate[2] - 4.0)


def test_an_effect_may_begin_at_some_rate() -> None:
    lab.declare_states("mine", ["saturated"], saturated, sigma=1.0)
    assert [one.name for one in declared_states("mine", "navigator.own_states")] == ["mine"]


def test_names_that_nobody_declared_and_too_many_states_are_refused() -> None:
    with pytest.raises(SettingError, match=r"no states 'mine' are declared .*; declared are none"):
        flight(navigator__own_states="mine").run()
    with pytest.raises(SettingError, match=r"sensors.own_errors: no states 'mine'"):
        flight(sensors__own_errors="mine").run()
    lab.declare_states("many", [str(k) for k in range(10)], bent, sigma=1.0)
    with pytest.raises(SettingError, match="accepted are up to 12 together"):
        declare()
