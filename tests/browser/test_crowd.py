"""Pages opened at the same time, as by a class: each arrives whole and works like one opened alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from urllib.parse import urlparse

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.browser.conftest import DRAWN, ERRORS, ROOT, complaint, eventually, new_context, remember, wait_for

pytestmark = pytest.mark.browser

PAGES = 3
HEIGHT = 900
"""Height of the windows [px], which is that of `shared_page` too."""
PLOTS = "Array.from(Bokeh.index.query((view) => view.model.type === 'Figure')).length"
DATA = "Bokeh.documents[0].get_model_by_name('time:position_east').data"
FILES = "[...Bokeh.documents[0].all_models].filter((one) => one.data?.label === 'Load settings').length"
"""Number of buttons that load settings: they come last."""
WATCH = f"""
const watch = setInterval(() => {{
  if (!(window.Bokeh?.documents.length === 1 && Bokeh.documents[0].is_idle)) return;
  window.plots_at_first = {PLOTS};
  clearInterval(watch);
}}, 10);
"""
"""Notes how many plots a page has once it shows anything."""


def start(page: Page, address: str) -> None:
    """Have a page ask for the simulator, and do not wait for the answer."""
    with page.expect_request(address):
        page.evaluate("(address) => { setTimeout(() => location.assign(address)) }", address)


@contextmanager
def crowd(chromium: Browser, address: str, complaints: list[str]) -> Iterator[list[Page]]:
    """Ask for several pages at the same time, each in a browser of its own; the last one leaves at once."""
    with ExitStack() as stack:
        pages = []
        for _ in range(PAGES + 1):
            context = stack.enter_context(new_context(chromium, viewport={"width": 1440, "height": HEIGHT}))
            pages.append(context.new_page())
        for page in pages:
            page.on("console", lambda message: complaints.extend(complaint(message)))
            page.on("pageerror", lambda error: complaints.append(str(error)))
            page.add_init_script(WATCH)
            start(page, address + ERRORS)
        *stay, leaves = pages
        leaves.close()
        yield stay


def written(address: str) -> str:
    """Return what the server of an address has written so far."""
    return Path(ROOT / ".pytest_cache" / f"simulator{urlparse(address).port}.log").read_text()


def same_place(one: Locator, other: Locator) -> bool:
    """Say whether two parts have the same place and size."""
    return one.bounding_box() == other.bounding_box()


def same_settings(one: Page, other: Page) -> bool:
    """Say whether two pages have the same sliders, in the same order, and some besides that of the time."""
    names = settings(one)
    return len(names) > 1 and names == settings(other)


@pytest.mark.proof
def test_pages_opened_at_once_arrive_whole_and_work(
    shared_page: Page, chromium: Browser, address: str, complaints: list[str]
) -> None:
    """The first page is alone: the server has what a first visitor needs compiled."""
    alone = shared_page
    wait_for(alone, f"{FILES} === 1")
    own_bar = alone.get_by_role("slider", name="Time")
    time_bar = own_bar.bounding_box()
    assert time_bar is not None
    assert time_bar["y"] < HEIGHT, "the time bar is below the window"
    before = len(written(address))
    with crowd(chromium, address, complaints) as pages:
        for page in pages:
            wait_for(page, DRAWN)
            wait_for(page, f"{PLOTS} === 9")
            wait_for(page, f"{FILES} === 1")
            eventually(page, partial(same_settings, page, alone))
            eventually(page, partial(same_place, page.get_by_role("slider", name="Time"), own_bar))
            expect(page.get_by_role("alert")).to_have_count(0)
        assert 0 in [page.evaluate("window.plots_at_first") for page in pages], "no page came in steps"
        for page in pages:
            remember(page, "before", DATA)
            page.get_by_role("slider", name="White noise").first.press("End")
        for page in pages:
            wait_for(page, f"{DATA} !== window.before")
            expect(page.get_by_role("alert")).to_have_count(0)
            wait_for(page, "location.search.includes('sensors.gyro.noise_density=0.5')")
    assert complaints == []
    assert "Traceback" not in written(address)[before:]


def settings(page: Page) -> list[str | None]:
    """Return the names of the sliders of a page, from top to bottom."""
    return [slider.get_attribute("aria-label") for slider in page.get_by_role("slider").all()]
