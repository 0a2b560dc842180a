"""What strangers write, in links, files and missions, is text on every page; the headers allow no more."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.error import HTTPError, URLError
from urllib.parse import urlencode, urlparse
from urllib.request import urlopen

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from lab.base.parameters.toml_file import MAX_BYTES
from lab.missions import add_mission, mission
from tests.browser.conftest import (
    HARMLESS,
    IDLE,
    PATIENCE,
    ROOT,
    free_port,
    new_context,
    share,
    show,
    wait_for,
)
from tests.browser.test_page_walk import walk

pytestmark = pytest.mark.browser

Strange = tuple[BrowserContext, list[str]]

RUN = "window.ran = true"
ATTRIBUTE = f'<img id="tried" src="data:," onerror="{RUN}">'


def mark(place: str) -> str:
    """Return a text that asks the server for something wherever it is taken for HTML, Markdown or TeX."""
    return f'<img src="/stranger-{place}"> ![{place}](/stranger-{place}) $$\\text{{{place}}}$$'


FILES = {
    f"mission = '{mark('settings')}'": "stranger-settings",
    f"'{mark('unknown')}' = 1": "stranger-unknown",
    f"seed = {'1' * 5000}": "1000 characters",
    "#" * (MAX_BYTES + 1): "The browser did not send",
}
"""Settings files, and what is said of them."""


@pytest.fixture(scope="module")
def server(own_missions: Path) -> Iterator[str]:
    """Return the address of the laboratory as people serve it, with a mission and a wreck of a stranger."""
    add_mission(
        mission("los_angeles").recording,
        "mine",
        title=mark("title"),
        description=mark("description"),
        origin=mark("origin"),
        aircraft=mark("aircraft"),
        airport=mark("airport"),
        tags=[mark("tag")],
        overwrite=True,
    )
    wreck = own_missions / "wreck.toml"
    wreck.write_text(f"title = 'x'\nrecording = 'x.csv'\n'{mark('key')}' = 1\n")
    port = free_port()
    command = [
        sys.executable,
        "-c",
        "from dashboards.command_line import main; main()",
        "serve",
        "--no-browser",
        "--no-warm",
    ]
    with subprocess.Popen([*command, "--port", str(port)], cwd=ROOT, stdout=subprocess.DEVNULL) as process:
        try:
            _wait(f"http://localhost:{port}/favicon.ico", process)
            yield f"http://localhost:{port}"
        finally:
            process.terminate()
    for path in own_missions.iterdir():  # among them what a page keeps of a mission that it deleted
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


def _wait(address: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + PATIENCE / 1000
    while process.poll() is None and time.monotonic() < deadline:
        try:
            urlopen(address).close()
        except URLError:
            time.sleep(0.1)
        else:
            return
    pytest.fail(f"{address} was not served")


def foreign(url: str) -> bool:
    """Say whether an address is that of another computer, or one that only a stranger's words ask for."""
    parts = urlparse(url)
    return parts.hostname not in {None, "localhost"} or "/stranger" in parts.path


@pytest.fixture
def strange(chromium: Browser) -> Iterator[tuple[BrowserContext, list[str]]]:
    """Return a browser window, and a list of what it was asked for and complained about."""
    context, wrong = new_context(chromium), list[str]()
    context.on("request", lambda one: wrong.append(one.url) if foreign(one.url) else None)
    context.on(
        "console",
        lambda message: (
            wrong.append(message.text)
            if message.type in {"error", "warning"} and not any(word in message.text for word in HARMLESS)
            else None
        ),
    )
    context.on("weberror", lambda error: wrong.append(str(error.error)))
    yield context, wrong
    context.close()
    assert wrong == []


def opened(strange: Strange, address: str) -> Page:
    page = strange[0].new_page()
    page.goto(address)
    wait_for(page, IDLE)
    return page


@pytest.mark.proof
def test_what_an_address_says_is_text_and_its_scripts_do_not_run(strange: Strange, server: str) -> None:
    names = {
        "mission": "mission",
        "seed": "seed",
        "sensors.gyro.noise_density": "noise_density",
        "navigator.model": "model",
        mark("name"): "name",
    }
    page = opened(strange, f"{server}/?{urlencode({key: mark(name) for key, name in names.items()})}")
    for name in names.values():
        expect(page.get_by_role("alert")).to_contain_text(f'{name}"> ![')
    assert strange[1] == []
    # Were a text ever taken for markup again, its script would not run.
    page.evaluate(f"document.body.insertAdjacentHTML('beforeend', {ATTRIBUTE!r})")
    page.evaluate(f"document.body.append(Object.assign(document.createElement('script'), {{text: {RUN!r}}}))")
    wait_for(page, "document.getElementById('tried').complete")
    assert page.evaluate("window.ran") is None
    assert {"Content Security Policy" in text for text in strange[1]} == {True}
    strange[1].clear()


def test_a_page_of_another_origin_cannot_frame_the_laboratory(
    strange: Strange, server: str, tmp_path: Path
) -> None:
    (tmp_path / "around.html").write_text(f"<link rel='icon' href='data:,'><iframe src='{server}/'></iframe>")
    answers = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    page, failures = strange[0].new_page(), list[str | None]()
    page.on("requestfailed", lambda request: failures.append(request.failure))
    with ThreadingHTTPServer(("127.0.0.1", 0), answers) as foreign:
        Thread(target=foreign.serve_forever, daemon=True).start()
        page.goto(f"http://localhost:{foreign.server_port}/around.html", wait_until="load")
        foreign.shutdown()
    (framed,) = page.main_frame.child_frames
    assert framed.url.startswith("chrome-error:")
    assert "net::ERR_BLOCKED_BY_RESPONSE" in failures
    strange[1].clear()


