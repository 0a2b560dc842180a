"""Openings: pages that open and end take turns, and the server handles other requests in between."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from contextvars import Context
from functools import partial
from weakref import ref

from bokeh.application.application import SessionContext
from bokeh.application.handlers.handler import Handler
from bokeh.document import Document
from bokeh.server.contexts import ApplicationContext
from bokeh.server.session import ServerSession

from dashboards import garbage

PAUSE = 0.01
"""Time between two turns [s]: requests of open pages meanwhile take a few rounds of the event loop."""

LONGEST = 2.0
"""Longest wait for the start of a step while a slow browser holds its document [s]."""

AGAIN = 10.0
"""Time until an ended page that is still in use is collected again [s]; it doubles each time. A computation
in a thread refers to its page until it is done."""

ENOUGH = 100
"""Ended pages between two full collections. A collection from a page misses 100 objects of a page that shows
its first plots, and objects that were frozen while another page opened and dropped before their own page
ended."""
FEW = 10
"""Most open pages for a full collection: with their imports they have 800,000 objects, which takes half a
second; thirty pages would take more than one second."""

Turn = Callable[[], "asyncio.Future[None]"]


class Openings(Handler):
    """Gives each page in turn the next step of its opening, in the order of the requests.

    Bokeh asks each handler of an application before it makes a session, and waits for the answer.
    """

    def __init__(self) -> None:
        super().__init__()
        self._waiting: deque[Turn] = deque()
        self._ended: deque[Turn] = deque()
        self._ended_since = 0
        self._working: asyncio.Task[None] | None = None
        self._context: ref[ApplicationContext] | None = None

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
        made._context = ref(context)
        context.application.add(made)
        return made

    @property
    def crowded(self) -> bool:
        """Whether other pages are open in a browser or waiting for their turn."""
        return bool(self._waiting) or any(session.connection_count for session in self._sessions)

    @property
    def _sessions(self) -> list[ServerSession]:
        context = self._context() if self._context is not None else None
        return list(context.sessions) if context is not None else []

    def modify_document(self, doc: Document) -> None:
        """Do not change the document here; the page fills it."""

    async def on_session_created(self, session_context: SessionContext) -> None:
        """Wait for the turn of a new page; when this returns, Bokeh creates the page without a break."""
        mine: asyncio.Future[None] = asyncio.get_running_loop().create_future()

        def begin() -> asyncio.Future[None]:
            if not mine.done():
                mine.set_result(None)
            return mine

        self._ask(begin)
        await mine

    def later(self, document: Document, step: Callable[[], None]) -> None:
        """Run a step of a page in its turn, as a callback of its document."""
        self._ask(partial(_step, document, step))

    def let_go(self, page: object, wait: float = AGAIN) -> None:
        """Free the objects of an ended page, once no page waits to be opened."""
        self._ended.append(partial(self._search, [page], wait))
        self._begin()

    def _search(self, pages: list[object], wait: float) -> asyncio.Future[None]:
        async def search() -> None:
            left = ref(pages[0])
            await garbage.search_from(pages.pop())
            if left() is not None:
                asyncio.get_running_loop().call_later(wait, self._search_again, left, 2 * wait)
                return
            self._ended_since += 1
            if self._ended_since >= ENOUGH and len(self._sessions) <= FEW:
                self._ended_since = 0
                garbage.search_all()

        return asyncio.ensure_future(search())

    def _search_again(self, left: ref[object], wait: float) -> None:
        if (page := left()) is not None:
            self.let_go(page, wait)

    def _ask(self, turn: Turn) -> None:
        self._waiting.append(turn)
        self._begin()

    def _begin(self) -> None:
        if self._working is None or self._working.done():
            # In an empty context, because the context of a page refers to its document while the work goes
            # on.
            self._working = asyncio.get_running_loop().create_task(self._work(), context=Context())

    async def _work(self) -> None:
        while turns := self._waiting or self._ended:
            await asyncio.wait({turns.popleft()()}, timeout=LONGEST)
            await asyncio.sleep(PAUSE)
            garbage.keep()


def _step(document: Document, step: Callable[[], None]) -> asyncio.Future[None]:
    """Schedule a step of a document; return a future that completes when the step is done or has failed."""
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
