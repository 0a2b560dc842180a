"""Epoch sums and error histogram: the figures of all runs kept, whatever runs came first."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.experiment.ensembles.epoch_sums import EpochSums
from lab.experiment.ensembles.error_histogram import PARTS, STEPS, ErrorHistogram

EPOCHS = np.arange(1.0, 13.0)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), runs=st.integers(1, 9), part=st.floats(0.1, 1.0))
def test_sums_over_runs_are_those_of_the_stored_values(seed: int, runs: int, part: float) -> None:
    """Runs that lack epochs, and values that are unknown, also where no run has one."""
    draws = np.random.default_rng(seed)
    used = draws.random((runs, EPOCHS.size)) < part
    nees = np.where(used, draws.chisquare(15, used.shape), np.nan)
    error = np.where(used[..., None], draws.standard_normal((*used.shape, 3)), np.nan)
    error[draws.random(error.shape) < 0.1] = np.nan
    sums = EpochSums()
    for run in range(runs):
        own = used[run]
        sums.add(EPOCHS[own], {"nees": nees[run, own], "error": error[run, own]})
    seen = used.any(axis=0)
    assert np.array_equal(sums.time, EPOCHS[seen])
    for name, values in (("nees", nees), ("error", error)):
        known = ~np.isnan(values)
        count = known.sum(axis=0)[seen]
        total = np.where(known, values, 0.0).sum(axis=0)[seen]
        assert np.array_equal(sums.count[name], count)
        mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        np.testing.assert_allclose(sums.mean(name), mean, rtol=1e-12, atol=1e-14)


def test_a_copy_stays_as_it_is() -> None:
    sums = EpochSums()
    sums.add(EPOCHS[::2], {"nees": np.ones(6)})
    before = sums.copy()
    sums.add(EPOCHS, {"nees": np.ones(12)})
    assert before.time.size == 6
    assert np.array_equal(before.count["nees"], np.ones(6))
    assert sums.count["nees"].tolist() == [2, 1] * 6


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.sampled_from([0.1, 1.0, 30.0]))
def test_percentiles_are_those_of_the_values_within_a_bin(seed: int, scale: float) -> None:
    """Of 400 values in each of two parts of the flight, added in pieces and in any order."""
    draws = np.random.default_rng(seed)
    time = np.repeat([1.0, 9.0], 400)
    values = scale * draws.standard_normal((800, 2))
    order = draws.permutation(800)
    histogram, other = (ErrorHistogram.over(0.0, 10.0, 2) for _ in range(2))
    histogram.add(time, values)
    for piece in np.array_split(order, int(draws.integers(1, 9))):
        other.add(time[piece], values[piece])
    assert np.array_equal(histogram.counts, other.counts)
    found = histogram.percentiles([5.0, 50.0, 95.0])
    filled = np.flatnonzero(np.isfinite(found[0, :, 0]))
    assert filled.tolist() == [int(0.1 * PARTS), int(0.9 * PARTS)]
    for part, own in zip(filled, (values[:400], values[400:]), strict=True):
        exact = np.percentile(own, [5.0, 50.0, 95.0], axis=0)
        # A bin, and the distance between two of the values.
        width = 1.1 * np.sqrt(1 + exact**2) / STEPS + 0.12 * scale
        assert (np.abs(found[:, part] - exact) < width).all()


def test_unknown_errors_do_not_count_and_diverged_ones_are_the_largest() -> None:
    histogram = ErrorHistogram.over(0.0, 10.0, 1)
    histogram.add(np.array([-1.0, 5.0, 5.0, 11.0]), np.array([[1.0], [np.nan], [np.inf], [-1e9]]))
    assert histogram.counts.sum() == 3
    assert histogram.counts[0].sum() == histogram.counts[-1].sum() == 1
    median = histogram.percentiles([50.0])[0, :, 0]
    assert median[0] == pytest.approx(1.0, rel=0.05)
    assert median[PARTS // 2] > 900
    assert median[-1] < -900
