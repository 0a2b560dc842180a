"""Print: paper has the whole page of a tab over its whole width, and neither settings nor bars."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import HEIGHT, IDLE, wait_for

PLOTS = """
[...Bokeh.index.query(view => view.model.type === 'Figure')]
  .map(view => view.el.getBoundingClientRect())
  .filter(box => box.width > 0)
"""
BREADTH = f"Math.max(...{PLOTS}.map(box => box.right)) - Math.min(...{PLOTS}.map(box => box.left))"
WHOLE = f"""
(() => {{
  const {{scrollWidth, scrollHeight}} = document.documentElement, plots = {PLOTS};
  return plots.length === 9 && plots.every(({{left, right, top, bottom}}) =>
    left >= 0 && right <= scrollWidth && top >= 0 && bottom <= scrollHeight + 1);
}})()
"""
"""Whether no plot reaches beyond what can be printed."""


@pytest.mark.browser
def test_a_page_is_printed_whole(shared_page: Page) -> None:
    page = shared_page
    page.set_viewport_size({"width": 1440, "height": 420})  # less than the plots need
    wait_for(page, f"{IDLE} && {PLOTS}.length === 9")
    before = page.evaluate(BREADTH)
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    try:
        expect(page.get_by_role("textbox", name="Seed")).not_to_be_visible()
        expect(page.get_by_role("tab", name="Errors", exact=True)).not_to_be_visible()
        expect(page.get_by_role("slider", name="Time")).not_to_be_visible()
        wait_for(page, f"{WHOLE} && {PLOTS}.at(-1).bottom > window.innerHeight")
        # As wide as on the screen or as paper takes, whatever is narrower: a browser paints no plot anew.
        assert page.evaluate(BREADTH) == pytest.approx(before * min(1, 1040 / 1110), rel=0.02)
    finally:
        page.emulate_media(media="screen")
        page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    printed = page.pdf(format="A4")
    # A browser without a window lays plots out as on paper until its size changes.
    page.set_viewport_size({"width": 1440, "height": HEIGHT})
    assert printed.count(b"/Type /Page\n") == 1
    expect(page.get_by_role("textbox", name="Seed")).to_be_visible()
