"""Each source of the error budget alone: against its effect in a run, or its spread over runs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from lab.analysis.budget import error_budget
from lab.base.parameters.settings import Settings
from lab.base.parameters.units import TO_SI
from lab.experiment.experiment import Experiment
from lab.experiment.stages import CACHE
from lab.navigation.belief import belief
from lab.sensors.suite import OTHER_SENSORS, TRIADS

RATE = 50.0
"""Rate of the IMU [Hz]: the effects of errors on a flight are those at 200 Hz, in a quarter of the time."""
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
    experiment.set("trajectory.imu_rate", RATE)
    assumed = belief(experiment.sensors, experiment.navigator)
    for name, matrix in (("p0", assumed.P0), ("q", np.diag(assumed.noise)), ("r", assumed.R)):
        experiment.set(f"navigator.{name}", np.diag(matrix).tolist())
    for path, value in {
        **QUIET,
        **{name.replace("__", "."): value for name, value in errors.items()},
    }.items():
        experiment.set(path, value)
    return experiment


FITTED = {
    **{f"sensors__{name}__fitted": True for name in OTHER_SENSORS},
    **{f"sensors__{name}__bias_sigma": 0.0 for name in ("barometer", "heading")},
    "sensors__barometer__drift_sigma": 0.0,
    "sensors__odometer__scale_factor_sigma": 0.0,
    "sensors__barometer__noise": 3e-4,
    "sensors__heading__noise": 1e-3,
    **{f"sensors__{name}__outages": [(0.0, 1000.0)] for name in ("odometer", "airspeed")},
    "navigator__aiding_scale": 1e6,
}
"""All other sensors, almost without errors, of which the filter assumes usual ones. The odometer has a state
but no readings: the filter corrects them for an uncertain heading, which is certain here. Nor has the
airspeed sensor: its wind is not certain."""

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
    "GPS latency": {"sensors__gps__latency": 0.05, "navigator__latency": 0.0},
    "GPS lever arm": {"sensors__gps__lever_arm": (1.0, -0.5, 0.3), "navigator__lever_arm": 0.0},
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
    "vehicle slip": {**FITTED, "navigator__no_slip": True, "navigator__slip_sigma": (3e-3, 3e-3)},
    "heading sensor declination": {
        **FITTED,
        "sensors__heading__source": "magnetometer",
        "sensors__heading__declination": 11.8,
    },
}


@pytest.mark.parametrize("source", GIVEN)
def test_a_given_error_alone_has_the_effect_it_has(source: str) -> None:
    """Without anything random a run *is* its effect, up to what is not linear."""
    result = alone(**GIVEN[source]).run()
    found = error_budget(result)
    samples = np.searchsorted(result.time, found.time.values - 1e-9)
    data = (result.errors[name].values[samples] for name in ("position", "velocity", "attitude"))
    run = getattr(result, "run", result)
    biases = run.solution_arrays.bias - run.true_bias
    shown = [TO_SI[unit] for unit in found.unit.values[9:15]]
    flown = np.abs(np.concatenate((*data, biases[samples] / shown), axis=1))
    alone_sigma = found.sigma.sel(source=source).values[:, :15]
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


@pytest.mark.proof
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
    sigma, believed = (
        values[SECOND_HALF, :9] for values in (found.sigma.sel(source=source).values, found.believed.values)
    )
    mean, size = (np.sqrt((np.mean(squares, axis=0) / of**2).mean(axis=0)) for of in (sigma, believed))
    CACHE.clear()
    print(source, mean.round(3).tolist())
    if source == "gyro turn-on bias σ":
        # Upwards it acts by the square of the tilt, which no linear budget has, and which is next to nothing.
        upwards = [2, 5]
        assert max(size[upwards].max(), (sigma / believed).mean(axis=0)[upwards].max()) < 0.03
        mean = np.delete(mean, upwards)
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
    noise = {"sensors__gyro__noise_density": 0.04}  # per sample a half of the step
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
    **{f"sensors.{triad}.correlation_time": {f"sensors.{triad}.instability": 1.0} for triad in TRIADS},
    "sensors.heading.correlation_time": {"sensors.heading.drift_sigma": 1.0},
    "sensors.heading.declination": {"sensors.heading.source": "magnetometer"},
}
"""Other settings without which a setting has no effect."""
VALUES = {
    "sensors.gyro.range": 5.0,
    "sensors.accelerometer.range": 1.05,
    "sensors.gps.outages": [(20, 30)],
    "sensors.gps.quality_steps": [(20, 40)],
    **{f"sensors.{sensor}.outages": [(20, 100)] for sensor in OTHER_SENSORS},
    "sensors.heading.declination": 20.0,
    "sensors.airspeed.slowest": 1000.0,
}


SOURCES = {
    "noise_density": "{} white noise",
    "bias": "{} turn-on bias, given",
    "bias_sigma": "{} turn-on bias σ",
    "instability": "{} bias instability",
    "correlation_time": "{} bias instability",
    "flicker": "{} flicker",
    "rate_random_walk": "{} random walk",
    "scale_factor": "{} scale factor, given",
    "scale_factor_sigma": "{} scale factor σ",
    "misalignment": "{} misalignment",
    "g_sensitivity": "{} g-sensitivity",
    "bias_temperature": "{} temperature, bias",
    "scale_temperature": "{} temperature, scale factor",
    "vibration_density": "vibration",
    "bandwidth": "{} bandwidth",
    "range": "{} range",
    "quantisation": "{} quantisation",
    "position_variance": "GPS position noise",
    "velocity_variance": "GPS velocity noise",
    "correlated_sigma": "GPS correlated position",
    "gps.correlation_time": "GPS correlated position",
    "period": "GPS position noise",
    "outages": "GPS position noise",
    "latency": "GPS latency",
    "lever_arm": "GPS lever arm",
    "outlier_rate": "GPS outliers",
    "outlier_size": "GPS outliers",
    "quality_steps": "GPS position noise",
    "quality_factor": "GPS position noise",
    **{
        f"{sensor}.{setting}": f"{named} {source}"
        for sensor, named in (
            ("barometer", "barometer"),
            ("heading", "heading sensor"),
            ("odometer", "odometer"),
            ("airspeed", "airspeed"),
        )
        for setting, source in {
            **dict.fromkeys(("noise", "period", "outages"), "noise"),
            "bias_sigma": "bias",
            "scale_factor_sigma": "scale factor",
            "drift_sigma": "drift",
            "correlation_time": "drift",
        }.items()
    },
    "heading.declination": "heading sensor declination",
    "airspeed.slowest": "airspeed noise",
    "airspeed.wind_sigma": "wind",
    **dict.fromkeys(("airspeed.wind_drift_sigma", "airspeed.correlation_time"), "wind drift"),
}
"""Source of the budget in which a setting shows, by its name; of a triad with the triad's."""
LEAST = 0.01
"""Part of the total by which its source has to change; each setting changes its own by 1.2 % or more."""


