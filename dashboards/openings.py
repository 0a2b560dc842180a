"""Openings: pages that open at once take turns, and what else the server is asked comes in between."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from functools import partial

from bokeh.application.application import SessionContext
from bokeh.application.handlers.handler import Handler
from bokeh.document import Document

from dashboards.garbage import Garbage

PAUSE = 0.01
"""Time between two turns [s]: what open pages have asked meanwhile takes a few rounds of the event loop."""

LONGEST = 2.0
"""Longest wait for a step that does not begin, because a slow browser holds its document [s]."""

Turn = Callable[[], "asyncio.Future[None]"]


class Openings(Handler):
    """Gives one page after the other its turn for the next step of its opening, in the order they asked.

    Bokeh asks each handler of an application before it makes a session, and waits for the answer.
    """

    def __init__(self) -> None:
        super().__init__()
        self._waiting: deque[Turn] = deque()
        self._working: asyncio.Task[None] | None = None
        self._garbage = Garbage()

    @classmethod
    def of(cls, document: Document) -> Openings | None:
        """Return the openings of the application that serves a document; None without a server."""
        server = getattr(document.session_context, "server_context", None)
        context = getattr(server, "application_context", None)
        if context is None:
            return None
        for handler in context.application.handlers:
            if isinstance(handler, cls):
                return handler
        made = cls()
        context.application.add(made)
        return made

    @property
    def crowded(self) -> bool:
        """Whether other pages wait for their turn."""
        return bool(self._waiting)

    def modify_document(self, doc: Document) -> None:
        """Leave the document to the page."""

    async def on_session_created(self, session_context: SessionContext) -> None:
        """Have a new page wait for its turn; once this returns, Bokeh makes it without a break."""
        mine: asyncio.Future[None] = asyncio.get_running_loop().create_future()

        def begin() -> asyncio.Future[None]:
            if not mine.done():
                mine.set_result(None)
            return mine

        self._ask(begin)
        await mine

    async def on_session_destroyed(self, session_context: SessionContext) -> None:
        """Let go of a page that has ended."""
        self._garbage.page_ended()

    def later(self, document: Document, step: Callable[[], None]) -> None:
        """Take a step of a page once it is its turn, as a callback of its document."""
        self._ask(partial(_step, document, step))

    def _ask(self, turn: Turn) -> None:
        self._waiting.append(turn)
        if self._working is None or self._working.done():
            self._working = asyncio.ensure_future(self._work())

    async def _work(self) -> None:
        while self._waiting:
            await asyncio.wait({self._waiting.popleft()()}, timeout=LONGEST)
            await asyncio.sleep(PAUSE)
            self._garbage.keep()


def _step(document: Document, step: Callable[[], None]) -> asyncio.Future[None]:
    """Have a document take a step; return what is done once the step has been taken or has failed."""
    taken: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def take() -> None:
        try:
            step()
        finally:
            if not taken.done():
                taken.set_result(None)

    context = document.session_context
    if context is None or context.destroyed:
        taken.set_result(None)
    else:
        document.add_next_tick_callback(take)
    return taken
