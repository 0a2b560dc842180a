"""Ring: compared with a list that forgets nothing."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lab.data.clock.timed_samples import TIMED_FIX, TIMED_IMU
from lab.data.streams.ring import Cursor, Ring


def rows(first: int, count: int, kind: np.dtype) -> np.ndarray:
    made = np.zeros(count, kind)
    made["time"] = np.arange(first, first + count)
    return made


@given(
    st.lists(
        st.one_of(
            st.tuples(st.just("append"), st.integers(0, 25), st.integers(0, 9)),
            st.tuples(st.sampled_from("ab"), st.just(0), st.just(0)),
        ),
        max_size=40,
    )
)
def test_readers_get_what_was_appended_or_know_what_they_lost(steps: list[tuple[str, int, int]]) -> None:
    ring, end = Ring((16, 4, 4)), [0, 0]
    cursors: dict[str, Cursor | None] = {"a": None, "b": None}
    for what, imu, fix in steps:
        if what == "append":
            ring.append(rows(end[0], imu, TIMED_IMU), rows(end[1], fix, TIMED_FIX))
            end = [end[0] + imu, end[1] + fix]
            continue
        begin = cursors[what] or Cursor()
        read = ring.since(cursors[what])
        cursors[what] = read.cursor
        assert read.cursor == Cursor(*end)
        assert read.imu["time"].tolist() == list(range(max(begin.imu, end[0] - 16), end[0]))
        assert read.fix["time"].tolist() == list(range(max(begin.fix, end[1] - 4), end[1]))
        lost = max(0, end[0] - 16 - begin.imu) + max(0, end[1] - 4 - begin.fix)
        assert read.lost == lost


def test_what_was_read_is_a_copy() -> None:
    ring = Ring((4, 4, 4))
    ring.append(rows(0, 3, TIMED_IMU), rows(0, 0, TIMED_FIX))
    before = ring.since().imu
    ring.append(rows(3, 4, TIMED_IMU), rows(0, 0, TIMED_FIX))
    assert before["time"].tolist() == [0, 1, 2]


@given(st.integers(0, 60), st.integers(0, 12), st.floats(0, 80))
def test_the_newest_are_those_of_the_last_seconds(imu: int, fix: int, seconds: float) -> None:
    ring = Ring((16, 4, 4))
    for k in range(imu):
        ring.append(rows(k, 1, TIMED_IMU), rows(0, 0, TIMED_FIX))
    for k in range(fix):
        ring.append(rows(0, 0, TIMED_IMU), rows(k, 1, TIMED_FIX))
    read = ring.newest(seconds)
    latest = max(imu, fix) - 1
    assert read.imu["time"].tolist() == [k for k in range(max(0, imu - 16), imu) if k > latest - seconds]
    assert read.fix["time"].tolist() == [k for k in range(max(0, fix - 4), fix) if k > latest - seconds]
