"""Lessons in a browser: formulas without help from outside, settings, answers, and the reminder."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.browser


def test_a_lesson_from_its_text_to_the_right_answer(open_page: Callable[..., Page]) -> None:
    page = open_page("?mission=los_angeles&trajectory.imu_rate=50")
    page.get_by_role("tab", name="Lessons", exact=True).click()
    page.get_by_role("button", name="Tuning R", exact=True).click()
    formula = page.locator("math").first
    expect(formula).to_be_visible()
    box = formula.bounding_box()
    assert box is not None
    assert box["width"] > 50  # drawn, not folded away
    page.get_by_role("button", name="Check the answer").click()
    expect(page.get_by_text("Give an answer first.")).to_be_visible()
    page.get_by_role("radio", name="no, they are too small").click()
    page.get_by_role("button", name="Check the answer").click()
    expect(page.get_by_text("Not yet.")).to_be_visible()
    page.get_by_role("radio", name="yes", exact=True).click()
    page.get_by_role("button", name="Check the answer").click()
    expect(page.get_by_text("1 of 3 solved")).to_be_visible()
    page.get_by_role("button", name="Next step").click()
    page.wait_for_function("location.search.includes('navigator.r_scale=0.1')")
    page.get_by_role("button", name="Look at Consistency").click()
    expect(page.get_by_text("R position is about").first).to_be_visible()
    expect(page.get_by_text("Tuning R, step 2 of 3")).to_be_visible()
