"""Filters with 21 states: consistency of the scale factors over seeds, agreement, and what is refused."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

from lab.analysis.consistency import chi_square_interval
from lab.analysis.errors import error_state
from lab.base.arrays import FloatArray
from lab.base.parameters.setting_error import SettingError
from lab.experiment.ensembles.comparison import models
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.experiment.stages import CACHE
from lab.navigation import strapdown
from lab.navigation.belief import belief
from lab.navigation.filters.error_models import ACCEL_SCALE, GYRO_SCALE

SEEDS = 60
RATE = 50.0
"""IMU rate over many seeds [Hz]: their statistics are taken at the fixes, which are as many at any rate."""
SCALED = {"sensors.gyro.scale_factor_sigma": 1.0, "sensors.accelerometer.scale_factor_sigma": 1.0}


def run(seed: int = 1, **settings: object) -> Result:
    """Run montreal with 21 states and scale factors of 1 % (1σ); further settings with __ for the dots."""
    experiment = Experiment(mission="montreal", seed=seed)
    given = {name.replace("__", "."): value for name, value in settings.items()}
    for path, value in {
        "trajectory.imu_rate": 100,
        "navigator.states": 21,
        **SCALED,
        **given,
    }.items():
        experiment.set(path, value)
    return experiment.run()


def all_errors(result: Result, samples: NDArray[np.int64]) -> FloatArray:
    """Return the error state at some samples."""
    return error_state(
        result.solution_arrays, samples, result.truth_arrays, result.true_bias, result.true_scale
    )


@pytest.mark.proof
@pytest.mark.parametrize("model", models())
def test_a_matched_filter_tells_the_truth_about_its_scale_factors(model: str) -> None:
    def one(seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        result = run(seed, navigator__model=model, trajectory__imu_rate=RATE)
        late = result.fixes.time > 20
        end = np.array([result.time.size - 1])
        sigma = np.sqrt(result.solution_arrays.variance[-1, 15:])
        return result.consistency.nees.values[late], all_errors(result, end)[0, 15:], sigma

    with ThreadPoolExecutor(2) as pool:
        runs = list(pool.map(one, range(1, SEEDS + 1)))
    CACHE.clear()
    nees, errors, sigma = (np.array(values) for values in zip(*runs, strict=True))
    low, high = chi_square_interval(21, SEEDS)
    mean = nees.mean(axis=0)
    inside = float(np.mean((low < mean) & (mean < high)))
    rms, believed = (np.sqrt(np.mean(np.square(values), axis=0)) for values in (errors, sigma))
    print(f"\n{model}, {SEEDS} seeds: NEES {nees.mean():.2f} of 21, inside at {100 * inside:.1f} % of epochs")
    print(
        f"scale factors at the end [%]: errors {(100 * rms).round(2)}, believed {(100 * believed).round(2)}"
    )
    assert inside >= 0.9
    # Four standard deviations of an rms of so many runs.
    np.testing.assert_allclose(rms / believed, 1, atol=4 / np.sqrt(2 * SEEDS))
    # Turns show the scale factor of the gyro about the vertical, gravity that of the accelerometer along it.
    assert rms[2] < 0.6 * 0.01
    assert rms[5] < 0.6 * 0.01


def test_scale_factors_that_are_certain_change_nothing() -> None:
    """Without a variance the states are there and stay zero; all else is that of 15 states, to roundoff."""
    nothing = dict.fromkeys(SCALED, 0.0)
    few, many = (run(2, **nothing, navigator__states=n) for n in (15, 21))
    one, other = few.solution_arrays, many.solution_arrays
    assert not other.scale.any()
    assert not other.variance[:, 15:].any()
    np.testing.assert_allclose(other.variance[:, :15], one.variance, rtol=1e-9)
    for name in ("velocity_n", "q_nb", "bias"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name), rtol=0, atol=1e-9)
    assert many.consistency.nees.attrs["degrees"] == 15
    np.testing.assert_allclose(many.consistency.nees, few.consistency.nees, rtol=1e-6)
    assert many.verdict.headline == few.verdict.headline


def test_the_strapdown_takes_out_what_the_sensors_put_in() -> None:
    """Sensors give (1 + s) x + b; a navigator that knows s and b goes where one with perfect ones goes."""
    rng = np.random.default_rng(4)
    state = np.zeros(strapdown.LENGTH)
    strapdown.set_position(state, 0.8, 0.3, 500.0)
    state[strapdown.Q_NB] = 1.0
    other, dt = state.copy(), 0.01
    bias, scale = rng.normal(0, [0.01] * 3 + [0.1] * 3), rng.normal(0, 0.05, 6)
    other[strapdown.GYRO_BIAS : strapdown.GYRO_BIAS + 6] = bias
    other[strapdown.GYRO_SCALE : strapdown.GYRO_SCALE + 6] = scale
    for _ in range(200):
        true = dt * rng.normal(0, [1.0] * 3 + [10.0] * 3)
        measured = (1 + scale) * true + dt * bias
        strapdown.step(state, tuple(true[:3]), tuple(true[3:]), dt)
        strapdown.step(other, tuple(measured[:3]), tuple(measured[3:]), dt)
    kept = slice(strapdown.LATITUDE, strapdown.GYRO_BIAS)
    np.testing.assert_allclose(other[kept], state[kept], rtol=1e-12, atol=1e-12)


SMALL = {
    "sensors__gyro__noise_density": 0.001,
    "sensors__gyro__bias_sigma": 0.001,
    "sensors__gyro__scale_factor_sigma": 0.01,
    "sensors__accelerometer__noise_density": 3.5,
    "sensors__accelerometer__bias_sigma": 0.02,
    "sensors__accelerometer__scale_factor_sigma": 0.01,
    "navigator__attitude_sigma": 0.01,
}
"""Errors so small that all is linear."""


@pytest.mark.parametrize(
    "model",
    [
        pytest.param("psi", marks=pytest.mark.proof),
        pytest.param("invariant", marks=pytest.mark.proof),
        "nonlinear",
    ],
)
def test_all_models_agree_while_errors_are_small(model: str) -> None:
    phi, other = (run(3, **SMALL, navigator__model=name) for name in ("phi", model))
    samples = np.arange(0, phi.time.size, 50)
    sigma = np.sqrt(phi.solution_arrays.variance[samples])
    worst = np.abs((all_errors(other, samples) - all_errors(phi, samples)) / sigma).max()
    print(f"\n{model} − phi, 21 states: {worst:.4f} σ at most")
    assert worst < 0.1


def test_feedback_equals_feedforward_while_errors_are_small() -> None:
    """Smaller still: what is small in a navigator that is corrected grows in one that runs free."""
    tiny = {name: value / 4 for name, value in SMALL.items()}
    one, other = (run(3, **tiny, navigator__correction=name) for name in ("feedback", "feedforward"))
    samples = np.arange(0, one.time.size, 50)
    sigma = np.sqrt(one.solution_arrays.variance[samples])
    assert np.abs((all_errors(other, samples) - all_errors(one, samples)) / sigma).max() < 0.05


@pytest.mark.proof
def test_smoothed_scale_factors_are_constant_and_better() -> None:
    """A constant is known equally well at all times once all fixes are known."""
    # Without held headings, which both would hold elsewhere.
    filtered, smoothed = (
        run(5, navigator__smoother=flag, navigator__hold_heading=False) for flag in (False, True)
    )
    one, other = filtered.solution_arrays, smoothed.solution_arrays
    assert (other.variance[:, 15:] <= one.variance[:, 15:] * (1 + 1e-6)).all()
    spread = np.ptp(other.scale, axis=0) / np.sqrt(other.variance[-1, 15:])
    print(
        f"\nsmoothed scale factors move by {spread.round(3)} σ, filtered ones by "
        f"{(np.ptp(one.scale, axis=0) / np.sqrt(other.variance[-1, 15:])).round(1)} σ"
    )
    assert (spread < 0.3).all()
    np.testing.assert_allclose(other.variance[0, 15:], other.variance[-1, 15:], rtol=0.02)


def test_p0_is_matched_to_given_and_drawn_scale_factors() -> None:
    experiment = Experiment()
    experiment.set("navigator.states", 21)
    experiment.set("sensors.gyro.scale_factor", [3.0, 0.0, 0.0])
    experiment.set("sensors.gyro.scale_factor_sigma", [4.0, 1.0, 0.0])
    sigma = np.sqrt(np.diag(belief(experiment.sensors, experiment.navigator).P0))
    np.testing.assert_allclose(sigma[GYRO_SCALE], [0.05, 0.01, 0.0], rtol=1e-12)
    assert not sigma[ACCEL_SCALE].any()


def test_a_given_p0_has_the_size_of_the_filter() -> None:
    experiment = Experiment()
    experiment.set("navigator.p0", [1.0] * 15)
    experiment.set("navigator.states", 21)
    with pytest.raises(SettingError, match="has 15 states, but the filter has 21"):
        experiment.run()
    experiment.set("navigator.p0", np.eye(21).tolist())
    assert belief(experiment.sensors, experiment.navigator).P0.shape == (21, 21)
    experiment.set("navigator.states", 15)
    with pytest.raises(SettingError, match="has 21 states, but the filter has 15"):
        experiment.run()
    with pytest.raises(SettingError, match="15 or 21 variances"):
        experiment.set("navigator.p0", [1.0] * 16)
    with pytest.raises(SettingError, match="one of 15, 21"):
        experiment.set("navigator.states", 18)


def test_true_scale_factors_follow_the_temperature_and_its_compensation() -> None:
    """What is measured, less noise, is (1 + s) x + b with the truth as it is told, at all times."""
    quiet = {"sensors__gyro__noise_density": 0.0, "sensors__gyro__range": 1e4}
    warm = {
        "sensors__temperature__profile": "warm_up",
        "sensors__gyro__scale_temperature": 0.02,
        "sensors__gyro__scale_factor": 0.5,
    }
    for compensation in (False, True):
        result = run(1, **quiet, **warm, sensors__temperature__compensation=compensation)
        dt, true = result.ideal.dt, result.ideal.dtheta
        expected = (1 + result.gyro.scale) * true + dt * result.gyro.bias
        np.testing.assert_allclose(result.gyro.increments, expected, rtol=0, atol=1e-12)
        moved = np.ptp(result.gyro.scale[:, 0])
        assert moved < 1e-5 if compensation else moved > 1e-3


@pytest.mark.proof
def test_files_have_the_scale_factors(tmp_path: Path) -> None:
    result = run(1)
    result.to_netcdf(tmp_path / "run.nc")
    tree = xr.open_datatree(tmp_path / "run.nc")
    assert tree["state_sigma"].sizes["state"] == 21
    assert str(tree["state_sigma"]["state"].values[20]) == "accelerometer scale z"
    assert str(tree["state_sigma"]["unit"].values[20]) == "%"
    np.testing.assert_allclose(
        tree["sensor_errors"]["gyro_scale"].values, 100 * result.solution_arrays.scale[:, :3]
    )
    tree.close()
    result.to_csv(tmp_path / "csv")
    head = (tmp_path / "csv" / "sensor_errors.csv").read_text(encoding="utf-8").splitlines()[0]
    assert "accelerometer_scale_true z [%]" in head
    assert "accelerometer scale z" in (tmp_path / "csv" / "state_sigma.csv").read_text().splitlines()[0]
