"""Thinning for the screen: no peak is lost, gaps stay gaps, axes hold what is drawn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lab.views.envelope import SMALLEST_DRAWN, envelope, limits, nice_limit, thin_path


def test_a_single_spike_survives() -> None:
    time = np.arange(50_000) / 200
    values = np.sin(time)
    values[31_234] = 9.0
    _, (thinned,) = envelope(time, [values], (0.0, 250.0), 400)
    assert thinned.max() == 9.0
    assert thinned.min() == values.min()
    assert len(thinned) == 800


@given(
    count=st.integers(1, 5000),
    buckets=st.integers(1, 60),
    start=st.floats(-0.2, 1.2),
    length=st.floats(0.001, 1.5),
    seed=st.integers(0, 9),
)
def test_extremes_of_the_window_are_kept(
    count: int, buckets: int, start: float, length: float, seed: int
) -> None:
    time = np.linspace(0, 1, count)
    values = np.random.default_rng(seed).normal(size=count)
    thin_time, (thinned,) = envelope(time, [values], (start, start + length), buckets)
    inside = values[(time >= start) & (time <= start + length)]
    assert len(thinned) == len(thin_time) <= max(2 * buckets, 2)
    assert np.all(np.diff(thin_time) >= 0)
    assert np.isin(thinned, values).all()
    if len(inside):
        assert thinned.max() >= inside.max()
        assert thinned.min() <= inside.min()


def test_a_rising_curve_stays_rising() -> None:
    time = np.linspace(0, 10, 10_000)
    _, (rising, falling) = envelope(time, [time**2, -(time**2)], (0, 10), 100)
    assert np.all(np.diff(rising) > 0)
    assert np.all(np.diff(falling) < 0)


def test_a_gap_stays_a_gap() -> None:
    time = np.linspace(0, 10, 10_000)
    values = np.ones(10_000)
    values[4000:6000] = np.nan
    thin_time, (thinned,) = envelope(time, [values], (0, 10), 100)
    assert np.isnan(thinned[(thin_time > 4.1) & (thin_time < 5.9)]).all()
    assert np.isfinite(thinned[(thin_time < 3.9) | (thin_time > 6.1)]).all()


def test_few_samples_are_left_as_they_are() -> None:
    time = np.arange(100.0)
    thin_time, (thinned,) = envelope(time, [time**2], (10.5, 20.5), 400)
    np.testing.assert_array_equal(thin_time, np.arange(10.0, 22.0))
    np.testing.assert_array_equal(thinned, np.arange(10.0, 22.0) ** 2)


def test_a_thinned_path_keeps_its_length_and_its_turns() -> None:
    angle = np.concatenate([np.zeros(20_000), np.linspace(0, np.pi, 500), np.full(20_000, np.pi)])
    path = np.cumsum(np.column_stack([np.cos(angle), np.sin(angle)]), axis=0)
    kept = thin_path(path, 200)
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    thin_length = np.linalg.norm(np.diff(path[kept], axis=0), axis=1).sum()
    assert len(kept) <= 200
    assert kept[0] == 0
    assert kept[-1] == len(path) - 1
    assert thin_length == pytest.approx(length, rel=1e-3)


def test_samples_at_rest_are_not_spent_on_the_last_digits_of_a_position() -> None:
    """Minutes on the apron, still but for a micrometre, then a circle of 100 m: that is what is drawn."""
    rng = np.random.default_rng(4)
    angle = np.linspace(0, 2 * np.pi, 2000)
    circle = 100.0 * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    path = np.concatenate([rng.normal(scale=1e-6, size=(20_000, 2)), circle])
    kept = thin_path(path, 400)
    assert (kept >= 20_000).sum() > 0.95 * len(kept)


def test_a_path_that_stands_still_or_has_gaps() -> None:
    assert 0 < len(thin_path(np.zeros((5000, 3)), 100)) <= 100
    broken = np.random.default_rng(1).normal(size=(5000, 2)).cumsum(axis=0)
    broken[100:200] = np.nan
    assert np.isfinite(broken[thin_path(broken, 300)]).all()


@given(st.floats(1e-9, 1e9))
def test_a_limit_is_just_above(value: float) -> None:
    limit = nice_limit(value)
    assert value * (1 - 1e-9) <= limit <= 1.35 * value


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20),
    st.sampled_from(["symmetric", "free", "logarithmic"]),
)
@example([5e-324], "symmetric")
@example([5e-324], "logarithmic")
@example([1e-300, 2e-300], "logarithmic")
def test_limits_hold_what_is_drawn(values: list[float], scale: str) -> None:
    series = np.array([*values, np.nan])
    low, high = limits([series], scale)
    drawn = series[np.isfinite(series)]
    if scale == "logarithmic":
        drawn = drawn[drawn >= SMALLEST_DRAWN]
        assert low > 0
    assert low < high
    assert np.all(drawn >= low)
    assert np.all(drawn <= high)
    if scale == "symmetric":
        assert low == -high


@pytest.mark.parametrize("scale", ["symmetric", "free", "logarithmic"])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("value", [0.0, 1e-45, 1e-38, 1e-13, 2.5e-7, 25.0, 300.0, -4e6])
def test_a_constant_is_neither_at_the_edge_nor_magnified_until_its_last_digit(
    value: float, kind: type, scale: str
) -> None:
    series = np.full(50, value, dtype=kind)
    low, high = limits([series], scale)
    assert np.isfinite([low, high]).all()
    assert low < high
    if abs(value) < SMALLEST_DRAWN or (scale == "logarithmic" and value < 0):
        assert (low, high) == ((0.1, 1.0) if scale == "logarithmic" else (-1.0, 1.0))
    elif scale == "logarithmic":
        assert low < value < high < 10 * low
    else:
        assert 0.05 * abs(value) < high - low < 4 * abs(value)
        assert low < value < high


@pytest.mark.parametrize("scale", ["symmetric", "free", "logarithmic"])
def test_axes_of_a_ten_millionth_of_a_millionth_fit_what_is_drawn(scale: str) -> None:
    series = (1e-13 * np.linspace(1, 3, 50)).astype(np.float32)
    low, high = limits([series], scale)
    assert low < series.min() < series.max() < high
    assert high - low < 1e-12


def test_single_precision_does_not_magnify_its_own_steps() -> None:
    """A height that changes by micrometres is constant once it is in single precision."""
    series = (300 + 1e-6 * np.sin(np.arange(1000.0))).astype(np.float32)
    low, high = limits([series], "free")
    assert high - low > 1


def test_limits_of_nothing() -> None:
    assert limits([np.full(3, np.nan)], "symmetric") == (-1, 1)
    assert limits([], "logarithmic") == (0.1, 1)
