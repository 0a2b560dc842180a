"""A laboratory in two processes behind one port: what they share, and who is sent where."""

from __future__ import annotations

import asyncio
import re
import secrets
import signal
import time
import zlib
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from dashboards.teaching.student_bar import FOLLOWING
from dashboards.teaching.teacher import COOKIE
from lab.missions import add_mission, mission
from tests.benchmarks.followers import CODE
from tests.browser.returning import RESTARTS, Student
from tests.security.conftest import START, Served, serving

pytestmark = pytest.mark.timeout(600)

Run = Callable[[Awaitable[Any]], Any]

FLIGHT = "mission=los_angeles&trajectory.imu_rate=50"


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Return a laboratory in two processes."""
    with serving(tmp_path_factory.mktemp("two"), "--processes", "2", "--teacher") as served:
        yield served


def processes(served: Served) -> list[psutil.Process]:
    """Return the processes that serve pages, in their order."""
    found = [one for one in served.process.children() if "--multiprocessing-fork" in one.cmdline()]
    return sorted(found, key=lambda one: one.create_time())


def pages(served: Served) -> list[int]:
    """Return how many connections each process has."""
    return [
        sum(way.status == psutil.CONN_ESTABLISHED and way.laddr.port == served.port for way in ways)
        for ways in (one.net_connections("tcp") for one in processes(served))
    ]


def browser_of(served: Served, number: int) -> str:
    """Return the cookie of a browser that belongs to a process."""
    while True:
        value = secrets.token_urlsafe(32)
        if zlib.crc32(value.encode()) % 2 == number:
            return f"ins_lab_browser_{served.port}={value}"


def test_visitors_are_spread_and_stay_with_their_process(two: Served, run: Run) -> None:
    async def visit() -> None:
        for number in range(2):
            opened = [Student(address(two), f"?{FLIGHT}", browser_of(two, number)) for _ in range(2)]
            before = pages(two)
            for page in opened:
                await page.open()
            await _becomes(two, [have + 2 * (one == number) for one, have in enumerate(before)])
            for page in opened:
                page.close()
            await _becomes(two, [0, 0])

    run(visit())


def test_both_have_the_same_missions(two: Served, own_missions: Path, run: Run) -> None:
    async def visit() -> None:
        name = "seen_by_both"
        add_mission(mission("los_angeles").recording, name, title="Seen by both", overwrite=True)
        for number in range(2):
            page = Student(address(two), f"?mission={name}&trajectory.imu_rate=50", browser_of(two, number))
            await page.open()
            assert f"mission={name}" in page.search
            page.close()

    run(visit())


def test_a_student_of_a_class_and_who_opens_live_are_sent_to_the_first(two: Served, run: Run) -> None:
    async def visit() -> None:
        token = re.search(r"/teach\?key=([\w-]+)", two.log.read_text())
        assert token is not None
        teacher = Student(address(two), f"?{FLIGHT}", f"{COOKIE}_{two.port}={token[1]}")
        await teacher.open()
        await teacher.click("Start a class")
        await teacher.arrives("?class=")
        code = CODE.search(teacher._seen)
        assert code is not None
        cookie = browser_of(two, 1)
        student = Student(address(two), f"?class={code[1]}", cookie)
        await student.open()
        await student.arrives(FOLLOWING)
        alone = Student(address(two), f"?{FLIGHT}&seed=5", cookie)
        await alone.open()
        await _becomes(two, [2, 1])
        await alone.turn_to("Live")
        await alone.arrives('"moves",true')
        assert "tab=Live" in alone.search
        assert "seed=5" in alone.search
        alone.close()
        async with two.visitor(f"/{alone.search}", Cookie=cookie):
            await _becomes(two, [3, 0])
        for page in (teacher, student):
            page.close()

    run(visit())


@pytest.mark.proof
def test_a_process_that_ends_is_started_again_and_the_others_do_not_notice(two: Served, run: Run) -> None:
    async def visit() -> None:
        await _becomes(two, [0, 0])
        first, second = (Student(address(two), f"?{FLIGHT}", browser_of(two, one)) for one in range(2))
        await first.open()
        await second.open()
        processes(two)[1].kill()
        assert await second.ends() != RESTARTS
        back = await second.come_back()
        await first.turn_to("Flight")
        await first.shows(f"{first.search}&tab=Flight")
        for page in (first, back):
            page.close()

    run(visit())


@pytest.mark.proof
def test_all_end_together_and_tell_their_pages(tmp_path: Path, run: Run) -> None:
    async def visit(served: Served) -> list[int]:
        opened = [Student(address(served), f"?{FLIGHT}", browser_of(served, one)) for one in range(2)]
        for page in opened:
            await page.open()
        served.popen.send_signal(signal.SIGTERM)
        return [await page.ends() for page in opened]

    with serving(tmp_path, "--processes", "2") as served:
        parts = served.process.children(recursive=True)
        assert run(visit(served)) == [RESTARTS, RESTARTS]
        assert served.popen.wait(START) == -signal.SIGTERM
        _, alive = psutil.wait_procs(parts, START)
        assert alive == []
        assert "Traceback" not in served.log.read_text()


def address(served: Served) -> str:
    """Return the address of a laboratory."""
    return f"http://127.0.0.1:{served.port}"


async def _becomes(served: Served, expected: list[int]) -> None:
    until = time.monotonic() + START
    while (found := pages(served)) != expected:
        assert time.monotonic() < until, (found, expected)
        await asyncio.sleep(0.1)
