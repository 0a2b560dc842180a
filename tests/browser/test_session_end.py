"""The end of a session: what a page held on the server goes with it."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import psutil
import pytest
from playwright.sync_api import Browser, Page, ViewportSize, expect

from tests.browser.conftest import DRAWN, ERRORS, IDLE, new_context, serving, show, wait_for
from tests.browser.test_live_in_browser import connect

pytestmark = pytest.mark.browser

MOST_PAGES = 6
"""Most pages until one of them adds no thread: on two cores, the pools of a server have five."""
SOON = ("--unused-session-lifetime", "500", "--check-unused-sessions", "200")
"""Flags of a server that discards a closed page within a second, not half a minute."""
PAGES = int(os.environ.get("INS_LAB_PAGES", "2"))
"""Pages with a stream that are opened and closed; the bar of the laboratory is 20."""
SMALL: ViewportSize = {"width": 900, "height": 600}
"""Size of the windows [px]: streams and the 3-D view are drawn without a graphics card."""
SETTLED = 6.0
"""Time for which nothing changes when all has ended [s]: a page is discarded and its station ends in 2 s."""


class Served(NamedTuple):
    """A server that discards closed pages soon: its address, its process, and its folder of uploads."""

    address: str
    process: psutil.Process
    uploads: Path


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Return one server for all tests: each compares what the server holds before and after its pages."""
    uploads = tmp_path_factory.mktemp("uploads")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(uploads))
        with serving(*SOON) as (address, process):
            yield Served(address, psutil.Process(process.pid), uploads)


def ports(server: psutil.Process) -> int:
    """Return on how many ports a server listens."""
    return sum(one.status == psutil.CONN_LISTEN for one in server.net_connections("tcp"))


def leave_when(page: Page) -> None:
    wait_for(page, DRAWN)
    show(page, "3-D")
    expect(page.frame_locator("iframe").get_by_text("Connected")).to_be_visible()


@pytest.mark.proof
def test_a_closed_page_leaves_no_port_and_no_thread(chromium: Browser, served: Served) -> None:
    address, server, _ = served
    threads = [0]
    # Pools of threads may still grow to their size; what a page leaves behind grows with each one.
    while len(threads) < 3 or (threads[-1] > threads[-2] and len(threads) < MOST_PAGES):
        context = new_context(chromium, viewport=SMALL)
        page = context.new_page()
        page.goto(address + ERRORS)
        alone = ports(server)
        leave_when(page)
        assert ports(server) > alone
        context.close()
        wait_for_ports(server, alone)
        threads.append(server.num_threads())
    assert threads[-1] <= threads[-2]


@pytest.mark.proof
def test_a_closed_page_leaves_no_upload_and_no_recording(chromium: Browser, served: Served) -> None:
    address, server, uploads = served
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as simulator:
        simulator.bind(("127.0.0.1", 0))
        context = new_context(chromium)
        page = context.new_page()
        page.goto(address + ERRORS)
        wait_for(page, DRAWN)
        show(page, "Missions")
        page.get_by_role("button", name="Import", exact=True).click()
        page.locator("input[type=file][multiple]").set_input_files(
            {"name": "a.csv", "mimeType": "text/csv", "buffer": b"no flight"}
        )
        expect(page.get_by_role("alert").filter(has_text="a.csv")).to_be_visible()
        assert [path.name for path in uploads.glob("ins-lab-upload-*/1/*")] == ["a.csv"]
        page.get_by_role("button", name="X-Plane", exact=True).click()
        page.get_by_role("textbox", name="Port").fill(str(simulator.getsockname()[1]))
        page.get_by_role("button", name="Start").click()
        expect(page.get_by_text("0 samples")).to_be_visible()
        assert server.net_connections("udp")
        context.close()
        wait_until(lambda: not server.net_connections("udp") and not list(uploads.glob("ins-lab-upload-*")))


def settled(process: psutil.Process) -> tuple[int, int]:
    """Return the numbers of the threads and of the open sockets of a server when they change no more."""
    found, since = (0, 0), time.monotonic()
    while time.monotonic() - since < SETTLED:
        now = process.num_threads(), len(process.net_connections("all"))
        if now != found:
            found, since = now, time.monotonic()
        time.sleep(0.1)
    return found


@pytest.mark.proof
def test_closed_pages_with_a_stream_leave_no_thread_and_no_port(chromium: Browser, served: Served) -> None:
    address, server, _ = served

    def visit(pages: int) -> None:
        opened = [new_context(chromium, viewport=SMALL).new_page() for _ in range(pages)]
        for page in opened:
            page.goto(address)
            wait_for(page, IDLE)
        for page in opened:  # a stream takes the processor that a page needs to open
            connect(page)
        for page in opened:
            page.context.close()

    visit(1)
    first = settled(server)
    visit(PAGES)
    last = settled(server)
    print(f"{PAGES} pages: threads {first[0]} and then {last[0]}, sockets {first[1]} and then {last[1]}")
    # A pool may start a thread for a page that computes beside another; a station would leave three.
    assert last[0] <= first[0] + 2
    assert last[1] <= first[1]


def wait_until(what: Callable[[], bool]) -> None:
    """Wait for something to become true."""
    end = time.monotonic() + 30
    while not what():
        assert time.monotonic() < end
        time.sleep(0.1)


def wait_for_ports(server: psutil.Process, count: int) -> None:
    """Wait until a server listens on no more ports than this."""
    wait_until(lambda: ports(server) <= count)
