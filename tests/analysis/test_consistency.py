"""Consistency: NEES, NIS and whiteness against their distributions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lab.analysis import consistency

RNG = np.random.default_rng(7)


def roots(epochs: int, states: int, coupling: float = 1.0) -> np.ndarray:
    """Return lower triangular roots of covariances whose states differ by ten orders of magnitude."""
    L = np.tril(RNG.normal(0, coupling, (epochs, states, states)), -1) + np.eye(states)
    return np.logspace(-6, 4, states)[:, None] * L


def test_normalised_squares_are_the_squares_of_the_white_draws():
    """With v = L z and P = L Lᵀ, vᵀ P⁻¹ v is zᵀ z."""
    L, z = roots(300, 6), RNG.normal(0, 1, (300, 6))
    squares = consistency.normalised_squares(np.einsum("mij,mj->mi", L, z), L @ np.swapaxes(L, 1, 2))
    assert np.allclose(squares, np.sum(z**2, axis=1), rtol=1e-8)


def test_normalised_squares_of_a_matched_covariance_are_chi_square():
    L, z = roots(4000, 15, 0.3), RNG.normal(0, 1, (4000, 15))
    squares = consistency.normalised_squares(np.einsum("mij,mj->mi", L, z), L @ np.swapaxes(L, 1, 2))
    assert stats.kstest(squares, stats.chi2(15).cdf).pvalue > 1e-4
    wrong = consistency.normalised_squares(np.einsum("mij,mj->mi", L, z), 1.2 * L @ np.swapaxes(L, 1, 2))
    assert stats.kstest(wrong, stats.chi2(15).cdf).pvalue < 1e-6


def test_certain_states_are_left_out():
    P = np.zeros((10, 4, 4))
    P[:, 0, 0], P[:, 2, 2] = 4.0, 9.0
    v = np.tile((2.0, 0.0, 3.0, 0.0), (10, 1))
    assert np.allclose(consistency.normalised_squares(v, P), 2.0)
    assert consistency.find_uncertain_states(P).tolist() == [0, 2]


def test_combinations_without_variance_are_left_out():
    """Three states driven by two independent draws have two degrees of freedom."""
    A = np.tile(np.array([(1.0, 0.0), (0.5, 1.0), (1.5, 1.0)]) * [[1e3], [1.0], [1e-3]], (50, 1, 1))
    z = RNG.normal(0, 1, (50, 2))
    v = np.einsum("mij,mj->mi", A, z)
    squares = consistency.normalised_squares(v, A @ np.swapaxes(A, 1, 2))
    assert np.allclose(squares, np.sum(z**2, axis=1), rtol=1e-6)


def test_two_states_that_are_one_count_once():
    """Of a covariance without any rest there is no Cholesky factor."""
    P = np.tile(np.array([(1.0, 1.0), (1.0, 1.0)]), (3, 1, 1))
    v = np.array([(1.0, 1.0), (2.0, 2.0), (-3.0, -3.0)])
    assert np.allclose(consistency.normalised_squares(v, P), (1.0, 4.0, 9.0))


def test_no_epochs_give_no_squares():
    assert consistency.normalised_squares(np.zeros((0, 6)), np.zeros((0, 6, 6))).shape == (0,)


@pytest.mark.parametrize("degrees", [1, 6, 15])
@pytest.mark.parametrize("runs", [1, 20, 100])
@pytest.mark.parametrize("probability", [0.95, 0.99])
def test_chi_square_interval(degrees, runs, probability):
    interval = consistency.chi_square_interval(degrees, runs, probability)
    expected = np.array(stats.chi2.interval(probability, degrees * runs)) / runs
    assert np.allclose(interval, expected, rtol=1e-10)


def test_whiteness_band():
    assert consistency.whiteness_band(400) == pytest.approx(stats.norm.ppf(0.975) / 20, rel=1e-12)
    assert consistency.whiteness_band(0) == 0


def test_autocorrelation_is_that_of_numpy():
    values = RNG.normal(0, 1, (120, 3))
    found = consistency.autocorrelation(values, 20)
    assert found.shape == (21, 3)
    for channel in range(3):
        full = np.correlate(values[:, channel], values[:, channel], "full")[119:140]
        assert np.allclose(found[:, channel], full / full[0], atol=1e-14)


def test_white_innovations_stay_inside_the_band_as_often_as_it_says():
    inside = [
        np.abs(consistency.autocorrelation(RNG.normal(0, 1, (400, 3)))[1:]) < consistency.whiteness_band(400)
        for _ in range(100)
    ]
    # The lag takes its number off the sum: at most 30 of 400, which only makes the band a little safer.
    assert 0.94 < np.mean(inside) < 0.975


def test_coloured_innovations_show_their_correlation():
    """AR(1) with coefficient a has the autocorrelation a^k."""
    n, a = 40_000, 0.8
    values = np.empty((n, 1))
    values[0] = RNG.normal(0, 1 / np.sqrt(1 - a**2))
    drive = RNG.normal(0, 1, n)
    for k in range(1, n):
        values[k] = a * values[k - 1] + drive[k]
    found = consistency.autocorrelation(values)[:, 0]
    spread = np.sqrt((1 + a**2) / (1 - a**2) / n)
    assert np.allclose(found, a ** np.arange(31), atol=5 * spread)
    assert np.mean(np.abs(found[1:]) < consistency.whiteness_band(n)) < 0.5


def test_short_records_give_fewer_lags():
    assert consistency.autocorrelation(np.ones((4, 2))).shape == (4, 2)
    assert consistency.autocorrelation(np.zeros((0, 2))).shape == (0, 2)
    assert not consistency.autocorrelation(np.zeros((4, 2))).any()


def ljung_box(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return Ljung-Box's Q and probability of values (m, channels)."""
    return consistency.ljung_box(consistency.autocorrelation(values), values.shape[0])


