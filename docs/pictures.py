"""Pictures of the pages, light and dark, for the documents: `make pictures` writes ``docs/pictures/``.

A server of its own is started, and Chromium opens each page on it. A picture is taken when the page has drawn
what its words and curves say; nothing waits for a fixed time. Those of the notebooks are plots on the pages
that `make docs` writes.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlencode

from PIL import Image
from playwright.sync_api import Browser, Page, ViewportSize, expect, sync_playwright

from dashboards.drawn_pages import PAGES
from dashboards.query import BESIDE
from dashboards.verdict_chip import JUDGING

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "docs/pictures"
WIDTH, HEIGHT = 1440, 900
"""Size of the window [px]: at most that of a laptop."""
PATIENCE = 300_000
"""Longest wait for what a page shows [ms]: a first run compiles the filter."""
COLOURS = 255
"""Colours of a picture. None differs by more than 12 of 255 from the page, and a file is a third as large."""
ALIKE = 4
"""Screenshots in a row that are alike before nothing moves: the themes of 20 buttons change one by one."""
NAMES = (
    "chromium-headless-shell",
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
)
"""Names of browsers that are looked for."""
IDLE = (
    "window.Bokeh && Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle"
    " && [...Bokeh.documents[0].all_models].some((one) => one.data?.label === 'Load settings')"
)
"""Whether a page has all of its parts: the button that loads settings comes last."""
TITLES = (
    "Array.from(Bokeh.index.query((view) => view.model.title?.text)).map((view) => view.model.title.text)"
)
"""The titles of all figures; some have figures of merit behind them."""
MONTREAL = "?mission=montreal&seed=7"
SIZES = {390: 844, 1440: 900, 2560: 1440}
"""Widths and heights of the windows of `make_every` [px]: a phone, a laptop, a large screen."""


class Picture(NamedTuple):
    """A picture: the address of the page, how the title of a figure there begins, and words that it shows."""

    address: str
    figure: str
    words: str


PICTURES = {
    "overview": Picture(MONTREAL, "Heading error [°]", "Horizontal position, rms"),
    "errors": Picture(
        MONTREAL + "&sensors.gps.outages=[[90,110]]&tab=Errors", "Position error, east [m]", "Consistent"
    ),
    "verdict": Picture(MONTREAL + "&navigator.q_scale=0.1&tab=Verdict", "NEES", "Tried:"),
    "budget": Picture(MONTREAL + "&tab=Budget", "Share of the variance of heading [%]", "At the end"),
    "compare": Picture(MONTREAL + "&tab=Compare&hold=navigator.q_scale%3D0.1", "", "relative to"),
    "missions": Picture(MONTREAL + "&beside=Missions", "", "Over the Pacific"),
    "lessons": Picture(MONTREAL + "&tab=Errors&beside=Lessons", "Position error, east [m]", "Tuning R"),
}
"""The pictures by the names of their files."""
SITE = ROOT / "build/site"
PLOTS = {
    "01_tour": 3, "02_strapdown": 0, "03_sensor_errors": 1, "04_filter": 0, "05_tuning": 0,
    "06_error_models": 0, "07_outages": 0, "08_own_flight": 0, "09_own_algorithm": 1, "10_many_runs": 1,
    "11_live": 0,
}  # fmt: skip
"""For each notebook, which one of its outputs with plots is its picture: the one of its subject."""
PLOT = (960, 540)
"""Size of a plot's picture before it is halved [px]: the width of a notebook on the site, and 16:9."""
SMALL = (PLOT[0] // 2, PLOT[1] // 2)
DRAWN = "(canvas) => canvas.getContext('2d').getImageData(canvas.width >> 1, 20, 1, 1).data[3] === 255"


@contextmanager
def served() -> Iterator[str]:
    """Serve the dashboard with the missions that ship; yield its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    command = [sys.executable, "-m", "dashboards", "serve", "--no-browser", "--no-warm", "--port", port]
    nobody = FOLDER / "no missions of one's own"
    environment = {**os.environ, "INS_LAB_MISSIONS": str(nobody), "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            next(line for line in server.stdout if port in line)
            yield f"http://localhost:{port}/"
        finally:
            server.terminate()


@contextmanager
def browser() -> Iterator[Browser]:
    """Start an installed Chromium or Chrome without a window."""
    path = os.environ.get("INS_LAB_BROWSER") or next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        sys.exit("no Chromium or Chrome found: install one, or name it in INS_LAB_BROWSER")
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


def draw(page: Page, wanted: Picture) -> None:
    """Open a page, and wait until it has drawn what it shows."""
    page.goto(wanted.address)
    page.wait_for_function(IDLE)
    if wanted.figure:
        page.wait_for_function(f"{TITLES}.some((title) => title.startsWith({wanted.figure!r}))")
        expect(page.locator("canvas").first).to_be_visible()
    if wanted.words:
        expect(page.get_by_text(wanted.words).first).to_be_visible()


def darken(page: Page) -> None:
    """Change to the dark theme, and wait until the page has changed."""
    toggle = page.get_by_role("button", name="Toggle theme")
    toggle.click()
    toggle.blur()
    page.wait_for_function(
        "Math.max(...getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)) < 60"
    )


def photograph(page: Page, path: Path, height: int = HEIGHT) -> None:
    """Write what a page shows when all of its messages have come, and nothing moves any more."""
    page.mouse.move(1, height - 1)  # over no button, whose tooltip would be there
    expect(page.get_by_role("tooltip")).to_have_count(0)
    page.wait_for_function(IDLE)
    expect(page.locator(".verdict-chip")).not_to_contain_text(JUDGING)
    write(at_rest(page.screenshot), path)


def at_rest(screenshot: Callable[[], bytes]) -> Image.Image:
    """Return the picture of a screenshot that is repeated until nothing moves any more."""
    seen = [b"", screenshot()]
    while seen[-1] != seen[-2] or len(seen) < ALIKE:
        seen = [*(seen if seen[-1] == seen[-2] else seen[-1:]), screenshot()]
    return Image.open(io.BytesIO(seen[-1])).convert("RGB")


def write(picture: Image.Image, path: Path, method: Image.Quantize = Image.Quantize.MAXCOVERAGE) -> None:
    """Write a picture with few colours."""
    few = picture.quantize(COLOURS, method=method, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def photograph_plot(page: Page, number: int, path: Path) -> None:
    """Write the plots of an output on the page of a notebook, from the first one on.

    Parameters
    ----------
    page
        The page, open.
    number
        Which one of its outputs with plots, from 0.
    path
        The file.
    """
    output = page.locator(".output", has=page.locator("canvas")).nth(number)
    output.scroll_into_view_if_needed()
    canvas = output.locator("canvas").first
    expect(canvas).to_be_visible()
    page.wait_for_function(DRAWN, arg=canvas.element_handle())
    found = at_rest(output.screenshot)
    top = output.evaluate(
        "(output, first) => first.getBoundingClientRect().top - output.getBoundingClientRect().top",
        output.locator(".bk-Figure, .bk-GridPlot").first.element_handle(),
    )
    left = 16  # the line beside an output, and its distance
    plots = found.crop((left, round(top), found.width, min(found.height, round(top) + PLOT[1])))
    picture = Image.new("RGB", PLOT, plots.getpixel((plots.width - 1, 0)))
    picture.paste(plots, ((PLOT[0] - plots.width) // 2, (PLOT[1] - plots.height) // 2))
    # An octree keeps a large dark area of one colour, where a half of all pixels are shades.
    write(picture.resize(SMALL, Image.Resampling.LANCZOS), path, Image.Quantize.FASTOCTREE)


def make_of_notebooks(folder: Path, chromium: Browser) -> None:
    """Write a plot of each notebook, light and dark, from the site.

    Parameters
    ----------
    folder
        Where the files ``NAME-light.png`` and ``NAME-dark.png`` are written.
    chromium
        The browser that draws them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, number in PLOTS.items():
        page_of_site = SITE / f"notebooks/{name}.html"
        if not page_of_site.is_file():
            sys.exit(f"{page_of_site}: does not exist; make docs writes it")
        for theme in ("light", "dark"):
            context = chromium.new_context(
                viewport={"width": WIDTH, "height": HEIGHT}, color_scheme=theme, device_scale_factor=1
            )
            context.set_default_timeout(PATIENCE)
            page = context.new_page()
            page.goto(page_of_site.as_uri())
            photograph_plot(page, number, folder / f"{name}-{theme}.png")
            context.close()
        print(f"{name}: light and dark")


def make(names: list[str], folder: Path, chromium: Browser) -> None:
    """Write pictures, light and dark.

    Parameters
    ----------
    names
        Keys of `PICTURES`.
    folder
        Where the files ``NAME-light.png`` and ``NAME-dark.png`` are written.
    chromium
        The browser that draws them.
    """
    folder.mkdir(exist_ok=True)
    with served() as address:
        for name in names:
            context = chromium.new_context(viewport={"width": WIDTH, "height": HEIGHT}, base_url=address)
            context.set_default_timeout(PATIENCE)
            page = context.new_page()
            draw(page, PICTURES[name])
            photograph(page, folder / f"{name}-light.png")
            darken(page)
            photograph(page, folder / f"{name}-dark.png")
            context.close()
            print(f"{name}: light and dark")


def make_every(folder: Path, chromium: Browser) -> None:
    """Write pictures of all pages, in both themes and several sizes of the window, to be looked at.

    Parameters
    ----------
    folder
        Where the files ``PAGE-WIDTH-THEME.png`` are written.
    chromium
        The browser that draws them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with served() as address:
        for title in [page.title for page in PAGES]:
            where = "beside" if title in BESIDE else "tab"
            for width, height in SIZES.items():
                for theme in ("default", "dark"):
                    size: ViewportSize = {"width": width, "height": height}
                    context = chromium.new_context(viewport=size, base_url=address)
                    context.set_default_timeout(PATIENCE)
                    page = context.new_page()
                    page.goto(f"{MONTREAL}&{urlencode({where: title, 'theme': theme})}")
                    page.wait_for_function(IDLE)
                    expect(
                        page.get_by_role("button", name=re.compile("^[●○]"))
                    ).to_be_visible()  # all is there
                    name = f"{title.lower().replace(' ', '_')}-{width}-{theme.replace('default', 'light')}"
                    photograph(page, folder / f"{name}.png", height)
                    context.close()
            print(title)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Write the pictures of the documents.")
    parser.add_argument("names", nargs="*", choices=[[], *PICTURES], help="all if none is named")
    parser.add_argument(
        "--every", type=Path, metavar="FOLDER", help="all pages instead, in three sizes, there"
    )
    parser.add_argument(
        "--notebooks", action="store_true", help="plots of the notebooks instead, from build/site"
    )
    chosen = parser.parse_args()
    expect.set_options(timeout=PATIENCE)
    with browser() as opened:
        if chosen.every is not None:
            make_every(chosen.every, opened)
        elif chosen.notebooks:
            make_of_notebooks(FOLDER / "notebooks", opened)
        else:
            make(chosen.names or list(PICTURES), FOLDER, opened)
