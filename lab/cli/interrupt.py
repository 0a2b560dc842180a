"""Interrupt: Ctrl-C as an event, for work that keeps its partial result."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator

STOPPED = 130
"""Exit code of work that Ctrl-C ended before all of it was done: that of a program that the signal ends."""


@contextlib.contextmanager
def interrupted() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C sets instead of ending the program."""
    pressed = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield pressed
        return
    before = signal.signal(signal.SIGINT, lambda *_: pressed.set())
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, before)
