"""Cache: results of computation stages, kept by the content of what they were computed from.

One computation per key at a time, however many threads ask for it; bounded in bytes, the least recently used leave
first; arrays are made read-only, since several results share them.
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
    """Keeps the results of stages.

    Parameters
    ----------
    limit
        Bytes of arrays to keep at most. A result larger than that is handed out and not kept.
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

        An exception raised by `compute` reaches everybody who waits for it, and nothing is kept.
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
        except BaseException as error:
            with self._lock:
                del self._running[at]
            mine.set_exception(error)
            raise
        self._keep(at, value)
        mine.set_result(value)
        return value

    def clear(self) -> None:
        """Forget everything."""
        with self._lock:
            self._kept.clear()
            self.computed.clear()
            self.bytes = 0

    def _keep(self, at: tuple[str, str], value: Any) -> None:
        size = 0
        for array in _arrays(value):
            array.setflags(write=False)
            size += array.nbytes
        with self._lock:
            del self._running[at]
            self.computed[at[0]] = self.computed.get(at[0], 0) + 1
            if size > self.limit:
                return
            self._kept[at] = (value, size)
            self.bytes += size
            while self.bytes > self.limit:
                _, (_, dropped) = self._kept.popitem(last=False)
                self.bytes -= dropped


def _arrays(value: Any) -> Iterator[NDArray[Any]]:
    """Iterate over the arrays in a result: arrays, tuples, lists, dictionaries and dataclasses of them."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _arrays(item)
    elif isinstance(value, dict):
        yield from _arrays(list(value.values()))
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield from _arrays([getattr(value, field.name) for field in dataclasses.fields(value)])
