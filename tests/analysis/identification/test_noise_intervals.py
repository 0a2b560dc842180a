"""The 95 % interval of a noise against closed forms, and how often it contains the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, stats

from lab.analysis.identification.assumptions import NOTHING, PARAMETERS, Assumed, parameters
from lab.analysis.identification.likelihood import InnovationSeries, log_likelihoods, maximise
from lab.analysis.identification.noise_intervals import logarithm_intervals

WHOLE = parameters(Assumed(np.ones(12), np.ones(3), 0.0, np.zeros(3)), np.full(3, 0.1))
FIXES = 40
"""Fixes of six values: a variance of 240 values has a σ of a tenth."""


class One:
    """A search for one noise, of which the innovations show the sum with a variance that is known."""

    masks = ()
    held = np.arange(PARAMETERS) > 0

    def __init__(self, variance: float, rest: float, seed: int) -> None:
        self.rest = rest
        spread = np.sqrt(variance + rest)
        self.innovation = spread * np.random.default_rng(seed).normal(size=(FIXES, 6))

    def run(self, by):
        """Return the innovations if the filter assumes a noise."""
        total = self.rest + np.exp(2 * by[0])
        return InnovationSeries(self.innovation, np.tile(total * np.eye(6), (FIXES, 1, 1)))

    def interval(self):
        """Return the interval of the variance, twice the loss without it, and that at its ends."""
        joint = maximise(self.run, WHOLE, np.zeros(PARAMETERS), self.held, most=40)
        nothing = np.zeros(PARAMETERS)
        nothing[0] = -NOTHING
        lost = 2 * (joint.log_likelihood - float(log_likelihoods(self.run(nothing)).sum()))
        without = np.array([lost, 0.0, 0.0, 0.0])
        low, high = logarithm_intervals(self, WHOLE, joint, without, {})[0]
        # The spread of the scores may be larger than the information says.
        wanted = stats.chi2.ppf(0.95, 1) * joint.sigma[0] ** 2 / joint.covariance[0, 0]
        return np.exp(2 * low), np.exp(2 * high), lost, wanted


def ends(mean_square, wanted):
    """Return the variances v at which n (m/v − 1 − ln m/v) is as wanted; m is the mean square."""

    def over(logarithm):
        ratio = np.exp(-logarithm)
        return 6 * FIXES * (ratio - 1 - np.log(ratio)) - wanted

    found = optimize.brentq(over, -2.0, 0.0), optimize.brentq(over, 0.0, 2.0)
    return mean_square * np.exp(found)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("rest", [0.01, 1.0])
def test_the_ends_are_where_the_likelihood_fell_by_what_chi_square_allows(rest, seed):
    search = One(2.0, rest, seed)
    low, high, _, wanted = search.interval()
    expected = ends(np.mean(search.innovation**2), wanted) - rest
    # A loss that is wrong by a tenth of its σ, in the worst case.
    np.testing.assert_allclose([low + rest, high + rest], expected + rest, rtol=0.012)


def test_a_noise_that_may_be_zero_has_an_upper_end_alone():
    search = next(one for one in (One(0.02, 1.0, seed) for seed in range(20)) if one.interval()[2] < 3.84)
    low, high, *_ = search.interval()
    assert low == 0
    assert high > 0.02


@pytest.mark.parametrize(
    "variance", [0.05, *(pytest.param(one, marks=pytest.mark.proof) for one in (0.2, 0.6))]
)
def test_it_holds_the_truth_as_often_as_it_says_whether_the_noise_shows_or_not(variance):
    """Where only intervals count whose noise shows, luck chose them."""
    held, shown = [], []
    for seed in range(400):
        low, high, lost, _ = One(variance, 1.0, seed).interval()
        held.append(low <= variance <= high)
        shown.append(lost > 3.84)
    assert 0.93 < np.mean(held) < 0.99
    if variance == 0.05:
        assert np.mean(np.array(held)[shown]) < 0.93
