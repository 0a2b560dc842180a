"""IMU errors: their statistics and their algebra against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from lab.sensors.imu import AccelerometerErrors, GyroErrors, ImuDraws, measure

DT = 0.005
DEGREE = np.pi / 180
G = 9.80665
CLEAN = {"noise_density": 0, "bias_sigma": 0}


def gyro(**settings: object) -> GyroErrors:
    """Return gyros without errors but for the given ones."""
    return GyroErrors(**{**CLEAN, **settings})


def accelerometer(**settings: object) -> AccelerometerErrors:
    """Return accelerometers without errors but for the given ones."""
    return AccelerometerErrors(**{**CLEAN, **settings})


def draws(samples: int, seed: int = 1, sensor: str = "gyro", *, instability: bool = True) -> ImuDraws:
    """Return the draws of a triad."""
    return ImuDraws.of(seed, sensor, samples, instability=instability)


def at_rest(errors: GyroErrors | AccelerometerErrors, samples: int, seed: int = 1, dt: float = DT) -> NDArray:
    """Return the increments (samples, 3) of a triad that feels nothing."""
    return measure(np.zeros((samples, 3)), dt, errors, draws(samples, seed)).increments


def test_without_errors_the_ideal_increments_come_out_unchanged():
    ideal = np.random.default_rng(1).normal(0, 0.1 * DT, (100, 3))
    out = measure(ideal, DT, gyro(), draws(100, instability=False))
    assert np.array_equal(out.increments, ideal)
    assert not out.bias.any()
    assert out.saturated == 0


@pytest.mark.parametrize(
    ("errors", "density"),
    [
        (gyro(noise_density=(0.05, 0.1, 0.02)), np.array((0.05, 0.1, 0.02)) * DEGREE),
        (accelerometer(noise_density=(35, 65, 350)), np.array((35, 65, 350)) * 1e-6 * G),
    ],
    ids=["gyro", "accelerometer"],
)
@pytest.mark.parametrize("cluster", [1, 10, 100])
def test_white_noise_has_the_density_of_the_settings(errors, density, cluster):
    """Allan variance of white noise is N²/τ at every τ."""
    increments = at_rest(errors, 100_000)
    means = increments.reshape(-1, cluster, 3).sum(axis=1) / (cluster * DT)
    allan = 0.5 * np.mean(np.diff(means, axis=0) ** 2, axis=0)
    assert np.allclose(allan * cluster * DT / density**2, 1, atol=5 * np.sqrt(3 / len(means)))


def test_white_noise_does_not_depend_on_the_rate_in_its_integral():
    """Angle random walk after a second: N √1 s, whether sampled at 10 Hz or 1 kHz."""
    for rate in (10, 1000):
        increments = at_rest(gyro(noise_density=0.05), 1000 * rate, dt=1 / rate)
        angle = increments.reshape(1000, rate, 3).sum(axis=1)
        assert np.std(angle) == pytest.approx(0.05 * DEGREE, rel=5 / np.sqrt(2 * angle.size))


def test_moving_the_density_rescales_the_same_realisation():
    one, two, ten = (at_rest(gyro(noise_density=n, bias=0.1), 1000) for n in (0.01, 0.02, 0.1))
    assert np.allclose(ten - one, 9 * (two - one), rtol=1e-9, atol=1e-18)
    assert np.abs(two - one).max() > 0


def test_the_noise_stays_when_other_errors_change():
    noise = at_rest(gyro(noise_density=0.05), 1000)
    both = at_rest(gyro(noise_density=0.05, bias_sigma=0.3, instability=20), 1000)
    other = at_rest(gyro(bias_sigma=0.3, instability=20), 1000)
    assert np.allclose(both - other, noise, atol=1e-17)


def test_turn_on_bias_is_the_given_one_plus_a_normal_draw():
    errors = gyro(bias=(0.5, -1.0, 0.0), bias_sigma=(0.1, 0.2, 0.4))
    biases = np.array([measure(np.zeros((1, 3)), DT, errors, draws(1, seed)).bias[0] for seed in range(600)])
    normal = (biases / DEGREE - (0.5, -1.0, 0.0)) / (0.1, 0.2, 0.4)
    assert stats.kstest(normal.ravel(), "norm").pvalue > 1e-4
    assert np.allclose(normal.std(axis=0), 1, atol=5 / np.sqrt(2 * 600))


def test_a_bias_adds_itself_times_the_interval():
    out = measure(np.zeros((50, 3)), DT, accelerometer(bias=(1, 2, -3)), draws(50))
    assert np.allclose(out.increments, np.array((1, 2, -3)) * 1e-3 * G * DT, rtol=1e-12)
    assert np.allclose(out.bias, np.array((1, 2, -3)) * 1e-3 * G, rtol=1e-12)


def test_bias_instability_has_the_covariance_of_a_gauss_markov_process():
    """σ² exp(−τ/T), over 6000 correlation times in all."""
    tau, dt, samples = 1.0, 0.05, 40_000
    errors = gyro(instability=100, correlation_time=tau)
    bias = measure(np.zeros((samples, 3)), dt, errors, draws(samples)).bias / (100 * DEGREE / 3600)
    for lag in (0, 5, 20, 60):
        covariance = np.mean(bias[lag:] * bias[: samples - lag])
        assert covariance == pytest.approx(np.exp(-lag * dt / tau), abs=5 * np.sqrt(2 / 6000))


def test_bias_instability_is_stationary_from_the_first_sample():
    errors = gyro(instability=100, correlation_time=2.0)
    unit = 100 * DEGREE / 3600
    runs = np.array([measure(np.zeros((60, 3)), 0.1, errors, draws(60, seed)).bias for seed in range(500)])
    for sample in (0, 20, 59):
        assert np.mean((runs[:, sample] / unit) ** 2) == pytest.approx(1, abs=5 * np.sqrt(2 / 1500))


def test_scale_and_misalignment_make_the_matrix_of_the_definition():
    """x_meas = (I + M) (x + b), M written out element by element."""
    errors = gyro(scale_factor=(1, 2, 3), misalignment=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6), bias=(1, -2, 3))
    M = np.array(
        [
            [0.01, 0.1 * DEGREE, 0.2 * DEGREE],
            [0.3 * DEGREE, 0.02, 0.4 * DEGREE],
            [0.5 * DEGREE, 0.6 * DEGREE, 0.03],
        ]
    )
    ideal = np.random.default_rng(5).normal(0, 1, (20, 3)) * DT
    out = measure(ideal, DT, errors, draws(20))
    for increment, true in zip(out.increments, ideal, strict=True):
        expected = (np.eye(3) + M) @ (true / DT + np.array((1, -2, 3)) * DEGREE) * DT
        assert np.allclose(increment, expected, rtol=1e-12)


def test_beyond_the_range_the_output_stays_at_its_end_and_is_counted():
    rates = np.array([(0, 99, -99), (101, -101, 0), (1000, 50, -1000)]) * DEGREE
    out = measure(rates * DT, DT, gyro(range=100), draws(3))
    expected = np.array([(0, 99, -99), (100, -100, 0), (100, 50, -100)]) * DEGREE * DT
    assert np.allclose(out.increments, expected, rtol=1e-12)
    assert out.saturated == 4


def test_the_input_is_left_as_it_is():
    ideal = np.full((10, 3), 0.01)
    measure(ideal, DT, gyro(noise_density=1, bias=5, scale_factor=1, range=1), draws(10))
    assert (ideal == 0.01).all()


def test_triads_have_their_own_draws():
    one, other = draws(5000, sensor="gyro"), draws(5000, sensor="accelerometer")
    for a, b in zip(one, other, strict=True):
        assert not np.array_equal(a, b)
    assert abs(np.corrcoef(one.noise.ravel(), other.noise.ravel())[0, 1]) < 5 / np.sqrt(15000)
