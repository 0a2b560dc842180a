"""BLAS threads: one thread for linear algebra, since the matrices of the lab are small.

The threads of one product wait for each other in a loop. With 200 rows there is nothing to gain; beside
another busy process, a run with its verdict takes two to four times as long with two threads as with one.
"""

from __future__ import annotations

import contextlib
import functools
import sys
import threading
from types import TracebackType
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


class OneBlasThread(contextlib.ContextDecorator):
    """A context, or a decorator, in which BLAS has one thread in the whole process.

    It may be entered from several threads, and within itself: when the last one leaves, BLAS has as many
    threads as before the first. A library that is loaded inside counts from the next entry on.
    """

    _lock: ClassVar[threading.Lock] = threading.Lock()
    _inside: ClassVar[int] = 0
    _known: ClassVar[int] = 0
    _limits: ClassVar[contextlib.ExitStack] = contextlib.ExitStack()

    def __enter__(self) -> None:
        """Limit BLAS to one thread."""
        everyone = OneBlasThread
        # SciPy has a BLAS of its own, which may be loaded at any time, by one of many modules.
        loaded = _of_scipy(len(sys.modules))
        with everyone._lock:
            if everyone._inside == 0 or everyone._known != loaded:
                everyone._limits.enter_context(_libraries(loaded).limit(limits=1))
                everyone._known = loaded
            everyone._inside += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Return the threads to BLAS, unless someone else is inside."""
        everyone = OneBlasThread
        with everyone._lock:
            everyone._inside -= 1
            if everyone._inside == 0:
                everyone._limits.close()


@functools.cache
def keep_one_blas_thread() -> None:
    """Limit BLAS to one thread until the process ends, for a server."""
    OneBlasThread().__enter__()


@functools.lru_cache(maxsize=1)
def _of_scipy(_loaded: int) -> int:
    """Return how many modules of SciPy are loaded, counted anew when another number of modules is loaded."""
    return sum(name.startswith("scipy.") for name in list(sys.modules))


@functools.lru_cache(maxsize=1)
def _libraries(_loaded: int) -> ThreadpoolController:
    """Return the BLAS libraries of the process, found anew when another number of modules is loaded."""
    from threadpoolctl import ThreadpoolController  # noqa: PLC0415 - importing the lab does without

    found: ThreadpoolController = ThreadpoolController().select(user_api="blas")
    return found
