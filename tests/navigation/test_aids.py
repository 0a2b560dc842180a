"""Aids: measurements besides GPS, and the further states of the filter."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from motions import NO_FILTER
from scipy.spatial.transform import Rotation

from lab import Experiment
from lab.analysis.verdicts.finding import Change
from lab.analysis.verdicts.trial import apply_changes
from lab.experiment.ensembles.seeds import run_ensemble
from lab.motion.frames.rotation import wrap
from lab.navigation import aids, navigator, reference_aids, strapdown, wander
from lab.navigation.aiding import KINDS, collect_aids, most_aids
from lab.navigation.belief import chosen_blocks
from lab.navigation.filters import blocks, observation
from lab.navigation.filters.blocks import BLOCKS, count, find_places, first_state, in_order
from lab.navigation.filters.error_models import MODELS, ErrorModel
from lab.navigation.filters.filter import Filter
from lab.navigation.filters.further_columns import with_blocks
from lab.navigation.filters.north_slaved import fix_axes, north_axes
from lab.navigation.filters.wander_models import PSI
from lab.navigation.frames import keep_radii
from lab.navigation.kernels.driver import Advance, driver
from lab.navigation.kernels.generation import interpret_kernel
from lab.navigation.kernels.propagation import layout_constants
from lab.navigation.solution import Imu, Solution, Start
from lab.run.memory import bytes_per_aid
from lab.sensors.readings import Readings

RATE = 50.0
"""Rate of the IMU [Hz]: measurements come once a second, at any rate."""


def of(settings: dict[str, Any]) -> Experiment:
    """Return an experiment with settings by their paths."""
    made = Experiment(mission="montreal", seed=1)
    made.set("trajectory.imu_rate", RATE)
    for path, value in settings.items():
        made.set(path, value)
    return made


def test_blocks_follow_each_other_in_one_order() -> None:
    names = in_order(tuple(reversed(BLOCKS)))
    assert names == tuple(BLOCKS)
    assert count(names) == 15 + sum(block.size for block in BLOCKS.values())
    at = 15
    for name in names:
        assert first_state(names, name) == at
        at += BLOCKS[name].size
    assert first_state((), blocks.LEVER_ARM) == -1
    assert len(set(find_places(names))) == len(find_places(names)) == count(names) - 9
    assert min(find_places(names)) == strapdown.GYRO_BIAS
    assert max(find_places(names)) < strapdown.SINE


@pytest.mark.parametrize("module", [aids, observation], ids=["aids", "observation"])
def test_each_first_state_in_a_kernel_is_that_of_a_block(module: ModuleType) -> None:
    """Another name would be the state of no filter, and its elements of H zero without a word."""
    used = {name for name, value in vars(module).items() if name.isupper() and value == blocks.NO_STATE}
    named = {name.lower().replace(" ", "_").replace("-", "_"): name for name in BLOCKS}
    every = tuple(BLOCKS)
    assert len(used) > 5
    for name in used - {"NO_STATE"}:
        first = first_state(every, named[name.lower()])
        assert layout_constants(every)[name] == (blocks.NO_STATE, first)


def test_the_axes_of_a_fix_are_unit_vectors_at_right_angles() -> None:
    axes = np.array(fix_axes(np.zeros(strapdown.SINE)))
    np.testing.assert_array_equal(axes @ axes.T, np.eye(3))


def test_memory_of_measurements_is_counted() -> None:
    made, duration, period = Experiment(), 600.0, 0.4
    for name in KINDS:
        made.set(f"sensors.{name}.fitted", True)
        made.set(f"sensors.{name}.period", period)
    made.set("navigator.no_slip", True)
    made.set("navigator.zero_velocity", True)
    time = np.arange(1.0, duration / period + 1) * period
    readings = {name: Readings(time, np.full(time.size, 20.0)) for name in KINDS}
    imu_time = np.arange(0.0, duration + 0.1, 0.1)
    imu = Imu(imu_time, *np.zeros((2, imu_time.size - 1, 3)))
    standing = np.ones(imu_time.size - 1, np.bool_)
    found = collect_aids(made.sensors, made.navigator, readings, imu, standing)
    most = most_aids(made.sensors, made.navigator, duration)
    assert found.time.size <= most < 1.01 * found.time.size
    solution = Solution.empty(0, 0, ("barometer bias",), aids=found.time.size)
    arrays = [*found[:5], *(getattr(solution, name) for name in Solution.__annotations__ if "aid" in name)]
    assert bytes_per_aid(solution.states) * found.time.size == sum(array.nbytes for array in arrays)


@pytest.mark.proof
@pytest.mark.parametrize(
    "own",
    [
        {},
        {"navigator.correction": "feedforward"},
        {"navigator.model": "nonlinear"},
        {"navigator.engine": "filterpy", "trajectory.imu_rate": 10.0},
    ],
)
def test_covariance_after_a_fix_is_that_of_its_sample(own: dict[str, Any]) -> None:
    """NEES holds the errors after the sample, with its other readings, against P of the fix.

    With the sensors of other tests, so that the filter is one that they compile too.
    """
    found = of(VEHICLE | {"sensors.heading.noise": 0.1} | own).run().solution_arrays
    fixes = np.flatnonzero(found.fix_sample >= 0)
    at = found.fix_sample[fixes]
    assert np.isin(found.aid_sample, at).any()
    variance = np.diagonal(found.fix_covariance[fixes], axis1=1, axis2=2)
    np.testing.assert_allclose(variance, found.variance[at], rtol=1e-12)


def state_at(rng: np.random.Generator) -> np.ndarray:
    """Return a north-slaved navigator that moves and turns, away from its last step."""
    state = np.zeros(strapdown.LENGTH)
    strapdown.set_position(state, 0.8, 0.3, 900.0)
    state[strapdown.MERIDIAN], state[strapdown.TRANSVERSE] = 1 / 6.37e6, 1 / 6.39e6
    state[strapdown.VELOCITY : strapdown.VELOCITY + 3] = rng.normal(0, 20, 3)
    state[strapdown.PREVIOUS_VELOCITY : strapdown.PREVIOUS_VELOCITY + 3] = state[
        strapdown.VELOCITY : strapdown.VELOCITY + 3
    ] + rng.normal(0, 0.05, 3)
    q = rng.normal(size=4)
    state[strapdown.Q_NB : strapdown.Q_NB + 4] = q / np.linalg.norm(q)
    state[strapdown.PER_STEP] = 100.0
    state[strapdown.PREVIOUS_DTHETA : strapdown.PREVIOUS_DTHETA + 3] = rng.normal(0, 0.002, 3)
    return state


def seen(state: np.ndarray, kind: int, place: np.ndarray, age: float) -> tuple[float, np.ndarray]:
    """Return what the navigator says of a measurement of zero, and its row of H."""
    row, field = np.zeros(15), np.array([0.3, -0.2, 0.9])
    return aids.predict_aid(state, north_axes(state, age), kind, 0.0, field, place, age, 0.01, row), row


def displaced(state: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return the navigator with an error: estimate minus truth, φ of Ĉ = exp(−[φ×]) C."""
    moved = state.copy()
    moved[strapdown.HEIGHT] -= error[2]
    for at in (strapdown.VELOCITY, strapdown.PREVIOUS_VELOCITY):
        moved[at : at + 3] += error[3:6]
    q = strapdown.product(strapdown.rotation(tuple(-error[6:9])), tuple(state[strapdown.Q_NB :][:4]))
    moved[strapdown.Q_NB : strapdown.Q_NB + 4] = q
    # The rates of the last step are those measured minus the estimated bias.
    moved[strapdown.PREVIOUS_DTHETA :][:3] -= error[9:12] / state[strapdown.PER_STEP]
    return moved


