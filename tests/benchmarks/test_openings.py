"""Openings: thirty pages opened at once, while a person in an open one goes on to move a slider.

A class opens the lab when its teacher says so. The visitors draw nothing: what is measured is the server.
"""

from __future__ import annotations

import asyncio
from itertools import cycle

import numpy as np
import pytest

from tests.benchmarks.visitor import Visitor
from tests.browser.conftest import serving

pytestmark = pytest.mark.benchmark

VISITORS = 30
ALL_OPEN = 12.0
"""Longest time until thirty pages, opened at once, show their plots [s]."""
ANSWER = 1.0
"""Longest time until a moved slider of an open page has its new curves meanwhile [s]."""


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
