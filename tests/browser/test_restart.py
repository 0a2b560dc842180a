"""A server that is restarted: its pages come back by themselves, with settings, tab, and solved steps."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.conftest import DRAWN, new_context, show, shown, wait_for
from tests.security.conftest import serving

pytestmark = [pytest.mark.browser, pytest.mark.proof]

SEED = 4711
RESTARTS = "The server restarts."
BACK = "document.getElementById('ins-lab-lost-connection') === null"


def solve_a_step(page: Page) -> None:
    """Open a lesson and give the right answer to its first question."""
    show(page, "Lessons")
    page.get_by_role("button", name="Tuning R", exact=True).click()
    page.get_by_role("radio", name="yes", exact=True).click()
    page.get_by_role("button", name="Check the answer").click()
    expect(page.get_by_text("1 of 3 solved")).to_be_visible()


def test_a_page_comes_back_with_settings_tab_and_solved_steps(chromium: Browser, tmp_path: Path) -> None:
    page = new_context(chromium, viewport={"width": 1440, "height": 900}).new_page()
    with serving(tmp_path) as served:
        page.goto(f"http://127.0.0.1:{served.port}/")
        wait_for(page, "window.Bokeh && Bokeh.documents.length === 1")
        solve_a_step(page)
        page.get_by_role("button", name="Next step").click()
        expect(page.get_by_text("Tuning R · step 2 of 3")).to_be_visible()
        wait_for(page, "location.search.includes('navigator.r_scale=0.1')")
        show(page, "Errors")
        wait_for(page, DRAWN)
        # The address follows what is shown; a busy server writes it last.
        wait_for(page, "location.search.includes('tab=Errors') && Bokeh.documents[0].is_idle")
        before = page.evaluate("location.search")
        assert "navigator.r_scale=0.1" in before
        served.popen.send_signal(signal.SIGTERM)
        alert = page.get_by_role("alert").filter(has_text=RESTARTS)
        expect(alert).to_be_visible()
        assert served.popen.wait(30) == -signal.SIGTERM
        assert "Traceback" not in served.log.read_text()
    with serving(tmp_path, port=served.port) as again:
        wait_for(page, BACK)
        wait_for(page, DRAWN)
        shown(page, "Errors")
        expect(page.get_by_text("Tuning R · step 2 of 3")).to_be_visible()
        expect(page.get_by_text("1 of 3 solved")).to_be_visible()
        expect(page).to_have_url(f"http://127.0.0.1:{served.port}/{before}")
        page.get_by_role("button", name="Back", exact=True).click()
        expect(page.get_by_text("Tuning R · step 1 of 3")).to_be_visible()
        wait_for(page, "Bokeh.documents[0].is_idle")
        assert "navigator.r_scale=0.1" in page.evaluate("location.search"), "a step back changed settings"
        assert "Traceback" not in again.log.read_text()
    page.context.close()
