"""Openings: pages that open and end take turns, and the server handles other requests in between."""

from __future__ import annotations

import asyncio
import sys
from collections import deque
from collections.abc import Callable, Iterable
from contextvars import Context
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary, WeakSet, ref

from bokeh.application.application import SessionContext
from bokeh.application.handlers.handler import Handler
from bokeh.document import Document
from bokeh.model import Model
from bokeh.server.contexts import ApplicationContext
from bokeh.server.session import ServerSession

from dashboards import garbage
from dashboards.computing import rested
from dashboards.upstream.server import models_version
from lab.experiment.sensor_stages import CACHE
from lab.run.memory import give_back, resident

PAUSE = 0.01
"""Time between two turns [s]: requests of open pages meanwhile take a few rounds of the event loop."""

LONGEST = 2.0
"""Longest wait for the start of a step while a slow browser holds its document [s]."""

AGAIN = 10.0
"""Time until an ended page that is still in use is collected again [s]; it doubles each time. A computation
in a thread refers to its page until it is done."""

ENOUGH = 100
"""Ended pages between two full collections. A collection from a page misses objects that it dropped and that
nothing of it refers to any more."""
MUCH = 200 * 2**20
"""Memory taken since the last full collection from which there is another one [bytes]: two streams at 1 kHz,
which are few objects."""
LEFT = 2.0
"""Time from which a page may end whose browser has left it [s]. Pages that are opened and left one after the
other are then few at once: Python keeps the memory that most of them had together."""
GOES_ON = 8.0
"""The same for a page with a stream or a place in a class [s]: a page that is loaded again is there by then,
and goes on with it."""
STILL = 2.0
"""Time without a run after which a full collection may begin [s]: it takes half a second, so nobody may be
moving a slider."""
LOOK = 1.0
"""Time between two looks whether nobody moves a slider [s]."""
AT_REST = 48 * 2**20
"""Memory of the cached results that wait for the next visitor once the last one has left [bytes]: those of
the first page of Montréal, 46 MB."""
EACH = 16 * 2**20
"""Memory of cached results that each page in a browser adds once another has ended [bytes]: twelve positions
of a slider. Two hundred pages, one after the other, otherwise fill the cache with what nobody sees."""
MOST = 3_000_000
"""Most blocks of memory of Python's objects for a full collection while pages are open: it takes half a
second for them. The imports are 1.2 million, and a page has 100,000 to 300,000."""

Turn = Callable[[], "asyncio.Future[None]"]

_go_on: WeakSet[Document] = WeakSet()
"""Documents of pages with a stream or a place in a class."""


