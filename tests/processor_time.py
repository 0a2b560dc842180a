"""Processor time: what a piece of a test takes of it, whatever else its process does meanwhile."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def takes_less_than(seconds: float) -> Iterator[None]:
    """Fail if what is done within takes this thread longer [s of a processor].

    Other threads of the process do not count, as an earlier test may have left one at work, and no search for
    garbage falls into it, which passes over all that earlier tests keep. With both, the parser of a text of
    ten characters once took 1.3 s.
    """
    searching = gc.isenabled()
    gc.disable()
    begun = time.thread_time()
    try:
        yield
        taken = time.thread_time() - begun
    finally:
        if searching:
            gc.enable()
    assert taken < seconds
