"""A class in browsers: the QR code, a phone that follows, wanders off and returns, and large type."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.conftest import DRAWN, eventually, new_context, show, shown, wait_for, watched
from tests.security.conftest import own_addresses, serving

pytestmark = pytest.mark.browser

PHONE = {
    "viewport": {"width": 390, "height": 844},
    "is_mobile": True,
    "has_touch": True,
    "user_agent": "Mozilla/5.0 (Linux; Android 14) Mobile Safari/537.36",
}
FLIGHT = "mission=los_angeles&trajectory.imu_rate=50&tab=Errors"
TIME = "Bokeh.documents[0].get_model_by_name('time cursor').location"
FLASHES = "[...Bokeh.documents[0].all_models].some(({css_classes}) => css_classes?.includes?.('told'))"
"""Whether a field flashes that a teacher has changed."""
TITLE_SIZE = """parseFloat(
    [...Bokeh.documents[0].all_models].find((model) => model.type === "Title").text_font_size)"""


def bar(page: Page, text: str) -> None:
    """Wait until the line of the class says something."""
    expect(page.get_by_text(text)).to_be_visible()


@pytest.mark.proof
def test_a_phone_follows_wanders_off_and_returns(chromium: Browser, tmp_path: Path) -> None:
    complaints: list[str] = []
    with serving(tmp_path, "--address", "0.0.0.0", "--teacher") as served:
        address = f"http://127.0.0.1:{served.port}"
        found = re.search(r"/teach\?key=[\w-]+", served.log.read_text())
        assert found is not None
        teacher = watched(chromium, address + "/", complaints)
        teacher.goto(address + found[0])
        assert "key" not in teacher.url
        teacher.goto(f"{address}/?{FLIGHT}")
        wait_for(teacher, DRAWN)
        teacher.get_by_role("button", name="Start a class").click()
        code = teacher.get_by_role("img", name="QR code of the link for students")
        expect(code).to_be_visible()
        box = code.bounding_box()
        assert box is not None
        assert box["width"] == pytest.approx(box["height"], abs=1)
        assert box["width"] > 400  # readable from the last row
        link = teacher.locator(".link").inner_text()
        assert re.fullmatch(rf"http://[\d.:a-f\[\]]+:{served.port}/\?class=[a-z2-9]{{6}}", link)
        teacher.keyboard.press("Escape")
        phone = new_context(chromium, **PHONE).new_page()
        phone.goto(f"{address}/?{link.rpartition('?')[2]}")
        wait_for(phone, DRAWN)
        bar(phone, "You follow your teacher.")
        bar(teacher, "follow")
        _check_that_a_change_flashes_and_is_named(teacher, phone)
        show(teacher, "Flight")
        teacher.evaluate(f"{TIME} = 42")
        wait_for(phone, f"{TIME} === 42")
        shown(phone, "Flight")
        show(phone, "Ground track")
        bar(phone, "You are exploring.")
        show(teacher, "Errors")
        wait_for(teacher, DRAWN)
        shown(phone, "Ground track")
        phone.get_by_role("button", name="Return to the teacher").click()
        wait_for(phone, DRAWN)
        bar(phone, "You follow your teacher.")
        wait_for(phone, "document.documentElement.scrollWidth <= 390")
        size = teacher.evaluate(TITLE_SIZE)
        teacher.get_by_role("button", name="Projector").click()
        wait_for(teacher, f"({TITLE_SIZE}) > {1.4 * size}")
        expect(teacher.get_by_role("combobox", name="Mission")).not_to_be_visible()
        teacher.get_by_role("button", name="Close the class").click()
        bar(phone, "The class has ended.")
        phone.context.close()
        teacher.context.close()
        assert "Traceback" not in served.log.read_text()
    assert complaints == []


def _check_that_a_change_flashes_and_is_named(teacher: Page, phone: Page) -> None:
    noise = teacher.get_by_role("textbox", name="White noise [°/s/√Hz]")
    noise.fill("0.2")
    noise.press("Enter")
    bar(phone, "Changed: Gyros: White noise 0.05 → 0.2")
    wait_for(phone, FLASHES)


def open_live(page: Page) -> None:
    """Open the page Live."""
    wait_for(page, DRAWN)
    show(page, "Live")
    expect(page.get_by_role("button", name="Connect", exact=True)).to_be_visible()


def offers(page: Page) -> list[str]:
    """Return the sources that a page offers."""
    page.get_by_role("combobox", name="Source").click()
    found = page.get_by_role("menuitem").all_inner_texts()
    page.keyboard.press("Escape")
    return found


def watch(page: Page) -> None:
    """Watch the source that others have opened."""
    page.get_by_role("combobox", name="Source").click()
    page.get_by_role("menuitem").filter(has_text="Watch: ").first.click()
    page.get_by_role("button", name="Connect", exact=True).click()
    page.get_by_role("button", name="Disconnect").wait_for()


@pytest.mark.proof
def test_a_student_shares_a_source_and_takes_it_back(chromium: Browser, tmp_path: Path) -> None:
    complaints: list[str] = []
    with serving(tmp_path, "--address", "0.0.0.0", "--teacher") as served:
        host = next(iter(own_addresses()), "127.0.0.1")  # not that of whoever serves, if there is one
        address = f"http://{host}:{served.port}"
        found = re.search(r"/teach\?key=[\w-]+", served.log.read_text())
        assert found is not None
        teacher = watched(chromium, address + "/", complaints)
        teacher.goto(address + found[0])
        teacher.goto(f"{address}/?{FLIGHT}")
        wait_for(teacher, DRAWN)
        teacher.get_by_role("button", name="Start a class").click()
        link = teacher.locator(".link").inner_text().rpartition("?")[2]
        teacher.keyboard.press("Escape")
        ann, ben = (new_context(chromium, viewport={"width": 1000, "height": 700}) for _ in range(2))
        first, other = ann.new_page(), ben.new_page()
        for page in (first, other):
            page.goto(f"{address}/?{link}&{FLIGHT}&seed=2")
            open_live(page)
        first.get_by_role("button", name="Connect", exact=True).click()
        first.get_by_role("button", name="Disconnect").wait_for()
        assert not any(offer.startswith("Watch") for offer in offers(other))
        share = first.get_by_text("Share with the class")
        share.click()
        eventually(other, lambda: any(offer.startswith("Watch") for offer in offers(other)))
        watch(other)
        expect(first.get_by_role("button", name="Unplug")).to_be_visible()
        expect(other.get_by_role("button", name="Unplug")).not_to_be_visible()
        expect(other.get_by_text("Share with the class")).not_to_be_visible()
        share.click()
        expect(other.get_by_text("not shared with you any more")).to_be_visible()
        expect(other.get_by_role("button", name="Connect", exact=True)).to_be_visible()
        if host != "127.0.0.1":
            tabs = [ann.new_page() for _ in range(2)]
            for seed, tab in enumerate(tabs, 3):
                tab.goto(f"{address}/?{link}&{FLIGHT}&seed={seed}")
                open_live(tab)
                tab.get_by_role("button", name="Connect", exact=True).click()
            tabs[0].get_by_role("button", name="Disconnect").wait_for()
            expect(tabs[1].get_by_text("You have 2 sources open")).to_be_visible()
            assert {cookie["name"] for cookie in ann.cookies()} == {f"ins_lab_browser_{served.port}"}
        for context in (ann, ben, teacher.context):
            context.close()
        assert "Traceback" not in served.log.read_text()
    assert complaints == []
