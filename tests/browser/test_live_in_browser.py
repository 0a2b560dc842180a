"""The Live page in a browser: a simulated device streams and is unplugged."""

from __future__ import annotations

import pytest
from playwright.sync_api import FloatRect, Locator, Page, ViewportSize, expect

from tests.browser.conftest import IDLE, eventually, show, wait_for

SMALL: ViewportSize = {"width": 900, "height": 600}
"""Size of the window [px]: a stream is drawn all the time, without a graphics card."""
NARROW: ViewportSize = {"width": 700, "height": 800}
PHONE: ViewportSize = {"width": 390, "height": 844}
LEGIBLE = 44
"""Least size of the large digits [px]: 10 mm high on most screens, which two metres away are 17'."""
RATES = "Bokeh.documents[0].get_model_by_name('live:Angular rate').data.time"

SCALES = """(() => {
  const figure = [...Bokeh.documents[0]._all_models.values()]
    .find(one => one.type === 'Figure' && one.title?.text?.startsWith('Ground track:'));
  const {x_range: x, y_range: y} = figure;
  return [(x.end - x.start) / figure.inner_width, (y.end - y.start) / figure.inner_height];
})()"""
"""Metres of a pixel of the live ground track, along both axes; that of the page Flight has no colon."""
EQUAL = f"{SCALES}.every(one => one > 0) && Math.abs({SCALES}[0] / {SCALES}[1] - 1) < 0.02"
PAINTED = """
async () => {
  const rates = Bokeh.documents[0].get_model_by_name('live:Angular rate'), line = [0.1, 0.1];
  rates.data = {time: [0, 200], age: [200, 0], forward: line, right: line, down: line};
  for (let frames = 0; frames < 3; ++frames) await new Promise(requestAnimationFrame);
  const view = [...Bokeh.index.query(one => one.model.title?.text?.startsWith('Angular rate'))][0];
  const {canvas, ctx} = view.canvas_view.overlays;
  const {data, width} = ctx.getImageData(0, 0, canvas.width, canvas.height);
  const edge = Math.floor((view.frame.bbox.left - 1) * view.canvas_view.pixel_ratio), painted = [0, 0];
  for (let byte = 3; byte < data.length; byte += 4)
    if (data[byte] > 0) painted[((byte >> 2) % width) < edge ? 0 : 1] += 1;
  return painted;
}
"""
"""Painted pixels of the overlay of a plot, left and right of the left edge of its frame.

A line in it begins long before the window."""
VISIBLE = (
    "[...Bokeh.documents[0]._all_models.values()]"
    ".filter(one => one.type === 'GlyphRenderer' && one.data_source.name === 'live:Angular rate')"
    ".map(one => one.visible)"
)


def connect(page: Page) -> None:
    """Open the page Live and connect the source that it offers first, the simulated device."""
    show(page, "Live")
    page.get_by_role("button", name="Connect", exact=True).click()
    page.get_by_role("button", name="Disconnect").wait_for()
    wait_for(page, f"{RATES}.length > 20")


def newest(page: Page) -> float:
    """Return the time of the newest sample that the browser has [s]."""
    return float(page.evaluate(f"{RATES}.at(-1)"))


def box(one: Locator) -> FloatRect:
    """Return where something is that is written anew four times a second, and is nowhere meanwhile."""
    expect(one).to_be_visible()
    found = next((found for _ in range(100) if (found := one.bounding_box()) is not None), None)
    assert found is not None
    return found


@pytest.mark.browser
def test_a_circle_on_the_ground_is_a_circle(shared_page: Page) -> None:
    page = shared_page
    for size in (SMALL, NARROW):
        page.set_viewport_size(size)
        if size is SMALL:
            connect(page)
        wait_for(page, EQUAL)
    # The attitude is the first thing that is seen, and is large.
    for size in (PHONE, SMALL):
        page.set_viewport_size(size)
        roll, strip = box(page.locator(".angle").first), box(page.get_by_text("streaming", exact=True))
        button = box(page.get_by_role("button", name="Disconnect"))
        assert 0 < roll["y"] < strip["y"] < button["y"] < size["height"]
        assert roll["x"] >= 0
        assert roll["x"] + roll["width"] <= size["width"]
        assert box(page.locator(".angle b").first)["height"] >= LEGIBLE
    # The strip stays in sight.
    page.mouse.move(size["width"] / 2, size["height"] - 50)
    page.mouse.wheel(0, 1000)
    eventually(page, lambda: box(page.get_by_role("button", name="Disconnect"))["y"] < 0)
    assert box(page.get_by_text("streaming", exact=True))["y"] > 0
    page.mouse.wheel(0, -1000)
    page.get_by_role("button", name="Details").click()
    expect(page.get_by_text("Recognised as VectorNav from")).to_be_visible()
    page.get_by_role("button", name="Disconnect").click()
    expect(page.get_by_text("Disconnected.")).to_be_visible()
    expect(page.locator(".angle").first).to_be_hidden()
    # The scales are equal in a window of another size, too, though nothing streams any more.
    for size in (NARROW, SMALL):
        page.set_viewport_size(size)
        wait_for(page, EQUAL)
    # A line that begins before the window is painted in the frame alone.
    wait_for(page, IDLE)
    outside, inside = page.evaluate(PAINTED)
    assert outside == 0 < inside


@pytest.mark.proof
@pytest.mark.browser
def test_a_stream_is_drawn_as_it_comes(shared_page: Page) -> None:
    page = shared_page
    page.set_viewport_size(SMALL)
    connect(page)
    before = newest(page)
    wait_for(page, f"{RATES}.at(-1) > {before} + 2")
    expect(page.get_by_text("streaming", exact=True)).to_be_visible()
    # The plots end at the newest sample, of all figures.
    ages = "Bokeh.documents[0].get_model_by_name('live:Angular rate').data.age"
    wait_for(page, f"{ages}.at(-1) >= 0 && {ages}.at(-1) < 0.5 && {ages}.length === {RATES}.length")

    page.get_by_text("forward", exact=True).first.click()
    wait_for(page, f"{VISIBLE}.join() === 'false,true,true'")
    page.get_by_text("forward", exact=True).first.click()
    wait_for(page, f"{VISIBLE}.join() === 'true,true,true'")

    page.get_by_role("button", name="Pause").click()
    page.get_by_role("button", name="Go on").wait_for()
    wait_for(page, IDLE)
    paused = newest(page)
    page.wait_for_timeout(1000)
    assert newest(page) == paused
    page.get_by_role("button", name="Go on").click()
    wait_for(page, f"{RATES}.at(-1) > {paused} + 1")

    page.get_by_role("button", name="Unplug for 3 s").click()
    expect(page.get_by_text("lost", exact=True)).to_be_visible()
    expect(page.get_by_text("streaming", exact=True)).to_be_visible()

    page.get_by_role("button", name="Disconnect").click()
    expect(page.get_by_text("Disconnected.")).to_be_visible()
