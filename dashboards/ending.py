"""Ending: a server that is asked to end writes what its pages show into their browsers, and tells them so.

The browsers then wait for a server at the same address, and load their pages again (`browser_scripts`).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from types import FrameType
from weakref import WeakKeyDictionary, WeakMethod

from bokeh.document import Document
from bokeh.server.session import ServerSession
from tornado.web import RequestHandler

from dashboards.openings import schedule_step
from dashboards.upstream.server import end_socket

log = logging.getLogger(__name__)

PATH = "health"
"""Path of the address that says whether the server answers, after that of the page."""
WRITING = 2.0
"""Longest time for pages to write their last changes [s]; that of thirty takes a tenth of a second."""
PATIENCE = 5.0
"""Time after which the process ends even if a computation holds it [s]: Docker kills it after 10 s."""
RESTARTS = 1012
"""Code with which the websockets of pages are closed: the service restarts (IANA's registry of RFC 6455)."""

_written: WeakKeyDictionary[Document, WeakMethod[Callable[[], None]]] = WeakKeyDictionary()
"""What writes the address of each open page of this process."""
_is_ending = threading.Event()
"""Set once this process is asked to end."""


class HealthHandler(RequestHandler):
    """Says whether the server takes visitors: 200, or 503 once it ends. It tells no more, to anybody."""

    def get(self) -> None:
        """Answer."""
        self.set_header("Cache-Control", "no-store")
        self.set_status(503 if _is_ending.is_set() else 200)
        self.finish({"status": "ending" if _is_ending.is_set() else "ready"})

    head = get


def before_the_end(document: Document, write: Callable[[], None]) -> None:
    """Call a method of a page, in its turn, before the server ends."""
    _written[document] = WeakMethod(write)


async def part(sessions: Iterable[ServerSession]) -> None:
    """Have pages write their addresses, and close their websockets, which tells their browsers.

    Parameters
    ----------
    sessions
        The sessions of the server.
    """
    sessions = list(sessions)
    writing = []
    for session in sessions:
        method = _written.get(session.document)
        write = None if method is None else method()
        if write is not None and session.connection_count:
            writing.append(schedule_step(session.document, write))
    if writing:
        await asyncio.wait(writing, timeout=WRITING)
    ends = [end_socket(session.document, RESTARTS, "the server restarts") for session in sessions]
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(asyncio.gather(*ends, return_exceptions=True), WRITING)


def end_on_signals(
    loop: asyncio.AbstractEventLoop,
    sessions: Callable[[], Iterable[ServerSession]],
    leave: Callable[[], None],
    clean: Iterator[Callable[[], None]],
) -> None:
    """Part from the pages when the system ends this process, clean up, and exit; even during a computation.

    Parameters
    ----------
    loop
        Loop of events of the server.
    sessions
        Returns the sessions of the server.
    leave
        Writes what the next server takes over.
    clean
        Functions that clean up in any case. Each is called once, though a second signal may interrupt it:
        called again, one that waits for a process would wait for itself.
    """

    def exit_now(number: int) -> None:
        for one in clean:
            one()
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)

    def exit_hard(number: int) -> None:
        for one in clean:
            one()
        # Python's own exit would wait for the thread that computes.
        os._exit(128 + number)

    async def end(number: int) -> None:
        try:
            leave()
            await part(sessions())
        except Exception:
            log.exception("the pages could not be told that the server ends")
        exit_now(number)

    ends = list[asyncio.Task[None]]()

    def asked(number: int, _frame: FrameType | None) -> None:
        if _is_ending.is_set() or not loop.is_running():  # asked twice, or before there is a page
            exit_now(number)
            return
        _is_ending.set()
        loop.call_soon_threadsafe(lambda: ends.append(loop.create_task(end(number))))

    with contextlib.suppress(ValueError):  # only the main thread receives signals
        numbers = {getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)}
        _exit_later(numbers, exit_hard)
        for number in numbers:
            signal.signal(number, asked)


def _exit_later(numbers: set[int], leave: Callable[[int], None]) -> None:
    """Have a thread call a function `PATIENCE` after a signal, even if compiled code holds the main one.

    Python calls handlers in the main thread, between two of its own instructions. It also writes the number
    of each signal to a socket, at once.
    """
    ours, pythons = socket.socketpair()
    pythons.setblocking(False)
    signal.set_wakeup_fd(pythons.fileno(), warn_on_full_buffer=False)
    if hasattr(os, "register_at_fork"):  # or a signal to a copy of this process would end this one
        os.register_at_fork(after_in_child=lambda: signal.set_wakeup_fd(-1))

    def watch() -> None:
        with ours, pythons:
            while not numbers & set(told := ours.recv(64)):
                pass
            time.sleep(PATIENCE)
            leave(next(number for number in told if number in numbers))

    threading.Thread(target=watch, daemon=True, name="ending").start()
