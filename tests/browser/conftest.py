"""A served simulator, a headless browser, and what a test asks of a page."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Frame,
    Page,
    ViewportSize,
    expect,
    sync_playwright,
)
from text_outputs import still_dot

from dashboards import devices
from dashboards.page_tabs import TABS
from dashboards.query import BESIDE
from dashboards.visitors import VARIABLE

ROOT = Path(__file__).parents[2]
NAMES = (
    "chromium-headless-shell",  # the same pages without the parts around them: a fifth less of a processor
    *("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"),
)
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
QUICK_TO_OPEN = "--js-flags=--no-opt --max-lazy"
"""Scripts are compiled when they are called, and not again for speed: opening a page takes 15 % less of a
processor. Tests that measure speed go without."""
HARMLESS = ("THREE.", "GPU stall", "GL Driver Message", "could not set initial ranges", "WebGL")

WIDTH, HEIGHT = 1440, 900
SIZE: ViewportSize = {"width": WIDTH, "height": HEIGHT}
"""Size of the windows of pages [px]."""

PATIENCE = 240_000.0
"""Longest wait for what a page shows [ms]: build machines share their cores, and a first run compiles."""
expect.set_options(timeout=PATIENCE)
LOOK = 100.0
"""Time between two looks whether a page shows something [ms]; by default, a browser looks whenever it paints,
and paints sixty times a second for it: without a graphics card, that is a tenth of a core for each page."""

ERRORS = "?tab=Errors"
"""Query of the nine plots, which most tests watch; without a query, the Overview opens."""
IDLE = "window.Bokeh && Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle"
DATA = "Bokeh.documents[0].get_model_by_name('time:position_east')?.data"
CURVE = f"String([...({DATA}?.time ?? []), ...({DATA}?.position_east ?? [])])"
"""Times and values of the first curve of the page, as one text."""
RANGE_END = "Bokeh.documents[0].get_model_by_name('time axis')?.end"
WHOLE = f"""{IDLE} && ((cards) => cards.length && cards.every(
  (card) => card.data.collapsed || card.data.objects[0]?.children.length
))([...Bokeh.documents[0].all_models].filter((one) => one.name === "Card"))"""
"""Whether the settings are there, which come after the plots."""
SEEN = f"""((time, cursor) => String([{CURVE}, ...[time.start, time.end, cursor.location].map(Math.round)]))(
  ...["time axis", "time cursor"].map((name) => Bokeh.documents[0].get_model_by_name(name)))"""
"""The first curve of the page, the time that is in sight, and that of the cursor to a second, as one text."""
AS_OPENED = f"""{IDLE} && location.search === '{ERRORS}' && !window.insLabUnheard.size &&
  {DATA} && {SEEN} === window.asOpened"""
"""Whether a page that tests share shows what it showed at first, and waits for no answer."""
DRAWN = f"{WHOLE} && Bokeh.documents[0].get_model_by_name('time:position_east')?.data.time?.length > 100"


@pytest.fixture(scope="session")
def chromium(request: pytest.FixtureRequest) -> Iterator[Browser]:
    """Return an installed Chromium or Chrome, headless."""
    path = os.environ.get("INS_LAB_BROWSER") or next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.fail("no Chromium or Chrome found: install one, or name it in INS_LAB_BROWSER")
    measures = any(item.get_closest_marker("benchmark") for item in request.session.items)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=path, args=ARGUMENTS if measures else [*ARGUMENTS, QUICK_TO_OPEN]
        )
        yield browser
        browser.close()


def new_context(chromium: Browser, **options: Any) -> BrowserContext:
    """Return a new visitor: a browser without cookies, which waits patiently."""
    context = chromium.new_context(**options)
    context.set_default_timeout(PATIENCE)
    return context


def wait_for(page: Page | Frame, expression: str, arg: Any = None, timeout: float | None = None) -> None:
    """Wait until an expression in JavaScript is true on a page, and leave it the processor meanwhile."""
    page.wait_for_function(expression, arg=arg, timeout=timeout, polling=LOOK)


def eventually(page: Page, what: Callable[[], bool]) -> None:
    """Wait until something that one expression in JavaScript cannot ask is true of a page, as a layout."""
    end = time.monotonic() + PATIENCE / 1000
    while not what():
        assert time.monotonic() < end, "it did not become true"
        page.wait_for_timeout(LOOK)


def _place_of(title: str) -> tuple[str, list[str]]:
    """Return the tab of a page, and the titles of all pages in it."""
    return next(
        (tab, titles) for tab, pages in TABS.items() if title in (titles := [one.title for one in pages])
    )


def show(page: Page, title: str) -> None:
    """Open a page by its title: its tab, and its part there; or a page beside the tabs."""
    for beside in ("Missions", title) if title in BESIDE else ("Missions",):
        close = page.get_by_role("button", name=f"Close {beside}")
        if close.is_visible():
            close.click()
    if title in BESIDE:
        page.get_by_role("button", name=re.compile(f"^{title}[,:]")).click()
        page.get_by_role("button", name=f"Close {title}").wait_for()  # what is not open yet cannot be closed
        return
    tab, titles = _place_of(title)
    page.get_by_role("tab", name=tab, exact=True).click()
    if len(titles) > 1:
        page.get_by_role("button", name=title, exact=True).click()


def shown(page: Page, title: str) -> None:
    """Expect that a page is open in the tabs."""
    tab, titles = _place_of(title)
    expect(page.get_by_role("tab", name=tab, exact=True)).to_have_attribute("aria-selected", "true")
    if len(titles) > 1:
        expect(page.get_by_role("button", name=title, exact=True)).to_have_attribute("aria-pressed", "true")


def reset(page: Page) -> None:
    """Bring all settings but the mission back to what they are at first."""
    page.get_by_role("button", name="Reset settings").click()
    page.get_by_role("menuitem", name="Everything", exact=True).click()


def share(page: Page, entry: str) -> None:
    """Press Share, and an entry of its menu: two clicks from any page."""
    page.get_by_role("button", name="Share", exact=True).click()
    page.get_by_role("menuitem", name=entry, exact=True).click()


def remember(page: Page, name: str, expression: str) -> None:
    """Keep the value of an expression in JavaScript as `window.NAME`, and send nothing of it to the test.

    The value of an assignment is an answer too: all models of a page took a test 25 s of a processor.
    """
    page.evaluate(f"() => {{ window.{name} = {expression}; }}")


def free_port() -> int:
    """Return a port nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="session")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the source that pages of the served simulator may open: a recording of a DOT at rest."""
    path = tmp_path_factory.mktemp("replayed") / "dot.csv"
    path.write_text(still_dot(7200))
    return f"replay:{path}"


@pytest.fixture(scope="session")
def address(replayed: str) -> Iterator[str]:
    """Return the address of a simulator served by a plain ``panel serve``, without further flags."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(devices.VARIABLE, replayed)
        with serving() as (address, _process):
            yield address


