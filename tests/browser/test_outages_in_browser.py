"""Compare > Outages in a browser: a table with curves, a refusal in words, and what turns pale."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import IDLE, eventually, wait_for

pytestmark = pytest.mark.browser


WIDE = "document.documentElement.scrollWidth"
ENTERED = """({name, value}) =>
  [...Bokeh.documents[0].all_models].some(({data}) => data?.label === name && data.value === value)"""
"""Whether a box has told the page what was typed: it does with the next frame, before a person can click."""


def enter(page: Page, name: str, text: str) -> None:
    """Type into a box as a person does: all that was in it goes."""
    box = page.get_by_role("textbox", name=name)
    box.click()
    box.press("Control+a")
    page.keyboard.type(text)
    box.press("Tab")
    wait_for(page, ENTERED, {"name": name, "value": float(text)})


def test_outages_are_run_refused_and_turn_pale(open_page: Callable[..., Page]) -> None:
    query = "?mission=los_angeles&trajectory.imu_rate=50&theme=dark&tab=Compare"
    page = open_page(query, width=390, drawn=False)
    page.get_by_role("button", name="Outages", exact=True).click()
    run, cancel = (page.get_by_role("button", name=name) for name in ("Run the outages", "Cancel"))
    enter(page, "Without GPS [s]", "20")
    enter(page, "Runs of each", "3")
    run.click()
    row = page.get_by_role("row", name="MEMSense AccelRate3D")
    expect(row.get_by_role("cell").nth(2)).to_have_text("3")
    expect(cancel).to_be_hidden()
    expect(page.get_by_text("Line: 95 % of the outages stay below it")).to_be_visible()
    wait_for(page, IDLE)
    assert page.evaluate(WIDE) <= 390

    enter(page, "Without GPS [s]", "3000")
    run.click()
    refused = page.get_by_text("an outage of 3000 s does not fit into the flight, which lasts 105 s")
    expect(refused).to_have_text(
        "Without GPS [s]: an outage of 3000 s does not fit into the flight, which "
        "lasts 105 s and in which the filter converges first; accepted is at most 84 s"
    )
    expect(row).to_be_visible()  # the table that was there
    expect(cancel).to_be_hidden()

    enter(page, "Without GPS [s]", "20")
    page.get_by_role("button", name="Open drawer").click()
    noise = page.get_by_role("textbox", name="White noise [°/s/√Hz]")
    noise.fill("0.2")
    noise.press("Enter")
    expect(
        page.get_by_text("This table belongs to earlier settings. Press Run to compute it again.")
    ).to_be_attached()
    page.set_viewport_size({"width": 1440, "height": 900})
    eventually(page, lambda: page.evaluate(f"innerWidth === 1440 && {WIDE} <= 1440"))
