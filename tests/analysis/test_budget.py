"""The error budget against closed forms, the filter's own covariance, and Monte Carlo runs of each source."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lab import earth
from lab.analysis import budget
from lab.analysis.budget import QUANTITIES, UNITS, error_budget
from lab.analysis.error_sources import (
    ACCELEROMETER,
    GPS_POSITION,
    GYRO,
    Constant,
    Process,
    coupled,
    flicker,
)
from lab.analysis.error_sources import initial as initial_columns
from lab.analysis.errors import error_state, to_enu
from lab.experiment import CACHE, Experiment
from lab.navigation.belief import belief
from lab.navigation.error_models import POS, VEL
from lab.result import Result
from lab.rotation import wrap
from lab.sensors.gps import GpsErrors
from lab.settings import SettingError
from lab.units import TO_SI

LATITUDE = 0.7
STEP = 0.01


def at_rest(seconds: float, fixes: Sequence[int] = (), gain: float = 0.0) -> SimpleNamespace:
    """Return a result of lying level, heading north; fixes correct the north position with a given gain."""
    n = round(seconds / STEP)
    gravity = float(earth.gravity(np.sin(LATITUDE), 0.0))
    euler = np.zeros((n + 1, 3))
    q_nb = np.tile([1.0, 0, 0, 0], (n + 1, 1))
    dvelocity = np.tile([0, 0, -gravity * STEP], (n, 1))
    dtheta = np.tile(earth.RATE * STEP * np.array([np.cos(LATITUDE), 0, -np.sin(LATITUDE)]), (n, 1))
    covariance = np.zeros((len(fixes), 15, 15))
    covariance[:, 0, 0] = gain
    time = STEP * np.arange(n + 1)
    truth = SimpleNamespace(
        latitude=np.full(n + 1, LATITUDE),
        height=np.zeros(n + 1),
        velocity_n=np.zeros((n + 1, 3)),
        q_nb=q_nb,
        euler=euler,
    )
    ideal = SimpleNamespace(dtheta=dtheta, dvelocity=dvelocity, dt=STEP, time=time)
    return SimpleNamespace(
        truth_arrays=truth,
        ideal=ideal,
        true_flight=lambda _name: (truth, ideal),
        belief=SimpleNamespace(bias_decay=np.zeros(6), R=np.eye(6)),
        solution_arrays=SimpleNamespace(
            fix_covariance=covariance, fix_sample=np.array(fixes, dtype=np.int64)
        ),
        experiment=SimpleNamespace(
            navigator=SimpleNamespace(correction="feedback", correction_period=0.0),
            sensors=SimpleNamespace(gps=GpsErrors()),
        ),
        fixes=SimpleNamespace(time=time[list(fixes)]),
        time=time,
    )


def sigmas(
    result: SimpleNamespace, constants: Iterable[Constant] = (), processes: Iterable[Process] = ()
) -> dict[str, np.ndarray]:
    """Return σ in time of each quantity, in SI units, of all sources together."""
    constants = [*constants] or [Constant("none", np.zeros((15, 1)), np.zeros((1, 6, 6)))]
    epochs = budget.epochs_of(result)
    variance = budget._Propagation(result, constants, list(processes)).run(epochs)
    return dict(zip(QUANTITIES, np.sqrt(variance.sum(axis=0)).T, strict=True))


def initial(block: slice, values: Sequence[float]) -> Constant:
    return initial_columns("start", block, np.diag(values))


# Within a minute the Earth's rotation and the Schuler oscillation change these forms by (t / 806 s)² at most.
CLOSE = 0.01


def test_a_gyro_bias_turns_the_heading_and_tilts_the_platform_into_gravity() -> None:
    t, b, g = 60.0, 1e-5, float(earth.gravity(np.sin(LATITUDE), 0.0))
    found = sigmas(at_rest(t), [initial(slice(9, 12), (b, b, b))])
    assert found["heading"][-1] == pytest.approx(b * t, rel=CLOSE)
    assert found["roll"][-1] == pytest.approx(b * t, rel=CLOSE)
    assert found["velocity east"][-1] == pytest.approx(g * b * t**2 / 2, rel=CLOSE)
    assert found["position north"][-1] == pytest.approx(g * b * t**3 / 6, rel=CLOSE)
    assert found["gyro bias y"][-1] == pytest.approx(b)


def test_an_accelerometer_bias_drives_the_position_with_the_square_of_time() -> None:
    t, b = 60.0, 1e-3
    found = sigmas(at_rest(t), [initial(slice(12, 15), (b, 2 * b, 0.0))])
    assert found["position north"][-1] == pytest.approx(b * t**2 / 2, rel=CLOSE)
    assert found["position east"][-1] == pytest.approx(b * t**2, rel=CLOSE)
    # The eastward velocity lifts by its Coriolis acceleration.
    coriolis = 2 * earth.RATE * np.cos(LATITUDE) * 2 * b
    assert found["position up"][-1] == pytest.approx(coriolis * t**3 / 6, rel=CLOSE)


def test_an_initial_velocity_error_becomes_a_position_error() -> None:
    found = sigmas(at_rest(60.0), [initial(VEL, (0.1, 0.0, 0.0))])
    assert found["position north"][-1] == pytest.approx(6.0, rel=CLOSE)


def test_an_accelerometer_scale_factor_is_felt_along_gravity_only() -> None:
    t, s, g = 60.0, 1e-4, float(earth.gravity(np.sin(LATITUDE), 0.0))
    scale = coupled("scale", slice(3, 6), slice(3, 6), s * np.eye(3)[None])
    found = sigmas(at_rest(t), [scale])
    assert found["velocity up"][-1] == pytest.approx(s * g * t, rel=CLOSE)
    assert found["velocity north"][-1] < 1e-2 * found["velocity up"][-1]
    cross = np.zeros((1, 3, 3))
    cross[0, 0, 2] = s
    found = sigmas(at_rest(t), [coupled("misalignment", slice(3, 6), slice(3, 6), cross)])
    assert found["velocity north"][-1] == pytest.approx(s * g * t, rel=CLOSE)


@settings(max_examples=20)
@given(time=st.floats(0.3, 1000), seconds=st.sampled_from([10.0, 25.0, 40.0]))
def test_first_order_noise_integrates_to_its_closed_form(time: float, seconds: float) -> None:
    """∫∫ σ² exp(−|s − u| / T) ds du = 2 σ² T² (t / T − 1 + exp(−t / T)); see Gelb, ch. 4.3."""
    s = 1e-5
    process = Process("bias", GYRO, np.full(3, s**2), time)
    found = sigmas(at_rest(seconds), processes=[process])
    expected = 2 * (s * time) ** 2 * (seconds / time - 1 + np.exp(-seconds / time))
    assert found["heading"][-1] == pytest.approx(np.sqrt(expected), rel=0.02)
    assert np.allclose(found["gyro bias x"], s)


def test_white_noise_and_random_walk_grow_with_their_powers_of_time() -> None:
    t, density, k = 40.0, 1e-4, 1e-6
    white = Process("white", GYRO, np.full(3, density**2 / STEP))
    found = sigmas(at_rest(t), processes=[white])
    assert found["heading"][-1] == pytest.approx(density * np.sqrt(t), rel=CLOSE)
    assert np.allclose(found["gyro bias z"], 0)
    white = Process("white", ACCELEROMETER, np.full(3, density**2 / STEP))
    found = sigmas(at_rest(t), processes=[white])
    assert found["position east"][-1] == pytest.approx(density * np.sqrt(t**3 / 3), rel=CLOSE)
    walk = Process("walk", GYRO, np.full(3, k**2), np.inf, settled=False)
    found = sigmas(at_rest(t), processes=[walk])
    assert found["heading"][-1] == pytest.approx(k * np.sqrt(t**3 / 3), rel=CLOSE)
    assert found["gyro bias z"][-1] == pytest.approx(k * np.sqrt(t))


def test_flicker_grows_as_its_fractional_integral_does() -> None:
    """Var of (1 − z⁻¹)^(−1/2) w after n samples is Σ h², h = Γ(k + ½) / (Γ(½) k!) (Kasdin, eq. 104)."""
    B, t = 1e-5, 40.0
    processes = flicker("flicker", GYRO, np.full(3, B), STEP, t)
    result = at_rest(t)
    found = sigmas(result, processes=processes)
    k = np.arange(1.0, t / STEP)
    h = np.concatenate(([1.0], np.cumprod((k - 0.5) / k)))
    bias = B * np.sqrt(np.sum(h**2))
    heading = B * STEP * np.sqrt(np.sum(np.cumsum(h) ** 2))
    assert found["gyro bias x"][-1] == pytest.approx(bias, rel=0.03)
    assert found["heading"][-1] == pytest.approx(heading, rel=0.03)


@settings(max_examples=30)
@given(gain=st.floats(0.05, 0.95), fixes=st.integers(1, 40), time=st.floats(0, 30))
def test_a_constant_gain_filters_start_and_noise_as_a_scalar_filter_does(
    gain: float, fixes: int, time: float
) -> None:
    """e⁺ = (1 − k) e⁻ + k v, written out: the start fades with (1 − k)ⁿ, and v comes with Σ k (1 − k)^j v."""
    variance = np.array([0.7, 5.0, 6.0])
    result = at_rest(fixes, fixes=[100 * m for m in range(1, fixes + 1)], gain=gain)
    found = sigmas(result, processes=[Process("noise", GPS_POSITION, variance, time)])
    weights = gain * (1 - gain) ** np.arange(fixes)
    lags = np.abs(np.subtract.outer(np.arange(fixes), np.arange(fixes)))
    correlation = np.exp(-lags / time) if time > 1e-9 else (lags == 0).astype(float)
    expected = np.sqrt(0.7 * weights @ correlation @ weights)
    assert found["position north"][-1] == pytest.approx(expected, rel=1e-6)
    assert found["position east"][-1] < 1e-6
    found = sigmas(result, [initial(POS, (2.0, 0.0, 0.0))])
    assert found["position north"][-1] == pytest.approx(2 * (1 - gain) ** fixes, rel=1e-6, abs=1e-9)


def made(*assignments: str, mission: str = "montreal", seed: int = 1) -> Experiment:
    experiment = Experiment(mission=mission, seed=seed)
    for assignment in assignments:
        experiment.set_text(assignment)
    return experiment


SMALL = (
    "sensors.gyro.noise_density=0.0005",
    "sensors.gyro.bias_sigma=0.001",
    "sensors.accelerometer.noise_density=[0.35,0.65,0.35]",
    "sensors.accelerometer.bias_sigma=0.02",
    "sensors.gps.position_variance=0.00005",
    "sensors.gps.velocity_variance=0.00002",
    "navigator.position_sigma=0.01",
    "navigator.velocity_sigma=0.003",
    "navigator.attitude_sigma=[0.005,0.005,0.02]",
)
"""The default sensors, a hundred times better: all is linear."""

SCALE_STATES = (
    "navigator.states=21",
    "sensors.gyro.scale_factor_sigma=0.02",
    "sensors.accelerometer.scale_factor_sigma=0.02",
)


@pytest.mark.parametrize(
    "more",
    [
        (),
        ("navigator.correction_period=20",),
        ("navigator.correction=feedforward",),
        ("navigator.model=psi",),
        ("navigator.model=invariant",),
        SCALE_STATES,
    ],
)
def test_of_a_matched_filter_all_sources_sum_to_its_own_covariance(more: tuple[str, ...]) -> None:
    found = error_budget(made(*SMALL, *more).run())
    assert np.allclose(found.total / found.believed, 1, atol=5e-3)


def test_gauss_markov_biases_of_a_matched_feedforward_filter_sum_to_its_covariance() -> None:
    """Feedforward, since in feedback the navigator keeps a bias that the filter believes to fade."""
    processes = [
        *("sensors.gyro.bias_sigma=0", "sensors.accelerometer.bias_sigma=0"),
        *("sensors.gyro.instability=3", "sensors.accelerometer.instability=0.02"),
        *("sensors.gyro.correlation_time=60", "sensors.accelerometer.correlation_time=20"),
    ]
    found = error_budget(made(*SMALL, *processes, "navigator.correction=feedforward").run())
    assert np.allclose(found.total / found.believed, 1, atol=5e-3)


def test_shares_sum_to_the_whole_and_are_those_of_the_variances() -> None:
    found = error_budget(made("sensors.gyro.scale_factor=0.5", "navigator.r_scale=30").run())
    np.testing.assert_allclose(found.share.sum("source"), 100)
    np.testing.assert_allclose((found.sigma**2).sum("source"), found.total**2, rtol=1e-9)
    assert list(found.unit.values) == list(UNITS)
    assert found.time[0] == 0
    assert found.time[-1] == pytest.approx(205, abs=0.1)
    assert float(found.time.diff("time").max()) <= 1 + 1e-9


def test_an_outage_has_epochs_and_growing_errors() -> None:
    found = error_budget(made("sensors.gps.outages=[[60, 90]]").run())
    there = found.total.sel(quantity="position east", time=slice(60.5, 89.5))
    assert there.sizes["time"] >= 28
    assert np.all(np.diff(there) > 0)


def final_errors(result: Result) -> np.ndarray:
    """Return the errors of all states at the end, in the order and units of the budget's quantities."""
    end = np.array([result.time.size - 1])
    x = error_state(result.solution_arrays, end, result.truth_arrays, result.true_bias, result.true_scale)
    angles = wrap(result.euler[-1] - result.truth_arrays.euler[-1])
    return np.concatenate((to_enu(x[:, POS])[0], to_enu(x[:, VEL])[0], angles, x[0, 9:])) / [
        TO_SI[unit] for unit in budget.quantities(x.shape[1]).values()
    ]


