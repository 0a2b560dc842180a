"""Faults of stamps and samples, against their definitions and against stamps that were spoilt on purpose."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.data.clock.faults import continue_times, equal_runs, increasing, over_rollovers, set_backs

STAMPS = st.lists(st.one_of(st.integers(0, 6).map(float), st.just(np.nan)), max_size=20)


@given(STAMPS, st.integers(0, 20))
def test_later_than_all_before_is_the_same_for_any_cut(stamps: list[float], cut: int) -> None:
    time = np.array(stamps)
    later = [
        x > max((y for y in stamps[:i] if not np.isnan(y)), default=-np.inf) for i, x in enumerate(stamps)
    ]
    assert increasing(time).tolist() == later
    before = np.fmax.reduce(time[:cut], initial=-np.inf)
    assert increasing(time[cut:], float(before)).tolist() == later[cut:]


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 1)), max_size=20))
def test_runs_of_equal_samples_are_those_of_the_definition(rows: list[tuple[int, int]]) -> None:
    start, length = equal_runs(np.array(rows, float).reshape(-1, 2))
    for i, row in enumerate(rows):
        first = next(j for j in range(i, -1, -1) if j == 0 or rows[j - 1] != row)
        end = next((j for j in range(i, len(rows)) if rows[j] != row), len(rows))
        assert (start[i], length[i]) == (first, end - first)


@given(st.lists(st.floats(0.0, 499.0), min_size=1, max_size=20), st.floats(0, 1e4))
def test_a_counter_that_begins_again_goes_on(steps: list[float], first: float) -> None:
    time = first + np.cumsum(steps)
    found = continue_times(np.insert(time % 1000.0, 0, np.nan), 1000.0, 500.0)
    assert np.isnan(found[0])
    np.testing.assert_allclose(np.diff(found[1:]), np.diff(time), rtol=0, atol=1e-6)


def test_a_clock_that_was_set_back_is_no_row_out_of_order() -> None:
    time = 0.01 * np.arange(1000)
    back = np.where(time >= 5, time - 0.192, time)
    ((row, size),) = set_backs(back)
    assert row == 500
    assert size == pytest.approx(0.192, abs=1e-6)
    late = np.r_[time[:500], time[520:540], time[500:520], time[540:]]  # two batches exchanged
    assert set_backs(late) == []
    assert set_backs(time) == set_backs(time[:0]) == []


def test_a_receiver_that_counts_other_weeks_is_taken_in_those_of_the_imu() -> None:
    period = 1024 * 7 * 86400
    imu = 1.7e9 + 0.01 * np.arange(10_000)
    fixes = 1.7e9 + np.arange(100.0)
    for behind in (1, 2, -1):
        stamps, remark = over_rollovers(fixes - behind * period, imu)
        assert (stamps == fixes).all()
        assert "1,024 weeks" in remark
    within = np.where(np.arange(100) < 60, fixes, fixes - period)  # rolls over in the log
    assert (over_rollovers(within, imu)[0] == fixes).all()
    for right in (fixes, fixes + 500, fixes - 3600, fixes[:0], np.full(3, np.nan)):
        stamps, remark = over_rollovers(right, imu)
        assert stamps is right
        assert not remark
