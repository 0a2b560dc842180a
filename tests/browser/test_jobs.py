"""Jobs of a user, with the clicks that they take from a fresh page: a click, a key or a choice is one."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.browser.conftest import PATIENCE, show, shown
from tests.browser.test_missions_page import capture_of

pytestmark = pytest.mark.browser


def click_all(*wanted: Locator) -> None:
    """Click on one after the other; nothing else is done by hand."""
    for one in wanted:
        one.click()


def test_a_filter_that_trusts_itself_too_much_is_mended_and_a_report_is_there_in_two_clicks_on_any_tab(
    open_page: Callable[..., Page],
) -> None:
    query = "?mission=los_angeles&trajectory.imu_rate=50&navigator.q_scale=0.1&tab=Overview"
    page = open_page(query, drawn=False)
    for tab in ("Overview", "Flight", "Live"):
        show(page, tab)
        chip = page.get_by_role("button", name=re.compile("^● .*too small"))
        click_all(chip, page.get_by_role("button", name=re.compile("^Apply")).first)
        expect(page.get_by_role("button", name="● Consistent")).to_be_visible()
        expect(page.get_by_role("button", name="● Consistent")).to_be_focused()
        undo = page.get_by_role("button", name=re.compile("^Undo: .*Q scale 0.1 →"))
        expect(undo).to_be_visible()
        undo.click()
    with page.expect_download() as download:
        click_all(
            page.get_by_role("button", name="Share", exact=True),
            page.get_by_role("menuitem", name="Report", exact=True),
        )
    assert "Los Angeles" in download.value.path().read_text(encoding="utf-8")


def test_a_dropped_log_has_its_verdict_after_three_clicks(
    own_missions: Path, open_page: Callable[..., Page], tmp_path: Path
) -> None:
    before = set(own_missions.iterdir())
    page = open_page("?tab=Overview", drawn=False)
    click_all(
        page.get_by_role("button", name=re.compile("^Missions:")),
        page.get_by_role("button", name="Import", exact=True),
    )
    page.locator("input[type=file][multiple]").set_input_files(capture_of("ublox", tmp_path / "drive.ubx"))
    click_all(page.get_by_role("button").filter(has_text="Navigate its sensors"))
    shown(page, "Overview")
    expect(page.get_by_role("combobox", name="Mission")).to_have_text("Log of drive.ubx")
    expect(page.get_by_role("button", name=re.compile("^[●○] (?!Judging|No verdict)"))).to_be_visible()
    for log in set(own_missions.iterdir()) - before:  # as it was, for other tests
        if log.is_dir():
            shutil.rmtree(log)
        else:
            log.unlink()


def test_two_cards_are_compared_in_four_clicks(shared_page: Page) -> None:
    page = shared_page
    page.get_by_role("tab", name="Compare", exact=True).click()
    page.get_by_role("button", name="Sensor cards", exact=True).click()
    page.get_by_role("checkbox", name=re.compile("^ADIS16470 · ")).click()
    page.get_by_role("checkbox", name=re.compile("^HG4930 · ")).click()
    for name in ("Now", "ADIS16470", "HG4930"):
        row = page.get_by_role("row", name=re.compile(f"^{name} .*(Consistent|✗)"))
        expect(row).to_be_visible(timeout=2 * PATIENCE)  # the filter of a card may have to be compiled
        expect(row.get_by_role("cell").nth(1)).to_have_text(re.compile(r"^\d"))
    expect(page.get_by_role("button", name="Cancel", exact=True)).to_have_count(0)
    # As it was, for the tests that share the page.
    for name in ("ADIS16470", "HG4930"):
        page.get_by_role("checkbox", name=re.compile(f"^{name} · ")).click()
    page.get_by_role("button", name="Sensor cards", exact=True).click()
    expect(page.get_by_role("cell", name="position east error", exact=True)).to_be_visible()
