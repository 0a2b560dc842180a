"""Sending: changes that leave for the browser together, and surely."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from bokeh.document import Document


@contextmanager
def together(document: Document) -> Iterator[None]:
    """Hold back the changes made inside, and send them when it ends, each property once.

    Bokeh's own hold, not Panel's (`panel.io.hold`), which drops changes of a page whose browser has fetched
    the document and not yet said that it is ready, and can leave a message lying when two of its write
    tasks overlap: the plots then stay empty, or a change behind, until the next change.
    """
    if document.callbacks.hold_value:
        yield
        return
    document.hold("combine")
    try:
        yield
    finally:
        document.unhold()
