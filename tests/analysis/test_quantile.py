"""A quantile's interval holds the true one as often as it says, for any number of values."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from lab.analysis.quantile import quantile_interval
from lab.experiment.ensembles.outages import ENLARGED, SURE

REPETITIONS = 1000
MOST = 0.95
COUNTS = (1, 3, 4, 5, 10, 20, 50, 60, 71, 72, 100, 200, 400)


def covered(samples: np.ndarray, part: float, true: float) -> float:
    """Return in which part of the samples (repetitions, n) the interval holds the true quantile."""
    found = [quantile_interval(sample, part) for sample in samples]
    return float(np.mean([one.low <= true <= one.high for one in found]))


@pytest.mark.parametrize("law", ["rayleigh", "expon"])
@pytest.mark.parametrize("count", COUNTS)
def test_the_interval_of_the_95_percent_covers(law, count):
    distribution = getattr(scipy.stats, law)()
    samples = distribution.rvs(size=(REPETITIONS, count), random_state=np.random.default_rng(count))
    assert 0.93 <= covered(samples, MOST, distribution.ppf(MOST)) <= 0.97


@pytest.mark.parametrize("count", [5, 7, 20, 100])
def test_the_interval_of_the_median_covers(count):
    distribution = scipy.stats.rayleigh()
    samples = distribution.rvs(size=(REPETITIONS, count), random_state=np.random.default_rng(count))
    assert 0.93 <= covered(samples, 0.5, distribution.ppf(0.5)) <= 0.97


def test_heavy_tails_are_covered():
    distribution = scipy.stats.lognorm(1.0)
    samples = distribution.rvs(size=(REPETITIONS, 100), random_state=np.random.default_rng(1))
    assert 0.93 <= covered(samples, MOST, distribution.ppf(MOST)) <= 0.97


def test_errors_of_begins_with_different_sizes_are_covered():
    """Thirteen begins whose errors differ by a factor of three, as straight flight and turns do."""
    sizes = np.repeat(np.linspace(1, 3, 13), 8)[:100]
    rng = np.random.default_rng(2)
    samples = np.hypot(*(sizes * rng.normal(size=(2, REPETITIONS, 100))))

    def inside(radius: float) -> float:
        return float(np.mean(1 - np.exp(-((radius / sizes) ** 2) / 2))) - MOST

    assert 0.93 <= covered(samples, MOST, scipy.optimize.brentq(inside, 1, 20)) <= 0.97


def test_a_few_more_runs_for_those_on_the_border_leave_the_interval_true():
    """More runs until the wish is outside a wider interval: the decision is rarely wrong."""
    rng, true = np.random.default_rng(3), float(scipy.stats.rayleigh.ppf(MOST))
    wrong = 0
    for _ in range(REPETITIONS):
        values = rng.rayleigh(size=100)
        while values.size < 100 * ENLARGED:
            sure = quantile_interval(values, MOST, SURE)
            if not sure.low <= true < sure.high:
                break
            values = np.append(values, rng.rayleigh(size=100))
        found = quantile_interval(values, MOST)
        wrong += not found.low <= true <= found.high
    assert wrong <= 0.07 * REPETITIONS


def test_too_few_values_have_no_upper_end():
    values = np.arange(1.0, 72.0)
    assert quantile_interval(values, MOST).high == np.inf
    assert np.isfinite(quantile_interval(np.append(values, 72.0), MOST).high)
    assert quantile_interval(values[:2], 0.5) == (1.5, -np.inf, np.inf)
    assert np.isnan(quantile_interval(values[:0], MOST).value)


def test_infinite_values_are_the_largest():
    values = np.append(np.arange(1.0, 100.0), np.inf)
    found = quantile_interval(values, MOST)
    assert found.value == pytest.approx(quantile_interval(np.arange(1.0, 101.0), MOST).value)
    assert found.high == np.inf
    assert quantile_interval(np.full(100, np.inf), MOST).value == np.inf


def test_the_order_of_the_values_does_not_matter_and_their_scale_does():
    rng = np.random.default_rng(4)
    values = rng.rayleigh(size=80)
    found = quantile_interval(values, MOST)
    assert quantile_interval(rng.permutation(values), MOST) == found
    assert np.allclose(quantile_interval(10 * values, MOST), 10 * np.array(found))
    assert found.low < found.value < found.high
