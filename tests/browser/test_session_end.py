"""The end of a session: what a page held on the server goes with it."""

from __future__ import annotations

import time

import psutil
import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.conftest import DRAWN, serving

pytestmark = pytest.mark.browser

SOON = ("--unused-session-lifetime", "500", "--check-unused-sessions", "200")


def ports(server: psutil.Process) -> int:
    """Return on how many ports a server listens."""
    return sum(socket.status == psutil.CONN_LISTEN for socket in server.net_connections("tcp"))


def leave_when(page: Page) -> None:
    page.wait_for_function(DRAWN)
    page.get_by_role("tab", name="3-D", exact=True).click()
    expect(page.frame_locator("iframe").get_by_text("Connected")).to_be_visible(timeout=30_000)


def test_a_closed_page_leaves_no_port_and_no_thread(chromium: Browser) -> None:
    with serving(*SOON) as (address, process):
        server = psutil.Process(process.pid)
        threads = []
        for _ in range(2):
            context = chromium.new_context()
            page = context.new_page()
            page.goto(address)
            alone = ports(server)
            leave_when(page)
            assert ports(server) > alone
            context.close()
            wait_for_ports(server, alone)
            threads.append(server.num_threads())
        assert threads[1] <= threads[0]


def wait_for_ports(server: psutil.Process, count: int) -> None:
    """Wait until a server listens on no more ports than this."""
    end = time.monotonic() + 30
    while ports(server) > count:
        assert time.monotonic() < end, f"still {ports(server)} ports open, expected {count}"
        time.sleep(0.1)
