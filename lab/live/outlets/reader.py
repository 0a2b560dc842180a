"""Reader: who reads a stream of rows, and what it loses if it is too slow."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Final

WAITING: Final = 25
"""Rows that wait for a reader, beside those that its line holds: half a second at 50 Hz."""

Row = list[bytes]
"""The messages of one solution, which are sent together or not at all."""


class Reader:
    """Rows that wait to be sent to one reader; all in the thread of one event loop.

    Attributes
    ----------
    sent, lost : int
        Rows that were sent, and those that gave way to newer ones.
    """

    def __init__(self) -> None:
        self.sent = self.lost = 0
        self._rows: deque[Row] = deque()
        self._more = asyncio.Event()
        self._idle = asyncio.Event()
        self._idle.set()

    def put(self, row: Row) -> None:
        """Take a row; the oldest one that waits gives way if there are too many."""
        if len(self._rows) >= WAITING:
            self._rows.popleft()
            self.lost += 1
        self._rows.append(row)
        self._idle.clear()
        self._more.set()

    async def send(self, write: Callable[[Row], Awaitable[None]]) -> None:
        """Send rows one after the other, until this is cancelled or `write` raises."""
        while True:
            while self._rows:
                try:
                    await write(self._rows.popleft())
                except BaseException:  # it left, or the end came
                    self.lost += 1
                    raise
                self.sent += 1
            self._idle.set()
            self._more.clear()
            await self._more.wait()

    async def emptied(self) -> None:
        """Wait until nothing waits."""
        await self._idle.wait()

    def end(self) -> None:
        """Count what waits as lost: it will not be sent."""
        self.lost += len(self._rows)
        self._rows.clear()
        self._idle.set()
