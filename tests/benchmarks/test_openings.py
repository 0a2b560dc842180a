"""Openings: thirty pages opened at once, and two hundred one after the other.

A class opens the lab when its teacher says so, while a person in an open page goes on to move a slider. The
visitors draw nothing: what is measured is the server.
"""

from __future__ import annotations

import asyncio
from itertools import cycle

import numpy as np
import psutil
import pytest

from dashboards.server import CHECK
from tests.benchmarks.visitor import Visitor
from tests.browser.conftest import serving

pytestmark = pytest.mark.benchmark

VISITORS = 30
ALL_OPEN = 12.0
"""Longest time until thirty pages, opened at once, show their plots [s]."""
ANSWER = 1.0
"""Longest time until a moved slider of an open page has its new curves meanwhile [s]."""


SESSIONS, EARLY = 200, 10
"""Pages that are opened and closed one after the other, and after how many memory is measured first."""
GROWTH = 1.1
"""Most memory after the last of these pages, in that after the first ones."""
ENDED = 40.0
"""Time after which a closed page has ended, and its memory has gone back [s]."""


async def burst(address: str) -> tuple[Visitor, list[Visitor], list[float]]:
    """Open one page alone and then thirty at once; move the slider of the first until all are open."""
    first, alone = Visitor(address), Visitor(address)
    await first.open()  # compiles and reads what the first visitor needs
    await alone.open()
    values = cycle(np.linspace(0.04, 0.06, 21).tolist())
    for _ in range(5):
        await first.move(next(values))
    visitors = [Visitor(address) for _ in range(VISITORS)]
    opening = asyncio.gather(*(visitor.open() for visitor in visitors))
    moves: list[float] = []
    while not opening.done():
        moves.append(await first.move(next(values)))
        await asyncio.sleep(0.1)  # a hand that moves a slider ten times a second
    await opening
    for visitor in (first, alone, *visitors):
        visitor.close()
    return alone, visitors, moves


def test_thirty_pages_opened_at_once() -> None:
    with serving() as (address, _process):
        alone, visitors, moves = asyncio.run(burst(address))
    for word in ("framed", "drawn", "complete"):
        seconds = [getattr(visitor, word) for visitor in visitors]
        print(
            f"\n{word}: alone {getattr(alone, word):.2f} s; of {VISITORS} at once the first "
            f"{min(seconds):.2f} s, median {np.median(seconds):.2f} s, last {max(seconds):.2f} s",
            end="",
        )
    print(f"\n{len(moves)} moves meanwhile: median {np.median(moves):.2f} s, longest {max(moves):.2f} s")
    assert max(visitor.drawn for visitor in visitors) <= ALL_OPEN
    assert max(moves) <= ANSWER


async def one_after_the_other(address: str, server: psutil.Process) -> list[float]:
    """Open and close pages, each with a slider at a place of its own; return the memory twice [MB]."""
    taken = []
    for number in range(1, SESSIONS + 1):
        visitor = Visitor(address)
        await visitor.open()
        await visitor.move(0.06 + 0.0001 * number)
        visitor.close()
        if number in (EARLY, SESSIONS):
            await asyncio.sleep(ENDED)
            memory = server.memory_info()
            # Pages of files belong to the system: it takes them when others need memory, and one compiled
            # kernel brings 100 MB of the compiler's.
            taken.append((memory.rss - memory.shared) / 1e6)
    return taken


def test_two_hundred_pages_one_after_the_other() -> None:
    with serving("--check-unused-sessions", str(CHECK)) as (address, process):
        server = psutil.Process(process.pid)
        before = sum(server.cpu_times()[:2])
        early, late = asyncio.run(one_after_the_other(address, server))
        spent = sum(server.cpu_times()[:2]) - before
    print(
        f"\nmemory after {EARLY} pages {early:.0f} MB, after {SESSIONS} {late:.0f} MB ({late / early:.2f} "
        f"times); {spent / SESSIONS:.2f} s of a processor for each page"
    )
    assert late <= GROWTH * early
