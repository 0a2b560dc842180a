"""A class of thirty follows its teacher over websockets: how fast a step arrives, and what a page costs."""

from __future__ import annotations

import asyncio
import os
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from tests.benchmarks.followers import Step, class_of, steps
from tests.benchmarks.visitor import Visitor
from tests.security.conftest import Served, serving

SECONDS = float(os.environ.get("INS_LAB_CLASS_SECONDS", "20"))
"""How long the class follows [s]; the bar of the laboratory is 300."""
STUDENTS = int(os.environ.get("INS_LAB_CLASS_STUDENTS", "30"))
"""Pages that follow."""
ARRIVES = 1.0
"""Time within which 95 % of the steps arrive [s]."""
MEMORY = 25.0
"""Most memory of a session [MB]."""

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(600 + 3 * SECONDS)]


async def follow(served: Served) -> tuple[list[Step], float, float, float]:
    """Return the steps; CPU of the server for each [s], its share of a core, and memory of a page [MB]."""
    alone = Visitor(f"http://127.0.0.1:{served.port}")
    await alone.open()  # compiles and reads what the first visitor needs
    before = served.process.memory_info().rss
    async with class_of(served, STUDENTS) as (teacher, followers):
        spent, begin = served.process.cpu_times(), time.monotonic()
        taken = [step async for step in steps(teacher, followers, SECONDS)]
        now, lasted = served.process.cpu_times(), time.monotonic() - begin
        memory = (served.process.memory_info().rss - before) / (STUDENTS + 1) / 2**20
    alone.close()
    cpu = now.user + now.system - spent.user - spent.system
    return taken, cpu / len(taken), cpu / lasted, memory


def test_a_class_follows_its_teacher(tmp_path: Path) -> None:
    with serving(tmp_path, "--teacher") as served:
        taken, cpu, share, memory = asyncio.run(follow(served))
        written = served.log.read_text()
    for kind in dict.fromkeys(step.kind for step in taken):
        delays = np.concatenate([step.delays for step in taken if step.kind == kind])
        print(
            f"\n{kind}: {len(delays)} arrivals, median {np.median(delays):.2f} s, 95 % "
            f"{np.percentile(delays, 95):.2f} s, longest {delays.max():.2f} s",
            end="",
        )
    every = np.concatenate([step.delays for step in taken])
    print(
        f"\nall: {STUDENTS} students, {len(taken)} steps in a row; 95 % within "
        f"{np.percentile(every, 95):.2f} s; {np.isinf(every).sum()} did not arrive; server {cpu:.2f} s of "
        f"CPU a step, {share:.0%} of a core; {memory:.1f} MB a session; load {psutil.getloadavg()[0]:.1f}"
    )
    assert np.isfinite(every).all()
    assert "Traceback" not in written
    assert np.percentile(every, 95) <= ARRIVES
    assert memory <= MEMORY
