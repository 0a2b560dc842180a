"""Rolling columns keep the last rows by their numbers, in memory that stays near that of the kept rows."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lab.data.streams.rolling import Rolling

STEPS = st.lists(st.tuples(st.integers(0, 700), st.integers(0, 2000)), max_size=30)


@given(STEPS)
def test_the_kept_rows_are_those_that_were_written(steps: list[tuple[int, int]]) -> None:
    rolling = Rolling({"number": (), "pair": (2,)}, {"number": np.int64})
    for count, keep in steps:
        begin = rolling.end
        rolling.extend(count)
        assert not rolling.rows("pair", begin, rolling.end).any()
        rolling.rows("number", begin, rolling.end)[:] = np.arange(begin, rolling.end)
        rolling.rows("pair", begin, rolling.end)[:] = np.arange(begin, rolling.end)[:, None]
        rolling.forget(rolling.end - keep)
        expected = np.arange(rolling.first, rolling.end)
        np.testing.assert_array_equal(rolling.column("number"), expected)
        np.testing.assert_array_equal(rolling.column("pair"), np.stack((expected, expected), axis=-1))


def test_memory_stays_within_two_fifths_of_the_kept_rows() -> None:
    rolling, keep = Rolling({"value": (8,)}), 20_000
    largest = 0
    for _ in range(3000):
        rolling.extend(50)
        rolling.forget(rolling.end - keep)
        base = rolling.column("value").base
        assert base is not None
        largest = max(largest, len(base))
    assert keep < largest < 1.4 * keep
