"""Share in a browser: what is copied, also where the clipboard is refused, and a link with held results."""

from __future__ import annotations

import re
from collections.abc import Callable
from urllib.parse import quote

from playwright.sync_api import Browser, Page, expect

from tests.browser.conftest import DRAWN, new_context, share, wait_for

REFUSED = "navigator.clipboard.writeText = () => Promise.reject(); document.execCommand = () => false"


def test_a_copied_link_shows_the_same_and_text_can_be_copied_by_hand(
    chromium: Browser, address: str, open_page: Callable[..., Page]
) -> None:
    held = quote("mission=los_angeles&navigator.r_scale=4", safe="")
    context = new_context(chromium, viewport={"width": 360, "height": 800})
    context.grant_permissions(["clipboard-read", "clipboard-write"])
    page = context.new_page()
    page.goto(
        f"{address}?mission=los_angeles&navigator.q_scale=0.5&class=none&theme=dark&hold={held}&tab=Errors"
    )
    wait_for(page, DRAWN)
    expect(page.get_by_text(re.compile("^A · .*R scale 4"))).to_be_visible()
    page.get_by_role("button", name="Rename A").click()
    name = page.get_by_role("textbox", name="Name of A")
    expect(name).to_be_focused()
    name.fill("Less R & <more>")
    name.press("Enter")
    expect(page.get_by_role("button", name="A · Less R & <more>: bring these settings back")).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    share(page, "Copy link")
    expect(page.get_by_role("status").filter(has_text="Copied")).to_be_visible()
    link = page.evaluate("navigator.clipboard.readText()")
    assert link.startswith(f"{address}?mission=los_angeles&navigator.q_scale=0.5&")
    assert "hold=" in link
    assert "class" not in link
    assert "theme" not in link
    page.evaluate(REFUSED)
    share(page, "Copy as command")
    by_hand = page.get_by_role("textbox", name="Text to copy")
    expect(by_hand).to_have_value("ins-lab run los_angeles --set navigator.q_scale=0.5")
    page.get_by_role("dialog").get_by_role("button", name="Close", exact=True).click()
    expect(by_hand).to_be_hidden()
    page.get_by_role("button", name="Share", exact=True).press("Enter")
    page.keyboard.press("ArrowUp")
    expect(page.get_by_role("menuitem", name="Path (GPX)")).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.get_by_role("menu", name="Share")).to_be_hidden()
    context.close()
    again = open_page(f"?{link.partition('?')[2]}")
    expect(again.get_by_text("A · Less R & <more>")).to_be_visible()
