"""The notebooks run from top to bottom, in Jupyter and as apps."""

from __future__ import annotations

import html
import re
import socket
import subprocess
import sys
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.request import Request, urlopen

import jupytext
import panel as pn
import pytest
from bokeh.client import pull_session
from bokeh.document import Document
from bokeh.models import GridPlot, Row
from bokeh.models.plots import Plot
from bokeh.models.widgets.sliders import AbstractSlider
from bokeh.util.token import get_session_id
from jupyter_client.manager import KernelManager
from nbclient import NotebookClient
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell
from notebook_claims import CLAIMS, HELPERS
from panel.models.markup import HTML
from panel.theme.base import DarkTheme

from lab.classroom.exercises.shipped_notebooks import copy_notebooks

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))
SECONDS = 240


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def notebook(request: pytest.FixtureRequest) -> Path:
    path: Path = request.param
    return path


@pytest.fixture(scope="module")
def kernel() -> Iterator[KernelManager]:
    """Return one kernel for all notebooks, which takes seconds to start and to import what they need."""
    kernel = KernelManager(kernel_name="python3")
    yield kernel
    kernel.shutdown_kernel(now=True)


def fresh(folder: Path) -> NotebookNode:
    """Return a cell that forgets the names of the notebook before, and works in a folder."""
    return new_code_cell(f"%reset -f\nimport os\nos.chdir({str(folder)!r})\ndel os")


def _texts(outputs: list[dict[str, Any]]) -> str:
    return "".join(str(output.get("text", "")) for output in outputs)


@pytest.mark.proof
def test_a_notebook_runs_in_jupyter_and_shows_something_in_most_cells(
    notebook: Path, tmp_path: Path, kernel: KernelManager
) -> None:
    cells = jupytext.read(notebook, fmt="py:percent")
    cells.cells.insert(0, fresh(tmp_path))
    claims = "\n".join(f"print(bool({claim}))" for claim in CLAIMS[notebook.stem].values())
    cells.cells.append(new_code_cell(f"{HELPERS.get(notebook.stem, '')}\n{claims}"))
    client = NotebookClient(cells, km=kernel, timeout=SECONDS)
    client.execute()
    client.kc.stop_channels()
    held = _texts(cells.cells.pop().outputs).split()
    assert not [claim for claim, holds in zip(CLAIMS[notebook.stem], held, strict=True) if holds != "True"]
    code = [cell for cell in cells.cells[1:] if cell.cell_type == "code"]
    shown = [cell for cell in code if any(out.output_type != "stream" for out in cell.outputs)]
    assert len(shown) > len(code) / 2
    for cell in code:
        assert "Warning" not in _texts(cell.outputs), cell.source


def test_a_notebook_alternates_prose_and_code_and_asks_questions(notebook: Path) -> None:
    cells = jupytext.read(notebook, fmt="py:percent").cells
    kinds = "".join(cell.cell_type[0] for cell in cells)
    assert "ccc" not in kinds, "three cells of code in a row without a word"
    prose = "".join(cell.source for cell in cells if cell.cell_type == "markdown")
    assert prose.count("**Try:**") >= 3
    assert 400 < len(prose.split()) < 2000, "ten minutes of reading"
    said = " ".join(prose.split())
    assert not [claim for claim in CLAIMS[notebook.stem] if claim not in said], (
        "claims of tests/notebook_claims"
    )


@pytest.fixture(scope="module")
def apps() -> Iterator[str]:
    """Return the address of one ``panel serve`` for all notebooks."""
    with serving(NOTEBOOKS) as address:
        yield address


@contextmanager
def serving(notebooks: list[Path]) -> Iterator[str]:
    """Serve notebooks with ``panel serve``; give the address."""
    pn.extension()  # its models are known when a page is pulled
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    where = ["--port", port, "--address", "127.0.0.1"]
    command = [sys.executable, "-m", "panel", "serve", *map(str, notebooks), *where]
    # What it says later is read and forgotten: a pipe that nobody reads would fill, and hold the server up.
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as server:
        try:
            assert server.stdout is not None
            said = next(line for line in server.stdout if "running at" in line)
            Thread(target=deque, args=(server.stdout, 0), daemon=True).start()
            yield re.findall(r"http://[^/\s]+", said)[0]
        finally:
            server.kill()  # a server in the middle of a session may put off a polite request for ever