@pytest.mark.proof
def test_every_tab_shows_its_own_plots_and_what_a_mission_and_a_file_say_is_text(
    strange: Strange, server: str, tmp_path: Path
) -> None:
    page = opened(strange, f"{server}/?mission=mine&navigator.states=21")
    walk(page)
    show(page, "Compare")
    expect(page.get_by_text("stranger-title").first).to_be_visible()
    show(page, "Missions")
    card = page.locator("article[data-name='mine']")
    expect(card).to_contain_text('<img src="/stranger-title">')
    expect(page.locator("article[data-name='wreck']")).to_contain_text("stranger-key")
    card.get_by_role("button", name="Edit mine").click()
    expect(page.get_by_role("textbox", name="Title")).to_have_value(re.compile("^<img"))
    page.get_by_role("button", name="Save").click()
    with page.expect_download() as download:
        share(page, "Settings file")
    assert "mine" in download.value.path().read_text(encoding="utf-8")
    chosen = page.locator("input[accept='.toml']")
    for text, words in FILES.items():
        (tmp_path / "x.toml").write_text(text)
        expect(chosen).to_have_js_property("value", "")  # an upload empties it, two seconds later
        with page.expect_file_chooser() as chooser:  # each is the same file, changed, as a person chooses it
            page.locator("label:has(input[accept='.toml'])").click()
        chooser.value.set_files(tmp_path / "x.toml")
        expect(page.get_by_role("alert").filter(has_text=words)).to_be_visible()
    (said,) = strange[1]  # by the button, of the file that is too large
    assert said.startswith("Upload error")
    strange[1].clear()


HEAD = "time_s,latitude_deg,longitude_deg,height_m"
WAY = [f"{second},{45 + 1e-4 * second},7,{1000 + second}" for second in range(60)]
POINT = '<trkpt lat="{:.4f}" lon="7"><ele>1000</ele><time>2026-01-01T00:00:{:02d}Z</time></trkpt>'
RECORDINGS = {
    "column": "\n".join([f"{HEAD},'{mark('column')}'", *(f"{row},0" for row in WAY)]),
    "cell": "\n".join([HEAD, *WAY[:-1], f"59,'{mark('cell')}',7,1000"]),
    "heads": f"'{mark('heads')}','{mark('other')}'\n1,2\n",
    "track": "<gpx version='1.1' xmlns='http://www.topografix.com/GPX/1/1'><trk><name><![CDATA["
    + mark("track")
    + "]]></name><trkseg>"
    + "".join(POINT.format(45 + 1e-4 * second, second) for second in range(60))
    + "</trkseg></trk></gpx>",
    "folder": "<kml xmlns='http://www.opengis.net/kml/2.2'><Placemark><name><![CDATA["
    + mark("folder")
    + "]]></name></Placemark></kml>",
}
"""What strangers write into recordings: names of columns, cells, names of tracks."""


@pytest.mark.proof
def test_what_a_recording_says_is_text_where_it_is_judged(
    strange: Strange, server: str, tmp_path: Path
) -> None:
    """A file's own name is text as well: a browser hands it over as it is."""
    page = opened(strange, f"{server}/?mission=los_angeles")
    show(page, "Missions")
    page.get_by_role("button", name="Import", exact=True).first.click()
    for place, text in RECORDINGS.items():
        path = tmp_path / f"{place}<img src=stranger onerror='{RUN}'>.csv"
        path.write_text(text)
        files = page.locator("input[type=file][multiple]")
        expect(files).to_have_js_property("value", "")
        files.set_input_files(path)
        said = page.get_by_role("alert").filter(has_text=place)
        judged = page.get_by_role("cell").filter(has_text="rows read")
        expect(said.or_(judged).first).to_be_visible()
        expect(page.locator("img[src*='stranger']")).to_have_count(0)
    assert page.evaluate("window.ran") is None
    assert strange[1] == []


@pytest.mark.parametrize("query", ["", "?seed=2"])
def test_a_plain_panel_server_sends_the_headers_with_the_page(address: str, query: str) -> None:
    """Also with the first page of all, whose making installs them."""
    with urlopen(address + query) as answer:
        headers, page = answer.headers, answer.read().decode()
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "same-origin"
    (number,) = re.findall(r"'nonce-([^']+)'", headers["Content-Security-Policy"])
    assert "frame-ancestors 'self'" in headers["Content-Security-Policy"]
    assert re.findall(r"<script(?! nonce=)[^>]*>", page) == []
    assert f'<script nonce="{number}"' in page


PATHS = {"": 200, "static/js/bokeh.min.js": 200, "favicon.ico": 200, "nowhere": 404, "static/nowhere": 404}


@pytest.mark.parametrize("path", PATHS)
def test_every_answer_has_the_headers(server: str, path: str) -> None:
    try:
        with urlopen(f"{server}/{path}") as answer:
            status, headers = answer.status, answer.headers
    except HTTPError as error:
        status, headers = error.code, error.headers
    assert status == PATHS[path]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "same-origin"
    assert "frame-ancestors 'self'" in headers["Content-Security-Policy"]
    (scripts,) = re.findall(r"script-src ([^;]*)", headers["Content-Security-Policy"])
    assert "'unsafe-inline'" not in scripts
    assert "http" not in scripts
