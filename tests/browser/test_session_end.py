"""The end of a session: what a page held on the server goes with it."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.conftest import DRAWN, new_context, serving

pytestmark = pytest.mark.browser

MOST_PAGES = 6
"""Most pages until one of them adds no thread: on two cores, the pools of a server have five."""
SOON = ("--unused-session-lifetime", "500", "--check-unused-sessions", "200")


def ports(server: psutil.Process) -> int:
    """Return on how many ports a server listens."""
    return sum(one.status == psutil.CONN_LISTEN for one in server.net_connections("tcp"))


def leave_when(page: Page) -> None:
    page.wait_for_function(DRAWN)
    page.get_by_role("tab", name="3-D", exact=True).click()
    expect(page.frame_locator("iframe").get_by_text("Connected")).to_be_visible()


def test_a_closed_page_leaves_no_port_and_no_thread(chromium: Browser) -> None:
    with serving(*SOON) as (address, process):
        server = psutil.Process(process.pid)
        threads = [0]
        # Pools of threads may still grow to their size; what a page leaves behind grows with each one.
        while len(threads) < 3 or (threads[-1] > threads[-2] and len(threads) < MOST_PAGES):
            # Small: the 3-D view is drawn without a graphics card.
            context = new_context(chromium, viewport={"width": 900, "height": 600})
            page = context.new_page()
            page.goto(address)
            alone = ports(server)
            leave_when(page)
            assert ports(server) > alone
            context.close()
            wait_for_ports(server, alone)
            threads.append(server.num_threads())
        assert threads[-1] <= threads[-2]


def test_a_closed_page_leaves_no_upload_and_no_recording(
    chromium: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with serving(*SOON) as (address, process), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as simulator:
        simulator.bind(("127.0.0.1", 0))
        server = psutil.Process(process.pid)
        context = new_context(chromium)
        page = context.new_page()
        page.goto(address)
        page.wait_for_function(DRAWN)
        page.get_by_role("tab", name="Missions", exact=True).click()
        page.get_by_role("button", name="Import", exact=True).click()
        page.locator("input[type=file][multiple]").set_input_files(
            {"name": "a.csv", "mimeType": "text/csv", "buffer": b"no flight"}
        )
        expect(page.get_by_role("alert").filter(has_text="a.csv")).to_be_visible()
        assert [path.name for path in tmp_path.glob("ins-lab-upload-*/1/*")] == ["a.csv"]
        page.get_by_role("button", name="X-Plane", exact=True).click()
        page.get_by_role("textbox", name="Port").fill(str(simulator.getsockname()[1]))
        page.get_by_role("button", name="Start").click()
        expect(page.get_by_text("0 samples")).to_be_visible()
        assert server.net_connections("udp")
        context.close()
        wait_until(lambda: not server.net_connections("udp") and not list(tmp_path.glob("ins-lab-upload-*")))


def wait_until(what: Callable[[], bool]) -> None:
    """Wait for something to become true."""
    end = time.monotonic() + 30
    while not what():
        assert time.monotonic() < end
        time.sleep(0.1)


def wait_for_ports(server: psutil.Process, count: int) -> None:
    """Wait until a server listens on no more ports than this."""
    wait_until(lambda: ports(server) <= count)
