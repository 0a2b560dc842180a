"""Suite: errors that are off leave every bit, each is reached by its setting, extremes give numbers."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from lab.base.parameters.setting_kinds import AxisQuantity, Quantity
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE
from lab.sensors.draws import unit_draws

DEGREE = np.pi / 180
G = 9.80665

OFF = {
    "gyro.correlation_time": 77,
    "accelerometer.correlation_time": 5,
    "temperature.start": 80,
    "temperature.warm_up_rise": 99,
    "temperature.warm_up_time": 3,
    "temperature.lapse_rate": 9,
    "temperature.thermometer_sigma": 5,
    "gps.correlation_time": 3,
    "gps.outlier_size": 1000,
    "gps.quality_factor": 50,
}
"""Settings that belong to errors which are off."""

ON = {
    "gyro.scale_factor_sigma": 1,
    "gyro.flicker": 20,
    "gyro.rate_random_walk": 20,
    "gyro.quantisation": 0.01,
    "gyro.bandwidth": 50,
    "gyro.g_sensitivity": 0.1,
    "gyro.bias_temperature": 0.01,
    "gyro.scale_temperature": 0.02,
    "accelerometer.scale_factor_sigma": 1,
    "accelerometer.flicker": 0.1,
    "accelerometer.rate_random_walk": 1,
    "accelerometer.quantisation": 1,
    "accelerometer.bandwidth": 50,
    "accelerometer.bias_temperature": 0.1,
    "accelerometer.scale_temperature": 0.02,
    "accelerometer.vibration_density": 500,
    "temperature.start": 40,
    "temperature.profile": "climb",
    "temperature.compensation": True,
    "gps.correlated_sigma": 2,
    "gps.latency": 0.2,
    "gps.lever_arm": 2,
    "gps.outlier_rate": 0.2,
    "gps.quality_steps": [[50, 70]],
}
"""Each error on, at an ordinary size."""

HOT = {"temperature.profile": "constant", "temperature.start": 60}


def run(**settings: object) -> Result:
    """Run montreal at 50 Hz with settings of the sensors, dots written as two underscores."""
    one = Experiment(mission="montreal", seed=5)
    one.trajectory.imu_rate = 50
    for path, value in settings.items():
        one.set(f"sensors.{path.replace('__', '.')}", value)
    return one.run()


def plainly(**settings: object) -> Result:
    """Run with settings given by their dotted paths."""
    return run(**{path.replace(".", "__"): value for path, value in settings.items()})


def measured(result: Result) -> str:
    """Return a digest of all bits the sensors put out."""
    arrays = (*result.gyro[:2], *result.accelerometer[:2], *result.fixes)
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


def test_with_all_else_off_bias_and_white_noise_remain_to_the_bit():
    """The plain model written out: increments, and fixes."""
    result = run()
    dt = result.ideal.dt
    samples = result.ideal.dtheta.shape[0]
    for sensor, out, ideal, noise, bias in (
        ("gyro", result.gyro, result.ideal.dtheta, np.full(3, 0.05) * DEGREE, np.full(3, 0.1) * DEGREE),
        (
            "accelerometer",
            result.accelerometer,
            result.ideal.dvelocity,
            np.array((35.0, 65.0, 35.0)) * (1e-6 * G),
            np.full(3, 2.0) * (1e-3 * G),
        ),
    ):
        turn_on = bias * unit_draws(5, f"{sensor}.bias", (3,))
        white = noise * np.sqrt(dt) * unit_draws(5, f"{sensor}.noise", (samples, 3))
        assert np.array_equal(out.increments, ideal + turn_on * dt + white)
        assert np.array_equal(out.bias, np.broadcast_to(turn_on, ideal.shape))
    fixes = result.fixes.time.size
    assert np.array_equal(
        result.fixes.position_error, np.sqrt((0.5,) * 3) * unit_draws(5, "gps.position", (fixes, 3))
    )
    assert np.array_equal(
        result.fixes.velocity_error, np.sqrt((0.2,) * 3) * unit_draws(5, "gps.velocity", (fixes, 3))
    )


def test_settings_of_errors_that_are_off_change_no_bit():
    first = measured(run())
    for path, value in OFF.items():
        assert measured(plainly(**{path: value})) == first, path


@pytest.mark.parametrize("path", ON)
def test_each_error_reaches_the_output_of_its_own_sensor_alone(path):
    heat = {
        **HOT,
        "gyro.bias_temperature": 0.01,
        "accelerometer.bias_temperature": 0.1,
        "temperature.thermometer_sigma": 1,
    }
    base = heat if path.startswith("temperature") else HOT
    before, after = plainly(**base), plainly(**{**base, path: ON[path]})
    changed = {
        sensor
        for sensor in ("gyro", "accelerometer")
        if not np.array_equal(getattr(before, sensor).increments, getattr(after, sensor).increments)
    }
    if not np.array_equal(before.fixes.position, after.fixes.position):
        changed.add("gps")
    own = path.partition(".")[0]
    assert changed == ({"gyro", "accelerometer"} if own == "temperature" else {own})


def test_vibration_shakes_gyros_that_are_sensitive_to_it():
    calm = run(gyro__g_sensitivity=0.1)
    shaken = run(gyro__g_sensitivity=0.1, accelerometer__vibration_density=5000)
    dt = calm.ideal.dt
    expected = 0.1 * DEGREE / G * 5000e-6 * G / np.sqrt(dt)
    added = shaken.gyro.bias - calm.gyro.bias
    assert np.allclose(added.std(axis=0) / expected, 1, atol=5 / np.sqrt(2 * added.shape[0]))
    # It is the accelerometers' vibration that they feel.
    force = (shaken.accelerometer.increments - calm.accelerometer.increments) / dt
    assert np.allclose(added, 0.1 * DEGREE / G * force, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize(
    ("path", "value", "stages"),
    [
        ("gyro.flicker", 5, {"draws", "gyro", "navigation"}),
        ("gyro.bandwidth", 5, {"gyro", "navigation"}),
        ("accelerometer.vibration_density", 5, {"accelerometer", "navigation"}),
        ("temperature.start", 5, {"gyro", "accelerometer", "navigation"}),
        ("gps.correlated_sigma", 5, {"gps", "navigation"}),
        ("gps.latency", 0.5, {"antenna", "gps", "navigation"}),
        ("gps.lever_arm", 5, {"antenna", "gps", "navigation"}),
    ],
)
def test_a_change_recomputes_what_depends_on_it_and_nothing_else(path, value, stages):
    CACHE.clear()
    run()
    before = dict(CACHE.computed)
    plainly(**{path: value})
    assert {stage for stage, count in CACHE.computed.items() if count > before.get(stage, 0)} == stages


def test_moving_a_coefficient_rescales_the_same_realisation():
    none, one, three = (run(gyro__flicker=b, gyro__rate_random_walk=b) for b in (0, 10, 30))
    step = one.gyro.bias - none.gyro.bias
    assert np.allclose(three.gyro.bias - none.gyro.bias, 3 * step, atol=1e-15)
    assert np.abs(step).max() > 1e-6


def ends() -> list[tuple[str, float]]:
    """Return every error that is a quantity with the ends of its bounds."""
    sensors, found = Experiment().sensors, []
    for path in ON:
        group, _, name = path.partition(".")
        declaration = sensors.get(group).param[name]
        if isinstance(declaration, Quantity | AxisQuantity):
            found += [(path, end) for end in declaration.bounds]
    return found


@pytest.mark.parametrize(("path", "value"), ends())
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_errors_at_the_ends_of_their_bounds_give_numbers(path, value):
    """Of the sensors; the navigator may say that it cannot go on with them."""
    try:
        result = plainly(**{**HOT, "temperature.compensation": True, path: value})
    except ValueError as error:
        assert "diverged" in str(error)
        return
    for array in (*result.gyro[:2], *result.accelerometer[:2], *result.fixes):
        assert np.isfinite(array).all()


def test_all_errors_together_fly():
    result = plainly(**ON)
    assert np.isfinite(result.solution_arrays.position).all()
    assert result.fixes.time[0] == 1
    assert np.abs(result.fixes.position_error).max() > 30
