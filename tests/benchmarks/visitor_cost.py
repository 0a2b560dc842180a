"""What visitors cost a server: ``python -m tests.benchmarks.visitor_cost [VISITORS] [flags of serve]``.

Each opens a page of his own, moves a slider some times, and rests. The seconds are those of a processor, of
all processes of the server together, so that other work on the machine does not count.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
import time
from pathlib import Path

import psutil

from tests.benchmarks.visitor import Visitor
from tests.security.conftest import Served, serving

MOVES = 10
"""Moves of the slider of each visitor."""
REST = 10.0
"""Time for which all pages rest [s]."""
QUERY = "?mission=los_angeles&seed={}"
"""A flight of 105 s at 200 Hz, as a course has it."""


def processes(served: Served) -> list[psutil.Process]:
    """Return all processes of a server."""
    return [served.process, *served.process.children(recursive=True)]


def spent(served: Served) -> float:
    """Return the time of a processor that a server has taken so far [s]."""
    return sum(sum(one.cpu_times()[:2]) for one in processes(served))


def memory(served: Served) -> float:
    """Return the memory of a server that it shares with nobody [MB]."""
    return sum(one.memory_full_info().uss for one in processes(served)) / 2**20


async def measure(served: Served, number: int) -> None:
    """Print what a number of visitors cost."""
    address = f"http://127.0.0.1:{served.port}"
    begun = memory(served)
    first = Visitor(address, QUERY.format(0))
    await first.open()
    await first.move(0.04)
    before, at = memory(served), spent(served)
    visitors = [Visitor(address, QUERY.format(n)) for n in range(1, number + 1)]
    for visitor in visitors:
        await visitor.open()
    opened = spent(served)
    print(f"{number} visitors; a server without pages has {begun:.0f} MB, with the first {before:.0f} MB")
    print(f"opening: {(opened - at) / number:.2f} s, {(memory(served) - before) / number:.0f} MB each")
    for step in range(MOVES):
        for visitor in visitors:
            await visitor.move(0.03 + 1e-3 * step)
    moved = spent(served)
    print(
        f"a move: {(moved - opened) / number / MOVES:.3f} s; {(memory(served) - before) / number:.0f} MB each"
    )
    begin = time.monotonic()
    waits = await asyncio.gather(*(_moves(visitor) for visitor in visitors))
    lasted, together = time.monotonic() - begin, spent(served)
    every = sorted(wait for one in waits for wait in one)
    print(
        f"all at once, {MOVES} moves each: {(together - moved) / number / MOVES:.3f} s a move, "
        f"{number * MOVES / lasted:.1f} moves/s, {(together - moved) / lasted:.1f} cores; "
        f"median {every[len(every) // 2]:.2f} s, 95 % {every[int(0.95 * len(every))]:.2f} s"
    )
    await asyncio.sleep(REST)
    print(f"at rest: {(spent(served) - together) / number / REST * 1000:.1f} ms of a processor a second")
    for visitor in (first, *visitors):
        visitor.close()


async def _moves(visitor: Visitor) -> list[float]:
    return [await visitor.move(0.05 + 1e-3 * step) for step in range(MOVES)]


def main() -> None:
    """Measure, with a number of visitors and flags for the server."""
    number, *flags = sys.argv[1:] or ["10"]
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), *flags) as served:
        asyncio.run(measure(served, int(number)))


if __name__ == "__main__":
    main()
