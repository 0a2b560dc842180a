"""What components of a page tell the server: what a person did, and nothing that the server told them."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import ERRORS, IDLE, eventually, remember, reset, show, wait_for

pytestmark = pytest.mark.browser

BOXES = """[...Bokeh.documents[0]._all_models.values()]
  .filter(({data}) => data?.attributes?.value_input)
  .map(({id, data}) => [Bokeh.index.find_one_by_id(id)?.shadow_el?.querySelector("input"), data])
  .filter(([input]) => input?.checkVisibility())"""
"""Boxes of text that one sees, each with its data."""
TOLD_TWICE = """
async () => {
  const page = Bokeh.documents[0], pause = () => new Promise((done) => setTimeout(done, 50));
  const {set, get} = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "defaultValue");
  const slowly = {configurable: true, get, set(value) {
    for (const begun = performance.now(); performance.now() - begun < 30;);
    set.call(this, value);
  }};
  const kept = [];
  for (const [input, data] of window.boxes) {
    const before = data.value, tell = (value) => page.apply_json_patch({events: ["value", "value_input"].map(
      (attr) => ({kind: "ModelChanged", model: {id: data.id}, attr, new: value}))});
    Object.defineProperty(input, "defaultValue", slowly);
    let again = performance.now() + 2000;  // the server may tell the box its value meanwhile
    const turns = new MessageChannel(), replaced = new Promise((done) => {
      turns.port1.onmessage = () => {
        if (input.value === "first") { tell("second"); done(); return; }
        if (performance.now() > again) { tell("first"); again += 2000; }
        turns.port2.postMessage(0);
      };
    });
    turns.port2.postMessage(0);
    tell("first");
    await replaced;
    delete input.defaultValue;
    await pause();
    kept.push(data.value);
    tell(before);
    await pause();
  }
  return kept;
}
"""
"""Tells each box a text, and another one when it shows the first; showing it takes the browser 30 ms."""


def test_a_text_that_the_server_replaced_is_not_sent_back(shared_page: Page) -> None:
    """It undid later steps of the slider to which the box belongs, where the browser was slow."""
    page = shared_page
    wait_for(page, f"{BOXES}.length >= 10")  # a box is drawn some time after the server has sent it
    remember(page, "boxes", f"{BOXES}.filter((_, place) => place % 4 === 0)")  # they are of few components
    kept = page.evaluate(TOLD_TWICE)
    assert len(kept) >= 3
    assert kept == ["second"] * len(kept)
    wait_for(page, IDLE)
    assert page.evaluate("location.search") == ERRORS


def test_what_a_person_enters_is_sent(shared_page: Page) -> None:
    """Also where it is what the box had told before, and where the server refuses it."""
    page = shared_page
    box = page.get_by_role("textbox", name="Seed").first
    for seed in ("7", "8", "7"):
        box.fill(seed)
        box.press("Enter")
        wait_for(page, f"location.search.includes('seed={seed}')")
    for _ in range(2):
        box.fill("seven")
        box.press("Enter")
        expect(page.get_by_text("Seed must be a whole number")).to_be_visible()
        expect(box).to_have_value("7")


NO_ANSWER = """
() => {
  const page = Bokeh.documents[0], late = [];
  page.apply_json_patch = (...patch) => { late.push(patch); };
  window.answer = () => {
    delete page.apply_json_patch;
    late.forEach((patch) => page.apply_json_patch(...patch));
  };
}
"""
"""Keeps all that the server says back until `answer` is called."""
SLOW_TO_DRAW = """
() => {
  const {postMessage} = MessagePort.prototype;
  MessagePort.prototype.postMessage = function (...message) {
    setTimeout(() => postMessage.call(this, ...message), 200);
  };
  window.draw_at_once = () => { MessagePort.prototype.postMessage = postMessage; };
}
"""
"""Components are drawn 200 ms after they have changed as on a busy machine until `draw_at_once` is called."""
GREY = "rgba(0, 0, 0, 0)"
COLOUR = "(button) => getComputedStyle(button).backgroundColor"
SEEN = """(button) => {
  window.seen = new Set();
  const look = () => {
    seen.add(`${getComputedStyle(button).backgroundColor} ${button.innerText}`);
    if (button.innerText.includes("Consistent")) requestAnimationFrame(look);
  };
  look();
}"""
"""Notes the colour of each frame until the verdict is another one."""


@pytest.mark.parametrize(("typed", "is_accepted"), [("0.1", True), ("-1", False), ("1.0", False)])
def test_no_verdict_is_green_while_the_server_has_not_answered(
    shared_page: Page, typed: str, is_accepted: bool
) -> None:
    """Neither on a change, nor on a value that the server refuses, or has already."""
    page = shared_page
    chip = page.locator(".verdict-chip button")
    expect(chip).to_have_text("● Consistent")
    eventually(page, lambda: chip.evaluate(COLOUR) != GREY)  # the one of a test before may be struck out
    green = chip.evaluate(COLOUR)
    page.evaluate(NO_ANSWER)
    page.evaluate(SLOW_TO_DRAW)
    box = page.get_by_role("textbox", name="Q scale").first
    box.fill(typed)
    box.press("Enter")
    page.evaluate("() => new Promise(requestAnimationFrame)")
    assert chip.evaluate(COLOUR) == GREY
    assert "line-through" in chip.evaluate("(button) => getComputedStyle(button).textDecoration")
    chip.evaluate(SEEN)
    page.evaluate("answer()")
    expect(chip).to_have_text("● Q 9.9 × too small" if is_accepted else "● Consistent")
    assert not is_accepted or f"{green} ● Consistent" not in page.evaluate("[...seen]")
    page.evaluate("draw_at_once()")
    eventually(page, lambda: (chip.evaluate(COLOUR) == green) != is_accepted)
    assert "line-through" not in chip.evaluate("(button) => getComputedStyle(button).textDecoration")


def test_no_verdict_is_green_while_a_button_that_begins_a_run_is_on_its_way(shared_page: Page) -> None:
    page = shared_page
    chip = page.locator(".verdict-chip button")
    page.get_by_role("textbox", name="Q scale").first.fill("0.9")
    page.get_by_role("textbox", name="Q scale").first.press("Enter")
    show(page, "Overview")
    redo, seed, gps = (
        page.get_by_role("button", name=name) for name in ("Redo", "Another seed", "Take away GPS")
    )
    for press, needs in (
        (lambda: page.keyboard.press("Control+z"), chip),
        (redo.click, redo),
        (seed.click, seed),
        (gps.click, gps),
        (lambda: reset(page), chip),
    ):
        wait_for(page, IDLE)
        expect(needs).to_be_enabled()
        eventually(page, lambda: chip.evaluate(COLOUR) != GREY)
        page.get_by_role("slider", name="Time").focus()
        page.evaluate(NO_ANSWER)
        press()
        eventually(page, lambda: chip.evaluate(COLOUR) == GREY)
        page.evaluate("answer()")
    eventually(page, lambda: chip.evaluate(COLOUR) != GREY)