@pytest.mark.proof
@pytest.mark.parametrize("kind", range(len(aids.NAMES)), ids=lambda kind: aids.NAMES[kind])
@pytest.mark.parametrize("age", [0.0, 0.007])
def test_rows_of_h_are_derivatives(kind: int, age: float) -> None:
    rng = np.random.default_rng(kind)
    for _ in range(5):
        state, place = state_at(rng), rng.normal(0, 2, 3)
        row = seen(state, kind, place, age)[1]
        for i in range(12):
            step = np.zeros(15)
            step[i] = 1e-5
            change = (
                seen(displaced(state, step), kind, place, age)[0]
                - seen(displaced(state, -step), kind, place, age)[0]
            )
            # The bias turns the attitude back over the age, by 1e-4 of what it does else.
            bound = 1e-6 if i < 9 else 1e-6 + 2 * age * np.abs(row[6:9]).max()
            assert wrap(change) / 2e-5 == pytest.approx(row[i], rel=1e-6, abs=bound + 1e-8), i


def test_the_columns_of_wind_and_scale_are_derivatives() -> None:
    """Of the reference, with which the compiled filter is compared."""
    names, given = (blocks.WIND, blocks.AIRSPEED_SCALE), np.zeros(1)
    one = aids.Aids(
        given, np.array([aids.AIRSPEED]), given + 30.0, given + 1.0, np.zeros((1, 3)), np.zeros(3)
    )
    state = state_at(np.random.default_rng(4))
    state[strapdown.WIND : strapdown.AIRSPEED_SCALE + 1] = 6.0, -4.0, 0.02
    row = reference_aids.predict_aid(state, one, 0, 0.007, 0.01, names)[1]
    for place, column in ((strapdown.WIND, 15), (strapdown.WIND + 1, 16), (strapdown.AIRSPEED_SCALE, 17)):
        ahead, behind = state.copy(), state.copy()
        ahead[place] += 1e-4
        behind[place] -= 1e-4
        change = [reference_aids.predict_aid(at, one, 0, 0.007, 0.01, names)[0] for at in (ahead, behind)]
        assert (change[0] - change[1]) / 2e-4 == pytest.approx(row[column], abs=1e-8)


