"""A served simulator, a headless browser, and what a test asks of a page."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, expect, sync_playwright

from dashboards.visitors import VARIABLE

ROOT = Path(__file__).parents[2]
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
HARMLESS = ("THREE.", "GPU stall", "GL Driver Message", "could not set initial ranges", "WebGL")

PATIENCE = 240_000.0
"""Longest wait for what a page shows [ms]: build machines share their cores, and a first run compiles."""
expect.set_options(timeout=PATIENCE)

IDLE = "window.Bokeh && Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle"
DRAWN = f"{IDLE} && Bokeh.documents[0].get_model_by_name('time:position_east')?.data.time?.length > 100"


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """Return an installed Chromium or Chrome, headless."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
    path = os.environ.get("INS_LAB_BROWSER") or next(filter(None, map(shutil.which, names)), None)
    if path is None:
        pytest.fail("no Chromium or Chrome found: install one, or name it in INS_LAB_BROWSER")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield browser
        browser.close()


def new_context(chromium: Browser, **options: Any) -> BrowserContext:
    """Return a new visitor: a browser without cookies, which waits patiently."""
    context = chromium.new_context(**options)
    context.set_default_timeout(PATIENCE)
    return context


def free_port() -> int:
    """Return a port nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="session")
def address() -> Iterator[str]:
    """Return the address of a simulator served by a plain ``panel serve``, without further flags."""
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
        process.wait(timeout=30)
        drain.wait(timeout=30)


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
    own = address.rpartition("/")[0]

    def strangers(url: str) -> list[str]:
        return [] if url.startswith((own + "/", "data:", "blob:")) else [f"asks {url}"]

    def open_it(query: str = "", *, width: int = 1440, height: int = 900, drawn: bool = True) -> Page:
        context = new_context(chromium, viewport={"width": width, "height": height})
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: complaints.extend(complaint(message)))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: complaints.extend(strangers(request.url)))
        page.goto(address + query)
        page.wait_for_function(DRAWN if drawn else IDLE)
        return page

    yield open_it
    for context in contexts:
        context.close()
    assert complaints == []


def complaint(message: ConsoleMessage) -> list[str]:
    """Return what a console says, where it is an error or a warning that is worth a look."""
    serious = message.type in {"error", "warning"} and not any(word in message.text for word in HARMLESS)
    return [message.text] if serious else []