def monte_carlo(seeds: int, *assignments: str, mission: str = "montreal") -> np.ndarray:
    """Return the errors (seeds, states) at the end of runs that differ in their seeds."""

    def fly(seed: int) -> np.ndarray:
        return final_errors(made(*assignments, mission=mission, seed=seed).run())

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        errors = np.array(list(pool.map(fly, range(1000, 1000 + seeds))))
    CACHE.clear()
    return errors


ONE_PERCENT = (
    "navigator.states=21",
    "sensors.gyro.scale_factor_sigma=1",
    "sensors.accelerometer.scale_factor_sigma=1",
    "trajectory.imu_rate=50",
)


@pytest.mark.parametrize(
    "assignments",
    [(), ("navigator.r_scale=100",), (*ONE_PERCENT, "navigator.p0_scale=0.3")],
    ids=["matched", "wrong R", "21 states, wrong P0"],
)
def test_the_total_is_that_of_200_runs(assignments: tuple[str, ...]) -> None:
    found = error_budget(made(*assignments).run()).isel(time=-1)
    spread = np.sqrt(np.mean(monte_carlo(200, *assignments) ** 2, axis=0))
    ratio = found.total.values / spread
    print("budget / Monte Carlo:", dict(zip(found.quantity.values, ratio.round(3).tolist(), strict=True)))
    print("believed / Monte Carlo:", (found.believed.values / spread).round(3).tolist())
    assert np.abs(ratio - 1).max() < 0.15


