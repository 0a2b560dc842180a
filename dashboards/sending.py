"""Sending: changes that a thread asks for, and that are sent to the browser together and reliably."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import panel as pn
from bokeh.document import Document

from dashboards.upstream.patch_messages import one_message


@contextmanager
def together(document: Document) -> Iterator[None]:
    """Hold back the changes made inside, and send them at the end as one message, each property once.

    This is Bokeh's hold, not Panel's (`panel.io.hold`). Panel's drops changes if the browser has fetched the
    document but has not yet reported that it is ready. It can also delay a message when two of its write
    tasks overlap: the plots then stay empty, or one change behind, until the next change.
    """
    if document.callbacks.hold_value:
        yield
        return
    document.hold("combine")
    try:
        yield
    finally:
        with one_message(document):
            document.unhold()


def soon(document: Document, callback: Callable[[], None]) -> None:
    """Ask for a turn of a document; any thread may ask.

    The event loop of the server adds the callback, and drops it if the page has ended by then. If a thread
    added it while Bokeh makes the session of the page, Bokeh would find it twice and refuse the page.
    """
    context = document.session_context
    server = getattr(context, "server_context", None)
    loop = getattr(getattr(server, "application_context", None), "io_loop", None)
    if context is None or loop is None:
        document.add_next_tick_callback(callback)
        return

    def add() -> None:
        if not context.destroyed:
            document.add_next_tick_callback(callback)

    loop.add_callback(add)


def turns_of_page() -> Callable[[Callable[[], None]], None]:
    """Return what any thread may call, to have a function called in a turn of the page that is being made."""
    document = pn.state.curdoc

    def ask(callback: Callable[[], None]) -> None:
        assert document is not None
        soon(document, callback)

    return ask
