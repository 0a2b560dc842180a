"""A walk over all tabs in a browser, of a run with series that are zero; and what buttons say they do."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, expect

from dashboards.drawn_pages import PAGES
from lab.views.time_plot import THIN
from tests.browser.conftest import DATA, IDLE, show, wait_for

pytestmark = pytest.mark.browser

TITLES = (
    "Array.from(Bokeh.index.query((view) => view.model.title?.text))"
    f".map((view) => view.model.title.text.split(/{THIN}·|\\n/)[0])"
)
"""The titles of all figures, without the figures of merit behind or below them."""
FIRST = {
    "Overview": "Ground track",
    "Errors": "Position error, east [m]",
    "Covariance": "σ of the position [m]",
    "Innovations": "Innovation, east [m]",
    "Verdict": "NEES: normalised errors",
    "States": "Gyro bias, x [°/s]",
    "Allan": "Gyros (dashed: the settings)",
    "Ground track": "Ground track",
    "Flight": "Height above the ellipsoid [m]",
    "Live": "Angular rate [°/s]: none yet",
    "Budget": "Share of the variance of heading [%]",
}
"""First figure of each tab that has figures."""
WORDS = {
    "Missions": ("Over the Pacific",),
    "Compare": ("position east error", "95 %"),
    "Verdict": ("Judged by 1 run",),
    "Cards": ("Sensors in use",),
    "Allan": ("Gyros: White noise N",),
    "Budget": ("At the end, σ of",),
    "Microscope": ("x⁺ = K y",),
    "Calibration": ("finds the constant errors of a sensor",),
    "Numbers": ("finds the noise that a filter should assume",),
    "Other filters": ("judges the filter of an autopilot",),
    "Lessons": ("Tuning R", "Break it: one hidden fault in each"),
}
"""What is written on a tab; those that are not in `FIRST` have no figure."""


def walk(page: Page) -> None:
    """Open each page; the filter has 21 states, of which six are known exactly: they stay zero.

    `test_strangers` does so with a mission of a stranger, whose words are on the tabs too.
    """
    show(page, "Errors")
    wait_for(page, f"{DATA}?.time?.length > 100")
    for name in (one.title for one in PAGES):
        show(page, name)
        for words in WORDS.get(name, ()):
            expect(page.get_by_text(words).filter(visible=True).first).to_be_visible()
        if name in FIRST:
            others = [first for first in FIRST.values() if first != FIRST[name]]
            wait_for(page, f"{TITLES}[0] === {FIRST[name]!r}")
            wait_for(page, f"{IDLE} && !{TITLES}.some((title) => {others!r}.includes(title))")
            expect(page.locator("canvas").first).to_be_visible()
        elif name not in WORDS:
            expect(page.frame_locator("iframe").get_by_text("Connected")).to_be_visible()
        assert page.get_by_text("could not be drawn").count() == 0
    show(page, "Covariance")
    wait_for(page, f"{TITLES}.includes('σ of the gyro scale factors [%]: zero')")
    show(page, "Errors")
    wait_for(page, f"{TITLES}[0] === {FIRST['Errors']!r}")
    wait_for(page, f"{DATA}?.position_east?.length > 100")


def test_buttons_beside_each_other_are_equally_high(shared_page: Page) -> None:
    places = [
        shared_page.get_by_role("button", name=re.compile(name)).bounding_box()
        for name in ("^Changed", "^Reset settings")
    ]
    assert places[0] is not None
    assert places[1] is not None
    assert places[0]["y"] == pytest.approx(places[1]["y"], abs=0.5)
    assert places[0]["height"] == pytest.approx(places[1]["height"], abs=0.5)


def test_what_a_button_says_is_wider_than_one_word(shared_page: Page) -> None:
    page = shared_page
    for name, lines in (("GPS outage", 5), ("Whole flight", 1), ("Another seed", 1)):
        page.get_by_role("button", name=re.compile(f"^{name}")).hover()
        tip = page.get_by_role("tooltip").locator(".MuiTooltip-tooltip")
        expect(tip).to_contain_text(name)
        box = tip.bounding_box()
        assert box is not None
        assert box["height"] < 20 * lines + 8, name  # with the space above and below
        assert box["x"] >= 0, name
        assert box["x"] + box["width"] <= 1440, name
        assert round(box["y"] + box["height"]) <= 900, name
        page.mouse.move(1, 1)
        expect(page.get_by_role("tooltip")).to_have_count(0)