def test_airspeeds_below_the_slowest_are_not_used() -> None:
    """Beside other sensors, so that the filter is one that other tests compile too."""
    kinds = of(VEHICLE | {"sensors.airspeed.slowest": 1000.0}).run().aids.kind
    assert set(kinds.tolist()) >= {aids.HEIGHT, aids.HEADING}
    assert aids.AIRSPEED not in kinds


def near_the_pole(latitude: float) -> np.ndarray:
    """Return a navigator in a wander-azimuth frame that moves and turns."""
    rng = np.random.default_rng(3)
    attitude = Rotation.from_euler("ZYX", [0.5, 0.2, -0.3]).as_quat(scalar_first=True)
    begin = Start(np.array([np.radians(latitude), 0.4, 900.0]), rng.normal(0, 20, 3), attitude)
    state = Filter.begin(begin, NO_FILTER, 0.0, PSI).state
    keep_radii(state)
    state[strapdown.PREVIOUS_VELOCITY :][:3] = state[strapdown.VELOCITY :][:3] + rng.normal(0, 0.05, 3)
    state[strapdown.PREVIOUS_DTHETA :][:3] = rng.normal(0, 0.002, 3)
    state[strapdown.PER_STEP] = 100.0
    return state


@pytest.mark.parametrize("latitude", [89.999, -89.95], ids=["110 m from the pole", "6 km from the other"])
@pytest.mark.parametrize("kind", range(len(aids.NAMES)), ids=lambda kind: aids.NAMES[kind])
def test_rows_of_h_are_derivatives_close_to_a_pole(kind: int, latitude: float) -> None:
    """For the errors of the computer frame; a reading at the end of the sample, as H takes its position."""
    state, field, place = near_the_pole(latitude), np.array([0.3, -0.2, 0.9]), np.array([1.0, -0.5, 0.4])
    see, axes, displace = (
        interpret_kernel(one) for one in (aids.predict_aid, wander.north_axes_before, wander.displace)
    )

    def value(at: np.ndarray, row: np.ndarray) -> float:
        return float(see(at, axes(at, 0.0), kind, 0.0, field, place, 0.0, 0.01, row))

    row = np.zeros(15)
    value(state, row)
    H = row[:9] @ PSI.map(state)[:9, :9]
    for i in range(9):
        x = np.zeros(9)
        x[i] = 1e-2 if i < 3 else 1e-5
        ahead, behind = state.copy(), state.copy()
        displace(ahead, -x)
        displace(behind, x)
        change = wrap(value(ahead, np.zeros(15)) - value(behind, np.zeros(15))) / (2 * x[i])
        assert change == pytest.approx(H[i], rel=1e-5, abs=1e-7), i


def test_a_heading_says_nothing_where_the_pole_is_closer_than_the_position_is_known() -> None:
    """The variance of north beyond the linear one, against positions drawn at 20 σ from the pole."""
    state = near_the_pole(89.9982)
    x, y = state[wander.AXIS : wander.AXIS + 2]
    away = np.hypot(x, y) / state[strapdown.MERIDIAN]
    sigma = away / 20
    rng = np.random.default_rng(1)
    along, across = away + sigma * rng.normal(size=1_000_000), sigma * rng.normal(size=1_000_000)
    beyond = np.var(np.arctan2(across, along) - across / away)
    assert interpret_kernel(wander.north_variance)(state, sigma**2) == pytest.approx(beyond, rel=0.05)
    assert interpret_kernel(wander.north_variance)(state, away**2) == pytest.approx(1.0)  # rad²


