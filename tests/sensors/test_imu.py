"""IMU errors: their statistics and their algebra against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from lab.sensors.imu import (
    AccelerometerErrors,
    Environment,
    GyroErrors,
    ImuDraws,
    compensate,
    measure,
    with_vibration,
)

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
    return ImuDraws.of(seed, sensor, samples, instability=instability, flicker=True, walk=True)


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
    """x_meas = (I + M) (x + b), M written out element by element; the bias is told as the output has it."""
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
    assert np.allclose(out.bias, (np.eye(3) + M) @ np.array((1, -2, 3)) * DEGREE, rtol=1e-12)


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


# Scale factor, flicker, random walk


def test_a_drawn_scale_factor_adds_to_the_given_one():
    errors = gyro(scale_factor=1, scale_factor_sigma=(0.1, 0.2, 0.4))
    ideal = np.full((1, 3), 0.3 * DT)
    scales = np.array([measure(ideal, DT, errors, draws(1, seed)).increments[0] for seed in range(600)])
    normal = (scales / (0.3 * DT) - 1.01) / (0.001, 0.002, 0.004)
    assert stats.kstest(normal.ravel(), "norm").pvalue > 1e-4
    assert np.allclose(normal.std(axis=0), 1, atol=5 / np.sqrt(2 * 600))


def test_the_scale_factor_is_drawn_apart_from_the_bias():
    pairs = [(d.bias, d.scale, d.start) for d in (draws(1, seed) for seed in range(700))]
    assert np.abs(np.corrcoef(np.reshape(pairs, (700, 9)).T) - np.eye(9)).max() < 5 / np.sqrt(700)


@pytest.mark.proof
@pytest.mark.parametrize(
    ("errors", "unit"),
    [
        (gyro(flicker=(1, 2, 4)), DEGREE / 3600),
        (accelerometer(flicker=(1, 2, 4)), 1e-3 * G),
    ],
    ids=["gyro", "accelerometer"],
)
@pytest.mark.parametrize("dt", [0.005, 0.02])
def test_flicker_has_the_allan_floor_of_its_coefficient_at_any_rate(errors, unit, dt):
    """0.664 B (IEEE 952), at 5 s whatever the rate."""
    cluster, runs = round(5 / dt), 9
    means = np.concatenate(
        [
            at_rest(errors, 400 * cluster, seed, dt).reshape(-1, cluster, 3).sum(axis=1) / (5 * unit)
            for seed in range(runs)
        ],
        axis=1,
    )
    variance = 0.5 * np.mean(np.diff(means, axis=0) ** 2, axis=0).reshape(runs, 3).mean(axis=0)
    # 400 clusters a run, neighbouring differences correlated.
    assert np.allclose(np.sqrt(variance) / (0.664 * np.array((1, 2, 4))), 1, atol=4 / np.sqrt(400 * runs))


@pytest.mark.proof
@pytest.mark.parametrize(
    ("errors", "unit"),
    [
        (gyro(rate_random_walk=(1, 2, 4)), DEGREE / 3600),
        (accelerometer(rate_random_walk=(1, 2, 4)), 1e-3 * G),
    ],
    ids=["gyro", "accelerometer"],
)
@pytest.mark.parametrize("dt", [2.0, 10.0])
def test_a_random_walk_has_its_coefficient_after_an_hour(errors, unit, dt):
    samples = round(3600 / dt)
    ends = [measure(np.zeros((samples, 3)), dt, errors, draws(samples, seed)).bias[-1] for seed in range(800)]
    assert np.allclose(np.std(ends, axis=0) / (unit * np.array((1, 2, 4))), 1, atol=5 / np.sqrt(1600))


def test_processes_of_the_bias_add_up_and_keep_their_realisations():
    alone = [
        measure(np.zeros((500, 3)), DT, gyro(**{name: 10}), draws(500)).bias
        for name in ("instability", "flicker", "rate_random_walk")
    ]
    errors = gyro(instability=20, flicker=30, rate_random_walk=40)
    together = measure(np.zeros((500, 3)), DT, errors, draws(500)).bias
    assert np.allclose(together, 2 * alone[0] + 3 * alone[1] + 4 * alone[2], atol=1e-15)
    columns = np.concatenate([np.diff(values, axis=0) for values in alone], axis=1)
    assert np.abs(np.corrcoef(columns.T) - np.eye(9)).max() < 5 / np.sqrt(499)


def test_long_draws_are_made_only_where_used():
    few = ImuDraws.of(1, "gyro", 1000, instability=False)
    assert [part.shape[0] for part in (few.drive, few.flicker, few.walk, few.noise)] == [0, 0, 0, 1000]
    all_of_them = draws(1000)
    assert np.array_equal(few.noise, all_of_them.noise)
    assert np.array_equal(few.bias, all_of_them.bias)


# Bandwidth, quantisation, and the order of the output's stages


def test_a_bandwidth_answers_a_step_of_the_rate_as_a_first_order_lag():
    """Means over each interval of 1 − exp(−2π f t), each axis with its own f."""
    bandwidth = np.array((5.0, 20.0, 80.0))
    ideal = np.zeros((200, 3))
    ideal[50:] = 0.2 * DT
    out = measure(ideal, DT, gyro(bandwidth=bandwidth), draws(200)).increments / (0.2 * DT)
    omega, start = 2 * np.pi * bandwidth, (np.arange(150) * DT)[:, None]
    expected = 1 - np.exp(-omega * start) * -np.expm1(-omega * DT) / (omega * DT)
    assert not out[:50].any()
    assert np.allclose(out[50:], expected, rtol=1e-9)


def test_a_bandwidth_of_zero_is_none_and_one_axis_can_have_it_alone():
    ideal = np.random.default_rng(1).normal(0, DT, (100, 3))
    free, one = (measure(ideal, DT, gyro(bandwidth=b, range=1000), draws(100)) for b in (0, (0, 10, 0)))
    assert np.array_equal(free.increments, ideal)
    assert np.array_equal(one.increments[:, [0, 2]], ideal[:, [0, 2]])
    assert not np.allclose(one.increments[:, 1], ideal[:, 1], rtol=0.1)


def test_a_lag_is_settled_at_the_start_and_takes_no_heed_of_the_first_noise():
    out = measure(np.full((20, 3), 0.1), DT, accelerometer(bandwidth=1, bias=3), draws(20)).increments
    assert np.allclose(out, 0.1 + 3e-3 * G * DT, rtol=1e-12)
    firsts = [at_rest(gyro(noise_density=0.05, bandwidth=1), 5, seed)[0] for seed in range(500)]
    # The mean of the first interval's answer to its own noise alone.
    gain = 1 + np.expm1(-2 * np.pi * DT) / (2 * np.pi * DT)
    assert np.std(firsts) / (0.05 * DEGREE * np.sqrt(DT) * gain) == pytest.approx(1, abs=5 / np.sqrt(3000))


@pytest.mark.parametrize(
    ("errors", "step"),
    [
        (gyro(quantisation=(0.01, 0.02, 0.05), noise_density=0.05), np.array((0.01, 0.02, 0.05)) * DEGREE),
        (accelerometer(quantisation=(1, 2, 5), noise_density=1000), np.array((1, 2, 5)) * 1e-3 * G),
    ],
    ids=["gyro", "accelerometer"],
)
def test_quantisation_puts_the_rate_on_whole_steps_with_an_error_of_one_twelfth(errors, step):
    fine = errors.copy()
    fine.quantisation = 0
    out, smooth = at_rest(errors, 50_000) / DT, at_rest(fine, 50_000) / DT
    assert np.allclose(out / step, np.round(out / step), atol=1e-9)
    error = (out - smooth) / step
    assert np.abs(error).max() <= 0.5 + 1e-9
    # The variance of a uniform error has a relative spread of √(4 / (5 n)).
    assert np.allclose(error.var(axis=0) * 12, 1, atol=5 * np.sqrt(0.8 / 50_000))
    assert np.abs(np.mean(error)) < 5 / np.sqrt(12 * 150_000)


def test_the_range_cuts_what_the_lag_lets_through_and_the_steps_come_last():
    ideal = np.zeros((400, 3))
    ideal[100:102] = 300 * DEGREE * DT  # a blow of 10 ms, which a lag of 5 Hz does not follow
    assert measure(ideal, DT, gyro(range=100), draws(400)).saturated == 6
    assert measure(ideal, DT, gyro(range=100, bandwidth=5), draws(400)).saturated == 0
    steps = measure(ideal, DT, gyro(range=100, quantisation=0.3), draws(400)).increments / (0.3 * DEGREE * DT)
    assert steps.max() == pytest.approx(333, abs=1e-9)


# What surrounds the sensors


def test_g_sensitivity_adds_the_specific_force_of_each_axis():
    force = np.random.default_rng(3).normal(0, G, (30, 3))
    errors = gyro(g_sensitivity=(0.1, -0.2, 0.05))
    out = measure(np.zeros((30, 3)), DT, errors, draws(30), Environment(np.array(25.0), force * DT))
    expected = np.array((0.1, -0.2, 0.05)) * DEGREE * force / G
    assert np.allclose(out.bias, expected, rtol=1e-12)
    assert np.allclose(out.increments, expected * DT, rtol=1e-12)


def warmed(errors: GyroErrors | AccelerometerErrors, ideal: NDArray, temperature: NDArray):
    """Return what a triad puts out at the temperatures."""
    samples = ideal.shape[0]
    return measure(ideal, DT, errors, draws(samples), Environment(temperature, np.zeros(3)))


def test_temperature_changes_bias_and_scale_from_25_degrees_on():
    temperature = np.array((25.0, 35.0, -15.0))
    errors = accelerometer(bias=1, scale_factor=2, bias_temperature=(0.1, 0.2, -0.3), scale_temperature=0.01)
    out = warmed(errors, np.full((3, 3), 5 * DT), temperature)
    for k, warmth in enumerate((0, 10, -40)):
        bias = (1 + np.array((0.1, 0.2, -0.3)) * warmth) * 1e-3 * G
        assert np.allclose(out.bias[k], (1.02 + 1e-4 * warmth) * bias, rtol=1e-12)
        assert np.allclose(out.increments[k], (1.02 + 1e-4 * warmth) * (5 + bias) * DT, rtol=1e-12)


@pytest.mark.parametrize("kind", [gyro, accelerometer])
def test_compensation_with_a_perfect_thermometer_undoes_the_temperature(kind):
    errors = kind(bias=0.5, noise_density=0.05, bias_temperature=(0.01, -0.02, 0.03), scale_temperature=0.02)
    ideal = np.random.default_rng(4).normal(0, 0.5 * DT, (2000, 3))
    temperature = np.linspace(-40, 85, 2000)
    warm, cool = warmed(errors, ideal, temperature), warmed(errors, ideal, np.full(2000, 25.0))
    again = compensate(warm, DT, errors, temperature, temperature)
    assert np.allclose(again.bias, cool.bias, rtol=1e-12)
    # The correction scales the noise too, by at most 1.3 %.
    noise = si_noise(errors) * np.sqrt(DT)
    assert np.abs(again.increments - cool.increments).max() < 0.014 * 5 * noise
    assert (
        np.abs(warm.increments - cool.increments).max() > 5 * np.abs(again.increments - cool.increments).max()
    )


def si_noise(errors: GyroErrors | AccelerometerErrors) -> float:
    """Return the density of the white noise in SI units."""
    unit = DEGREE if isinstance(errors, GyroErrors) else 1e-6 * G
    return float(errors.noise_density[0] * unit)


def test_an_error_of_the_thermometer_is_left_times_the_coefficients():
    errors = gyro(bias_temperature=0.02)
    temperature = np.full(10, 45.0)
    out = warmed(errors, np.zeros((10, 3)), temperature)
    again = compensate(out, DT, errors, temperature, temperature + 0.5)
    assert np.allclose(again.increments, -0.5 * 0.02 * DEGREE * DT, rtol=1e-9)
    assert np.allclose(again.bias, 0, atol=1e-15)


def test_vibration_is_a_specific_force_of_the_given_density():
    errors = accelerometer(vibration_density=(100, 200, 400))
    smooth = np.full((100_000, 3), 0.05)
    shaken = with_vibration(errors, 1, smooth, DT) - smooth
    expected = np.array((100, 200, 400)) * 1e-6 * G * np.sqrt(DT)
    assert np.allclose(shaken.std(axis=0) / expected, 1, atol=5 / np.sqrt(2e5))
    assert np.abs(np.corrcoef(shaken.T) - np.eye(3)).max() < 5 / np.sqrt(1e5)
    assert np.array_equal(with_vibration(accelerometer(), 1, smooth, DT), smooth)


def test_vibration_meets_the_range_and_is_scaled_like_any_motion():
    errors = accelerometer(vibration_density=1e5, range=1, scale_factor=10)
    shaken = with_vibration(errors, 1, np.zeros((1000, 3)), DT)
    out = measure(shaken, DT, errors, draws(1000))
    limit = G * DT
    assert np.allclose(out.increments, np.clip(1.1 * shaken, -limit, limit), rtol=1e-12)
    assert out.saturated == np.count_nonzero(np.abs(1.1 * shaken) > limit) > 100