@pytest.fixture(scope="module")
def filter_of_its_own() -> Iterator[dict[str, object]]:
    """Return settings of a filter that no setting of the sensors changes: its gains are not the source."""
    experiment = Experiment(mission="los_angeles")
    assumed = belief(experiment.sensors, experiment.navigator)
    given = {"p0": np.diag(assumed.P0), "q": assumed.noise, "r": np.diag(assumed.R)}
    yield {f"navigator.{name}": values.tolist() for name, values in given.items()} | {
        "navigator.latency": 0.0,
        "navigator.lever_arm": 0.0,
        "sensors.temperature.profile": "constant",
        "sensors.temperature.start": 40.0,
    }
    CACHE.clear()


@pytest.mark.proof
@pytest.mark.parametrize(
    ("path", "owner", "name"),
    [
        leaf
        for leaf in Experiment().sensors.leaves("sensors.")
        if leaf[0].split(".")[1] in (*TRIADS, "gps")
        # The filter knows where the odometer is, and another kind of sensor has no error of its own.
        or (leaf[0].split(".")[1] in OTHER_SENSORS and leaf[2] not in ("fitted", "source", "lever_arm"))
    ],
    ids=lambda part: part if isinstance(part, str) and part.startswith("sensors.") else "",
)
def test_no_setting_of_a_sensor_is_left_out_silently(
    path: str, owner: Settings, name: str, filter_of_its_own: dict[str, object]
) -> None:
    """Each shows in the source that is named after it, though the filter does not know of it."""
    before, after = (Experiment(mission="los_angeles") for _ in range(2))
    for experiment in (before, after):
        experiment.set("trajectory.imu_rate", RATE)
        for setting, value in {**filter_of_its_own, **NEEDS.get(path, {})}.items():
            experiment.set(setting, value)
        for sensor in OTHER_SENSORS if path.split(".")[1] in OTHER_SENSORS else ():
            experiment.set(f"sensors.{sensor}.fitted", True)
    declaration = owner.param[name]
    high = (getattr(declaration, "softbounds", None) or (0, 1))[1]
    after.set(path, VALUES.get(path, 0.4 * high))
    found = [error_budget(experiment.run()).isel(time=-1) for experiment in (before, after)]
    assert found[1].attrs["left_out"] == ""
    group = path.split(".")[1]
    own = f"{group}.{name}"
    source = SOURCES[own if own in SOURCES else name].format(group)
    sigma = [
        one.sigma.sel(source=source).values if source in one.source else np.zeros(one.total.shape)
        for one in found
    ]
    assert np.max(np.abs(sigma[1] - sigma[0]) / found[0].total.values) > LEAST
