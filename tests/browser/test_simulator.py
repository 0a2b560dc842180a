"""The simulator in a real browser, served by a plain ``panel serve``: what a person sees and does."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from urllib.request import urlopen

import netCDF4
import pytest
from playwright.sync_api import Browser, FloatRect, Locator, Page, TimeoutError, ViewportSize, expect

from lab.views.cards import PLOTS
from tests.browser.conftest import (
    CURVE,
    DATA,
    IDLE,
    PATIENCE,
    RANGE_END,
    remember,
    reset,
    share,
    show,
    wait_for,
    watched,
)
from tests.browser.test_page_walk import FIRST, TITLES

pytestmark = pytest.mark.browser

Open = Callable[..., Page]

SMALL: ViewportSize = {"width": 900, "height": 600}
"""Window of tests in three dimensions [px]: it is drawn without a graphics card."""
CURSOR = "Bokeh.documents[0].get_model_by_name('time cursor').location"


def remember_data(page: Page) -> None:
    remember(page, "before", DATA)


def wait_for_new_data(page: Page) -> None:
    wait_for(page, f"{DATA} !== window.before")


def noise(page: Page) -> tuple:
    """Return the slider and the box of the gyro noise."""
    return page.get_by_role("slider", name="White noise").first, page.get_by_role(
        "textbox", name="White noise [°/s/√Hz]"
    )


ANSWER = 10_000.0
"""Longest wait for what a browser does by itself [ms]."""
ATTEMPTS = round(PATIENCE / ANSWER)


def zoom(page: Page, plot: Locator, start: float, end: float) -> FloatRect:
    """Drag over a part of a plot, from one fraction of its width to another; return the place of the plot.

    Bokeh takes a button that is held for 300 ms without a move of 5 px for a press, and sees no drag. On a
    busy computer even one move may take longer: one drags again, as a person does.
    """
    for _attempt in range(ATTEMPTS):
        wait_for(page, IDLE)
        box = plot.bounding_box()
        assert box is not None
        middle = box["y"] + box["height"] / 2
        page.mouse.move(box["x"] + start * box["width"], middle)
        page.mouse.down()
        page.mouse.move(box["x"] + (start + 0.03) * box["width"], middle)
        page.mouse.move(box["x"] + end * box["width"], middle, steps=4)
        page.mouse.up()
        try:
            wait_for(page, f"{RANGE_END} < 180", timeout=ANSWER)  # it waits for no server
        except TimeoutError:
            continue
        return box
    pytest.fail("no drag zoomed the plot")


def tap(page: Page, x: float, y: float) -> None:
    """Click on a plot until the cursor is there; on a busy computer, Bokeh takes a click for a press too."""
    for _attempt in range(ATTEMPTS):
        page.mouse.click(x, y)
        try:
            wait_for(page, f"{CURSOR} > 60", timeout=ANSWER)  # it waits for no server
        except TimeoutError:
            continue
        return
    pytest.fail("no click moved the cursor")


def test_opens_with_nine_plots_and_the_server_answers_others_plainly(shared_page: Page, address: str) -> None:
    """What the page asks others for, if anything, is a complaint of `shared_page`."""
    page = shared_page
    assert page.evaluate(f"Object.keys({DATA}).length") == 28
    assert page.evaluate(RANGE_END) == pytest.approx(205, abs=0.1)
    with urlopen(address) as answer:
        assert answer.status == 200


def test_slider_box_and_variance_of_a_noise_move_the_curves_and_no_value_out_of_bounds_does(
    shared_page: Page,
) -> None:
    page = shared_page
    slider, box = noise(page)
    page.get_by_role("button", name="σ²", exact=True).click()
    variance = page.get_by_role("textbox", name="Variance per sample").first
    remember_data(page)
    slider.press("End")
    wait_for_new_data(page)
    expect(box).to_have_value("0.5")
    expect(variance).to_have_value("50")
    wait_for(page, "location.search.includes('sensors.gyro.noise_density=0.5')")
    remember_data(page)
    variance.fill("0.5")
    variance.press("Enter")
    wait_for_new_data(page)
    expect(box).to_have_value("0.05")
    wait_for(page, "!location.search.includes('noise_density')")
    wait_for(page, IDLE)
    remember_data(page)
    plot = page.locator("canvas").first.bounding_box()
    box.fill("99")
    box.press("Enter")
    expect(page.get_by_role("alert")).to_have_text("White noise must be between 0 and 10 °/s/√Hz.")
    expect(box).to_have_value("0.05")
    assert page.locator("canvas").first.bounding_box() == plot  # no bar moves the plots
    assert page.evaluate(f"{DATA} === window.before")
    page.get_by_role("button", name="σ", exact=True).click()
    expect(page.get_by_role("textbox", name="σ per sample").first).to_have_value("0.707107")
    box.fill("0.06")
    box.press("Enter")
    wait_for_new_data(page)
    expect(page.get_by_role("alert")).to_have_count(0)


@pytest.mark.parametrize(
    ("name", "path"), [("White noise", "sensors.gyro.noise_density"), ("R scale", "navigator.r_scale")]
)
def test_each_of_many_quick_steps_of_a_slider_counts(shared_page: Page, name: str, path: str) -> None:
    """A position sent back by the server while the next ones are under way would undo them."""
    page, steps = shared_page, 30
    slider = page.get_by_role("slider", name=name).first
    begun, step = float(slider.input_value()), float(slider.get_attribute("step") or "nan")
    for _ in range(steps):
        slider.press("ArrowRight")
    ended = begun + steps * step
    assert float(slider.input_value()) == pytest.approx(ended, abs=step / 10)
    value = 10**ended if name == "R scale" else ended
    wait_for(page, f"Math.abs(new URLSearchParams(location.search).get('{path}') - {value}) < {value / 100}")
    wait_for(page, IDLE)
    assert float(slider.input_value()) == pytest.approx(ended, abs=step / 10)


def test_the_address_brings_settings_that_are_saved_and_reset(open_page: Open) -> None:
    page = open_page("?mission=los_angeles&sensors.gyro.noise_density=0.2")
    wait_for(page, f"{RANGE_END} < 120")
    expect(noise(page)[1]).to_have_value("0.2")
    expect(page.get_by_role("alert")).to_have_count(0)
    with page.expect_download() as download:
        share(page, "Settings file")
    assert "noise_density" in download.value.path().read_text(encoding="utf-8")
    assert download.value.suggested_filename == "los_angeles_1.toml"
    reset(page)
    expect(noise(page)[1]).to_have_value("0.05")


@pytest.mark.proof
@pytest.mark.parametrize(
    ("query", "words"),
    [
        (
            "?sensors.gyro.noise=1&navigator.r_scale=-3&mission=/etc/passwd.csv",
            ("unknown setting, sensors.gyro.noise;", "must be between", "there is no such mission"),
        ),
        ("?mission=atlantis&seed=2", ("there is no such mission",)),
    ],
    ids=["of all kinds", "a mission beside a setting"],
)
def test_nonsense_in_the_address_is_answered(open_page: Open, query: str, words: tuple[str, ...]) -> None:
    page = open_page(query)
    for part in words:
        expect(page.get_by_role("alert")).to_contain_text(part)
    if "seed=2" in query:  # the rest of the link is taken
        expect(page.get_by_role("textbox", name="Seed")).to_have_value("2")
    expect(page.get_by_role("alert")).not_to_contain_text("Traceback")


def test_a_page_that_was_left_is_not_sent_and_is_there_again(shared_page: Page) -> None:
    page = shared_page
    remember(page, "drawn", CURVE)
    views = (
        "Array.from(Bokeh.index.query((view) => view.model.title?.text?.startsWith('Position error'))).length"
    )
    show(page, "Covariance")
    wait_for(page, f"{views} === 0")
    show(page, "Errors")
    wait_for(page, f"{views} === 3 && {IDLE} && {CURVE} === window.drawn")
    slider, _ = noise(page)
    remember_data(page)
    slider.press("End")
    wait_for_new_data(page)
    wait_for(page, IDLE)

    innovations = "Bokeh.documents[0].get_model_by_name('time_gps:innovation_position_east')"
    wait_for(page, f"!{innovations}")  # a browser keeps the models of another test for half a minute
    remember(page, "errors", "Bokeh.documents[0].get_model_by_name('time:position_east')")
    remember(page, "before", "window.errors.data")
    show(page, "Innovations")
    wait_for(page, f"{innovations}?.data.time.length > 100")
    remember(page, "first", f"{innovations}.data")
    slider.press("Home")
    wait_for(page, f"{innovations}.data !== window.first")
    assert page.evaluate("window.errors.data === window.before")
    show(page, "Errors")
    wait_for(page, "window.errors.data !== window.before")


def test_zooming_one_plot_zooms_all_and_a_click_moves_the_cursor_that_play_runs(
    shared_page: Page,
) -> None:
    page = shared_page
    remember_data(page)
    plot = page.locator("canvas").nth(4)
    box = zoom(page, plot, 0.5, 0.55)
    middle = box["y"] + box["height"] / 2
    wait_for_new_data(page)
    wait_for(page, f"{DATA}.time.at(-1) - {DATA}.time[0] < 30")
    page.get_by_role("button", name="Whole flight", exact=True).click()
    wait_for(page, f"{RANGE_END} > 200")

    tap(page, box["x"] + box["width"] / 2, middle)
    clicked = page.evaluate(CURSOR)
    expect(page.get_by_text(re.compile(rf"^{clicked:.2f} s$"))).to_be_visible()
    play = page.locator(".MuiCheckbox-root", has_text=re.compile("play_arrow|pause")).locator("input")
    play.check()
    wait_for(page, f"{CURSOR} > {clicked} + 2")
    play.uncheck()


@pytest.mark.proof
def test_the_flight_in_three_dimensions_comes_through_the_same_port_and_by_no_forged_way(
    shared_page: Page, address: str
) -> None:
    page = shared_page
    page.set_viewport_size(SMALL)
    sockets: list[str] = []
    page.on("websocket", lambda socket: sockets.append(socket.url))
    show(page, "3-D")
    frame = page.frame_locator("iframe")
    expect(frame.locator("canvas").first).to_be_visible()
    expect(frame.get_by_text("Connected")).to_be_attached()  # its panel would cover so small a scene
    server = address.rpartition("/")[0]
    assert [url for url in sockets if "/viser/" in url]
    assert all(url.startswith(server.replace("http", "ws")) for url in sockets)
    forged = ("80.abc.def", "x", "5006..", "1.2.3.4")
    answers = {token: page.request.get(f"{server}/viser/{token}/").status for token in forged}
    assert answers == dict.fromkeys(forged, 403)


BACKGROUND = """() => {
  let part = document.querySelector("canvas");
  while (part && getComputedStyle(part).backgroundColor.endsWith(", 0)")) part = part.parentElement;
  return part && Math.max(...getComputedStyle(part).backgroundColor.match(/\\d+/g).slice(0, 3).map(Number));
}"""
"""Brightness of what is behind the scene in three dimensions, 0 to 255."""


@pytest.mark.proof
def test_the_theme_changes_without_a_new_session_and_in_three_dimensions(shared_page: Page) -> None:
    page = shared_page
    page.set_viewport_size(SMALL)
    remember_data(page)
    tab = page.get_by_role("tab", name="Sensors", exact=True)
    ink = tab.evaluate("element => getComputedStyle(element).color")
    toggle = page.get_by_role("button", name="Toggle theme")
    toggle.click()
    expect(tab).not_to_have_css("color", ink)
    assert page.evaluate(f"{DATA} === window.before")
    show(page, "3-D")
    page.frame_locator("iframe").get_by_text("Connected").wait_for(state="attached")
    scene = next(frame for frame in page.frames if "/viser/" in frame.url)
    wait_for(scene, f"({BACKGROUND})() < 60")
    toggle.click()
    wait_for(scene, f"({BACKGROUND})() > 200")
    toggle.click()
    wait_for(scene, f"({BACKGROUND})() < 60")
    toggle.click()
    expect(tab).to_have_css("color", ink)


INKS = """
window.inks = [];
const all = (root) => [...(root?.querySelectorAll("*") ?? [])].flatMap((el) => [el, ...all(el.shadowRoot)]);
const found = (root) => all(root).filter((one) => one.matches("[role=combobox]"));
setInterval(() => inks.push(...found(document).map(
  (one) => Math.min(...getComputedStyle(one).color.match(/\\d+/g).slice(0, 3).map(Number)))), 50);
