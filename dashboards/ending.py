"""Ending: a server that is asked to end writes what its pages show into their browsers, and tells them so.

The browsers then wait for a server at the same address, and load their pages again (`browser_scripts`).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import threading
from collections.abc import Callable, Iterable, Sequence
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
    clean: Sequence[Callable[[], None]],
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
        What must be cleaned up in any case.
    """

    def exit_now(number: int) -> None:
        for one in clean:
            one()
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)

    def exit_hard(number: int) -> None:
        for one in clean:
            one()
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
        timer = threading.Timer(PATIENCE, exit_hard, [number])
        timer.daemon = True
        timer.start()
        loop.call_soon_threadsafe(lambda: ends.append(loop.create_task(end(number))))

    with contextlib.suppress(ValueError):  # only the main thread receives signals
        for name in ("SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), asked)
