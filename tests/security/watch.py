"""Watch: somebody else with a session of a served laboratory, who waits for answers while others act."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import psutil

from tests.security.conftest import Served, Visitor

WAIT = 1.0
"""How long anybody else may wait for an answer [s]."""
STANDSTILL = 30.0
"""Wait beyond which it does not matter whether the server worked [s]."""


class Watch:
    """Somebody else, who has a session too, and asks again and again.

    A wait counts as long as the event loop of the server worked meanwhile: a machine that does other work
    makes all of them longer. One of more than `STANDSTILL` counts whole.
    """

    def __init__(self, served: Served, visitor: Visitor) -> None:
        self._served, self._visitor = served, visitor
        self._longest = 0.0
        self._asked: tuple[float, float] | None = None

    @property
    def longest(self) -> float:
        """The longest time an answer took, or has taken so far [s]."""
        return max(self._longest, self._waiting())

    def _waiting(self) -> float:
        """Return how long the answer to the last question has taken so far [s]."""
        if self._asked is None:
            return 0.0
        waited, worked = (now - then for now, then in zip(self._clocks(), self._asked, strict=True))
        return waited if waited > STANDSTILL else min(waited, worked)

    def _clocks(self) -> tuple[float, float]:
        """Return the time, and how long the event loop has worked [s]."""
        process = self._served.process
        with contextlib.suppress(psutil.NoSuchProcess):
            for thread in process.threads():
                if thread.id == process.pid:
                    return time.monotonic(), thread.user_time + thread.system_time
        return time.monotonic(), 0.0

    def forget(self) -> None:
        """Forget the longest time."""
        self._longest = 0.0

    async def settle(self) -> None:
        """Wait until the first result of the session is there."""
        waits = [WAIT]
        while max(waits[-20:]) > WAIT / 10:
            waits.append(await self._visitor.wait())

    async def go_on(self) -> None:
        """Ask until cancelled."""
        while True:
            self._asked = self._clocks()
            await self._visitor.wait()
            self._longest, self._asked = self.longest, None
            await asyncio.sleep(WAIT / 50)


@asynccontextmanager
async def watched(served: Served) -> AsyncIterator[Watch]:
    """Have somebody else ask, from the first result of a session on."""
    async with served.visitor() as visitor:
        await say(visitor, "document_ready")
        watch = Watch(served, visitor)
        await watch.settle()
        asking = asyncio.create_task(watch.go_on())
        yield watch
        assert not asking.done() or served.popen.poll() is not None, asking
        asking.cancel()


async def say(visitor: Visitor, name: str, *parts: bytes, **values: Any) -> None:
    """Tell the server of an event, as a browser does."""
    event = {"type": "event", "name": name, "values": as_map(**values)}
    told = {"kind": "MessageSent", "msg_type": "bokeh_event", "msg_data": event}
    await visitor.send("PATCH-DOC", {"events": [told]}, *parts)
    await visitor.reply("OK", "ERROR")


def as_map(**values: Any) -> dict[str, Any]:
    """Return values as Bokeh's messages have a dictionary."""
    return {"type": "map", "entries": [list(item) for item in values.items()]}
