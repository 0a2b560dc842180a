"""X-Plane on the page Live in a browser: chosen, navigated with, compared with its truth, and paused."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, ViewportSize, expect
from xplane_simulator import XPlaneSimulator, montreal, standing_first

from dashboards.devices import VARIABLE
from tests.browser.conftest import IDLE, new_context, serving, show, wait_for

SMALL: ViewportSize = {"width": 900, "height": 600}
"""Size of the window [px]: a stream is drawn all the time, without a graphics card."""
REST = 14.0
"""Time on the runway before the flight [s]: the navigator levels over ten."""

FLOWN = 204.0
"""Time that is flown [s]: at its end the clock stands still, and a slow computer takes two minutes to it."""


@pytest.fixture
def xplane() -> Iterator[XPlaneSimulator]:
    """Return a stand-in for X-Plane that is paused until a page is there to see its flight."""
    with XPlaneSimulator(standing_first(montreal(FLOWN), REST)) as simulator:
        simulator.paused = True
        yield simulator


@pytest.fixture
def visited(xplane: XPlaneSimulator, chromium: Browser, monkeypatch: pytest.MonkeyPatch) -> Iterator[Page]:
    """Return a page of a server that allows the stand-in for X-Plane."""
    monkeypatch.setenv(VARIABLE, address_of(xplane))
    with serving() as (address, _server):
        context = new_context(chromium, viewport=SMALL)
        page = context.new_page()
        page.goto(address)
        wait_for(page, IDLE)
        yield page
        context.close()


def address_of(xplane: XPlaneSimulator) -> str:
    """Return the address at which a page finds the stand-in."""
    return f"xplane:127.0.0.1:{xplane.port}"


def connect(page: Page, address: str) -> None:
    """Choose a source on the page Live, and connect it."""
    show(page, "Live")
    page.get_by_role("combobox").filter(has_text="Simulated device").click()
    page.get_by_role("menuitem", name=address).click()
    expect(page.get_by_text("X-Plane sends its motion")).to_be_visible()
    page.get_by_role("button", name="Connect", exact=True).click()
    page.get_by_role("button", name="Disconnect").wait_for()


@pytest.mark.proof
@pytest.mark.browser
def test_x_plane_is_navigated_compared_and_paused(visited: Page, xplane: XPlaneSimulator) -> None:
    page = visited
    xplane.paused = False
    connect(page, address_of(xplane))
    expect(page.get_by_text("streaming", exact=True)).to_be_visible()
    page.get_by_role("button", name="Errors", exact=True).click()
    expect(page.get_by_text("Errors are estimate minus truth.")).to_be_visible()
    # A verdict, which only a navigator has, takes the place of the word when there are enough fixes.
    expect(page.get_by_text(re.compile("^(Navigating|Verdict)$"))).to_be_visible()
    xplane.paused = True
    expect(page.get_by_text("X-Plane is paused: its clock has stood still")).to_be_visible()
    xplane.paused = False
    expect(page.get_by_text("streaming", exact=True)).to_be_visible()
    expect(page.get_by_text("X-Plane is paused")).to_have_count(0)
    xplane.jump(40.0)
    expect(page.get_by_text("since the aircraft was moved by")).to_be_visible()
    page.get_by_role("button", name="Disconnect").click()
    expect(page.get_by_text("Disconnected.")).to_be_visible()
