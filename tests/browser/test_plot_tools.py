"""Tools of the plots in a real browser: menu, legend, values at pointer and cursor, lane of events."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from lab.experiment.experiment import Experiment
from tests.browser.conftest import DRAWN, ERRORS, IDLE, new_context, show, wait_for

pytestmark = pytest.mark.browser

CURSOR = "Bokeh.documents[0].get_model_by_name('time cursor')"
OVERVIEW = "Bokeh.documents[0].get_model_by_name('time:overview_position')"
EAST = "Bokeh.documents[0].get_model_by_name('time:position_east').data"

NEAR = """(data, time) => {
  const far = Array.from(data.time, (t) => Math.abs(t - time));
  const near = far.indexOf(Math.min(...far));
  return [data.position_east[near], data.position_east_band_high[near] / 3].map((one) => one.toPrecision(3));
}"""
"""Error and σ of the sample next to a time, with three digits."""


REFUSE = """() => {
  navigator.clipboard.writeText = () => Promise.reject();
  const execute = () => { window.selected = document.activeElement.value; return false; };
  document.execCommand = execute;
}"""
"""Has the browser allow no copying, and note what would have been copied."""


def saved(page: Page, item: str) -> tuple[str, bytes]:
    """Choose an item of the menu of the first plot by keys; return the name and the content of the file."""
    page.get_by_role("button", name="Menu of Position error, east").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("menuitem").first).to_be_focused()
    with page.expect_download() as download:
        page.get_by_role("menuitem", name=item).click()
    return download.value.suggested_filename, Path(download.value.path()).read_bytes()


def test_each_plot_gives_pictures_numbers_and_a_link(open_page: Callable[..., Page]) -> None:
    page = open_page("?mission=los_angeles&trajectory.imu_rate=50&zoom=20-40")
    name, content = saved(page, "PNG")
    assert name == "position_error_east.png" and content.startswith(b"\x89PNG") and len(content) > 2000
    name, content = saved(page, "SVG")
    drawing = content.decode()
    assert name == "position_error_east.svg" and "Position error, east [m]" in drawing
    assert "<image" not in drawing  # lines, and no picture of them
    name, content = saved(page, "csv")
    head, *rows = csv.reader(io.StringIO(content.decode()))
    assert head == ["time [s]", "±3σ from [m]", "±3σ to [m]", "error [m]"]
    made = Experiment(mission="los_angeles").update({"trajectory.imu_rate": 50.0}).run()
    seen = (made.time >= 20.0) & (made.time <= 40.0)
    error, sigma = (one["position"].values[seen, 0] for one in (made.errors, made.sigma))
    expected = np.stack((made.time[seen], -3 * sigma, 3 * sigma, error), axis=-1)
    assert page.evaluate(f"{EAST}.time.length") < seen.sum()  # on the page, they are thinned
    np.testing.assert_allclose(np.array(rows, dtype=float), expected, rtol=1e-9, atol=1e-12)
    page.evaluate("navigator.clipboard.writeText = (text) => { window.copied = text; }")
    page.get_by_role("button", name="Menu of Position error, east").focus()
    page.keyboard.press("Enter")
    page.keyboard.press("ArrowUp")  # from the first item to the last
    page.keyboard.press("Enter")
    expect(page.get_by_role("status").get_by_text("Link copied")).to_be_visible()
    assert page.evaluate("window.copied === location.href && location.search.includes('zoom')")
    page.evaluate("history.replaceState(history.state, '', location.href + '&class=abc&theme=dark')")
    page.evaluate(REFUSE)
    page.get_by_role("button", name="Menu of Position error, east").press("Enter")
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Enter")
    expect(page.get_by_role("status").get_by_text("does not allow copying")).to_be_visible()
    assert "class=" not in page.evaluate("window.selected")
    assert "theme=" not in page.evaluate("window.selected")


def test_values_legend_and_events_follow_what_is_shown(open_page: Callable[..., Page]) -> None:
    page = open_page("?mission=los_angeles&trajectory.imu_rate=50&sensors.gps.outages=[[30,40]]")
    lane = page.get_by_role("toolbar", name="Events of the flight")
    starts = [
        float(re.findall(r"[\d.]+", name)[0])
        for name in lane.get_by_role("button").evaluate_all("(all) => all.map((one) => one.ariaLabel)")
    ]
    assert starts == sorted(starts)  # as a screen reader, and Tab, go through them
    assert len(starts) > 4
    expect(
        page.get_by_role("figure", name=re.compile(r"^Position error, east \[m\].*rms .* in 3σ$"))
    ).to_be_visible()
    lane.get_by_role("button", name="Outage: 30.0 s to 40.0 s").click()
    wait_for(page, f"{CURSOR}.location === 30")
    legend = page.get_by_role("group", name="Legend")
    for words in ("error", "±3σ of the filter", "no GPS"):
        expect(legend.get_by_text(words, exact=True)).to_be_visible()
    page.keyboard.press("v")
    row = page.get_by_role("table", name="Values at the time cursor").get_by_role("row").nth(1)
    expect(row.get_by_role("rowheader")).to_have_text("Position error, east")
    for time in (30, 39):
        page.evaluate(f"{CURSOR}.location = {time}")
        expect(page.get_by_text(f"at {time}.00 s", exact=True)).to_be_visible()
        error, sigma = page.evaluate(f"({NEAR})({EAST}, {time})")
        assert row.get_by_role("cell").all_inner_texts() == [error.replace("-", "\u2212"), sigma, "m"]
    show(page, "Flight")
    expect(legend.get_by_role("button", name="truth")).to_be_visible()
    truths = "Bokeh.documents[0]._all_models.values().filter((m) => m.name === 'truth').map((m) => m.visible)"
    legend.get_by_role("button", name="truth").click()
    expect(legend.get_by_role("button", name="truth")).to_have_attribute("aria-pressed", "false")
    assert page.evaluate(f"Array.from({truths}).filter((one) => !one).length >= 6")
    expect(page.get_by_role("table", name="Values at the time cursor")).to_contain_text(
        "Height above the ellipsoid, estimate"
    )
    _the_sigma_of_a_length_is_a_third_of_its_bound(page, time)


def _the_sigma_of_a_length_is_a_third_of_its_bound(page: Page, time: float) -> None:
    """Expect it on the Overview, beside a cursor at a time [s], where the table of values is shown."""
    show(page, "Overview")
    wait_for(page, f"{OVERVIEW}?.data.time?.length > 100 && {CURSOR}?.location === {time}")
    expect(page.get_by_role("group", name="Legend").get_by_text("3σ of the filter")).to_have_count(1)
    row = page.get_by_role("table", name="Values at the time cursor").get_by_role("row").nth(1)
    expect(row.get_by_role("rowheader")).to_have_text("Horizontal position error")
    high = page.evaluate(f"""() => {{
      const {{data}} = {OVERVIEW};
      const far = Array.from(data.time, (time) => Math.abs(time - {time}));
      return data.overview_position_band_high[far.indexOf(Math.min(...far))];
    }}""")
    assert float(row.get_by_role("cell").nth(1).inner_text()) == pytest.approx(high / 3, rel=5e-3)


STRETCH = "(({start, end}) => [start, end])(Bokeh.documents[0].get_model_by_name('time axis'))"
SCROLLED = "Array.from(Bokeh.index.query(({model}) => model.name === 'page stage'))[0].el.scrollTop"
TITLES = """[...insLabPlots].map(({model, bbox, frame, renderer_views}) => [
  model.title.text.includes("\\n"),
  frame.bbox.left + renderer_views.get(model.title).get_size().width <= bbox.width - 36,
  renderer_views.get(model.title).get_size().height <= frame.bbox.top,
])"""
"""Of each plot, whether its title has two lines, leaves room for the menu, and is whole above its curves."""
EDGES = """[...insLabPlots].map(({bbox, canvas_view: {primary: {ctx}}}) => {
  const {data} = ctx.getImageData(bbox.width / 4, 0, bbox.width / 2, 1);
  const painted = [...data].filter((value, index) => index % 4 < 3 && data[index | 3] > 0);
  return [painted.length > 0, painted.some((value) => value < 250)];
})"""
"""Of each plot, whether its upper edge has been painted, and whether a line of a title has been painted
across it, of which a trace stays. What is not painted yet is black, but not opaque."""


@pytest.fixture(scope="module")
def phone(chromium: Browser, address: str) -> Iterator[Page]:
    """Return the nine plots on a phone."""
    context = new_context(chromium, viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(address + ERRORS)
    wait_for(page, DRAWN)
    yield page
    context.close()


def test_fingers_zoom_a_plot_then_move_along_the_time_and_scroll_the_page(phone: Page) -> None:
    page = phone
    wire = page.context.new_cdp_session(page)

    def move(steps: int, *fingers: tuple[float, float, float, float]) -> None:
        """Put fingers down at x and y, and move each by a step at a time."""
        for step in range(steps + 1):
            points = [
                {"x": x + step * dx, "y": y + step * dy, "id": finger}
                for finger, (x, y, dx, dy) in enumerate(fingers)
            ]
            for count in range(1, len(points) + 1) if step == 0 else [len(points)]:
                kind = "touchMove" if step else "touchStart"
                wire.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points[:count]})
        wire.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    whole = page.evaluate(STRETCH)
    move(10, (300, 280, -10, 0))  # with the whole flight in sight, there is nowhere to go
    assert page.evaluate(STRETCH) == whole
    move(8, (180, 280, -8, 0), (220, 280, 8, 0))
    wait_for(page, f"{STRETCH}[1] < {whole[1] * 0.8}")
    start, end = page.evaluate(STRETCH)
    move(10, (300, 280, -10, 0))
    wait_for(page, f"{STRETCH}[0] > {start + 5}")
    moved = page.evaluate(STRETCH)
    assert moved[1] - moved[0] == pytest.approx(end - start)
    assert page.evaluate(f"{CURSOR}.location") == 0  # it was no tap
    move(12, (200, 600, 0, -20))
    wait_for(page, f"{SCROLLED} > 100")
    assert page.evaluate(STRETCH) == moved


def test_a_title_that_would_run_under_the_menu_of_its_plot_has_two_lines(phone: Page) -> None:
    page = phone
    wait_for(page, f"{TITLES}.some(([two]) => two) && {TITLES}.every(([, free]) => free)")
    wait_for(page, f"{EDGES}.some(([painted]) => painted)")
    assert not page.evaluate(f"{EDGES}.some(([, cut]) => cut)")
    assert page.get_by_role("button", name="Menu of Position error, east").count() == 1
    page.set_viewport_size({"width": 690, "height": 844})  # in one column
    wait_for(page, f"{TITLES}.every(([two, free]) => !two && free)")
    page.set_viewport_size({"width": 720, "height": 844})  # in three columns: a name alone may be too long
    for tab in ("Flight", "Errors"):
        show(page, tab)
        wait_for(page, f"{TITLES}.length >= 9 && {IDLE}")
        wait_for(page, f"{TITLES}.some(([two]) => two) && {TITLES}.every(([, free, whole]) => free && whole)")
    assert page.get_by_role("button", name="Menu of Velocity error, north").count() == 1


def test_the_legend_of_the_budget_stands_below_in_a_narrow_window_of_a_mouse(
    open_page: Callable[..., Page],
) -> None:
    page = open_page("?mission=los_angeles&trajectory.imu_rate=50&tab=Budget", width=390, drawn=False)
    places = """(() => {
      const plot = [...insLabPlots].find(({model}) => model.title?.text.startsWith("Share"));
      const legend = [...plot.model.right, ...plot.model.below].find(({type}) => type === "Legend");
      const view = plot.renderer_views.get(legend);
      const outer = plot.el.getBoundingClientRect();
      const parts = [...view.shadow_el.querySelectorAll("*")].map((el) => el.getBoundingClientRect());
      const drawn = parts.filter(({width}) => width > 0);
      const inside = drawn.every(({left, right}) => left >= outer.left && right <= outer.right);
      return [plot.model.below.includes(legend), inside && plot.frame.bbox.height > 100];
    })()"""
    wait_for(
        page, "[...insLabPlots].some(({model}) => model.title?.text.startsWith('Share of the variance of'))"
    )
    # The settings stay closed.
    for width, below in ((390, True), (360, True), (700, False), (480, True), (1440, False)):
        page.set_viewport_size({"width": width, "height": 900})
        wait_for(page, f"String({places}) === '{str(below).lower()},true'")


REPAINTS = """() => {
  const [view] = window.insLabPlots, cursor = Bokeh.documents[0].get_model_by_name("time cursor");
  const parts = [...view.renderer_views.values()];
  view.paint();
  const painted = [];
  for (const layer of ["_paint_primary", "_paint_overlays"]) {
    const paint = view[layer];
    view[layer] = (ctx) => {
      painted.push(layer);
      paint.call(view, ctx);
    };
  }
  cursor.setv({location: cursor.location + 1}, {sync: false});
  view.paint();
  delete view._paint_primary;
  delete view._paint_overlays;
  cursor.setv({location: cursor.location - 1}, {sync: false});
  const curves = parts.filter(({model}) => model.type === "GlyphRenderer");
  const progress = Array.from(Bokeh.index.query(({model}) => model.css_classes?.includes("progress")))[0];
  return [painted, curves.map(({position}) => position.css).join(""), progress.el.offsetHeight > 15];
}"""
"""Which layers of a plot a move of the time cursor paints, what style its curves write with a repaint, and
whether the text of the progress, which is empty, is as high as a line."""


def test_what_moves_over_plots_paints_itself_alone_and_runs_lay_no_page_out(shared_page: Page) -> None:
    wait_for(shared_page, IDLE)
    assert shared_page.evaluate(REPAINTS) == [["_paint_overlays"], "", True]
