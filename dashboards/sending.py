"""Sending: changes that are sent to the browser together and reliably."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from bokeh.document import Document

from dashboards.patch_messages import one_message


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