class Openings(Handler):
    """Gives each page in turn the next step of its opening, in the order of the requests.

    Bokeh asks each handler of an application before it makes a session, and waits for the answer.
    """

    def __init__(self) -> None:
        super().__init__()
        self._waiting: deque[Turn] = deque()
        self._ended: deque[Turn] = deque()
        self._ended_since = 0
        self._taken = resident()  # after the last full collection
        self._searching: asyncio.Task[None] | None = None
        self._models: WeakKeyDictionary[Document, set[ref[Model]]] = WeakKeyDictionary()
        self._noted: WeakKeyDictionary[Document, tuple[int, int]] = WeakKeyDictionary()
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
        # A plain reference would keep the application, and all its sessions, for good.
        made._context = ref(context)
        context.application.add(made)
        return made

    def is_crowded(self, document: Document) -> bool:
        """Return whether pages besides that of a document are open in a browser or waiting for their turn."""
        watched = (one for one in self._sessions if one.connection_count > 0)
        return bool(self._waiting) or any(one.document is not document for one in watched)

    @property
    def busy(self) -> bool:
        """Whether pages wait for their turn to open."""
        return bool(self._waiting)

    @property
    def _is_left(self) -> bool:
        """Whether all pages have ended: then a search keeps nobody waiting, however long it takes."""
        return self._context is not None and not self._sessions

    @property
    def _watched(self) -> int:
        """How many pages are open in a browser; others have lost theirs, and end soon."""
        return sum(session.connection_count > 0 for session in self._sessions)

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
        self._ask(partial(schedule_step, document, step))

    def let_go(self, page: object, document: Document) -> None:
        """Free the objects of an ended page, once no page waits to be opened."""
        self._ended.append(
            partial(self._search, [page, *_living_objects(self._models.pop(document, ()))], AGAIN)
        )
        self._begin()

    def _search(self, roots: list[object], wait: float) -> asyncio.Future[None]:
        async def search() -> None:
            left = [ref(root) for root in roots]
            await garbage.collect_from(roots)
            # A thread, or a callback that waits, may still hold the page: it is tried again, later each
            # time.
            if any(root() is not None for root in left):
                asyncio.get_running_loop().call_later(wait, self._search_again, left, 2 * wait)
                self._search_all()  # what is in use may be so by garbage only
                return
            self._ended_since += 1
            self._search_all()

        return asyncio.ensure_future(search())

    @property
    def _is_much(self) -> bool:
        """Whether the process has taken much memory since the last full collection, or since it had least."""
        now = resident()
        # Memory that was given back in between is room for more.
        self._taken = min(self._taken, now)
        return now - self._taken > MUCH

    def _search_all(self) -> None:
        """Have all objects searched if enough may be found, once that keeps nobody waiting.

        Once the last page has ended, all that it left is searched: then nobody waits.
        """
        left = self._is_left and self._ended_since > 0
        due = left or self._ended_since >= ENOUGH or self._is_much
        if due and (self._searching is None or self._searching.done()):
            loop = asyncio.get_running_loop()
            self._searching = loop.create_task(self._search_when_still(), context=Context())  # as in `_begin`

    async def _search_when_still(self) -> None:
        while rested() < STILL:
            await asyncio.sleep(LOOK)
        if self._is_left or sys.getallocatedblocks() < MOST:
            garbage.search_all()
            await asyncio.to_thread(give_back)
            self._ended_since = 0
            self._taken = resident()

    def _search_again(self, left: list[ref[object]], wait: float) -> None:
        self._ended.append(partial(self._search, _living_objects(left), wait))
        self._begin()

    def _ask(self, turn: Turn) -> None:
        self._waiting.append(turn)
        self._begin()

    def _begin(self) -> None:
        if self._working is None or self._working.done():
            # In an empty context, because the context of a page refers to its document while the work goes
            # on.
            self._working = asyncio.get_running_loop().create_task(self._work(), context=Context())

    async def _work(self) -> None:
        while self._waiting or self._ended:
            if await self._give_turns():
                CACHE.shrink(AT_REST + EACH * self._watched)
                if not self._sessions:
                    self._search_all()
                # In a thread, because it goes through all free memory. Others may ask for a turn meanwhile.
                await asyncio.to_thread(give_back)

    async def _give_turns(self) -> bool:
        """Give all turns; return whether an ended page was among them."""
        searched = False
        # Pages that open go first; only when none waits are ended ones searched.
        while turns := self._waiting or self._ended:
            searched = searched or turns is self._ended
            # A step that hangs keeps its page alone from opening, not all that wait behind it.
            await asyncio.wait({turns.popleft()()}, timeout=LONGEST)
            # Between two turns, the loop answers what open pages have asked.
            await asyncio.sleep(PAUSE)
            self._note_models()
            garbage.freeze_objects()
        return searched

    def _note_models(self) -> None:
        """Note the models that are about to be kept: their document may drop them before it ends."""
        for session in self._sessions:
            document = session.document
            version = models_version(document)
            if self._noted.get(document) != version:
                self._noted[document] = version
                # Plain references: a `WeakSet` takes ten times as long.
                self._models.setdefault(document, set()).update(map(ref, document.models))


def end_later(document: Document) -> None:
    """Have a page end later, because the page that is loaded again goes on with what it has."""
    _go_on.add(document)


def may_not_end(document: Document) -> bool:
    """Return whether a page that its browser has left must stay for the one that is loaded again."""
    openings = Openings.of(document)
    if openings is not None and openings.busy:
        return True
    session = getattr(document.session_context, "session", None)
    left = 0.0 if session is None else session.milliseconds_since_last_unsubscribe / 1000
    return document in _go_on and left < GOES_ON


def _living_objects(some: Iterable[ref[Any]]) -> list[Any]:
    """Return the objects of some references that are still there."""
    return [one for known in some if (one := known()) is not None]


def schedule_step(document: Document, step: Callable[[], None]) -> asyncio.Future[None]:
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
