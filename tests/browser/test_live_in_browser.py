"""The Live page in a browser: a simulated device streams, is unplugged, and leaves nothing behind."""

from __future__ import annotations

import os
import time

import psutil
import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import IDLE, new_context, serving

PAGES = int(os.environ.get("INS_LAB_PAGES", "2"))
"""Pages that are opened and closed; the bar of the laboratory is 20."""
AT_ONCE = ("--unused-session-lifetime", "500", "--check-unused-sessions", "500")
"""Flags of a server that discards a closed page within a second, not half a minute."""
SETTLED = 6.0
"""Time for which nothing changes when all has ended [s]: a page is discarded and its station ends in 2 s."""
RATES = "Bokeh.documents[0].get_model_by_name('live:Angular rate').data.time"

VISIBLE = (
    "[...Bokeh.documents[0]._all_models.values()]"
    ".filter(one => one.type === 'GlyphRenderer' && one.data_source.name === 'live:Angular rate')"
    ".map(one => one.visible)"
)


def connect(page: Page) -> None:
    """Open the page Live and connect the source that it offers first, the simulated device."""
    page.get_by_role("tab", name="Live").click()
    page.get_by_role("button", name="Connect", exact=True).click()
    page.get_by_role("button", name="Disconnect").wait_for()
    page.wait_for_function(f"{RATES}.length > 20")


def newest(page: Page) -> float:
    """Return the time of the newest sample that the browser has [s]."""
    return float(page.evaluate(f"{RATES}.at(-1)"))


@pytest.mark.browser
def test_a_stream_is_drawn_as_it_comes(open_page) -> None:
    page = open_page()
    connect(page)
    before = newest(page)
    page.wait_for_function(f"{RATES}.at(-1) > {before} + 2")
    expect(page.get_by_text("streaming", exact=True)).to_be_visible()
    # The plots end at the newest sample, of all figures.
    ends = "Bokeh.documents[0].get_model_by_name('live time 0').end"
    page.wait_for_function(f"Math.abs({ends} - {RATES}.at(-1)) < 0.5")

    page.get_by_text("forward", exact=True).first.click()
    page.wait_for_function(f"{VISIBLE}.join() === 'false,true,true'")
    page.get_by_text("forward", exact=True).first.click()
    page.wait_for_function(f"{VISIBLE}.join() === 'true,true,true'")

    page.get_by_role("button", name="Pause").click()
    page.get_by_role("button", name="Go on").wait_for()
    page.wait_for_function(IDLE)
    paused = newest(page)
    page.wait_for_timeout(1000)
    assert newest(page) == paused
    page.get_by_role("button", name="Go on").click()
    page.wait_for_function(f"{RATES}.at(-1) > {paused} + 1")

    page.get_by_role("button", name="Unplug for 3 s").click()
    expect(page.get_by_text("lost", exact=True)).to_be_visible()
    expect(page.get_by_text("streaming", exact=True)).to_be_visible()

    page.get_by_role("button", name="Disconnect").click()
    expect(page.get_by_text("Disconnected.")).to_be_visible()


def settled(process: psutil.Process) -> tuple[int, int]:
    """Return the numbers of the threads and of the open sockets of a server when they change no more."""
    found, since = (0, 0), time.monotonic()
    while time.monotonic() - since < SETTLED:
        now = process.num_threads(), len(process.net_connections("all"))
        if now != found:
            found, since = now, time.monotonic()
        time.sleep(0.1)
    return found


@pytest.mark.browser
def test_closed_pages_leave_no_thread_and_no_port(chromium) -> None:
    with serving(*AT_ONCE) as (address, server):

        def visit(pages: int) -> None:
            contexts = [new_context(chromium, viewport={"width": 1440, "height": 900}) for _ in range(pages)]
            for context in contexts:
                page = context.new_page()
                page.goto(address)
                page.wait_for_function(IDLE)
                connect(page)
            for context in contexts:
                context.close()

        process = psutil.Process(server.pid)
        visit(1)
        first = settled(process)
        visit(PAGES)
        last = settled(process)
        print(f"{PAGES} pages: threads {first[0]} and then {last[0]}, sockets {first[1]} and then {last[1]}")
        # A pool may start a thread for a page that computes beside another; a station would leave three.
        assert last[0] <= first[0] + 2
        assert last[1] <= first[1]