QUIET = {
    **{
        f"sensors.{name}.{term}": 0.0
        for name in ("gyro", "accelerometer")
        for term in ("noise_density", "bias_sigma")
    },
    **{"sensors.gps.position_variance": 1e-6, "sensors.gps.velocity_variance": 1e-8},
    **{f"navigator.{name}_sigma": 1e-6 for name in ("position", "velocity", "attitude")},
}
"""All errors off, or as small as they can be."""


def alone(seed: int = 1, **errors: object) -> Experiment:
    """Return an experiment with one source of error, and the gains of the filter for the default ones."""
    experiment = Experiment(mission="los_angeles", seed=seed)
    assumed = belief(experiment.sensors, experiment.navigator)
    for name, matrix in (("p0", assumed.P0), ("q", np.diag(assumed.noise)), ("r", assumed.R)):
        experiment.set(f"navigator.{name}", np.diag(matrix).tolist())
    for path, value in {
        **QUIET,
        **{name.replace("__", "."): value for name, value in errors.items()},
    }.items():
        experiment.set(path, value)
    return experiment


GIVEN = {
    "gyro turn-on bias, given": {"sensors__gyro__bias": (0.02, -0.01, 0.03)},
    "accelerometer turn-on bias, given": {"sensors__accelerometer__bias": (1.0, 0.5, -2.0)},
    "gyro scale factor, given": {"sensors__gyro__scale_factor": (0.1, -0.2, 0.1)},
    "accelerometer scale factor, given": {"sensors__accelerometer__scale_factor": (0.1, 0.1, -0.1)},
    "gyro g-sensitivity": {"sensors__gyro__g_sensitivity": (0.02, -0.01, 0.01)},
    "gyro misalignment": {"sensors__gyro__misalignment": (0.1, 0, 0.05, 0, -0.1, 0)},
    "accelerometer misalignment": {"sensors__accelerometer__misalignment": (0.1, 0.1, 0, 0, 0, -0.1)},
    "initial position, given": {"navigator__position_error": (2.0, -1.0, 3.0)},
    "initial attitude, given": {"navigator__attitude_error": (0.05, -0.03, 0.2)},
    "GPS latency": {"sensors__gps__latency": 0.05},
    "GPS lever arm": {"sensors__gps__lever_arm": (1.0, -0.5, 0.3)},
    "gyro temperature, bias": {
        "sensors__gyro__bias_temperature": (0.002, -0.001, 0.003),
        "sensors__temperature__profile": "warm_up",
    },
    "accelerometer temperature, scale factor": {
        "sensors__accelerometer__scale_temperature": (0.005, 0.002, -0.003),
        "sensors__temperature__profile": "constant",
        "sensors__temperature__start": 40.0,
    },
    "accelerometer bandwidth": {"sensors__accelerometer__bandwidth": 2.0},
    "gyro range": {"sensors__gyro__range": 10.0},
    "accelerometer range": {"sensors__accelerometer__range": 1.1},
    "gyro quantisation": {"sensors__gyro__quantisation": 0.05},
}


