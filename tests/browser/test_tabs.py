"""Tabs in a browser: keys, what covers a page that one leaves, and what a link opens beside the tabs."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.browser.conftest import (
    DRAWN,
    ERRORS,
    HEIGHT,
    WHOLE,
    WIDTH,
    eventually,
    new_context,
    show,
    shown,
    wait_for,
)

pytestmark = pytest.mark.browser

COVERED = """
() => {
  const isSeen = (one) => !["STYLE", "LINK"].includes(one.tagName) && getComputedStyle(one).opacity > 0;
  const isFrame = (one) => one.matches(".frame") && one.querySelector("p").innerText.startsWith("Drawing ");
  const hasOnlyFrame = (parts) => parts.length === 1 && isFrame(parts[0]);
  const inside = (root) => [...root.querySelectorAll("*")].some((one) =>
    (one.hasAttribute("data-waiting") && hasOnlyFrame([...one.shadowRoot.children].filter(isSeen))) ||
    (one.shadowRoot && inside(one.shadowRoot)));
  window.covered = [];
  window.painted = [];
  const parts = Array.from(Bokeh.index.query(({model}) => model.css_classes?.includes("page-parts")))[0];
  const note = () => window.covered.push([inside(document), getComputedStyle(parts.el).visibility]);
  document.addEventListener("click", () => {
    setTimeout(note, 0);
    requestAnimationFrame(() => window.painted.push(inside(document)));
  }, true);
}
"""
"""Notes after each click whether the page that one leaves is covered, in the turn of the browser after it,
and whether its parts are seen beside the tab; and whether it is still covered in the next picture."""
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
    wait_for(page, "window.covered.length === 1 && window.painted.length === 1")
    assert page.evaluate("window.covered[0]") == [True, "hidden"]
    assert page.evaluate("window.painted[0]")  # however soon the next page comes
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
        expect(sensors).to_be_hidden()  # the settings would lie over the page
        for title in ("Verdict", "Other filters"):
            part = page.get_by_role("button", name=title, exact=True)
            eventually(page, lambda part=part: _right_of(part) <= 390)  # type: ignore[misc]
    finally:
        page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    expect(sensors).to_be_visible()


NAMED = """
([kind, label]) => {
  const found = [...Bokeh.documents[0].all_models].find((one) => one.css_classes?.includes?.(kind));
  found.data.label = label;
}
"""
"""Gives a button of the header other words."""


@pytest.mark.parametrize("width", [360, 390])
def test_the_header_and_the_legend_fit_a_phone_whatever_mission_and_verdict_are_called(
    shared_page: Page, width: int
) -> None:
    page = shared_page
    show(page, "Verdict")
    page.set_viewport_size({"width": width, "height": 844})
    try:
        page.evaluate(NAMED, ["mission", "A recording with a name as long as a sentence, copy (2)"])
        page.evaluate(NAMED, ["verdict-chip", "Errors grow faster than the filter claims (+2)"])
        keys = page.get_by_role("button", name="What keys and mouse do (?)")
        eventually(page, lambda: _right_of(keys) <= width)
        header = page.get_by_role("banner").get_by_role("button").all()
        entries = page.get_by_role("group", name="Legend").locator("> *").all()
        assert len(header) > 8
        for part in (*header, *entries):
            box = part.bounding_box()
            if box is None:  # not shown
                continue
            assert box["x"] >= -8, part.inner_text()  # the menu's round ground is wider than its icon
            assert box["x"] + box["width"] <= width, part.inner_text()
        rows = {round(box["y"] / 44) for part in header if (box := part.bounding_box()) is not None}
        assert rows == {0, 1}
        tab = page.get_by_role("tab", name="Filter", exact=True)
        assert _edges(tab)[0] >= _edges(page.get_by_role("banner"))[1] - 1
    finally:
        page.set_viewport_size({"width": WIDTH, "height": HEIGHT})


def test_the_settings_close_in_a_window_that_becomes_too_narrow_for_them(shared_page: Page) -> None:
    """They took half of it, and the last button of a page was beyond its edge."""
    page = shared_page
    expect(page.get_by_role("button", name="Close drawer")).to_be_visible()
    page.set_viewport_size({"width": 1024, "height": 768})
    try:
        expect(page.get_by_role("button", name="Open drawer")).to_be_visible()
    finally:
        page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    expect(page.get_by_role("button", name="Close drawer")).to_be_visible()


def test_a_finger_that_scrolls_the_settings_moves_no_slider_but_by_its_thumb(
    chromium: Browser, address: str
) -> None:
    page = new_context(
        chromium, viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True
    ).new_page()
    page.goto(address + ERRORS)
    wait_for(page, WHOLE)
    drawer = page.get_by_role("button", name="Open drawer")
    if drawer.is_visible():
        drawer.click()
    thumb = page.get_by_role("slider", name="White noise [°/s/√Hz]").locator("xpath=..")
    number = page.get_by_role("textbox", name="White noise [°/s/√Hz]")
    expect(number).to_have_value("0.05")
    expect(thumb).to_be_visible()
    eventually(page, lambda: 0 < _left_of(thumb) < 200)  # the drawer has slid in
    right, before = _left_of(thumb) + 150, _edges(thumb)
    _swipe(page, (right, before[0] + 6), (0, -15))
    eventually(page, lambda: _edges(thumb)[0] < before[0] - 40)
    expect(number).to_have_value("0.05")
    _swipe(page, (_left_of(thumb) + 6, _edges(thumb)[0] + 6), (10, 0))
    expect(number).not_to_have_value("0.05")
    page.context.close()


def _swipe(page: Page, start: tuple[float, float], step: tuple[float, float]) -> None:
    """Move a finger by ten steps [px]."""
    session = page.context.new_cdp_session(page)
    for count in range(11):
        point = {"x": start[0] + count * step[0], "y": start[1] + count * step[1]}
        kind = "touchMove" if count else "touchStart"
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [point]})
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def _left_of(part: Locator) -> float:
    box = part.bounding_box()
    return float("inf") if box is None else box["x"]


def test_letters_of_twice_the_size_leave_tabs_and_time_bar_whole(shared_page: Page) -> None:
    page = shared_page
    show(page, "Errors")
    page.evaluate("document.documentElement.style.fontSize = '200%'")
    try:
        banner, tab = page.get_by_role("banner"), page.get_by_role("tab", name="Errors", exact=True)
        eventually(page, lambda: _edges(banner)[1] > 60)
        eventually(page, lambda: _edges(tab)[0] >= _edges(banner)[1] - 1)
        button = page.get_by_role("button", name="Whole flight", exact=True)
        eventually(page, lambda: _edges(button)[1] <= HEIGHT)
    finally:
        page.evaluate("document.documentElement.style.fontSize = ''")


def _edges(part: Locator) -> tuple[float, float]:
    """Return the upper and the lower edge of a part of the page [px]."""
    box = part.bounding_box()
    return (float("nan"), float("nan")) if box is None else (box["y"], box["y"] + box["height"])


def _right_of(part: Locator) -> float:
    box = part.bounding_box()
    return float("inf") if box is None else box["x"] + box["width"]


def test_a_link_opens_the_missions_with_all_their_cards_and_its_note_is_text_to_be_changed_and_deleted(
    open_page: Callable[..., Page],
) -> None:
    page = open_page("?note=20-30:%3Cimg%20src%3Dx%3E%20turn&beside=Missions", drawn=False)
    expect(page.get_by_role("button", name="Choose Over the Pacific")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="Close Missions")).to_be_hidden()
    show(page, "Missions")
    expect(page.get_by_role("button", name="Choose Over the Pacific")).to_be_visible()
    page.get_by_role("button", name="Lessons,").click()  # they are not opened behind the missions
    expect(page.get_by_role("button", name="Tuning R", exact=True)).to_be_visible()
    expect(page.get_by_role("button", name="Close Missions")).to_be_hidden()
    page.get_by_role("button", name="Close Lessons").click()
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
    write = page.get_by_role("button", name=re.compile("^Note on the visible stretch"))
    write.press("Enter")  # with keys alone, one is where one was once the note is written, or not
    expect(field).to_be_focused()
    field.press("Escape")
    expect(write).to_be_focused()
    page.get_by_role("button", name="2 h ?: 20.0 s to 30.0 s").click()
    page.get_by_role("button", name="Delete", exact=True).click()
    expect(page.get_by_role("button", name="2 h ?: 20.0 s to 30.0 s")).to_have_count(0)
    page.get_by_role("button", name="Undo").first.click()
    expect(page.get_by_role("button", name="2 h ?: 20.0 s to 30.0 s")).to_be_visible()


def test_what_is_chosen_and_what_colours_mean_is_seen_with_the_colours_of_high_contrast(
    chromium: Browser, address: str
) -> None:
    page = new_context(
        chromium, viewport={"width": WIDTH, "height": HEIGHT}, forced_colors="active"
    ).new_page()
    page.goto(address + ERRORS)
    wait_for(page, DRAWN)
    ground = "(element) => getComputedStyle(element).backgroundColor"
    chosen, other = (page.get_by_role("button", name=name, exact=True) for name in ("Errors", "Covariance"))
    assert chosen.evaluate(ground) != other.evaluate(ground)
    band = page.get_by_role("group", name="Legend").locator("i.band")
    outage = page.get_by_role("toolbar", name="Events of the flight").get_by_role("button").first
    for coloured in (band, outage, page.locator(".MuiTabs-indicator").first):
        assert coloured.evaluate(ground) != page.locator("body").evaluate(ground)
    page.context.close()
