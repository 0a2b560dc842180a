"""Processes: spectra, Allan variances and responses against closed forms."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, signal

from lab.sensors.draws import unit_draws
from lab.sensors.processes import apply_lag, flicker, gauss_markov, random_walk, settled_lag

N = 2**17


def allan_variance(values: np.ndarray, cluster: int) -> np.ndarray:
    """Return the overlapping Allan variance of each column at so many samples (IEEE 952, annex C)."""
    angle = np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(values, axis=0))) / cluster
    second = angle[2 * cluster :] - 2 * angle[cluster:-cluster] + angle[: -2 * cluster]
    return 0.5 * np.mean(second**2, axis=0)


def test_flicker_has_the_spectrum_of_its_coefficient():
    """B² / (2π f) two-sided (IEEE 952), over more than two decades of frequency."""
    runs = np.concatenate([flicker(unit_draws(seed, "flicker", (N, 3))) for seed in range(8)], axis=1)
    frequency, density = signal.welch(runs[N // 8 :], nperseg=N // 8, axis=0, detrend="linear")
    edges = np.logspace(np.log10(64 / N), np.log10(0.1), 8)
    for low, high in pairwise(edges):
        band = (frequency >= low) & (frequency < high)
        assert np.mean(density[band] / 2 * (2 * np.pi * frequency[band])[:, None]) == pytest.approx(
            1, abs=0.06
        )
    band = (frequency > edges[0]) & (frequency < edges[-1])
    slope = np.polyfit(np.log(frequency[band]), np.log(density[band].mean(axis=1)), 1)[0]
    assert slope == pytest.approx(-1, abs=0.02)


def test_flicker_has_a_flat_allan_deviation_of_0_664():
    """√(2 ln 2 / π): the integral 4 ∫ S(f) sin⁴(πfτ) / (πfτ)² df of that spectrum, taken numerically."""
    value, _ = integrate.quad(lambda u: np.sin(u) ** 4 / u**3, 0, 2000, limit=5000)
    floor = np.sqrt(2 / np.pi * value)
    assert floor == pytest.approx(0.664, abs=0.001)
    runs = np.concatenate([flicker(unit_draws(seed, "floor", (N, 3))) for seed in range(12)], axis=1)
    for cluster in (30, 100, 300, 1000, 3000):
        variance = allan_variance(runs, cluster)
        spread = variance.std(ddof=1) / np.sqrt(variance.size) / variance.mean()
        assert spread < 0.04
        assert variance.mean() / floor**2 == pytest.approx(1, abs=max(4 * spread, 0.01))


def test_a_longer_flicker_begins_with_the_shorter():
    draws = unit_draws(1, "flicker", (5000, 3))
    assert np.allclose(flicker(draws)[:700], flicker(draws[:700]), atol=1e-11)


def test_flicker_twice_integrated_by_halves_is_a_random_walk():
    """(1 − z⁻¹)^(−1/2) applied twice is (1 − z⁻¹)^(−1), the sum."""
    draws = unit_draws(2, "flicker", (3000, 3))
    assert np.allclose(flicker(flicker(draws)), np.cumsum(draws, axis=0), atol=1e-9)


def test_flicker_along_the_last_axis_is_that_along_the_first():
    draws = np.random.default_rng(5).standard_normal((1000, 3))
    np.testing.assert_allclose(flicker(draws.T, axis=-1), flicker(draws).T, rtol=1e-12, atol=1e-13)


def test_no_draws_make_no_flicker():
    assert flicker(np.zeros((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("cluster", [10, 100, 1000])
def test_a_random_walk_has_the_allan_variance_of_its_coefficient(cluster):
    """K² τ / 3, times 1 + 1 / (2 m²) for a walk in steps."""
    runs = np.concatenate([random_walk(unit_draws(seed, "walk", (N, 3))) for seed in range(12)], axis=1)
    variance = allan_variance(runs, cluster)
    expected = cluster / 3 * (1 + 0.5 / cluster**2)
    spread = variance.std(ddof=1) / np.sqrt(variance.size) / variance.mean()
    assert spread < 0.05
    assert variance.mean() / expected == pytest.approx(1, abs=max(4 * spread, 0.01))


def test_a_random_walk_grows_with_the_square_root_of_time():
    runs = np.concatenate([random_walk(unit_draws(seed, "walk", (1000, 3))) for seed in range(400)], axis=1)
    for samples in (1, 100, 1000):
        assert runs[samples - 1].var() / samples == pytest.approx(1, abs=5 * np.sqrt(2 / 1200))


def test_gauss_markov_has_unit_variance_from_the_first_sample_and_decays():
    runs = np.concatenate(
        [
            gauss_markov(unit_draws(seed, "s", (3,)), unit_draws(seed, "d", (80, 3)), 0.95)
            for seed in range(700)
        ],
        axis=1,
    )
    for sample in (0, 1, 40, 79):
        assert runs[sample].var() == pytest.approx(1, abs=5 * np.sqrt(2 / 2100))
        assert np.mean(runs[sample] * runs[0]) == pytest.approx(0.95**sample, abs=5 * np.sqrt(2 / 2100))


def first_order_lag(inputs, start, cutoff):
    """Return the output of a lag that is in steady state at first."""
    return apply_lag(inputs, settled_lag(start, cutoff), cutoff)[0]


@given(st.floats(-3, 3), st.floats(1e-6, 1e6))
def test_the_lag_lets_constants_pass(value, cutoff):
    assert np.allclose(first_order_lag(np.full(50, value), value, cutoff), value, rtol=1e-9)


@pytest.mark.parametrize("cutoff", [1e-3, 0.1, 1.0, 30.0])
def test_the_lag_answers_a_step_with_an_exponential(cutoff):
    """Means over each interval of 1 − exp(−ω t), by quadrature."""
    expected = [integrate.quad(lambda t: -np.expm1(-cutoff * t), k, k + 1)[0] for k in range(20)]
    assert np.allclose(first_order_lag(np.ones(20), 0.0, cutoff), expected, rtol=1e-9)


@pytest.mark.parametrize("ratio", [0.2, 1.0, 5.0])
def test_the_lag_has_the_gain_and_phase_of_its_bandwidth(ratio):
    """1 / (1 + j f / f_c) for a wave far below the rate of the samples, here 400 per period."""
    omega = 2 * np.pi / 400
    edges = np.arange(40_001.0)
    wave = np.diff(-np.cos(omega * edges)) / omega
    out = first_order_lag(wave, 0.0, omega / ratio)
    middle = np.exp(-1j * omega * (edges[:-1] + 0.5))[-4000:]
    gain = np.mean(out[-4000:] * middle) / np.mean(wave[-4000:] * middle)
    assert gain == pytest.approx(1 / (1 + 1j * ratio), abs=2e-4)


@given(st.integers(0, 2**32 - 1))
def test_a_lag_far_above_the_rate_changes_nothing(seed):
    values = np.random.default_rng(seed).normal(size=100)
    assert np.allclose(first_order_lag(values, 0.0, 1e9), values, atol=1e-8)