@pytest.mark.parametrize("source", GIVEN)
def test_a_given_error_alone_has_the_effect_it_has(source: str) -> None:
    """Without anything random a run *is* its effect, up to what is not linear."""
    result = alone(**GIVEN[source]).run()
    found = error_budget(result)
    samples = np.searchsorted(result.time, found.time.values - 1e-9)
    data = (result.errors[name].values[samples] for name in ("position", "velocity", "attitude"))
    flown = np.abs(np.concatenate(list(data), axis=1))
    alone_sigma = found.sigma.sel(source=source).values[:, :9]
    largest = flown.max(axis=0)
    assert np.all(np.abs(alone_sigma - flown).max(axis=0) < 0.05 * largest + 2e-3)


RANDOM = {
    "initial position": {"navigator__position_sigma": 1.0},
    "initial velocity": {"navigator__velocity_sigma": 0.3},
    "initial attitude": {"navigator__attitude_sigma": (0.1, 0.1, 0.5)},
    "gyro turn-on bias σ": {"sensors__gyro__bias_sigma": 0.05},
    "accelerometer turn-on bias σ": {"sensors__accelerometer__bias_sigma": 2.0},
    "gyro white noise": {"sensors__gyro__noise_density": 0.02},
    "accelerometer white noise": {"sensors__accelerometer__noise_density": 2000.0},
    "gyro bias instability": {
        "sensors__gyro__instability": 100.0,
        "sensors__gyro__correlation_time": 20.0,
    },
    "accelerometer bias instability": {
        "sensors__accelerometer__instability": 2.0,
        "sensors__accelerometer__correlation_time": 20.0,
    },
    "gyro scale factor σ": {"sensors__gyro__scale_factor_sigma": 0.2},
    "accelerometer scale factor σ": {"sensors__accelerometer__scale_factor_sigma": 0.2},
    "gyro flicker": {"sensors__gyro__flicker": 100.0},
    "accelerometer flicker": {"sensors__accelerometer__flicker": 2.0},
    "gyro random walk": {"sensors__gyro__rate_random_walk": 300.0},
    "accelerometer random walk": {"sensors__accelerometer__rate_random_walk": 10.0},
    "vibration": {"sensors__accelerometer__vibration_density": 2000.0},
    "GPS position noise": {"sensors__gps__position_variance": 0.5},
    "GPS correlated position": {
        "sensors__gps__correlated_sigma": (2.0, 1.0, 3.0),
        "sensors__gps__correlation_time": 20.0,
    },
    "GPS velocity noise": {"sensors__gps__velocity_variance": (0.2, 0.1, 0.05)},
    "GPS outliers": {"sensors__gps__outlier_rate": 0.3, "sensors__gps__outlier_size": 5.0},
    "gyro thermometer": {
        "sensors__gyro__bias_temperature": (0.3, 0.0, 0.0),
        "sensors__temperature__compensation": True,
        "sensors__temperature__thermometer_sigma": 1.0,
    },
    "accelerometer thermometer": {
        "sensors__accelerometer__scale_temperature": (0.0, 0.0, 0.05),
        "sensors__temperature__compensation": True,
        "sensors__temperature__thermometer_sigma": 10.0,
    },
}
BAD_TIMES = {
    "sensors__gps__position_variance": 0.5,
    "sensors__gps__quality_steps": [(30, 70)],
    "sensors__gps__quality_factor": 4.0,
}


