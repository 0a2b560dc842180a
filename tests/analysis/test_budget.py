"""The error budget against closed forms, the filter's own covariance, and Monte Carlo runs."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.analysis import budget
from lab.analysis.budget import QUANTITIES, UNITS, error_budget
from lab.analysis.error_sources import (
    ACCELEROMETER,
    GPS_POSITION,
    GYRO,
    Constant,
    Process,
    coupled_source,
    flicker,
)
from lab.analysis.error_sources import initial as initial_columns
from lab.analysis.errors import error_state
from lab.base.parameters.setting_error import SettingError
from lab.base.parameters.units import TO_SI
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE
from lab.motion.frames import earth
from lab.motion.frames.east_north_up import east_north_up
from lab.motion.frames.rotation import wrap
from lab.navigation.filters.error_models import POS, VEL
from lab.navigation.settings import NavigatorSettings
from lab.sensors.gps import GpsErrors

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
        longitude=np.full(n + 1, -2.0),
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
        belief=SimpleNamespace(decay=np.zeros(6), R=np.eye(6)),
        solution_arrays=SimpleNamespace(
            fix_covariance=covariance,
            fix_sample=np.array(fixes, dtype=np.int64),
            fix_H=np.tile(np.eye(6, 15), (len(fixes), 1, 1)),
            fix_R=np.tile(np.eye(6), (len(fixes), 1, 1)),
            fix_held=np.zeros((len(fixes), 3)),
            innovation=np.zeros((len(fixes), 6)),
            aid_sample=np.zeros(0, dtype=np.int64),
            states=15,
            position=np.tile([LATITUDE, -2.0, 0.0], (n + 1, 1)),
            velocity_n=np.zeros((n + 1, 3)),
        ),
        experiment=SimpleNamespace(
            navigator=NavigatorSettings(correction="feedforward"),
            sensors=SimpleNamespace(gps=GpsErrors()),
        ),
        fixes=SimpleNamespace(time=time[list(fixes)], position=np.tile([LATITUDE, -2.0, 0], (len(fixes), 1))),
        time=time,
        blocks=(),
    )


def sigmas(
    result: SimpleNamespace, constants: Iterable[Constant] = (), processes: Iterable[Process] = ()
) -> dict[str, np.ndarray]:
    """Return σ in time of each quantity, in SI units, of all sources together."""
    none = np.zeros((15, 1))
    constants = [*constants] or [Constant("none", none, np.zeros((1, 6, 6)))]
    constants = [source._replace(start=source.start[:15]) for source in constants]
    epochs = budget.choose_epochs(result)
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
    scale = coupled_source("scale", slice(3, 6), slice(3, 6), s * np.eye(3)[None])
    found = sigmas(at_rest(t), [scale])
    assert found["velocity up"][-1] == pytest.approx(s * g * t, rel=CLOSE)
    assert found["velocity north"][-1] < 1e-2 * found["velocity up"][-1]
    cross = np.zeros((1, 3, 3))
    cross[0, 0, 2] = s
    found = sigmas(at_rest(t), [coupled_source("misalignment", slice(3, 6), slice(3, 6), cross)])
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
    experiment.set_texts(assignments)
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

CARD_STATES = (
    "navigator.states=21",
    "navigator.estimate_misalignments=true",
    "navigator.estimate_g_sensitivity=true",
)
"""The states that cards of sensors bring: this filter is compiled for other tests too."""

OTHERS = (
    *("sensors.barometer.fitted=true", "sensors.heading.fitted=true", "sensors.odometer.fitted=true"),
    *("sensors.barometer.noise=0.003", "sensors.heading.noise=0.01", "sensors.odometer.noise=0.001"),
    *("sensors.barometer.bias_sigma=0.05", "sensors.barometer.drift_sigma=0"),
    *("sensors.heading.bias_sigma=0", "sensors.heading.drift_sigma=0.02"),
    *("sensors.heading.correlation_time=60", "sensors.odometer.scale_factor_sigma=0.01"),
    *("sensors.odometer.lever_arm=[-1.2,0.3,0.5]", "trajectory.imu_rate=50"),
    *(
        "sensors.airspeed.fitted=true",
        "sensors.airspeed.noise=0.01",
        "sensors.airspeed.scale_factor_sigma=0.01",
    ),
    *("sensors.airspeed.wind_sigma=0", "sensors.airspeed.wind_drift_sigma=0.1"),
)
"""Other sensors as good, with a constant, a drifting and a scale error, each of which has its state."""


@pytest.mark.proof
@pytest.mark.parametrize(
    "more",
    [
        (),
        ("navigator.correction_period=20",),
        ("navigator.correction=feedforward",),
        ("navigator.model=psi",),
        ("navigator.model=invariant",),
        ("navigator.alignment=20",),
        SCALE_STATES,
        (*SCALE_STATES, "navigator.alignment=20"),
        OTHERS,
        (*OTHERS, "navigator.correction_period=20"),
    ],
)
def test_of_a_matched_filter_all_sources_sum_to_its_own_covariance(more: tuple[str, ...]) -> None:
    found = error_budget(made(*SMALL, *more).run())
    assert np.allclose(found.total / found.believed, 1, atol=5e-3)


def test_tilts_that_were_degrees_off_at_the_start_sum_to_the_covariance_of_the_filter() -> None:
    """An accelerometer bias of 15 mg tilts the start; the filter takes it along the axes of its estimate."""
    poor = "sensors.accelerometer.bias_sigma=15", "sensors.gyro.bias_sigma=0.2"
    found = error_budget(made("mission=los_angeles", *poor).run())
    assert np.allclose(found.total / found.believed, 1, atol=0.04)
    np.testing.assert_allclose(found.total[-1], found.believed[-1], rtol=1e-3)


def test_one_misalignment_with_a_state_acts_as_the_filter_believes() -> None:
    """A given misalignment alone in its triad is one number, as in P0; the others are zero and certain."""
    triads = ("gyro", "[0,0.1,0,0,0,0]"), ("accelerometer", "[0,0,0,0,0.1,0]")
    misaligned = (f"sensors.{triad}.misalignment={values}" for triad, values in triads)
    found = error_budget(made(*SMALL, *CARD_STATES, *misaligned, "trajectory.imu_rate=50").run())
    np.testing.assert_allclose(found.total, found.believed, rtol=1e-2)  # at 50 Hz
    share = found.share.sel(source="gyro misalignment", quantity="gyro misalignment xz")
    assert float(share[0]) == pytest.approx(100)
    # Of one number with a prior variance, the fixes leave the share P / P0 to the prior (Bayes).
    sigma = found.total.sel(quantity="gyro misalignment xz").values
    assert float(share[-1]) == pytest.approx(100 * (sigma[-1] / sigma[0]) ** 2, rel=0.5)
    first, last = (found.total.sel(quantity="accelerometer misalignment zx").values[i] for i in (0, -1))
    assert last < 0.5 * first


def test_a_tilt_of_misaligned_accelerometers_after_an_alignment_is_theirs() -> None:
    """Gravity through xz tilts the navigator as much as it is measured in flight: both are one number."""
    tilted = "navigator.attitude_sigma=[0.1,0.1,0.02]", "sensors.accelerometer.misalignment=[0,0.01,0,0,0,0]"
    settings = *SMALL, *CARD_STATES, "navigator.alignment=20", "trajectory.imu_rate=50"
    found = error_budget(made(*settings, *tilted).run())
    np.testing.assert_allclose(found.total, found.believed, rtol=1e-2)
    share = found.share.sel(source="accelerometer misalignment", quantity="pitch")
    assert float(share[0]) > 80


@pytest.mark.parametrize("correction", ["feedback", "feedforward"])
def test_gauss_markov_biases_of_a_matched_filter_sum_to_its_covariance(correction: str) -> None:
    processes = [
        *("sensors.gyro.bias_sigma=0", "sensors.accelerometer.bias_sigma=0"),
        *("sensors.gyro.instability=3", "sensors.accelerometer.instability=0.02"),
        *("sensors.gyro.correlation_time=60", "sensors.accelerometer.correlation_time=20"),
    ]
    found = error_budget(made(*SMALL, *processes, f"navigator.correction={correction}").run())
    assert np.allclose(found.total / found.believed, 1, atol=5e-3)


def test_a_bias_that_an_alignment_took_off_does_not_come_back() -> None:
    """The filter's estimate starts at zero and decays; the alignment's, thousands of σ here, does not."""
    settings = "sensors.gyro.bias_sigma=1", "sensors.gyro.instability=1", "sensors.gyro.correlation_time=60"
    found = error_budget(made(*SMALL, *settings, "navigator.alignment=900").run())
    assert np.allclose(found.total / found.believed, 1, atol=0.02)


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
    solution = result.solution_arrays
    x = error_state(
        solution,
        end,
        result.truth_arrays,
        result.true_bias,
        result.true_scale,
        result.true_further() if solution.further.size else None,
    )
    angles = wrap(result.euler[-1] - result.truth_arrays.euler[-1])
    return np.concatenate((east_north_up(x[:, POS])[0], east_north_up(x[:, VEL])[0], angles, x[0, 9:])) / [
        TO_SI[unit] for unit in budget.quantities(result.blocks).values()
    ]


def monte_carlo(seeds: int, *assignments: str, mission: str = "montreal") -> np.ndarray:
    """Return the errors (seeds, states) at the end of runs that differ in their seeds."""

    def fly(seed: int) -> np.ndarray:
        return final_errors(made(*assignments, mission=mission, seed=seed).run())

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        errors = np.array(list(pool.map(fly, range(1000, 1000 + seeds))))
    CACHE.clear()
    return errors


RATE = "trajectory.imu_rate=50"
"""A low rate for many runs: budget and runs then have the same one."""
BAD = (
    *("sensors.barometer.noise=1", "sensors.heading.noise=0.5", "sensors.odometer.noise=0.3"),
    *("sensors.barometer.bias_sigma=3", "sensors.heading.drift_sigma=0.5"),
    "sensors.odometer.scale_factor_sigma=0.5",
    *("sensors.airspeed.noise=0.5", "sensors.airspeed.wind_sigma=3", "sensors.airspeed.wind_drift_sigma=1"),
)
"""Errors of usual other sensors."""
ONE_PERCENT = (
    "navigator.states=21",
    "sensors.gyro.scale_factor_sigma=1",
    "sensors.accelerometer.scale_factor_sigma=1",
    RATE,
)


@pytest.mark.proof
@pytest.mark.parametrize(
    "assignments",
    [
        (RATE,),
        (RATE, "navigator.r_scale=100"),
        (*ONE_PERCENT, "navigator.p0_scale=0.3"),
        (*OTHERS, *BAD, "navigator.aiding_scale=30"),
    ],
    ids=["matched", "wrong R", "21 states, wrong P0", "other sensors, wrong noise"],
)
def test_the_total_is_that_of_200_runs(assignments: tuple[str, ...]) -> None:
    found = error_budget(made(*assignments).run()).isel(time=-1)
    spread = np.sqrt(np.mean(monte_carlo(200, *assignments) ** 2, axis=0))
    ratio = found.total.values / spread
    print("budget / Monte Carlo:", dict(zip(found.quantity.values, ratio.round(3).tolist(), strict=True)))
    print("believed / Monte Carlo:", (found.believed.values / spread).round(3).tolist())
    assert np.abs(ratio - 1).max() < 0.15


@pytest.mark.parametrize("length", [0, 30])
def test_the_effect_of_a_g_sensitivity_is_the_difference_it_makes(length: int) -> None:
    """An alignment takes off what of it is there at rest."""
    settings = *SMALL, f"navigator.alignment={length}", "sensors.gps.outages=[[0, 300]]"
    sensitive = made(*settings, "sensors.gyro.g_sensitivity=0.0005").run()
    found = error_budget(sensitive).sigma.sel(source="gyro g-sensitivity").isel(time=-1).values
    change = np.abs(final_errors(sensitive) - final_errors(made(*settings).run()))
    np.testing.assert_allclose(found, change, rtol=0.05, atol=0.02 * change.max())


def test_outliers_that_a_gate_refuses_are_named_as_left_out() -> None:
    found = error_budget(made("sensors.gps.outlier_rate=0.1", "navigator.gate=0.999").run())
    assert "sensors.gps.outlier_rate (the gate rejects outliers" in found.attrs["left_out"]
    assert "GPS outliers" not in found.source.values


def test_a_budget_is_refused_where_the_gains_are_not_those_of_a_linear_model() -> None:
    navigator = SimpleNamespace(model="nonlinear", smoother=False)
    run = SimpleNamespace(experiment=SimpleNamespace(navigator=navigator), algorithm="")
    with pytest.raises(SettingError, match=r"navigator\.model = 'nonlinear'.*accepted here is one of phi"):
        budget._check(run)  # type: ignore[arg-type]
