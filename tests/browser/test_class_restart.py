"""A class of thirty behind nginx, whose server is restarted: nobody loses settings or solved steps."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import threading
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest
from playwright.sync_api import Browser, expect

from dashboards.teaching.student_bar import FOLLOWING
from dashboards.teaching.teacher import COOKIE
from tests.benchmarks.followers import CODE
from tests.browser.conftest import DRAWN, new_context, shown, wait_for
from tests.browser.nginx import nginx_before
from tests.browser.returning import RESTARTS, Student
from tests.browser.test_restart import BACK, solve_a_step
from tests.security.conftest import START, free_port, serving

pytestmark = [pytest.mark.browser, pytest.mark.proof, pytest.mark.timeout(2400)]

STUDENTS = int(os.environ.get("INS_LAB_CLASS_PAGES", "30")) - 1
"""Pages over websockets, a teacher and a follower among them; with a browser, the class has thirty."""
PATIENCE_OF_ALL = 900.0
"""Longest time for all pages to open, or to come back [s]; on a free core, thirty take 40 s."""
T = TypeVar("T")
FLIGHT = "mission=los_angeles&trajectory.imu_rate=50"
LIST = "beside=Lessons"


class Class:
    """The pages of a class that are no browsers: a teacher, a student who follows, and students who explore.

    Attributes
    ----------
    code : str
        Code of the class.
    """

    def __init__(self, address: str, teacher: str) -> None:
        self._address, self._cookie = address, teacher
        self._pages: list[Student] = []
        self.code = ""

    async def open(self) -> None:
        """Open all pages; who explores has settings and a tab of his own, and solves a step."""
        teacher = Student(self._address, f"?{FLIGHT}", self._cookie)
        await teacher.open()
        await teacher.click("Start a class")
        await teacher.arrives("?class=")
        found = CODE.search(teacher._seen)
        assert found is not None
        self.code = found[1]
        follower = Student(self._address, f"?class={self.code}")
        await follower.open()
        await follower.arrives(FOLLOWING)
        tabs = ("Errors", "Flight")
        students = [
            Student(self._address, f"?class={self.code}&{FLIGHT}&seed={n}&tab={tabs[n % len(tabs)]}&{LIST}")
            for n in range(2, STUDENTS)
        ]
        await asyncio.gather(*(_work(student, number) for number, student in enumerate(students)))
        self._pages = [teacher, follower, *students]

    async def come_back(self) -> list[tuple[Student, Student]]:
        """Wait for the end of all pages and for the next server; return the pages of before and of after."""
        codes = await asyncio.gather(*(page.ends() for page in self._pages))
        assert set(codes) == {RESTARTS}
        after = await asyncio.gather(*(page.come_back() for page in self._pages))
        for old, new in zip(self._pages, after, strict=True):
            await new.shows(old.search)
        await after[0].arrives("Close the class")
        await after[1].arrives(FOLLOWING)
        return list(zip(self._pages, after, strict=True))

    def close(self) -> None:
        """Leave."""
        for page in self._pages:
            page.close()


async def _work(student: Student, number: int) -> None:
    """Open a page, solve a step, and choose a setting of one's own."""
    await student.open()
    await student.solve()
    await student.choose(0.051 + 1e-3 * number)


@contextmanager
def in_a_thread() -> Iterator[Callable[[Coroutine[Any, Any, T]], Future[T]]]:
    """Run a loop of events in a thread: that of the tests belongs to the browser."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    try:
        yield lambda work: asyncio.run_coroutine_threadsafe(work, loop)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(START)


@pytest.mark.parametrize("processes", ["1", "2"])
def test_a_class_of_thirty_comes_back_through_nginx(
    chromium: Browser, tmp_path: Path, processes: str
) -> None:
    port = free_port()
    with ExitStack() as stack:
        outside = stack.enter_context(nginx_before(port, tmp_path))
        run = stack.enter_context(in_a_thread())
        flags = ["--teacher", "--proxy", "127.0.0.1", "--processes", processes]
        flags += ["--origin", f"localhost:{outside}", "--origin", f"127.0.0.1:{outside}"]
        address = f"https://localhost:{outside}"
        context = new_context(chromium, ignore_https_errors=True, viewport={"width": 1440, "height": 900})
        page = context.new_page()
        with serving(tmp_path, *flags, port=port) as served:
            token = re.search(r"/teach\?key=([\w-]+)", served.log.read_text())
            assert token is not None
            pages = Class(address, f"{COOKIE}_{port}={token[1]}")
            run(pages.open()).result(PATIENCE_OF_ALL)
            page.goto(f"{address}/?class={pages.code}&{FLIGHT}&seed=1&tab=Errors")
            wait_for(page, DRAWN)
            solve_a_step(page)
            wait_for(page, "location.search.includes('beside=Lessons')")
            before = page.evaluate("location.search")
            (cookie,) = [one for one in context.cookies() if one["name"].startswith("ins_lab_browser")]
            assert cookie["secure"]  # nginx says that the browser talks TLS, and is believed
            coming = run(pages.come_back())
            served.popen.send_signal(signal.SIGTERM)
            assert served.popen.wait(START) == -signal.SIGTERM
            assert "Traceback" not in served.log.read_text()
        with serving(tmp_path, *flags, port=port) as again:
            pairs = coming.result(PATIENCE_OF_ALL)
            assert len(pairs) == STUDENTS
            for old, new in pairs:
                assert (new.search, new.kept) == (old.search, old.kept)
            assert sum("04-tuning-r" in new.kept for _, new in pairs) == STUDENTS - 2
            wait_for(page, BACK)
            wait_for(page, DRAWN)
            shown(page, "Errors")
            expect(page.get_by_text("1 of 3 solved")).to_be_visible()
            expect(page.get_by_text("You are exploring.")).to_be_visible()
            wait_for(page, f"location.search === {before!r}")
            assert "Traceback" not in again.log.read_text()
            for _, new in pairs:
                new.close()
        context.close()