@pytest.mark.parametrize(
    ("source", "errors"),
    [*RANDOM.items(), ("GPS position noise", BAD_TIMES)],
    ids=[*RANDOM, "bad constellation"],
)
def test_a_random_source_alone_has_the_spread_of_its_runs(source: str, errors: dict[str, object]) -> None:
    """Mean of error² / σ² over seeds and the second half of the flight, for each quantity."""
    seeds = 40
    experiments = [alone(seed, **errors) for seed in range(seeds)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        squares = list(pool.map(_squares, experiments))
    found = error_budget(experiments[0].run())
    ratio = np.mean(squares, axis=0) / found.sigma.sel(source=source).values[SECOND_HALF, :9] ** 2
    CACHE.clear()
    mean = np.sqrt(ratio.mean(axis=0))
    print(source, mean.round(3).tolist())
    # A number that is drawn once for each seed has a σ known to 1 / √(2 · seeds).
    assert np.abs(mean - 1).max() < 4 / np.sqrt(2 * seeds)


SECOND_HALF = slice(51, 101)


def _squares(experiment: Experiment) -> np.ndarray:
    """Return squared position, velocity and attitude errors at the epochs of the second half (50, 9)."""
    return _errors(experiment) ** 2


def _errors(experiment: Experiment) -> np.ndarray:
    """Return position, velocity and attitude errors at the epochs of the second half (50, 9)."""
    result = experiment.run()
    samples = np.searchsorted(result.time, np.arange(51, 101) - 1e-9)
    data = (result.errors[name].values[samples] for name in ("position", "velocity", "attitude"))
    return np.concatenate(list(data), axis=1)


def test_fine_steps_are_noise_of_a_twelfth_of_their_square() -> None:
    """Runs with and without rounding differ by the quantisation alone: its spread over 40 seeds."""
    noise = {"sensors__gyro__noise_density": 0.02}
    seeds = 40

    def pair(seed: int) -> np.ndarray:
        steps = alone(seed, sensors__gyro__quantisation=0.5, **noise)
        plain = alone(seed, **noise)
        return (_errors(steps) - _errors(plain)) ** 2

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        squares = list(pool.map(pair, range(seeds)))
    found = error_budget(alone(sensors__gyro__quantisation=0.5, **noise).run())
    ratio = (
        np.mean(squares, axis=0) / found.sigma.sel(source="gyro quantisation").values[SECOND_HALF, :9] ** 2
    )
    CACHE.clear()
    mean = np.sqrt(ratio.mean(axis=0))
    print("quantisation", mean.round(3).tolist())
    assert np.abs(mean - 1).max() < 4 / np.sqrt(2 * seeds)


NEEDS = {
    "sensors.gps.outlier_rate": {"sensors.gps.outlier_size": 20.0},
    "sensors.gps.outlier_size": {"sensors.gps.outlier_rate": 0.1},
    "sensors.gps.quality_factor": {"sensors.gps.quality_steps": [(20, 40)]},
    "sensors.gps.correlation_time": {"sensors.gps.correlated_sigma": 1.0},
    **{
        f"sensors.{triad}.correlation_time": {f"sensors.{triad}.instability": 1.0}
        for triad in ("gyro", "accelerometer")
    },
}
VALUES = {
    "sensors.gyro.range": 5.0,
    "sensors.accelerometer.range": 1.05,
    "sensors.gps.outages": [(20, 30)],
    "sensors.gps.quality_steps": [(20, 40)],
}


def test_no_setting_of_a_sensor_is_left_out_silently() -> None:
    """Every one of them moves the total of the budget."""
    warm = {"sensors.temperature.profile": "constant", "sensors.temperature.start": 40.0}
    silent = []
    for path, owner, name in Experiment().sensors.leaves("sensors."):
        if path.startswith("sensors.temperature."):
            continue
        declaration = owner.param[name]
        before, after = (Experiment(mission="los_angeles") for _ in range(2))
        for experiment in (before, after):
            for setting, value in {**warm, **NEEDS.get(path, {})}.items():
                experiment.set(setting, value)
        high = (getattr(declaration, "softbounds", None) or (0, 1))[1]
        after.set(path, VALUES.get(path, 0.4 * high))
        totals = [error_budget(experiment.run()).isel(time=-1) for experiment in (before, after)]
        if np.allclose(totals[0].total, totals[1].total, rtol=1e-9, atol=0):
            silent.append(path)
        assert totals[1].attrs["left_out"] == ""
    CACHE.clear()
    assert silent == []


def test_outliers_that_a_gate_refuses_are_named_as_left_out() -> None:
    found = error_budget(made("sensors.gps.outlier_rate=0.1", "navigator.gate=0.999").run())
    assert "sensors.gps.outlier_rate (the gate refuses outliers" in found.attrs["left_out"]
    assert "GPS outliers" not in found.source.values


def test_a_budget_is_refused_where_the_gains_are_not_those_of_a_linear_model() -> None:
    navigator = SimpleNamespace(model="nonlinear", smoother=False)
    run = SimpleNamespace(experiment=SimpleNamespace(navigator=navigator), algorithm="")
    with pytest.raises(SettingError, match=r"navigator\.model = 'nonlinear'.*accepted here is one of phi"):
        budget._check(run)  # type: ignore[arg-type]
