"""The card chooser in a real browser: a card is loaded, a change of it is shown, and it is loaded anew."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, Page, expect

from lab.sensors.cards import CLASSIC, cards
from tests.browser.conftest import reset

pytestmark = pytest.mark.browser

Open = Callable[..., Page]


def chooser(page: Page) -> Locator:
    return page.get_by_role("combobox", name="Sensors")


def noise(page: Page) -> Locator:
    """Return the box of the gyro noise."""
    return page.get_by_role("textbox", name="White noise [°/s/√Hz]")


def choose(page: Page, card: str) -> None:
    chooser(page).click()
    page.get_by_role("menuitem", name=card, exact=True).click()


@pytest.mark.proof
def test_all_cards_are_offered_and_one_is_loaded_changed_and_loaded_anew(open_page: Open) -> None:
    page = open_page("?sensors.gyro.noise_density=0.0123")
    expect(chooser(page)).to_have_text("Own settings")
    chooser(page).click()
    for name in cards():
        expect(page.get_by_role("menuitem", name=name, exact=True)).to_have_count(1)
    for grade in ("consumer", "industrial", "tactical", "navigation"):
        expect(page.get_by_text(f"{grade} grade", exact=True)).to_have_count(1)
    page.get_by_role("menuitem", name="STIM300", exact=True).click()
    expect(noise(page)).to_have_value("0.0025")
    expect(chooser(page)).to_have_text("STIM300")
    noise(page).fill("0.02")
    noise(page).press("Enter")
    expect(chooser(page)).to_have_text("STIM300, changed")
    choose(page, "STIM300")
    expect(noise(page)).to_have_value("0.0025")
    expect(chooser(page)).to_have_text("STIM300")
    reset(page)
    expect(chooser(page)).to_have_text(CLASSIC)


def assumed(page: Page) -> Locator:
    return page.get_by_text("Assumed as typical of the grade")


@pytest.mark.proof
def test_what_is_assumed_is_marked_and_switched_off(shared_page: Page) -> None:
    page = shared_page
    expect(chooser(page)).to_have_text(CLASSIC)
    expect(assumed(page)).to_have_count(0)
    choose(page, "LN-200S")
    expect(noise(page)).to_have_value("0.00158333")
    expect(assumed(page).first).to_be_visible()
    page.get_by_role("switch", name="Fill gaps in the datasheet with typical values").click()
    expect(noise(page)).to_have_value("0")
    expect(chooser(page)).to_have_text("LN-200S")
    expect(assumed(page)).to_have_count(0)
    choose(page, "HG1700")  # the switch holds for the next card too
    expect(noise(page)).to_have_value("0.00208333")
    expect(assumed(page)).to_have_count(0)
    page.get_by_role("switch", name="Fill gaps in the datasheet with typical values").click()
    expect(assumed(page).first).to_be_visible()
