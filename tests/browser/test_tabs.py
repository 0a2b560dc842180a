"""Tabs in a browser: keys, what covers a page that one leaves, and what a link opens beside the tabs."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.browser.conftest import HEIGHT, WIDTH, eventually, show, shown, wait_for

pytestmark = pytest.mark.browser

COVERED = """
() => {
  const isSeen = (one) => !["STYLE", "LINK"].includes(one.tagName) && getComputedStyle(one).opacity > 0;
  const inside = (root) => [...root.querySelectorAll("*")].some((one) =>
    (one.dataset?.waiting && ![...one.shadowRoot.children].some(isSeen)) ||
    (one.shadowRoot && inside(one.shadowRoot)));
  window.covered = [];
  document.addEventListener("click", () => setTimeout(() => window.covered.push(inside(document)), 0), true);
}
"""
"""Notes after each click whether the page that one leaves is covered, in the turn of the browser after it."""
LOCATION = "Bokeh.documents[0].get_model_by_name('time cursor')?.location"


def test_keys_open_tabs_step_and_close_and_a_page_that_one_leaves_is_covered(shared_page: Page) -> None:
    page = shared_page
    page.keyboard.press("2")  # its last part opens, whichever that was
    expect(page.get_by_role("tab", name="Flight", exact=True)).to_have_attribute("aria-selected", "true")
    page.keyboard.press("3")
    shown(page, "Errors")
    page.get_by_role("button", name="Whole flight", exact=True).click()  # a button has no use for arrows
    for time in (1, 2):
        page.keyboard.press("ArrowRight")
        wait_for(page, f"Math.abs({LOCATION} - {time}) < 0.01")
    page.keyboard.press("ArrowLeft")
    wait_for(page, f"Math.abs({LOCATION} - 1) < 0.01")
    page.keyboard.press("?")
    expect(page.get_by_role("dialog").get_by_text("hold this result")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_be_hidden()
    page.get_by_role("button", name="Lessons,").click()
    expect(page.get_by_role("button", name="Close Lessons")).to_be_visible()
    page.mouse.move(1, 1)
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="Close Lessons")).to_be_hidden()
    page.evaluate(COVERED)
    page.get_by_role("tab", name="Sensors", exact=True).click()
    wait_for(page, "window.covered.length === 1")
    assert page.evaluate("window.covered[0]")
    page.get_by_role("button", name="Cards", exact=True).click()  # another part of it may have been open last
    expect(page.get_by_text("Sensors in use")).to_be_visible()


def test_the_parts_of_a_tab_fit_a_phone_and_the_card_is_named_in_full(
    shared_page: Page,
) -> None:
    page = shared_page
    sensors = page.get_by_role("combobox", name="Sensors")
    assert sensors.evaluate("(one) => one.scrollWidth <= one.clientWidth")  # its name is not cut
    show(page, "Verdict")
    page.set_viewport_size({"width": 390, "height": 844})
    try:
        for title in ("Verdict", "Other filters"):
            part = page.get_by_role("button", name=title, exact=True)
            eventually(page, lambda part=part: _right_of(part) <= 390)  # type: ignore[misc]
    finally:
        page.set_viewport_size({"width": WIDTH, "height": HEIGHT})


def _right_of(part: Locator) -> float:
    box = part.bounding_box()
    return float("inf") if box is None else box["x"] + box["width"]


def test_a_note_of_a_link_is_text_to_be_changed_and_deleted(
    open_page: Callable[..., Page],
) -> None:
    page = open_page("?note=20-30:%3Cimg%20src%3Dx%3E%20turn", drawn=False)
    note = page.get_by_role("button", name="<img src=x> turn: 20.0 s to 30.0 s")
    note.click()
    field = page.get_by_role("textbox", name="Text of the note")
    expect(field).to_have_value("<img src=x> turn")
    expect(page.locator("img[src=x]")).to_have_count(0)
    wait_for(page, f"{LOCATION} === 20")
    field.fill("2 h ?")  # which are keys of the page elsewhere
    field.press("Enter")
    expect(page.get_by_role("button", name="2 h ?: 20.0 s to 30.0 s")).to_be_visible()
    wait_for(page, "location.search.includes('note=20-30:2%20h%20%3F')")
    shown(page, "Errors")
    page.get_by_role("button", name="2 h ?: 20.0 s to 30.0 s").click()
    page.get_by_role("button", name="Delete", exact=True).click()
    expect(page.get_by_role("button", name="2 h ?: 20.0 s to 30.0 s")).to_have_count(0)
    page.get_by_role("button", name="Undo").first.click()
    expect(page.get_by_role("button", name="2 h ?: 20.0 s to 30.0 s")).to_be_visible()


def test_a_link_opens_the_missions_with_all_their_cards(open_page: Callable[..., Page]) -> None:
    page = open_page("?beside=Missions", drawn=False)
    expect(page.get_by_role("button", name="Choose Over the Pacific")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="Close Missions")).to_be_hidden()
    show(page, "Missions")
    expect(page.get_by_role("button", name="Choose Over the Pacific")).to_be_visible()
    page.get_by_role("button", name="Lessons,").click()  # they are not opened behind the missions
    expect(page.get_by_role("button", name="Tuning R", exact=True)).to_be_visible()
    expect(page.get_by_role("button", name="Close Missions")).to_be_hidden()
