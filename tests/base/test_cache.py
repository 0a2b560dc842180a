"""Stage cache: computed once, bounded, safe under threads and under failure."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lab.base.cache import StageCache, digest

KILOBYTE = 1024


def array(value: float = 0.0, size: int = KILOBYTE) -> NDArray[np.float64]:
    """Return an array of so many bytes."""
    return np.full(size // 8, value)


def test_a_result_is_computed_once_and_then_kept():
    cache = StageCache(10 * KILOBYTE)
    first = cache.get("stage", "key", array)
    assert cache.get("stage", "key", lambda: pytest.fail("computed again")) is first
    assert cache.computed == {"stage": 1}


def test_stages_and_keys_are_told_apart():
    cache = StageCache(10 * KILOBYTE)
    got = [cache.get(stage, key, lambda at=stage + key: at) for stage in "ab" for key in "ab"]
    assert got == ["aa", "ab", "ba", "bb"]


def test_many_threads_get_one_computation():
    cache, release, started = StageCache(10 * KILOBYTE), threading.Event(), threading.Barrier(9)

    def compute() -> NDArray[np.float64]:
        assert release.wait(10)
        return array()

    def ask() -> NDArray[np.float64]:
        started.wait(10)
        return cache.get("stage", "key", compute)

    with ThreadPoolExecutor(8) as pool:
        asked = [pool.submit(ask) for _ in range(8)]
        started.wait(10)
        release.set()
        results = [future.result(10) for future in asked]
    assert all(result is results[0] for result in results)
    assert cache.computed == {"stage": 1}


def test_different_keys_are_computed_at_the_same_time():
    """Each computation waits for the other: with one lock around both this would never end."""
    cache, both = StageCache(10 * KILOBYTE), threading.Barrier(2)
    with ThreadPoolExecutor(2) as pool:
        asked = [pool.submit(cache.get, "stage", key, lambda: both.wait(10)) for key in "ab"]
        assert sorted(future.result(10) for future in asked) == [0, 1]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failure_reaches_everybody_and_is_not_kept(error):
    cache, release, inside = StageCache(10 * KILOBYTE), threading.Event(), threading.Event()

    def fail() -> None:
        inside.set()
        assert release.wait(10)
        raise error("no such thing")

    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(cache.get, "stage", "key", fail)
        assert inside.wait(10)
        second = pool.submit(cache.get, "stage", "key", fail)
        release.set()
        for future in (first, second):
            with pytest.raises(error, match="no such thing"):
                future.result(10)
    assert cache.get("stage", "key", lambda: 3) == 3
    assert cache.bytes == 0


def test_the_least_recently_used_leave_first():
    cache = StageCache(3 * KILOBYTE)
    for key in "abc":
        cache.get("stage", key, array)
    cache.get("stage", "a", array)
    cache.get("stage", "d", array)
    assert cache.computed["stage"] == 4
    for key in "acd":
        cache.get("stage", key, array)
    assert cache.computed["stage"] == 4
    cache.get("stage", "b", array)
    assert cache.computed["stage"] == 5


def test_what_leaves_stays_whole_with_those_who_use_it():
    cache = StageCache(KILOBYTE)
    kept = cache.get("stage", "a", lambda: array(7))
    cache.get("stage", "b", array)
    assert (kept == 7).all()


def test_a_result_larger_than_the_limit_is_handed_out_and_pushes_nothing_out():
    cache = StageCache(2 * KILOBYTE)
    cache.get("stage", "small", array)
    assert cache.get("stage", "large", lambda: array(size=3 * KILOBYTE)).nbytes == 3 * KILOBYTE
    cache.get("stage", "small", lambda: pytest.fail("pushed out"))
    assert cache.bytes == KILOBYTE


@given(st.lists(st.tuples(st.integers(0, 8), st.integers(0, 5)), max_size=60))
def test_the_bound_holds_and_results_are_right_whatever_is_asked(asked):
    cache = StageCache(10 * KILOBYTE)
    for key, size in asked:
        value = cache.get("stage", f"{key} {size}", lambda k=key, s=size: array(k, s * KILOBYTE))
        assert value.nbytes == size * KILOBYTE
        assert (value == key).all()
        assert cache.bytes <= cache.limit
        assert cache.bytes == sum(held for _, held in cache._kept.values())


class Pair(NamedTuple):
    """Two arrays, as a stage may return them."""

    one: NDArray[np.float64]
    two: NDArray[np.float64]


@dataclass(frozen=True)
class Deep:
    """A result within a result."""

    pair: Pair
    table: dict[str, list[NDArray[np.float64]]]


def test_arrays_are_made_read_only_however_deep_they_are():
    cache = StageCache(10 * KILOBYTE)
    deep = cache.get("stage", "key", lambda: Deep(Pair(array(), array()), {"x": [array()]}))
    assert cache.bytes == 3 * KILOBYTE
    for kept in (*deep.pair, deep.table["x"][0]):
        with pytest.raises(ValueError, match="read-only"):
            kept[0] = 1


def test_memory_is_counted_once_and_as_it_is_held():
    """Views hold the whole of their array; a broadcast array is as large as what it repeats."""
    cache = StageCache(100 * KILOBYTE)
    block = array(size=4 * KILOBYTE)
    cache.get("stage", "views", lambda: [block[:10], block[10:20], block])
    assert cache.bytes == 4 * KILOBYTE
    cache.get("stage", "part", lambda: array(size=4 * KILOBYTE)[:10])
    assert cache.bytes == 8 * KILOBYTE
    cache.get("stage", "broadcast", lambda: np.broadcast_to(np.zeros(3), (1000, 3)))
    assert cache.bytes == 8 * KILOBYTE + 24


class Curve:
    """Something that knows its memory, as a trajectory does."""

    nbytes = 5 * KILOBYTE


def test_things_that_know_their_memory_are_counted():
    cache = StageCache(100 * KILOBYTE)
    cache.get("stage", "curve", lambda: (Curve(), array()))
    assert cache.bytes == 6 * KILOBYTE


def test_a_shrunk_cache_keeps_what_was_used_last():
    cache = StageCache(10 * KILOBYTE)
    for key in "abcd":
        cache.get("stage", key, array)
    cache.get("stage", "a", array)
    cache.shrink(2 * KILOBYTE)
    assert cache.bytes == 2 * KILOBYTE
    for key in "adcb":
        cache.get("stage", key, array)
    assert cache.computed == {"stage": 6}
    cache.shrink(0)
    assert cache.bytes == 0


def test_clear_forgets_everything():
    cache = StageCache(10 * KILOBYTE)
    cache.get("stage", "key", array)
    cache.clear()
    assert (cache.bytes, cache.computed) == (0, {})
    cache.get("stage", "key", array)
    assert cache.computed == {"stage": 1}


def test_digests_tell_settings_apart():
    assert digest({"a": 1.0, "b": [1, 2]}) == digest({"b": [1, 2], "a": 1.0})
    parts = [(1,), (1.5,), ("1",), ([1],), (1, 1), ({"a": 1},), ({"a": None},), (True,), ("é",), ()]
    assert len({digest(*part) for part in parts}) == len(parts)
