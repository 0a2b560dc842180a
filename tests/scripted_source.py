"""Scripted source: a transport that brings what a test gives it, and how to wait for what it brings."""

from __future__ import annotations

import time
from collections.abc import Callable

from lab.data.streams.source import Source
from lab.data.streams.source_status import STREAMING, Status
from lab.data.streams.transport import Chunk

PATIENCE = 240.0
"""Longest time to wait for what must happen [s]: build machines are slow."""


def until(happened: Callable[[], bool]) -> None:
    """Wait until something has happened."""
    end = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.002)


def streaming(source: Source) -> Status:
    """Return a status while it streams: a busy computer may see any source stale for a moment."""
    seen: list[Status] = []

    def look() -> bool:
        seen[:] = [source.status]
        return seen[0].state == STREAMING and seen[0].rate > 0

    until(look)
    return seen[0]


class Scripted:
    """A transport that brings what it is given."""

    address = "tcp:scripted:1"
    reconnects = True

    def __init__(self) -> None:
        self.steps: list[Chunk | BaseException] = []
        self.openings: list[BaseException] = []
        self.opened = self.closed = 0

    def open(self) -> None:
        """Count, and fail as told."""
        self.opened += 1
        if self.openings:
            raise self.openings.pop(0)

    def read(self, longest: float) -> Chunk:
        """Return or raise the next step."""
        if not self.steps:
            time.sleep(0.001)
            return Chunk(time.monotonic(), b"")
        step = self.steps.pop(0)
        if isinstance(step, BaseException):
            raise step
        return step

    def close(self) -> None:
        """Count."""
        self.closed += 1
