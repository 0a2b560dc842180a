"""Undo, redo, Back, Forward and a reload in a real browser: the page and its address stay together."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, Route, WebSocket, expect

from tests.browser.conftest import IDLE, eventually, show, shown, wait_for

pytestmark = pytest.mark.browser

NOISE = "White noise [°/s/√Hz]"
BEGUN = "?mission=los_angeles&trajectory.imu_rate=50"
ADDRESS = "decodeURIComponent(location.search)"
CURSOR = "Bokeh.documents[0].get_model_by_name('time cursor')?.location"
ENTRIES = "history.length"


def shows(page: Page, noise: str, tab: str = "Errors") -> None:
    """Expect that the page shows a noise of the gyros and a tab, and that its address says so."""
    expect(page.get_by_role("textbox", name=NOISE)).to_have_value(noise)
    shown(page, tab)
    setting = f"&sensors.gyro.noise_density={noise}" if noise != "0.05" else ""
    view = f"&tab={tab}"
    wait_for(page, f"{ADDRESS}.replace(/&time=[0-9.]+/, '') === '{BEGUN}{setting}{view}'")


def drag(page: Page) -> str:
    """Drag the slider of the noise in several steps; return the noise at its end."""
    slider = page.get_by_role("slider", name="White noise").first
    place = slider.bounding_box()
    assert place is not None
    x, y = place["x"] + place["width"] / 2, place["y"] + place["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 50, y, steps=5)
    page.mouse.up()
    dragged = f"{float(slider.input_value()):.6g}"
    assert dragged != "0.2"
    return dragged


def test_back_forward_undo_redo_a_reload_and_the_sheet_of_missions_change_page_and_address(
    open_page: Callable[..., Page],
) -> None:
    page = open_page(BEGUN)
    entries, box = page.evaluate(ENTRIES), page.get_by_role("textbox", name=NOISE)
    undo, redo = page.get_by_role("button", name="Undo"), page.get_by_role("button", name="Redo")
    expect(undo).to_be_disabled()
    box.fill("0.2")
    box.press("Enter")
    shows(page, "0.2")
    show(page, "Flight")
    shows(page, "0.2", "Flight")
    page.go_back()
    shows(page, "0.05")
    expect(undo).to_be_disabled()
    page.go_forward()
    shows(page, "0.2", "Flight")
    undo.click()
    shows(page, "0.05")
    expect(redo).to_have_attribute("title", "Redo: Gyros: White noise 0.05 → 0.2 (Ctrl+Shift+Z)")
    box.focus()
    page.keyboard.press("Control+Shift+Z")  # that of the box, which is for its letters
    page.get_by_role("slider", name="Time").focus()
    page.keyboard.press("Control+Shift+Z")
    shows(page, "0.2", "Flight")
    page.keyboard.press("Control+z")
    shows(page, "0.05")
    redo.click()
    shows(page, "0.2", "Flight")
    assert page.evaluate(ENTRIES) == entries + 1  # none of these ways added one
    dragged = drag(page)
    shows(page, dragged, "Flight")
    expect(undo).to_have_attribute("title", f"Undo: Gyros: White noise 0.2 → {dragged} (Ctrl+Z)")
    assert page.evaluate(ENTRIES) == entries + 2
    page.get_by_role("slider", name="Time").press("End")
    wait_for(page, f"{ADDRESS}.includes('&time=')")

    page.reload()
    wait_for(page, f"{IDLE} && {CURSOR} > 50")
    shows(page, dragged, "Flight")
    page.go_back()  # to what was before the reload
    shows(page, "0.2", "Flight")
    wait_for(page, IDLE)
    page.go_back()
    shows(page, "0.05")
    wait_for(page, IDLE)
    _back_closes_the_sheet_of_missions(page)


def _back_closes_the_sheet_of_missions(page: Page) -> None:
    """Back closes the sheet and does not leave the page, which shows what it showed before."""
    missions = page.get_by_role("button", name=re.compile("^Missions[,:]"))
    close = page.get_by_role("button", name="Close Missions")
    missions.click()
    expect(close).to_be_visible()
    wait_for(page, "history.state.over === true")
    page.evaluate("history.back()")
    expect(close).not_to_be_visible()
    shows(page, "0.05")
    missions.click()  # closed by its own button, it leaves nothing behind that Back would have to pass
    wait_for(page, "history.state.over === true")
    close.click()
    wait_for(page, "history.state.over === false")
    shows(page, "0.05")
    box = page.get_by_role("textbox", name=NOISE)
    box.fill("0.2")
    box.press("Enter")
    shows(page, "0.2")
    page.evaluate("history.back()")
    shows(page, "0.05")
    missions.click()  # what can be redone stays
    expect(close).to_be_visible()
    close.click()
    expect(close).not_to_be_visible()
    page.evaluate("history.forward()")
    shows(page, "0.2")


@pytest.mark.proof
def test_undo_and_forward_lead_past_a_reload(open_page: Callable[..., Page]) -> None:
    """The server has forgotten what was before; the browser has its addresses."""
    page = open_page(BEGUN)
    box, undo = page.get_by_role("textbox", name=NOISE), page.get_by_role("button", name="Undo")
    for noise in ("0.2", "0.3"):
        box.fill(noise)
        box.press("Enter")
        shows(page, noise)
    page.reload()
    expect(undo).to_have_attribute("title", "Undo: the last change before the reload (Ctrl+Z)")
    undo.click()
    shows(page, "0.2")
    wait_for(page, IDLE)
    page.go_forward()
    shows(page, "0.3")
    wait_for(page, IDLE)
    page.go_back()
    shows(page, "0.2")
    wait_for(page, IDLE)
    box.fill("0.4")
    box.press("Enter")
    shows(page, "0.4")
    for noise in ("0.2", "0.05"):
        page.get_by_role("slider", name="Time").focus()
        page.keyboard.press("Control+z")
        shows(page, noise)
        wait_for(page, IDLE)
    expect(undo).to_be_disabled()


@pytest.mark.proof
def test_undos_past_a_reload_are_neither_lost_nor_overwritten_by_what_the_server_still_writes(
    open_page: Callable[..., Page],
) -> None:
    page = open_page(BEGUN)
    box, time = page.get_by_role("textbox", name=NOISE), page.get_by_role("slider", name="Time")
    for noise in ("0.2", "0.3"):
        box.fill(noise)
        box.press("Enter")
        shows(page, noise)
    sent: list[str] = []  # by the server

    def listen(socket: WebSocket) -> None:
        socket.on("framereceived", lambda frame: sent.append(str(frame)))

    page.on("websocket", listen)
    page.reload()
    wait_for(page, IDLE)
    box.fill("0.4")
    box.press("Enter")
    shows(page, "0.4")
    opened: list[Route] = []  # on their way to the server

    def hold(route: Route) -> None:
        opened.append(route)

    page.route("**/simulator?*", hold)
    time.focus()
    for _ in range(3):
        page.keyboard.press("Control+z")
    eventually(page, lambda: any("noise_density" not in one.request.url for one in opened))
    page.keyboard.press("End")
    eventually(page, lambda: any("&time=" in frame for frame in sent))
    opened[-1].continue_()
    shows(page, "0.05")
    wait_for(page, IDLE)
    expect(page.get_by_role("button", name="Undo")).to_be_disabled()