def _open_on_a_phone(address: str, query: str = "") -> tuple[str, Document]:
    """Return the page that a phone gets, and the document of its session."""
    phone = Request(
        address + query, headers={"User-Agent": "Mozilla/5.0 (Linux; Android 14) Chrome/120 Mobile"}
    )
    with urlopen(phone, timeout=SECONDS) as answer:
        page = answer.read().decode()
    token = re.findall(r'"token":\s*"([^"]+)"', page)[0]
    return page, pull_session(session_id=get_session_id(token), url=address).document


@pytest.mark.proof
def test_a_notebook_is_an_app_for_panel_serve_on_a_phone_too(notebook: Path, apps: str) -> None:
    # In a thread: a browser of other tests may keep an event loop running in this one.
    with ThreadPoolExecutor(1) as thread:
        page, document = thread.submit(_open_on_a_phone, f"{apps}/{notebook.stem}").result()
    sliders = {str(slider.title) for slider in document.select({"type": AbstractSlider})}
    figures = list(document.select({"type": Plot}))
    assert len(sliders) >= 3 or len(figures) >= 3
    # The tab of the browser and the page itself say which app it is.
    assert f'.servable(title="{document.title}")' in notebook.read_text(encoding="utf-8")
    assert f"<title>{document.title}</title>" in page
    texts = " ".join(html.unescape(str(one.text)) for one in document.select({"type": HTML}))
    assert [words.strip() for words in re.findall("<h1[^>]*>([^<]*)<", texts)] == [document.title]
    assert '<meta name="viewport" content="width=device-width' in page  # else a phone shrinks 980 px
    assert not list(document.select({"type": Row})), "a row is wider than a phone"
    for grid in document.select({"type": GridPlot}):
        assert {column for _, _, column, *_ in grid.children} == {0}
    fixed = [plot.width for plot in figures if plot.sizing_mode in {None, "fixed"}]
    assert max(fixed, default=0) <= 390  # the width of a usual phone [px]


@pytest.mark.proof
def test_a_copy_for_jupyter_is_an_app_too(tmp_path: Path) -> None:
    copies, _ = copy_notebooks(tmp_path)
    copy = next(path for path in copies if path.stem == "03_sensor_errors")
    with serving([copy]) as address, ThreadPoolExecutor(1) as thread:
        _, document = thread.submit(_open_on_a_phone, f"{address}/{copy.stem}").result()
    assert document.title == "Allan deviation of a sensor at rest"
    assert len(list(document.select({"type": AbstractSlider}))) == 3
    assert len(list(document.select({"type": Plot}))) == 2


@pytest.mark.proof
def test_an_app_is_dark_where_it_is_asked_to_be(apps: str) -> None:
    with ThreadPoolExecutor(1) as thread:
        _, document = thread.submit(_open_on_a_phone, f"{apps}/11_live", "?theme=dark").result()
    grounds = {str(plot.background_fill_color) for plot in document.select({"type": Plot})}
    assert grounds == {str(DarkTheme().bokeh_theme._json["attrs"]["Plot"]["background_fill_color"])}


def test_an_exercise_with_a_device_that_sends_no_fixes_ends() -> None:
    code = [c.source for c in jupytext.read(ROOT / "notebooks" / "11_live.py", fmt="py:percent").cells]
    source = next(text for text in code if text.startswith("folder ="))
    for old, new in (("device=vectornav", "device=text"), ("samples < 800", "samples < 100")):
        assert old in source
        source = source.replace(old, new)
    names: dict[str, Any] = {}
    imports = next(text for text in code if text.startswith("import tempfile"))
    exec(f"{imports}\n{source}", names)
    assert names["status"].protocol == "text"
    assert names["status"].fixes == 0


def test_the_filter_that_is_written_openly_is_the_compiled_one() -> None:
    cells = jupytext.read(ROOT / "notebooks" / "04_filter.py", fmt="py:percent").cells
    code = [cell.source for cell in cells if cell.cell_type == "code"]
    shown = next(k for k, source in enumerate(code) if source.endswith("differences(compiled, mine)"))
    names: dict[str, Any] = {}
    exec("\n".join(code[: shown + 1]), names)
    found = names["differences"](names["compiled"], names["mine"])
    assert (found.loc["difference"] < 1e-9).all()
    assert (found.loc["difference of σ"] < 1e-9).all()
    assert (found.loc["σ"] > 0.1).all()