RECEIVER = {
    "sensors.gps.lever_arm": (1.0, 0.4, -0.6),
    "sensors.gps.latency": 0.1,
    "sensors.gps.correlated_sigma": 1.5,
    "navigator.lever_arm": (0.6, 0.6, -0.2),
    "navigator.latency": 0.05,
    "navigator.estimate_lever_arm": True,
    "navigator.estimate_latency": True,
    "navigator.estimate_gps_drift": True,
}
VEHICLE = {
    "sensors.barometer.fitted": True,
    "sensors.heading.fitted": True,
    "sensors.heading.drift_sigma": 0.5,
    "sensors.odometer.fitted": True,
    "sensors.odometer.lever_arm": (-1.2, 0.3, 0.5),
    "sensors.airspeed.fitted": True,
    "navigator.no_slip": True,
    "navigator.slip_sigma": (5.0, 5.0),
}
MISALIGNED = {
    "sensors.gyro.misalignment": (0.3, -0.2, 0.1, 0.4, -0.3, 0.2),
    "sensors.accelerometer.misalignment": 0.1,
    "navigator.estimate_misalignments": True,
    "sensors.gyro.g_sensitivity": (0.02, -0.03, 0.05),
    "navigator.estimate_g_sensitivity": True,
}
DRIFTING = {
    "sensors.gyro.instability": 30.0,
    "sensors.gyro.correlation_time": 20.0,
    "sensors.accelerometer.instability": 0.5,
    "sensors.accelerometer.correlation_time": 20.0,
    "navigator.estimate_bias_drift": True,
}
FREE = {
    "navigator.correction": "feedforward",
    "navigator.attitude_error": (0.0, 0.0, 0.0),
    "sensors.gyro.noise_density": 0.005,
    "sensors.gyro.bias_sigma": 0.01,
}
"""A navigator that runs free, with gyros so good that the gate never finds the filter wrong, from which only
the compiled one recovers."""
ALL = VEHICLE | RECEIVER | MISALIGNED | DRIFTING | {"navigator.states": 21}
"""All sensors, all conditions and all states together."""


@pytest.mark.proof
@pytest.mark.parametrize(
    ("settings", "model", "rate"),
    [
        (VEHICLE | {"sensors.heading.source": "magnetometer"}, "phi", 0.0),
        (ALL, "phi", 0.0),
        (ALL, "phi", 5.0),
        (ALL | FREE, "phi", 0.0),
        (ALL | FREE, "phi", 5.0),
        (ALL | {"navigator.correction_period": 5.0}, "psi", 0.0),
        (ALL, "psi", 0.0),
        (ALL, "invariant", 0.0),
    ],
    ids=[
        "sensors",
        "all phi",
        "all phi, P every 200 ms",
        "all phi, feedforward",
        "all phi, feedforward, P every 200 ms",
        "all psi, corrected every 5 s",
        "all psi",
        "all invariant",
    ],
)
def test_compiled_and_filterpy_agree(settings: dict[str, Any], model: str, rate: float) -> None:
    wanted = settings | {
        "mission": "los_angeles",
        "trajectory.imu_rate": 25.0,
        "navigator.model": model,
        "navigator.filter_rate": rate,
        "navigator.gate": 0.99,
    }
    a = of(wanted).run().solution_arrays
    b = of(wanted | {"navigator.engine": "filterpy"}).run().solution_arrays
    assert a.states == b.states
    assert (a.aid_sample < 0).any()  # the gate rejected some
    np.testing.assert_array_equal(a.aid_sample, b.aid_sample)
    for part in ("velocity_n", "q_nb", "bias", "scale", "further", "variance", "innovation"):
        found, expected = getattr(a, part), getattr(b, part)
        scale = np.maximum(np.nanmax(np.abs(expected), axis=0, initial=0.0), 1e-12)
        assert np.nanmax(np.abs(found - expected) / scale, initial=0.0) < 1e-9, part
    np.testing.assert_allclose(a.aid_innovation, b.aid_innovation, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(a.aid_variance, b.aid_variance, rtol=1e-9)
    for found, expected in ((a.aid_H, b.aid_H), (a.aid_gain, b.aid_gain)):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9 * np.nanmax(np.abs(expected)))


