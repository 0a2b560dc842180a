"""How long students wait who each work: ``python -m tests.benchmarks.working_class STUDENTS CORES [flags]``.

The server, with these flags of `serve`, has some cores of its own; the pages of students are on the others.
Each student changes a setting again and again, after pauses of random length, and waits for the new curves.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

from tests.benchmarks.visitor import Visitor
from tests.benchmarks.visitor_cost import QUERY, memory, processes, spent
from tests.security.conftest import Served, serving

PAUSE = 5.0
"""Mean time between two changes of a student [s]."""
LASTS = 60.0
"""For how long the class works [s]."""


async def work(visitor: Visitor, number: int, until: float) -> list[float]:
    """Return the waits of a student [s]."""
    chance = np.random.default_rng(number)
    waits: list[float] = []
    while time.monotonic() + (pause := float(chance.exponential(PAUSE))) < until:
        await asyncio.sleep(pause)
        waits.append(await visitor.move(0.03 + 1e-3 * len(waits)))
    return waits


async def measure(served: Served, students: int, cores: int) -> None:
    """Print the waits of a class, and what they took."""
    begin = time.monotonic()
    visitors = [Visitor(f"http://127.0.0.1:{served.port}", QUERY.format(n)) for n in range(students)]
    await asyncio.gather(*(visitor.open() for visitor in visitors))
    opened = [visitor.drawn for visitor in visitors]
    print(
        f"{students} students on {cores} core{'s' * (cores > 1)}: all open at once, drawn after "
        f"{np.median(opened):.1f} s (median), {max(opened):.1f} s (longest), complete after "
        f"{time.monotonic() - begin:.1f} s"
    )
    begin, at = time.monotonic(), spent(served)
    found = await asyncio.gather(*(work(one, n, begin + LASTS) for n, one in enumerate(visitors)))
    lasted = time.monotonic() - begin
    waits = np.concatenate(found)
    print(
        f"each changes something every {PAUSE:.0f} s: {waits.size / lasted:.1f} changes/s, waits "
        f"{np.median(waits):.2f} s (median), {np.percentile(waits, 95):.2f} s (95 %), "
        f"{waits.max():.2f} s (longest); {(spent(served) - at) / lasted:.2f} cores, {memory(served):.0f} MB"
    )
    for visitor in visitors:
        visitor.close()


def main() -> None:
    """Measure a class on some of the cores of this machine."""
    students, cores, *flags = sys.argv[1:]
    every = psutil.Process().cpu_affinity()
    assert every is not None
    number = int(cores)
    assert 0 < number < len(every), f"accepted are 1 to {len(every) - 1} cores: the students need one"
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), *flags) as served:
        for process in processes(served):
            process.cpu_affinity(every[:number])
        psutil.Process().cpu_affinity(every[number:])
        asyncio.run(measure(served, int(students), number))


if __name__ == "__main__":
    main()
