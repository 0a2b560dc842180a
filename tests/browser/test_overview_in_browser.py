"""The Overview in a browser: its buttons, and its introduction, which is closed for ever."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import shown, wait_for

pytestmark = pytest.mark.browser

DATA = "Bokeh.documents[0].get_model_by_name('time:overview_position')?.data"
REFUSE = "() => { Storage.prototype.setItem = () => { throw new Error('storage is full') } }"


def test_the_introduction_is_closed_for_ever_and_its_buttons_are_undone(
    open_page: Callable[..., Page],
) -> None:
    page = open_page("?tab=Overview", drawn=False)
    wait_for(page, f"{DATA}?.time?.length > 100")
    introduction = page.get_by_text("A simulated flight, “Montréal”")
    expect(introduction).to_be_visible()
    page.get_by_role("button", name="Fool the filter").click()
    expect(page.get_by_text("Q scale 1 → 0.1").first).to_be_visible()
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_text("All settings have their defaults.")).to_be_visible()
    page.evaluate(REFUSE)
    close = page.get_by_role("button", name="Close the introduction")
    close.click()
    expect(introduction).to_be_hidden()
    page.reload()
    expect(introduction).to_be_visible()
    close.click()
    expect(introduction).to_be_hidden()
    page.reload()
    page.get_by_role("button", name="Read the verdict").wait_for()
    expect(introduction).to_be_hidden()
    page.get_by_role("button", name="Read the verdict").click()
    shown(page, "Verdict")
