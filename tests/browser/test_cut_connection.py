"""A connection that is cut while the server lives, or refused: nothing is lost, and nobody wonders."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, Locator, Page, ViewportSize, WebSocketRoute, expect

from tests.browser.conftest import (
    DRAWN,
    ERRORS,
    SIZE,
    WHOLE,
    eventually,
    new_context,
    show,
    shown,
    wait_for,
)

pytestmark = pytest.mark.browser

MADE_PLOTS = """
() => {
  const {add} = window.insLabPlots;
  window.madePlots = [];
  window.insLabPlots.add = (view) => {
    window.madePlots.push(view);
    return add.call(window.insLabPlots, view);
  };
}
"""
"""Notes each plot that the browser makes from here on."""
PHONE: ViewportSize = {"width": 390, "height": 844}
BACK = "window.cut !== true && window.insLabReady"


def overlap(one: Locator, other: Locator) -> bool:
    """Return whether two parts of a page that are visible lie over each other."""
    first, second = one.bounding_box(), other.bounding_box()
    assert first is not None and second is not None
    return all(
        first[start] < second[start] + second[size] and second[start] < first[start] + first[size]
        for start, size in (("x", "width"), ("y", "height"))
    )


class Wire:
    """The connections of a page: the server can be made deaf to it, or slow, and the last one can be cut."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._is_deaf = self._is_slow = False
        self._late: list[str | bytes] = []
        self._last: WebSocketRoute | None = None
        page.route_web_socket(re.compile("/ws"), self._take)

    def _take(self, route: WebSocketRoute) -> None:
        server = route.connect_to_server()
        self._last = route
        route.on_message(lambda message: None if self._is_deaf else server.send(message))
        server.on_message(
            lambda message: self._late.append(message) if self._is_slow else route.send(message)
        )

    @contextmanager
    def delayed(self) -> Iterator[list[str | bytes]]:
        """Keep what the server says back until the end; give it."""
        assert self._last is not None
        self._is_slow = True
        yield self._late
        self._is_slow = False
        for message in self._late:
            self._last.send(message)
        self._late.clear()

    def lose(self) -> None:
        """Let nothing more arrive at the server."""
        self._is_deaf = True

    def cut(self) -> None:
        """Cut the connection, and wait until the page is back."""
        assert self._last is not None
        self._page.evaluate("window.cut = true")
        self._is_deaf = False
        self._last.close()
        wait_for(self._page, BACK)


@pytest.fixture(scope="module")
def wired(chromium: Browser, address: str) -> Iterator[tuple[Page, Wire]]:
    """Return a page of a short flight, which tests share, and its connections."""
    context = new_context(chromium, viewport=SIZE)
    page = context.new_page()
    wire = Wire(page)
    page.goto(f"{address}?mission=los_angeles&trajectory.imu_rate=50&{ERRORS.removeprefix('?')}")
    wait_for(page, DRAWN)
    yield page, wire
    context.close()


def test_a_tab_that_is_left_before_it_comes_is_not_made(wired: tuple[Page, Wire]) -> None:
    """Open a tab by its key while nothing arrives, and go back: the page says so, and does not make it."""
    page, wire = wired
    frame = page.locator(".frame")
    silence = page.get_by_role("status").filter(has_text="The server does not answer")
    page.evaluate(MADE_PLOTS)
    with wire.delayed() as late:
        page.keyboard.press("2")
        expect(page.get_by_role("tab", name="Flight", exact=True)).to_have_attribute("aria-selected", "true")
        expect(frame).to_contain_text("what was flown, measured and estimated")
        expect(frame.get_by_role("progressbar")).to_be_visible()
        expect(silence).to_be_visible()
        page.set_viewport_size(PHONE)  # it covers neither the tabs, nor the header, nor the time
        covers = [
            page.get_by_role("tablist"),
            page.get_by_role("banner"),
            page.get_by_role("slider", name="Time"),
        ]
        eventually(page, lambda: not any(overlap(silence, one) for one in covers))
        page.set_viewport_size(SIZE)
        eventually(page, lambda: any("Specific force" in str(one) for one in late))
        frame.get_by_role("button", name="Cancel").click()
        expect(frame).to_have_count(0)
        shown(page, "Errors")
    wait_for(page, f"window.madePlots.length && {DRAWN}")
    expect(frame).to_have_count(0)
    expect(silence).to_have_count(0)
    made = page.evaluate("window.madePlots.map((view) => view.model.title.text)")
    assert len(made) == 9
    assert all("error" in title for title in made)


