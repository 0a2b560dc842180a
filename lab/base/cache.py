"""Cache: results of computation stages, keyed by the content of their inputs.

There is one computation per key at a time, for any number of threads. The size is bounded, and the least
recently used results are dropped first. Arrays are made read-only, since several results share them.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")


def digest(*parts: Any) -> str:
    """Return a hash of plain data: numbers, text, and nested lists and dictionaries of them."""
    text = json.dumps(parts, sort_keys=True, ensure_ascii=False, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


class StageCache:
    """A cache for the results of stages.

    Parameters
    ----------
    limit
        Largest size of the cache [bytes]. A larger result is returned but not kept.

    Attributes
    ----------
    bytes : int
        Memory of the kept results: arrays, and other objects with an attribute `nbytes`.
    computed : dict
        How many times each stage has been computed.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.bytes = 0
        self.computed: dict[str, int] = {}
        self._kept: OrderedDict[tuple[str, str], tuple[Any, int]] = OrderedDict()
        self._running: dict[tuple[str, str], Future[Any]] = {}
        self._lock = threading.Lock()

    def get(self, stage: str, key: str, compute: Callable[[], T]) -> T:
        """Return the result of a stage for a key, computing it if it is not kept.

        An exception raised by `compute` is raised in all waiting threads, and nothing is kept.
        """
        at = (stage, key)
        with self._lock:
            if at in self._kept:
                self._kept.move_to_end(at)
                return self._kept[at][0]  # type: ignore[no-any-return]
            running = self._running.get(at)
            if running is None:
                mine: Future[T] = Future()
                self._running[at] = mine
        if running is not None:
            return running.result()  # type: ignore[no-any-return]
        try:
            value = compute()
            self._keep(at, value)
        except BaseException as error:
            # For any end, even an interrupt, so that no thread waits forever.
            with self._lock:
                self._running.pop(at, None)
            mine.set_exception(error)
            raise
        mine.set_result(value)
        return value

    def shrink(self, size: int) -> None:
        """Drop the least recently used results until the others take at most a size [bytes]."""
        with self._lock:
            self._drop_oldest(size)

    def clear(self) -> None:
        """Drop all results."""
        with self._lock:
            self._kept.clear()
            self.computed.clear()
            self.bytes = 0

    def _keep(self, at: tuple[str, str], value: Any) -> None:
        size = _freeze(value)
        with self._lock:
            self._running.pop(at, None)
            self.computed[at[0]] = self.computed.get(at[0], 0) + 1
            if size > self.limit:
                return
            self._kept[at] = (value, size)
            self.bytes += size
            self._drop_oldest(self.limit)

    def _drop_oldest(self, size: int) -> None:
        while self.bytes > size:
            _, (_, dropped) = self._kept.popitem(last=False)
            self.bytes -= dropped


def _freeze(value: Any) -> int:
    """Make the arrays of a result read-only, and return the memory it holds [bytes]."""
    holders = {}
    for part in _parts(value):
        if isinstance(part, np.ndarray):
            part.setflags(write=False)
            # Views keep their whole array alive, and several may share one.
            part = _owner(part)  # noqa: PLW2901
        holders[id(part)] = int(part.nbytes)
    return sum(holders.values())


def _owner(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array that owns the memory of a view."""
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array


def _parts(value: Any) -> Iterator[Any]:
    """Iterate over the objects of a result that take memory: arrays, and others with an `nbytes`.

    They may be inside tuples, lists, dictionaries and dataclasses.
    """
    if hasattr(value, "nbytes"):
        yield value
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _parts(item)
    elif isinstance(value, dict):
        yield from _parts(list(value.values()))
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield from _parts([getattr(value, field.name) for field in dataclasses.fields(value)])
