"""Draws: standard normal, independent by name and seed, and stable."""

from __future__ import annotations

import numpy as np
from scipy import stats

from lab.sensors.draws import unit_draws

N = 20000


def test_draws_are_standard_normal():
    values = unit_draws(3, "gyro.noise", (N, 3)).ravel()
    assert stats.kstest(values, "norm").pvalue > 1e-4
    assert abs(values.mean()) < 5 / np.sqrt(values.size)
    assert abs(values.var() - 1) < 5 * np.sqrt(2 / values.size)


def test_streams_of_other_names_seeds_and_axes_are_independent():
    streams = [unit_draws(seed, name, (N,)) for seed in (1, 2) for name in ("gyro.noise", "gyro.bias", "gps")]
    streams += list(unit_draws(1, "gyro.noise x", (N, 3)).T)
    correlation = np.corrcoef(streams) - np.eye(len(streams))
    assert np.abs(correlation).max() < 5 / np.sqrt(N)


def test_a_longer_draw_begins_with_the_shorter():
    short, long = (unit_draws(7, "gps.position", (length, 3)) for length in (10, 1000))
    assert np.array_equal(long[:10], short)


def test_the_same_seed_and_name_give_the_same_bits():
    assert np.array_equal(unit_draws(2**32 - 1, "a", (5,)), unit_draws(2**32 - 1, "a", (5,)))
    assert not np.array_equal(unit_draws(0, "a", (5,)), unit_draws(1, "a", (5,)))