def test_a_change_that_the_server_did_not_hear_any_more_is_made_after_the_cut(
    wired: tuple[Page, Wire],
) -> None:
    page, wire = wired
    noise = page.get_by_role("textbox", name="White noise [°/s/√Hz]")
    noise.fill("0.2")
    noise.press("Enter")
    wait_for(page, "location.search.includes('noise_density=0.2')")
    with wire.delayed() as late:  # what is undone arrives after something else was typed, and is older
        page.keyboard.press("Tab")
        page.get_by_role("button", name=re.compile("^Undo: ")).click()
        eventually(page, lambda: any("0.05" in str(one) for one in late))
        noise.fill("0.25")
        noise.press("Enter")
    wait_for(page, "location.search.includes('noise_density=0.25')")
    expect(noise).to_have_value("0.25")
    wire.lose()
    noise.fill("0.3")
    noise.press("Enter")
    page.get_by_role("textbox", name="Seed").fill("7")
    page.get_by_role("textbox", name="Seed").press("Enter")
    wire.cut()
    wait_for(page, "location.search.includes('noise_density=0.3') && location.search.includes('seed=7')")
    wait_for(page, DRAWN)
    expect(noise).to_have_value("0.3")
    wire.cut()  # what was made again is not made once more, over what was changed meanwhile
    noise.fill("0.4")
    noise.press("Enter")
    wait_for(page, "location.search.includes('noise_density=0.4')")
    wire.cut()
    wait_for(page, DRAWN)
    expect(noise).to_have_value("0.4")


def test_an_upload_that_is_cut_is_named_once_the_page_is_back(wired: tuple[Page, Wire]) -> None:
    page, wire = wired
    show(page, "Missions")
    page.get_by_role("button", name="Import", exact=True).click()
    wire.lose()
    page.locator("input[type=file][multiple]").set_input_files(
        {"name": "my drive.csv", "mimeType": "text/csv", "buffer": b"time,x\n"}
    )
    expect(page.get_by_text("Uploading my drive.csv")).to_be_visible()
    wire.cut()
    alert = page.get_by_role("alert").filter(has_text="the upload of my drive.csv was complete")
    expect(alert).to_be_visible()
    alert.get_by_role("button", name="Close").click()
    expect(alert).to_have_count(0)
    wire.cut()
    wait_for(page, WHOLE)
    expect(alert).to_have_count(0)


def test_what_compare_computes_goes_on_after_a_cut(wired: tuple[Page, Wire]) -> None:
    """Last of those that share the page: after each cut, all of it is computed again."""
    page, wire = wired
    show(page, "Compare")
    page.get_by_role("button", name="Seeds", exact=True).click()
    page.get_by_role("textbox", name="Number of seeds").fill("3")
    page.get_by_role("textbox", name="Number of seeds").press("Enter")
    page.get_by_role("button", name="A sweep", exact=True).click()
    page.get_by_role("textbox", name="Seeds of each").fill("2")
    page.get_by_role("textbox", name="Seeds of each").press("Enter")
    page.get_by_role("button", name="Run the sweep").click()
    wait_for(page, "/sweep.*axes.*q_scale/.test(sessionStorage.getItem(`ins-lab-kept ${location.pathname}`))")
    wire.cut()
    expect(
        page.get_by_role("heading", name="Mean of 3 seeds").or_(page.get_by_text("Mean of 3 seeds"))
    ).to_be_visible()
    about = page.get_by_text("Line: mean over the seeds")  # below the curves
    expect(about).to_be_in_viewport()


def test_a_page_whose_connection_is_refused_says_why_it_is_empty(chromium: Browser, address: str) -> None:
    page = new_context(chromium).new_page()
    page.route_web_socket(re.compile("/ws"), lambda route: route.close(code=1008))
    page.goto(address)
    alert = page.get_by_role("alert").filter(has_text="--origin")
    expect(alert).to_contain_text("cannot connect to its server")
    expect(alert).to_contain_text(f"--origin {page.evaluate('location.host')}")
    expect(alert.get_by_role("button", name="Reload")).to_be_visible()
    page.context.close()
