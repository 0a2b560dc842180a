"""Names for who hears the page: every field, button and bar has one, and says what it changes."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import IDLE, show, wait_for

pytestmark = pytest.mark.browser

UNNAMED = re.compile(
    r"^\s*- '?(button|checkbox|combobox|link|progressbar|slider|switch|tab|textbox)\b(?! \").*", re.M
)
"""A line of the tree that a browser gives to readers of the screen, with a part that has no name."""
LIGATURE = re.compile(r'^\s*- \'?\w+ "[a-z]+(_[a-z]+)+\b.*', re.M)
"""A part whose name begins with that of its icon, as "restart_alt Reset"."""
TABS = {
    "Errors": ("slider", "Time"),
    "Verdict": ("button", re.compile("Identify")),
    "Missions": ("button", "Choose Montréal"),
    "Live": ("button", "Connect"),
}
"""Tabs, and what they show when they are there."""

MISPLACED = """(() => {
  const found = [];
  const walk = (root) => {
    for (const element of root.querySelectorAll("*")) {
      const {tagName, shadowRoot} = element;
      if (/^(SPAN|DIV)$/.test(tagName) && element.hasAttribute("aria-label") && !element.hasAttribute("role"))
        found.push(element.outerHTML.slice(0, 100));
      if (shadowRoot) walk(shadowRoot);
    }
  };
  walk(document);
  return found;
})()"""
"""Elements without a role that have a name: readers do not say it, or say it for another part."""


def test_everything_that_one_can_change_has_a_name(shared_page: Page) -> None:
    page = shared_page
    for tab, (role, name) in TABS.items():
        show(page, tab)
        expect(page.get_by_role(role, name=name).first).to_be_visible()
        wait_for(page, IDLE)
        heard = page.locator("body").aria_snapshot()
        assert [line[0].strip() for line in UNNAMED.finditer(heard)] == []
        assert [line[0].strip() for line in LIGATURE.finditer(heard)] == []
        assert "show more" not in heard
        assert page.evaluate(MISPLACED) == []


def test_a_slider_says_its_value_and_a_field_what_it_is_about(shared_page: Page) -> None:
    page = shared_page
    sigma = page.get_by_role("slider", name="Position σ [m]")
    expect(sigma).to_have_attribute("aria-valuetext", "0.707 m")  # its position is -0.15
    page.get_by_role("button", name="σ²", exact=True).click()
    variance = page.get_by_role("slider", name="Position variance [m²]")
    expect(variance).to_have_attribute("aria-valuetext", "0.5 m²")
    page.get_by_role("button", name="σ", exact=True).click()
    expect(sigma).to_have_attribute("aria-valuetext", "0.707 m")
    noise = page.get_by_role("slider", name="White noise").first
    expect(noise).to_have_attribute("aria-valuetext", "0.05 °/s/√Hz")
    expect(page.get_by_role("textbox", name="White noise [°/s/√Hz]")).to_have_value("0.05")
    expect(page.get_by_role("textbox", name="Seed")).to_have_attribute(
        "aria-description", "Seed of all random draws."
    )
    page.get_by_role("checkbox", name="White noise: one for each axis").first.click()
    expect(page.get_by_role("slider", name="x", exact=True)).to_have_attribute(
        "aria-valuetext", "0.05 °/s/√Hz"
    )
    page.get_by_role("checkbox", name="White noise: one for each axis").first.click()
    fold = page.get_by_role("button", name="Accelerometers")
    expect(fold).to_have_attribute("aria-expanded", "false")
    fold.click()
    expect(page.get_by_role("slider", name="White noise")).to_have_count(2)
    expect(fold).to_have_attribute("aria-expanded", "true")
    fold.click()
    expect(page.get_by_role("heading", name="INS Lab")).to_have_attribute("aria-level", "1")


FOCUSED = """(() => {
  let at = document.activeElement;
  while (at?.shadowRoot?.activeElement) at = at.shadowRoot.activeElement;
  return at;
})()"""
"""The element that has the focus, in whatever component it is."""
INSIDE = f"""(name) => {{
  const [view] = Array.from(Bokeh.index.query((one) => one.model.name === name));
  for (let at = {FOCUSED}; at; at = at.assignedSlot ?? at.parentElement ?? at.getRootNode().host) {{
    if (at === view.el) return true;
  }}
  return false;
}}"""
"""Whether the focus is in a part of the page that has a name."""


def test_the_first_key_reaches_a_link_past_all_settings(open_page: Callable[..., Page]) -> None:
    page = open_page()  # on a page that was clicked, keys go on from there
    link = page.get_by_role("link", name="Skip to the plots")
    page.keyboard.press("Tab")
    expect(link).to_be_focused()
    expect(link).to_be_in_viewport(ratio=1)
    page.keyboard.press("Enter")
    assert page.evaluate(INSIDE, "page stage")
    expect(link).not_to_be_in_viewport()
    page.keyboard.press("Tab")
    assert page.evaluate(INSIDE, "page stage")  # the next key goes on from there
    page.keyboard.press("2")
    expect(page.get_by_role("tab", name="Flight")).to_have_attribute("aria-selected", "true")
    show(page, "Missions")
    expect(page.get_by_role("button", name="Choose Montréal")).to_be_visible()
    link.focus()
    page.keyboard.press("Enter")
    assert page.evaluate(INSIDE, "page Missions")
