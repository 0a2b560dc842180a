"""The page on consistency: the verdict in words, beside NEES and the tables it rests on."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.browser


def test_the_verdict_is_in_words_and_names_what_is_wrong(open_page: Callable[..., Page]) -> None:
    page = open_page("?mission=los_angeles&sensors.gps.latency=0.2")
    page.get_by_role("tab", name="Consistency", exact=True).click()
    expect(page.get_by_role("heading", name="The fixes are 0.20 s late")).to_be_visible(timeout=30_000)
    expect(page.get_by_text("Move the times of the fixes by -0.20 s")).to_be_visible()
    assert page.get_by_role("cell", name="position north").count() == 2
    nees = "Bokeh.documents[0].get_model_by_name('time_gps:nees').data"
    page.wait_for_function(f"{nees}.nees.length > 100 && {nees}.nees_band_high[5] > 27")