def test_ljung_box_of_white_values_is_chi_square():
    Q, white = ljung_box(RNG.normal(0, 1, (500, 1000)))
    assert Q.mean() == pytest.approx(30, abs=5 * np.sqrt(60 / 1000))
    assert 0.02 < np.mean(white < 0.05) < 0.09
    assert np.allclose(white, stats.chi2(30).sf(Q), rtol=1e-9)


def test_ljung_box_is_its_formula_term_by_term():
    values = RNG.normal(0, 1, (50, 1))
    r = consistency.autocorrelation(values)[:, 0]
    expected = 50 * 52 * sum(r[lag] ** 2 / (50 - lag) for lag in range(1, 31))
    assert ljung_box(values)[0][0] == pytest.approx(expected, rel=1e-12)


def test_ljung_box_sees_colour():
    values = np.cumsum(RNG.normal(0, 1, (200, 4)), axis=0)
    assert (ljung_box(values)[1] < 1e-6).all()


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_ljung_box_of_next_to_nothing_has_nothing_against_it(count):
    assert (ljung_box(RNG.normal(0, 1, (count, 3)))[1] > 0.01).all()


@pytest.mark.parametrize("runs", [1, 4])
def test_the_table_of_whiteness_holds_the_limits_of_as_many_innovations_as_there_are(runs):
    count, values = 400, RNG.normal(0, 1, (400, 6))
    correlations = consistency.autocorrelation(values)
    mean, variance = values.mean(axis=0), values.var(axis=0)
    given = () if runs == 1 else (runs,)  # one run is what is meant without a number
    table = consistency.whiteness_table(mean, variance, correlations, count, *given)
    assert table["innovation"].tolist()[1::4] == ["position north", "velocity up"]
    assert np.array_equal(table["mean"], mean)
    assert np.array_equal(table["variance"], variance)
    assert table["mean ±"].unique() == pytest.approx(stats.norm.ppf(0.975) / np.sqrt(runs * count))
    ends = [table[f"variance {end}"].unique().item() for end in ("from", "to")]
    assert ends == pytest.approx(stats.chi2.ppf([0.025, 0.975], runs * count) / (runs * count))
    Q = runs * sum(count * (count + 2) * correlations[lag] ** 2 / (count - lag) for lag in range(1, 31))
    assert np.allclose(table["Q"], Q, rtol=1e-12)
    assert np.allclose(table["p white"], stats.chi2(30).sf(Q), rtol=1e-9)
    assert set(table["lags"]) == {30}


def test_of_no_innovations_nothing_is_known():
    empty = np.zeros((0, 6))
    table = consistency.whiteness_table(np.ones(6), np.ones(6), consistency.autocorrelation(empty), 0)
    known = table[["mean", "variance", "variance from", "variance to", "Q", "p white"]]
    assert known.isna().all(axis=None)


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_coverage_of_normal_errors(factor):
    sigma = RNG.uniform(0.1, 10, (100_000, 2))
    part = stats.norm.cdf(factor) - stats.norm.cdf(-factor)
    found = consistency.coverage(sigma * RNG.normal(0, 1, sigma.shape), sigma, factor)
    assert np.allclose(found, part, atol=5 * np.sqrt(part * (1 - part) / 100_000))
    assert np.isnan(consistency.coverage(np.zeros((0, 2)), np.zeros((0, 2)))).all()