@contextmanager
def serving(*flags: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serve the simulator; give its address and the process of the server."""
    port = free_port()
    command = [sys.executable, "-m", "panel", "serve", "dashboards/simulator.py", "--port", str(port), *flags]
    log = ROOT / ".pytest_cache" / f"simulator{port}.log"
    log.parent.mkdir(exist_ok=True)
    process = subprocess.Popen(
        command,
        cwd=ROOT,
        env={**os.environ, VARIABLE: "edit"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        bufsize=1,
    )
    assert process.stdout is not None
    for line in process.stdout:
        if "Starting Bokeh server with process id" in line:
            break
    else:
        pytest.fail(f"{' '.join(command)} ended at once")
    with log.open("w") as sink:
        drain = subprocess.Popen(["cat"], stdin=process.stdout, stdout=sink)
    try:
        yield f"http://localhost:{port}/simulator", process
    finally:
        process.terminate()
        try:
            process.wait(timeout=30)
        except subprocess.TimeoutExpired:  # it compiles a filter for a session that nobody has any more
            process.kill()
        drain.wait(timeout=30)


def on_errors(query: str) -> str:
    """Return the query of an address that opens the nine plots of errors, unless it names a tab."""
    if "tab=" in query:
        return query
    return f"{query}&{ERRORS.removeprefix('?')}" if query else ERRORS


@pytest.fixture
def complaints() -> list[str]:
    """Return what the consoles of all pages complain about, and whom else a page of `open_page` asks.

    A test fails where there is anything.
    """
    return []


@pytest.fixture
def open_page(chromium: Browser, address: str, complaints: list[str]) -> Iterator[Callable[..., Page]]:
    """Return a function that opens the simulator in a session of its own and waits for its first plots."""
    contexts = []

    def open_it(query: str = "", *, width: int = WIDTH, height: int = HEIGHT, drawn: bool = True) -> Page:
        page = watched(chromium, address, complaints, width, height)
        contexts.append(page.context)
        page.goto(address + on_errors(query))
        wait_for(page, DRAWN if drawn else WHOLE)
        return page

    yield open_it
    for context in contexts:
        context.close()
    assert complaints == []


class Keeper:
    """Keeps one page of the simulator for many tests: opening it takes 8 s of a processor, a test 2 s.

    Attributes
    ----------
    page : Page or None
        The page as it opens. None before the first test, and after one that failed.
    complaints : list of str
        What the console of the page complains about, and requests to strangers.
    """

    def __init__(self, chromium: Browser, address: str) -> None:
        self._chromium, self._address = chromium, address
        self.page: Page | None = None
        self.complaints: list[str] = []

    def open(self) -> Page:
        """Return the page."""
        if self.page is None:
            self.page = watched(self._chromium, self._address, self.complaints)
            self.page.goto(self._address + ERRORS)
            wait_for(self.page, DRAWN)
            remember(self.page, "asOpened", SEEN)
        return self.page

    def restore(self) -> None:
        """Turn the page back to what it showed at first, with its own controls."""
        page = self.page
        assert page is not None
        if page.viewport_size != SIZE:
            page.set_viewport_size(SIZE)
        if page.get_by_role("alert").count() or not page.evaluate(AS_OPENED):
            self._turn_back(page)
        page.mouse.move(1, 1)  # over no button, whose tooltip would be there
        page.evaluate("document.activeElement.blur()")
        expect(page.get_by_role("alert")).to_have_count(0)

    def _turn_back(self, page: Page) -> None:
        """Turn a page back that shows something else."""
        show(page, "Errors")
        if page.get_by_role("button", name="Close Lessons").is_visible():
            page.get_by_role("button", name="Close Lessons").click()
        wait_for(page, DRAWN)
        mission = page.get_by_role("combobox", name="Mission")
        if mission.inner_text() != "Montréal":
            mission.click()
            page.get_by_role("menuitem", name="Montréal", exact=True).click()
        reset(page)
        page.get_by_role("slider", name="Time").press("Home")
        page.get_by_role("button", name="Whole flight", exact=True).click()
        wait_for(page, AS_OPENED)

    def close(self) -> None:
        """Close the page."""
        if self.page is not None:
            self.page.context.close()
        self.page = None
        self.complaints.clear()


@pytest.fixture(scope="session")
def keeper(chromium: Browser, address: str) -> Iterator[Keeper]:
    """Return what keeps the page that tests share."""
    keeper = Keeper(chromium, address)
    yield keeper
    keeper.close()


PASSED = pytest.StashKey[bool]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Remember whether a test passed, for the fixtures that end after it."""
    report = yield
    if report.when == "call":
        item.stash[PASSED] = report.passed
    return report


@pytest.fixture
def shared_page(request: pytest.FixtureRequest, keeper: Keeper) -> Iterator[Page]:
    """Return the simulator as it opens, on a page that tests share: each leaves it as it was.

    A test for which an address, a new session, or all models of a page matter takes `open_page`.
    """
    yield keeper.open()
    if not request.node.stash.get(PASSED, False):
        keeper.close()
        return
    try:
        keeper.restore()
        assert keeper.complaints == []
    except BaseException:
        keeper.close()
        raise


def watched(
    chromium: Browser, address: str, complaints: list[str], width: int = WIDTH, height: int = HEIGHT
) -> Page:
    """Return an empty page of a new visitor, whose complaints, and requests to strangers, are noted."""
    own = address.rpartition("/")[0]

    def strangers(url: str) -> list[str]:
        return [] if url.startswith((own + "/", "data:", "blob:")) else [f"asks {url}"]

    page = new_context(chromium, viewport={"width": width, "height": height}).new_page()
    page.on("console", lambda message: complaints.extend(complaint(message)))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: complaints.extend(strangers(request.url)))
    return page


def complaint(message: ConsoleMessage) -> list[str]:
    """Return what a console says, where it is an error or a warning that is worth a look."""
    serious = message.type in {"error", "warning"} and not any(word in message.text for word in HARMLESS)
    return [message.text] if serious else []