def test_between_corrections_each_sample_has_the_estimated_error_taken_off() -> None:
    """Also after headings between the fixes: hardly anything differs from a correction at once."""
    settings = VEHICLE | {"sensors.heading.period": 0.2}
    late, at_once = (
        of(settings | {"navigator.correction_period": period}).run().solution_arrays for period in (10.0, 0.0)
    )
    assert (late.aid_sample >= 0).sum() > 4 * (late.fix_sample >= 0).sum() > 0
    apart = np.abs(late.velocity_n - at_once.velocity_n) / np.sqrt(at_once.variance[:, 3:6])
    assert apart.max() < 0.5  # uncorrected, the navigator is off by more than 5 σ


def test_a_model_with_the_same_number_of_other_states_is_another_one() -> None:
    lever = with_blocks(MODELS["phi"], (blocks.LEVER_ARM,))
    drift = with_blocks(MODELS["phi"], (blocks.GPS_DRIFT,))
    assert lever.states == drift.states == 18
    assert lever.label != drift.label


def test_the_verdict_names_measurements_with_another_noise_than_assumed() -> None:
    right, wrong = (of(VEHICLE | {"navigator.aiding_scale": scale}).run() for scale in (1.0, 0.01))
    assert right.verdict.consistent, right.verdict
    for verdict in (wrong.verdict, wrong.innovation_verdict):
        found = {finding.quantity for finding in verdict.findings}
        assert {"R height", "R heading", "R speed forward", "R airspeed"} <= found


@pytest.mark.parametrize(
    ("settings", "gaining", "constant"),
    [
        (VEHICLE, ("barometer bias", "odometer scale"), "odometer scale"),
        pytest.param(
            ALL,
            ("lever arm right", "barometer bias", "odometer scale", "latency", "gyro misalignment zx"),
            "lever arm right",
            marks=pytest.mark.proof,  # the filter of 55 states, which other proofs compile
        ),
    ],
    ids=["sensors", "all states"],
)
def test_observability_shows_what_each_state_gains(
    settings: dict[str, Any], gaining: tuple[str, ...], constant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run without measurements is of the filter that is compiled already."""
    made: list[bool] = []

    def watched(model: ErrorModel, *, summed: bool, aided: bool) -> Advance:
        made.append(aided)
        return driver(model, summed=summed, aided=aided)

    monkeypatch.setattr(navigator, "driver", watched)
    experiment = of(settings)
    found = experiment.run().observability
    assert len(made) > 1
    assert all(made)
    assert found.sizes["quantity"] == count(chosen_blocks(experiment.navigator, experiment.sensors))
    first, last = found.sigma.isel(time=0), found.sigma.isel(time=-1)
    for state in gaining:
        assert float(last.sel(quantity=state)) < 0.9 * float(first.sel(quantity=state)), state
    free = found.free.sel(quantity=constant)
    np.testing.assert_allclose(free, float(free[0]))


@pytest.mark.proof
def test_an_ensemble_and_its_advice_work_with_all_states() -> None:
    """Matrices that advice changes are those of IMU and GPS: the settings accept no others."""
    ensemble = run_ensemble(of(ALL | {"navigator.p0_scale": 0.05, "navigator.q_scale": 0.02}), range(2))
    assert ensemble.errors.sigma.shape[1] == 9
    assert np.isfinite(ensemble.errors.sigma).all()
    assert np.isfinite(ensemble.consistency.anees).all()
    _ = ensemble.tried_verdict
    changes = (
        Change("navigator.p0", 4.0, times=True, rows=(6, 9)),
        Change("navigator.q", 4.0, times=True, rows=(0, 3)),
    )
    changed = apply_changes(of(ALL).run(), changes)
    assert np.shape(changed.get("navigator.p0"))[0] == 21
    assert len(changed.get("navigator.q")) == 12
    changed.run()


@pytest.mark.proof
def test_files_hold_what_other_sensors_measured(tmp_path: Path) -> None:
    result = of(VEHICLE).run()
    result.to_csv(tmp_path)
    aids_csv = (tmp_path / "aiding.csv").read_text(encoding="utf-8").splitlines()
    assert aids_csv[0] == "time_aid [s],innovation,sigma,used,kind,unit"
    assert sum(line.endswith("height,m") for line in aids_csv) == 205
    states = (tmp_path / "further_states.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "estimate barometer bias [m]" in states
    assert "truth odometer scale [%]" in states