"""
"""Keeps the brightness of the letters in lists of the page, ever since it was asked for."""


def test_the_page_begins_with_the_theme_of_the_address_or_of_the_system(
    chromium: Browser, address: str, complaints: list[str]
) -> None:
    page = watched(chromium, address, complaints)
    brightness = "Math.max(...getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number))"
    page.emulate_media(color_scheme="dark")
    page.add_init_script(INKS)
    page.goto(address)
    wait_for(page, f"{brightness} < 60")
    wait_for(page, f"{IDLE} && inks.length > 3")
    assert min(page.evaluate("inks")) > 150, "letters were dark on dark ground as the page opened"
    page.goto(address + "?theme=default&seed=3")
    wait_for(page, IDLE)
    wait_for(page, f"{brightness} > 200")
    assert page.get_by_text("there is no setting").count() == 0
    page.wait_for_url(re.compile("theme=default&seed=3"))
    page.context.close()
    assert complaints == []


def test_an_outage_is_drawn_on_the_timeline(shared_page: Page) -> None:
    page = shared_page
    zoom(page, page.locator("canvas").first, 0.4, 0.6)
    start, end = page.evaluate(f"[{RANGE_END.replace('.end', '.start')}, {RANGE_END}]")
    page.get_by_role("button", name="GPS outage").click()
    shaded = "Bokeh.documents[0].get_model_by_name('time without GPS').data"
    wait_for(page, f"{shaded}.start.length === 1")
    assert page.evaluate(f"{shaded}.start[0]") == pytest.approx(start, abs=0.06)
    assert page.evaluate(f"{shaded}.end[0]") == pytest.approx(end, abs=0.06)
    wait_for(page, f"{RANGE_END} > 200")
    expect(page.get_by_role("textbox", name="Outages")).to_have_value(re.compile(rf"{start:.1f}\D+{end:.1f}"))


@pytest.mark.proof
def test_results_are_downloaded(shared_page: Page) -> None:
    page = shared_page
    remember_data(page)
    seed = page.get_by_role("textbox").first
    seed.fill("4")
    seed.press("Enter")
    wait_for_new_data(page)
    with page.expect_download() as download:
        share(page, "Result (netCDF)")
    assert download.value.suggested_filename == "montreal_4.nc"
    with netCDF4.Dataset(download.value.path()) as file:
        assert {"truth", "solution", "errors", "sigma", "innovations"} <= set(file.groups)
        assert file["errors"]["position"].shape == (41_009, 3)
    with page.expect_download() as download:
        share(page, "All data (csv)")
        expect(page.get_by_text("Writing ")).to_be_visible()
    assert download.value.suggested_filename == "montreal_4.zip"
    with zipfile.ZipFile(download.value.path()) as archive:
        assert archive.testzip() is None
        assert {"errors.csv", "gps.csv"} <= {Path(name).name for name in archive.namelist()}
    for label, ending, words in (
        ("Path (KML)", "kml", "<name>Estimate</name>"),
        ("Path (GPX)", "gpx", "<trkpt "),
        ("Data as seen (csv)", "csv", "position east [m]"),
        ("Result (JSON)", "json", '"schema_version": 1'),
        ("Settings file", "toml", "seed = 4"),
        ("Report", "html", "<h1>Montréal</h1>"),
    ):
        with page.expect_download() as download:
            share(page, label)
        assert download.value.suggested_filename == f"montreal_4.{ending}"
        assert words in download.value.path().read_text(encoding="utf-8")
    with page.expect_download() as download:
        share(page, "Figures for print (PDF)")
    assert download.value.suggested_filename == "montreal_4.pdf"
    assert download.value.path().read_bytes().count(b"/MediaBox") == len(PLOTS)


def test_a_settings_file_that_is_none_is_answered_in_red_and_the_next_one_is_taken(shared_page: Page) -> None:
    page = shared_page
    files = page.locator("input[type=file]")
    files.set_input_files(
        {"name": "mine.toml", "mimeType": "application/toml", "buffer": b"[sensors.gyro]\nnoise = 0.2\n"}
    )
    alert = page.get_by_role("alert").filter(has_text="there is no setting 'noise'")
    expect(alert).to_be_visible()
    expect(alert).to_have_class(re.compile("colorError|standardError|Error"))
    expect(noise(page)[1]).to_have_value("0.05")
    # Two seconds after an upload the button empties itself, and what is given to it before.
    expect(files).to_have_js_property("value", "")
    right = b"[sensors.gyro]\nnoise_density = 0.2\n"
    files.set_input_files({"name": "mine.toml", "mimeType": "application/toml", "buffer": right})
    expect(noise(page)[1]).to_have_value("0.2")


SCROLLED = """
() => {
  const found = [];
  const walk = (root) => {
    for (const element of root.querySelectorAll('*')) {
      const beyond = element.scrollHeight - element.clientHeight;
      const scrolls = /auto|scroll/.test(getComputedStyle(element).overflowY);
      if (scrolls && String(element.className).includes('layout-Column')) found.push(beyond);
      if (element.shadowRoot) walk(element.shadowRoot);
    }
  };
  walk(document);
  return Math.max(0, ...found);
}
"""
"""By how much columns of the page can be scrolled at most [px]."""


def test_one_cannot_scroll_far_below_the_plots(shared_page: Page) -> None:
    for tab in ("Errors", "Innovations", "States"):
        show(shared_page, tab)
        wait_for(shared_page, f"{TITLES}[0] === {FIRST[tab]!r} && {IDLE}")
        wait_for(shared_page, f"({SCROLLED})() < 50")
