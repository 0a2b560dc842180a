"""axe-core finds nothing serious in any part of the page, in either theme."""

from __future__ import annotations

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect

from dashboards.page_tabs import IN_TABS
from dashboards.settings_panel import SECTIONS
from tests.browser.conftest import DRAWN, ERRORS, HEIGHT, IDLE, WIDTH, show, wait_for, watched

pytestmark = pytest.mark.browser

SERIOUS = {"serious", "critical"}
OPTIONS = {"resultTypes": ["violations"], "preload": False}
DRESSED = "Bokeh.documents[0].roots().some((root) => root.data?.dark_theme === (arg === 'dark'))"
LOOKS, FADING = 4, 3000.0
"""How often axe-core looks before a finding counts, and the time between [ms]: colours of settings that
arrive while the page changes to the dark theme fade in."""
BESIDE = {"Missions": ("Choose Over the Pacific", ("Import", "Fly")), "Lessons": ("Tuning R", ("Tuning R",))}
"""A button that a page beside the tabs has once it is there, and buttons that open its parts."""


def serious(page: Page, what: str) -> list[str]:
    """Return what axe-core finds that is serious and stays, once the page has nothing to do."""
    expect(page.locator("[data-waiting]")).to_have_count(0)
    expect(page.get_by_role("button", name="Cancel")).to_have_count(0)
    page.mouse.move(1, 1)
    wait_for(page, IDLE)
    for _ in range(LOOKS):
        found = Axe().run(page, options=OPTIONS).response["violations"]
        texts = [
            f"{what}, {one['id']}: {node['html'][:250]}"
            for one in found
            if one["impact"] in SERIOUS
            for node in one["nodes"]
        ]
        if not texts:
            break
        page.wait_for_timeout(FADING)
    return texts


def unfold(page: Page) -> None:
    """Open all that is folded in the settings; change one, and have one refused."""
    for title, is_open in SECTIONS.values():
        if not is_open:
            page.get_by_role("button", name=title, exact=True).click()
    more = page.get_by_role("button", name="More", exact=True)
    expect(more).to_have_count(len(SECTIONS))
    for left in reversed(range(len(SECTIONS))):
        more.first.click()
        expect(more).to_have_count(left)
    for name in ("White noise: one for each axis", "R: one σ for each row"):
        page.get_by_role("checkbox", name=name).first.click()
    for name, value in (("Seed", "3"), ("Q scale", "0.1"), ("R scale", "-1")):
        page.get_by_role("textbox", name=name).fill(value)
        page.get_by_role("textbox", name=name).press("Enter")
    expect(page.get_by_role("alert").get_by_text("R scale must be between")).to_be_visible()


@pytest.mark.proof
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing_serious_anywhere(
    chromium: Browser, address: str, complaints: list[str], theme: str
) -> None:
    page = watched(chromium, address, complaints)
    page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]
    page.goto(address + ERRORS)
    wait_for(page, f"{DRAWN} && {DRESSED.replace('arg', repr(theme))}")
    found = serious(page, "as it opens")
    unfold(page)
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Hold").first.click()
    found += serious(page, "all settings")
    page.get_by_role("button", name="Close drawer").click()
    page.mouse.move(1, 1)  # its tooltip would be over the tabs
    page.evaluate("document.activeElement.blur()")
    for kind in IN_TABS:
        show(page, kind.title)
        found += serious(page, kind.title)
    page.get_by_role("button", name="Share", exact=True).click()
    found += serious(page, "Share")
    page.keyboard.press("Escape")
    page.locator(".verdict-chip button").click()
    expect(page.get_by_role("button", name="Show me")).to_be_visible()
    found += serious(page, "the card of the verdict")
    page.keyboard.press("Escape")
    page.keyboard.press("?")
    expect(page.get_by_role("dialog")).to_be_visible()
    found += serious(page, "the keys")
    page.keyboard.press("Escape")
    page.set_viewport_size({"width": 360, "height": 740})  # tables scroll in their boxes, also by keys
    for title in ("Verdict", "Compare", "Cards"):
        show(page, title)
        found += serious(page, f"{title} on a phone")
    page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
    for title, (there, parts) in BESIDE.items():
        show(page, title)
        expect(page.get_by_role("button", name=there).first).to_be_visible()
        found += serious(page, title)
        for part in parts:
            page.get_by_role("button", name=part, exact=True).click()
            found += serious(page, f"{title}, {part}")
    assert found == []
    page.context.close()
    assert complaints == []
