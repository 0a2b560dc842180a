"""The smoothing spline is SciPy's, and picks its λ as cross-validation by the book would."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from lab.data.rebuild.smoothing import best_smoothing, evaluate_smoothed, slope_noise, smoothing_spline


def noisy(sigma: float, samples: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.02, 0.1, samples))
    true = np.stack((np.sin(time), np.cos(0.7 * time)), axis=-1)
    return time, true, true + sigma * rng.normal(size=true.shape)


@pytest.mark.parametrize("smoothing", [1e-5, 1e-2, 1.0, 100.0])
def test_it_is_the_spline_of_scipy(smoothing):
    time, _, values = noisy(0.1)
    expected = make_smoothing_spline(time, values, lam=smoothing)
    np.testing.assert_allclose(evaluate_smoothed(time, values, smoothing), expected(time), atol=1e-8)
    between = np.linspace(time[0], time[-1], 1000)
    curve = smoothing_spline(time, values, smoothing)
    np.testing.assert_allclose(curve(between, 2), expected(between, 2), atol=1e-5)


def test_no_smoothing_keeps_every_sample():
    time, _, values = noisy(0.1)
    np.testing.assert_array_equal(evaluate_smoothed(time, values, 0.0), values)


def test_a_line_stays_a_line():
    time = np.cumsum(np.random.default_rng(1).uniform(0.01, 1, 50))
    line = np.stack((3 - 2 * time, time), axis=-1)
    np.testing.assert_allclose(evaluate_smoothed(time, line, 7.0), line, atol=1e-9)


@pytest.mark.parametrize("sigma", [0.01, 0.1, 0.5])
def test_the_best_smoothing_is_nearly_as_good_as_knowing_the_truth(sigma):
    time, true, values = noisy(sigma, 1500)
    errors = {
        smoothing: np.sqrt(np.mean((evaluate_smoothed(time, values, smoothing) - true) ** 2))
        for smoothing in np.geomspace(1e-6, 1e4, 60)
    }
    chosen = best_smoothing(time, values)
    error = np.sqrt(np.mean((evaluate_smoothed(time, values, chosen) - true) ** 2))
    assert error < 1.1 * min(errors.values())
    assert error < 0.5 * sigma


def test_exact_samples_are_left_alone():
    time, true, _ = noisy(0.0)
    curve = evaluate_smoothed(time, true, best_smoothing(time, true))
    assert np.abs(curve - true).max() < 1e-5


@pytest.mark.parametrize("smoothing", [0.01, 1.0, 30.0])
def test_the_noise_of_the_slope_is_as_said(smoothing):
    time = np.arange(4000) * 0.1
    noise = 0.7 * np.random.default_rng(9).normal(size=(4000, 4))
    slope = smoothing_spline(time, noise, smoothing)(time, 1)[100:-100]
    assert slope_noise(time, 0.7, smoothing) == pytest.approx(np.std(slope), rel=0.1)
