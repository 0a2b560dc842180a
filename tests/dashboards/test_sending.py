"""What a thread asks for while Bokeh makes the session of a page neither refuses the page nor is lost."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import bokeh.server.contexts
import pytest
from bokeh.application.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.callbacks import SessionCallback
from bokeh.server.contexts import ApplicationContext
from bokeh.server.session import ServerSession
from tornado.ioloop import IOLoop

from dashboards.sending import soon

DELIVERED: list[str] = []


class Overtaken(Document):
    """A document for which a thread asks just when Bokeh looks through its callbacks."""

    _asked = False

    @property
    def session_callbacks(self) -> list[SessionCallback]:
        """The callbacks, while a thread asks for one more."""
        if not self._asked:
            self._asked = True
            thread = threading.Thread(target=soon, args=(self, lambda: DELIVERED.append("result")))
            thread.start()
            thread.join()
        return super().session_callbacks


async def opened() -> tuple[ApplicationContext, ServerSession]:
    """Open a page; return what serves it, and its session, once the callbacks that were due have run."""
    context = ApplicationContext(Application(FunctionHandler(lambda _document: None)), IOLoop.current())
    session = await context.create_session_if_needed("page")
    for _ in range(10):
        await asyncio.sleep(0)
    return context, session


def test_a_thread_that_delivers_while_a_page_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    """Found when thirty pages opened at once: one was refused with the status 500."""
    monkeypatch.setattr(bokeh.server.contexts, "Document", Overtaken)
    DELIVERED.clear()
    # In a thread of its own: a browser of other tests may leave a loop running in this one.
    with ThreadPoolExecutor(1) as thread:
        thread.submit(lambda: asyncio.run(opened())).result(30)
    assert DELIVERED == ["result"]


def test_a_page_that_has_ended_takes_nothing(caplog: pytest.LogCaptureFixture) -> None:
    async def late() -> None:
        context, session = await opened()
        document = session.document
        assert document.session_context is not None
        soon(document, lambda: DELIVERED.append("in time"))
        await asyncio.sleep(0.01)
        soon(document, lambda: DELIVERED.append("late"))
        assert context.get_session("page") is session
        session.destroy()
        await asyncio.sleep(0.01)

    DELIVERED.clear()
    with ThreadPoolExecutor(1) as thread:
        thread.submit(lambda: asyncio.run(late())).result(30)
    assert DELIVERED == ["in time"]
    assert not caplog.records


class Loop:
    """A loop of events that keeps what it is asked to call."""

    def __init__(self) -> None:
        self.asked: list[Callable[[], None]] = []

    def add_callback(self, callback: Callable[[], None]) -> None:
        """Keep it."""
        self.asked.append(callback)


@pytest.mark.parametrize("served", [True, False])
def test_only_the_loop_of_a_served_page_adds_what_a_thread_asks_for(served: bool) -> None:
    loop, document = Loop(), Document()
    server = SimpleNamespace(application_context=SimpleNamespace(io_loop=loop)) if served else None
    context = SimpleNamespace(server_context=server, destroyed=False)
    document._session_context = lambda: context  # type: ignore[assignment]
    soon(document, lambda: DELIVERED.append("asked"))
    assert len(loop.asked) == served
    assert len(document.session_callbacks) == (not served)
    for callback in loop.asked:
        callback()
    assert len(document.session_callbacks) == 1


def test_a_document_without_a_session_takes_what_a_thread_asks_for() -> None:
    document = Document()
    soon(document, lambda: DELIVERED.append("asked"))
    assert len(document.session_callbacks) == 1
