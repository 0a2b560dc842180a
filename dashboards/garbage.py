"""Garbage: what lives is not searched for garbage again and again, so that no page waits for the search.

To find what is left in cycles, Python goes through all objects there are, and answers nobody meanwhile.
Thirty pages and what they import are two million objects: a second for each search, and one search whenever
there are a quarter more. What an opening has made stays, so it is left out until a page ends.
"""

from __future__ import annotations

import gc

YOUNG, WHOLE = 1, 2
"""Generations of Python's objects: a search of the young takes milliseconds, the whole goes through all."""


class Garbage:
    """Decides what the searches for garbage go through."""

    def __init__(self) -> None:
        self._ended_at: int | None = None

    def keep(self) -> None:
        """Leave all objects out of the next searches, unless an ended page is among them."""
        if self._ended_at is not None and _whole_searches() == self._ended_at:
            return
        self._ended_at = None
        gc.collect(YOUNG)
        gc.freeze()

    def page_ended(self) -> None:
        """Have the next whole search go through everything; Panel has one done soon after a page ends."""
        gc.unfreeze()
        self._ended_at = _whole_searches()


def _whole_searches() -> int:
    return int(gc.get_stats()[WHOLE]["collections"])
