"""The usual interval: a median of the past, the same for any pieces in which samples arrive."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lab.data.clock.faults import UsualInterval
from lab.data.clock.limits import LIMITS


def by_definition(intervals: np.ndarray) -> np.ndarray:
    """Return the usual interval at each interval, one by one."""
    usual = np.empty(intervals.size)
    for i in range(intervals.size):
        known = i // LIMITS.block * LIMITS.block
        past = (
            intervals[max(0, known - LIMITS.intervals) : known]
            if known
            else intervals[: LIMITS.first_intervals]
        )
        usual[i] = np.median(past)
    return usual


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.lists(st.integers(0, 400), max_size=8))
def test_pieces_change_nothing(seed, sizes):
    dt = np.random.default_rng(seed).lognormal(-4, 0.5, LIMITS.first_intervals + sum(sizes))
    usual, parts, start = UsualInterval(), [], 0
    for size in (LIMITS.first_intervals, *sizes):
        parts.append(usual.accept(dt[start : start + size]))
        start += size
    np.testing.assert_array_equal(np.concatenate(parts), by_definition(dt))
    np.testing.assert_array_equal(UsualInterval().accept(dt), by_definition(dt))


def test_a_new_rate_counts_after_half_of_the_intervals():
    dt = np.repeat((0.01, 0.05), 1024)
    usual = UsualInterval().accept(dt)
    assert (usual[: 1024 + LIMITS.intervals // 2] == 0.01).all()
    assert (usual[1024 + LIMITS.intervals // 2 + LIMITS.block :] == 0.05).all()


def test_few_intervals():
    assert UsualInterval().accept(np.array([1.0, 3.0, 2.0])).tolist() == [2.0] * 3
    assert UsualInterval().accept(np.empty(0)).size == 0
