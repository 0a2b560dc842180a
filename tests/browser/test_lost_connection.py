"""A server that ends: the page says so, and goes on with its settings once there is one again."""

from __future__ import annotations

from urllib.parse import urlparse

import pytest
from playwright.sync_api import Browser, expect

from tests.browser.conftest import DRAWN, new_context, serving, wait_for
from tests.browser.test_restart import BACK

pytestmark = pytest.mark.browser

SEED = 4711


@pytest.mark.proof
def test_a_page_without_its_server_says_so_and_comes_back_with_its_settings(chromium: Browser) -> None:
    page = new_context(chromium, viewport={"width": 400, "height": 800}).new_page()
    lost = page.get_by_role("alert").filter(has_text="The connection to the server is lost")
    with serving() as (address, _):
        page.goto(f"{address}?mission=los_angeles&trajectory.imu_rate=50&seed={SEED}&tab=Errors")
        wait_for(page, DRAWN)
        expect(lost).to_have_count(0)
    expect(lost).to_be_visible()
    expect(lost).to_have_count(1)
    box = lost.bounding_box()
    assert box is not None
    assert box["width"] <= 400
    expect(lost.get_by_role("button", name="Reload")).to_be_visible()
    with serving("--port", str(urlparse(address).port)):
        wait_for(page, f"{BACK} && {DRAWN}")  # by itself; this server has no address for its health
        expect(lost).to_have_count(0)
        assert f"seed={SEED}" in page.url
    page.context.close()
