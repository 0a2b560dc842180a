"""Two sensor cards stand side by side after four clicks from a fresh page."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.browser


def test_two_cards_are_compared_in_four_clicks(shared_page: Page) -> None:
    page = shared_page
    page.get_by_role("tab", name="Compare", exact=True).click()
    page.get_by_role("button", name="Sensor cards", exact=True).click()
    page.get_by_role("checkbox", name=re.compile("^ADIS16470 · ")).click()
    page.get_by_role("checkbox", name=re.compile("^HG4930 · ")).click()
    for name in ("Now", "ADIS16470", "HG4930"):
        row = page.get_by_role("row", name=re.compile(f"^{name} .*(Consistent|✗)"))
        expect(row).to_be_visible()
        expect(row.get_by_role("cell").nth(1)).to_have_text(re.compile(r"^\d"))
    expect(page.get_by_role("button", name="Cancel", exact=True)).to_have_count(0)
    # As it was, for the tests that share the page.
    for name in ("ADIS16470", "HG4930"):
        page.get_by_role("checkbox", name=re.compile(f"^{name} · ")).click()
    page.get_by_role("button", name="Sensor cards", exact=True).click()
    expect(page.get_by_role("cell", name="position east error", exact=True)).to_be_visible()
