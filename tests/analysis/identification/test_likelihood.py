"""Maximum likelihood of innovations against what is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis.identification.likelihood import (
    InnovationSeries,
    Parameter,
    is_white,
    log_likelihoods,
    long_run_covariance,
    maximise,
)

SPREAD = 1.5
"""By how much the spread of the scores may exceed the information: it is known to a fifth from 300 fixes."""


def scale(prior=100.0):
    return Parameter("logarithm of σ", 0.0, -20.0, 20.0, prior, 1e-4, 2.0)


def slope(**changes):
    return Parameter("slope", 0.0, -100.0, 100.0, 1e6, 1e-3, 100.0, **changes)


def noise(m, sigma, seed=1):
    return np.random.default_rng(seed).normal(scale=sigma, size=(m, 6))


def test_of_gaussian_numbers_it_is_their_standard_deviation():
    """σ̂² is the mean square, and the σ of ln σ̂ is 1/√(2n)."""
    values = noise(500, 40.0)

    def run(by):
        return InnovationSeries(values, np.tile(np.eye(6) * np.exp(2 * by[0]), (500, 1, 1)))

    found = maximise(run, [scale()], np.zeros(1), np.zeros(1, bool))
    assert np.exp(found.value[0]) == pytest.approx(np.sqrt(np.mean(values**2)), rel=2e-3)
    assert 0.99 < found.sigma[0] * np.sqrt(2 * values.size) < SPREAD
    assert found.white


@pytest.mark.parametrize("both", [False, True])
def test_of_a_line_through_the_origin_it_is_least_squares(both):
    at = np.linspace(-1, 1, 300)[:, None] * np.ones(6)
    values = 3.0 * at + noise(300, 0.5)

    def run(by):
        return InnovationSeries(values - by[0] * at, np.tile(np.eye(6) * 0.25, (300, 1, 1)))

    found = maximise(run, [slope(both=both)], np.zeros(1), np.zeros(1, bool))
    assert found.value[0] == pytest.approx(np.sum(at * values) / np.sum(at**2), abs=1e-6)
    assert 1 - 1e-6 < found.sigma[0] / (0.5 / np.sqrt(np.sum(at**2))) < SPREAD


def test_what_is_not_measured_counts_for_nothing():
    values = noise(200, 2.0)
    values[:, 5] = np.nan
    whole = InnovationSeries(values, np.tile(np.diag([4.0] * 5 + [1e8]), (200, 1, 1)))
    expected = -0.5 * (5 * np.log(4.0) + np.sum(values[:, :5] ** 2, axis=1) / 4.0)
    np.testing.assert_allclose(log_likelihoods(whole), expected, rtol=1e-12)


def test_a_parameter_that_nothing_shows_keeps_its_prior():
    values = noise(200, 1.0)
    found = maximise(
        lambda by: InnovationSeries(values, np.tile(np.eye(6) * np.exp(2 * by[0]), (200, 1, 1))),
        [scale(), scale(prior=3.5)],
        np.zeros(2),
        np.zeros(2, bool),
    )
    assert found.value[1] == 0.0
    assert found.sigma[1] == pytest.approx(3.5)


@pytest.mark.parametrize("begin", [-5.0, 8.0])
@pytest.mark.parametrize("prior", [0.01, 0.1])
def test_a_prior_and_fixes_are_weighed_by_their_variances(begin, prior):
    """The mean of a Gaussian prior about 2 and of as many numbers of σ 1."""
    values = noise(50, 1.0)

    def run(by):
        return InnovationSeries(values - by[0], np.tile(np.eye(6), (50, 1, 1)))

    known = Parameter("mean", 2.0, -100.0, 100.0, prior, 1e-3, 100.0)
    found = maximise(run, [known], np.array([begin]), np.zeros(1, bool))
    expected = (values.sum() + 2.0 / prior**2) / (values.size + 1 / prior**2)
    assert found.value[0] == pytest.approx(expected, abs=1e-6)


def test_errors_that_are_correlated_make_an_estimate_less_certain():
    """By √((1 + a) / (1 − a)), a first-order process and a slope that changes slowly beside it."""
    rng, a, m = np.random.default_rng(4), 0.6, 3000
    errors = rng.normal(size=(m, 6))
    for k in range(1, m):
        errors[k] = a * errors[k - 1] + np.sqrt(1 - a**2) * errors[k]
    at = np.sin(np.arange(m) / 30)[:, None] * np.ones(6)

    def run(by):
        return InnovationSeries(errors - by[0] * at, np.tile(np.eye(6), (m, 1, 1)))

    found = maximise(run, [slope()], np.zeros(1), np.zeros(1, bool))
    white = 1 / np.sqrt(np.sum(at**2))
    assert found.sigma[0] / white == pytest.approx(np.sqrt((1 + a) / (1 - a)), rel=0.25)


def test_on_a_peak_the_search_stays():
    """Whichever way it steps from there, the innovations are less likely."""
    values = noise(100, 1.0)

    def run(by):
        return InnovationSeries(values * (1 + abs(by[0] - 3.0)), np.tile(np.eye(6), (100, 1, 1)))

    found = maximise(run, [slope()], np.array([3.0]), np.zeros(1, bool))
    assert found.value[0] == 3.0
    assert found.rounds == 1


@pytest.mark.parametrize("most", [1, 2])
def test_a_search_ends_after_the_most_steps(most):
    values = noise(100, 1e4)

    def run(by):
        return InnovationSeries(values, np.tile(np.eye(6) * np.exp(2 * by[0]), (100, 1, 1)))

    found = maximise(run, [scale()], np.zeros(1), np.zeros(1, bool), most=most)
    assert found.rounds == most
    assert found.value[0] == pytest.approx(2.0 * most)  # as far as a step may go


def test_where_the_filter_cannot_be_run_the_search_turns_back():
    values = noise(400, 1.0)

    def run(by):
        if by[0] < 1.0:
            raise ValueError("diverged")
        return InnovationSeries(values, np.tile(np.eye(6) * np.exp(2 * by[0]), (400, 1, 1)))

    found = maximise(run, [scale()], np.array([5.0]), np.zeros(1, bool))
    assert 1.0 <= found.value[0] < 1.6
    with pytest.raises(ValueError, match="diverged"):
        maximise(run, [scale()], np.zeros(1), np.zeros(1, bool))


def test_scores_that_are_correlated_make_the_sum_less_certain():
    """The sum of a first-order process with factor a: (1 + a) / (1 − a) times the variance of white noise."""
    rng, a, m = np.random.default_rng(2), 0.6, 4000
    values = np.zeros((m, 1))
    for k in range(1, m):
        values[k] = a * values[k - 1] + rng.normal()
    white = np.sum((values - values.mean()) ** 2)
    assert long_run_covariance(values)[0, 0] / white == pytest.approx((1 + a) / (1 - a), rel=0.35)


def test_correlated_innovations_are_not_white():
    values = noise(600, 1.0)
    S = np.tile(np.eye(6), (600, 1, 1))
    assert is_white(InnovationSeries(values, S))
    assert not is_white(InnovationSeries(np.cumsum(values, axis=0), S))


def test_white_innovations_are_called_white():
    """Of all channels together, one series in a hundred is not; χ² alone would say one in forty."""
    S = np.tile(np.eye(6), (175, 1, 1))
    draws = np.random.default_rng(1).normal(size=(600, 175, 6))
    assert np.mean([is_white(InnovationSeries(values, S)) for values in draws]) > 0.98


def test_a_jump_of_the_filter_beside_the_estimate_is_no_information():
    """Beyond a value, a decision of the filter is another one; σ of ln σ̂ is 1/√(2n) all the same."""
    values = noise(500, 40.0)
    best = 0.5 * np.log(np.mean(values**2))
    jumps = 500.0 * (np.arange(500) > 400)[:, None] * np.ones(6)

    def run(by):
        shifted = values + jumps * (by[0] > best + 1e-6)
        return InnovationSeries(shifted, np.tile(np.eye(6) * np.exp(2 * by[0]), (500, 1, 1)))

    found = maximise(run, [scale()], np.array([best - 0.1]), np.zeros(1, bool))
    assert found.value[0] == pytest.approx(best, abs=2e-3)
    assert 0.99 < found.sigma[0] * np.sqrt(2 * values.size) < SPREAD
