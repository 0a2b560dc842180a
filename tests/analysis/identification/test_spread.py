"""Spread: innovations drawn from known densities, of which what is wrong is known."""

from __future__ import annotations

import numpy as np
import pytest

from lab.analysis.identification.likelihood import InnovationSeries, is_white
from lab.analysis.identification.spread import describe_spread


def drawn(values: np.ndarray) -> InnovationSeries:
    """Return innovations whose filter states a variance of four of each."""
    return InnovationSeries(2.0 * values, np.broadcast_to(4.0 * np.eye(6), (values.shape[0], 6, 6)).copy())


def gaussian(seed: int, count: int = 400) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 6))


def test_gaussian_innovations_are_not_complained_of():
    complaints = [text for seed in range(200) if (text := describe_spread(drawn(gaussian(seed))))]
    assert len(complaints) <= 2  # of a probability of 0.2 %


def test_noise_that_changes_is_named():
    values = gaussian(1)
    values[200:] *= 0.5
    text = describe_spread(drawn(values))
    assert text.startswith("The noise is not constant")
    assert "0.2" in text


@pytest.mark.parametrize("channel", [0, 5])
def test_heavy_tails_are_named(channel):
    values = gaussian(2)
    values[::100, channel] = 8.0
    text = describe_spread(drawn(values))
    assert "far larger than the rest" in text
    assert ("position north", "velocity down")[channel == 5] in text


@pytest.mark.parametrize(("factor", "word"), [(1.3, "larger"), (0.7, "smaller")])
def test_a_wrong_size_is_named(factor, word):
    text = describe_spread(drawn(factor * gaussian(3)))
    assert f"are {word} than the filter states" in text
    assert float(text.rstrip(".").split()[-1]) == pytest.approx(factor**2, rel=0.1)


def test_what_is_not_measured_says_nothing():
    values = gaussian(4)
    values[:, 3:] = np.nan
    assert describe_spread(drawn(values)) == ""
    assert describe_spread(drawn(np.full((40, 6), np.nan))) == ""


def test_short_records_too_are_called_white_or_not():
    white = [is_white(drawn(gaussian(seed, 60))) for seed in range(100)]
    assert sum(white) >= 94  # six channels, 0.3 % each: two are expected not to be
    correlated = np.cumsum(gaussian(5, 60), axis=0) / 5
    assert not is_white(drawn(correlated))
