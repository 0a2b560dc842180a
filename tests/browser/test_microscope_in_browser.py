"""The Microscope in a browser: an arrow key shows the next fix, and on a phone only its boxes scroll."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import show

pytestmark = pytest.mark.browser


def test_arrow_keys_show_the_numbers_of_each_fix(shared_page: Page) -> None:
    page = shared_page
    show(page, "Microscope")
    expect(page.get_by_text("The filter has not updated yet")).to_be_visible()
    numbers = page.locator("dl dd").first
    page.keyboard.press("ArrowRight")  # the mouse has chosen the page, and leaves the arrows to the fixes
    expect(page.get_by_text("The filter has not updated yet")).to_be_hidden()
    expect(page.get_by_text("Fix 1 of")).to_be_visible()
    first = numbers.inner_text()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_text("Fix 2 of")).to_be_visible()
    expect(numbers).not_to_have_text(first)
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_text("Fix 1 of")).to_be_visible()
    expect(numbers).to_have_text(first)


def test_on_a_phone_tables_scroll_in_their_boxes(shared_page: Page) -> None:
    page = shared_page
    size = page.viewport_size
    assert size is not None
    show(page, "Microscope")
    box = page.get_by_role("region", name="Correlations before the fix")
    expect(box).to_be_visible()
    page.set_viewport_size({"width": 390, "height": 844})
    try:
        assert box.evaluate("(one) => one.scrollWidth > one.clientWidth && one.clientWidth <= 390")
        assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    finally:
        page.set_viewport_size(size)
