"""The page Live in a browser asks for the unit of angular rates that nothing names."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, ViewportSize, expect

from tests.browser.conftest import IDLE, new_context, show, wait_for

SMALL: ViewportSize = {"width": 900, "height": 600}
RATES = "Bokeh.documents[0].get_model_by_name('live:Angular rate').data"


@pytest.mark.browser
def test_a_button_gives_all_samples_that_are_drawn_the_other_unit(
    chromium: Browser, address: str, replayed: str
) -> None:
    page = new_context(chromium, viewport=SMALL).new_page()
    page.goto(address)
    wait_for(page, IDLE)
    show(page, "Live")
    page.get_by_role("combobox").filter(has_text="Simulated device").click()
    page.get_by_role("menuitem", name=replayed).click()
    page.get_by_role("button", name="Connect", exact=True).click()
    question = page.get_by_text("The unit of the angular rates is unknown")
    expect(question).to_be_visible(timeout=60_000)
    expect(page.locator(".MuiAlert-colorWarning:visible")).to_have_count(1)
    wait_for(page, f"{RATES}.time.length > 60")
    assert page.evaluate(f"Math.max(...{RATES}.forward.filter(isFinite).map(Math.abs))") < 1  # [°/s]
    page.get_by_role("button", name="They are in rad/s").click()
    expect(question).to_be_hidden()
    wait_for(page, f"{RATES}.time.length > 60 && {RATES}.forward.filter(isFinite).every(one => one > 1)")
    page.context.close()
