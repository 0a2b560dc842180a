"""Executed notebooks: outputs of their cells, kept in ``build/notebooks`` until they would be others.

They are kept with the digests of the files of the lab that the notebook imported or opened, such as cards of
sensors and missions, also while its cells ran.

Plots are those that Jupyter shows, drawn by the scripts of Bokeh and Panel, which the site brings along.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import bokeh
import jupytext
import panel
from docutils import nodes
from nbclient import NotebookClient
from nbformat.v4 import new_code_cell
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).parent.parent.parent
SECONDS = 600
"""Longest time of a cell on an idle computer [s]: the first runs of four error models compile each."""
PANEL = Path(panel.__file__).parent / "dist"
BOKEH = Path(bokeh.__file__).parent / "server/static/js"
SCRIPTS = ("bokeh.min.js", "bokeh-widgets.min.js", "bokeh-tables.min.js")
STYLES = ("css", "bundled/theme")
"""Folders with the style sheets that outputs of Panel name."""
NETWORK = f"https://cdn.holoviz.org/panel/{panel.__version__}/dist/"
"""Where outputs look for style sheets; here they are beside the page."""
LOADING = {"application/javascript", "application/vnd.holoviews_load.v0+json"}
"""Kinds of output with which Jupyter loads scripts: the page has its own."""

WATCHED = """
import sys
sys.opened = set()
sys.addaudithook(lambda event, given: sys.opened.add(given[0]) if event == "open" else None)
"""
"""A first cell, which has Python remember the files that are opened."""
USED = """
import json, os, sys
_opened = {os.fspath(one) for one in sys.opened if isinstance(one, (str, os.PathLike))}
_imported = {vars(one).get("__file__") for one in list(sys.modules.values())}
print(json.dumps([*(one for one in _opened if not one.endswith((".py", ".pyc"))), *filter(None, _imported)]))
"""
"""A last cell, which prints them without those of Python, and the files of all modules that were imported."""
FOLDERS = ROOT / "lab", ROOT / "missions"
"""Where the files stand that are the lab's."""

Cell = dict[str, Any]
_log = logging.getLogger(__name__)


class Executed(NamedTuple):
    """A notebook that was executed.

    Attributes
    ----------
    cells : list of dict
        Its cells with their outputs.
    files : dict
        The files of the lab that it imported or opened, within the repository, and their digests.
    """

    cells: list[Cell]
    files: dict[str, str]


def key(source: str) -> str:
    """Return a text that changes with a notebook and with what draws the plots."""
    return digest("\0".join([source, bokeh.__version__, panel.__version__]).encode())


def digest(content: bytes) -> str:
    """Return a text that changes with a content."""
    return hashlib.sha256(content).hexdigest()[:16]


def is_current(notebook: Executed) -> bool:
    """Return whether all files are as they were."""
    return all(
        (ROOT / name).is_file() and digest((ROOT / name).read_bytes()) == known
        for name, known in notebook.files.items()
    )


def executed(name: str, source: str, cache: Path) -> Executed:
    """Return a notebook with its outputs.

    Parameters
    ----------
    name
        Name of the file without its suffix.
    source
        The notebook in the percent format.
    cache
        Folder of the outputs that are kept.

    Raises
    ------
    nbclient.exceptions.CellExecutionError
        If a cell fails.
    """
    kept = cache / f"{name}-{key(source)}.json"
    if kept.exists():
        found = Executed(**json.loads(kept.read_text("utf-8")))
        if is_current(found):
            return found
    _log.info("executing %s", name)
    begin = time.monotonic()
    notebook = jupytext.reads(source, fmt="py:percent")
    notebook.cells = [new_code_cell(WATCHED), *notebook.cells, new_code_cell(USED)]
    with TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        # Below errors, it warns that other users of this computer could listen.
        quiet = ["--log-level=ERROR"]
        NotebookClient(notebook, timeout_func=longest, resources=resources, extra_arguments=quiet).execute()
    _log.info("executed %s in %.0f s", name, time.monotonic() - begin)
    _, *cells, last = (dict(cell) for cell in notebook.cells)
    paths = {Path(path) for path in json.loads(last["outputs"][0]["text"])}
    own = sorted(path for path in paths if any(map(path.is_relative_to, FOLDERS)) and path.is_file())
    files = {path.relative_to(ROOT).as_posix(): digest(path.read_bytes()) for path in own}
    made = Executed(cells, files)
    cache.mkdir(parents=True, exist_ok=True)
    for old in cache.glob(f"{name}-*.json"):
        old.unlink()
    kept.write_text(json.dumps(made._asdict()), "utf-8")
    return made


def longest(_cell: object = None) -> int:
    """Return the longest time of a cell that begins now [s]: a computer with other work gets more."""
    if not hasattr(os, "getloadavg"):  # Windows
        return SECONDS
    return round(SECONDS * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1)))


class CellOutputs(SphinxDirective):
    """``{cell-outputs} N`` shows the outputs of a cell of the notebook that is read."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the outputs."""
        cell = self.env.temp_data["cells"][int(self.arguments[0])]
        static = "../" * self.env.docname.count("/") + "_static/panel/"
        shown: list[nodes.Node] = []
        scripts = ""
        for kind, found in outputs(cell):
            text = found.replace(NETWORK, static)
            if kind == "html":
                if "docs_json" in text and not self.env.temp_data.get("has scripts"):
                    self.env.temp_data["has scripts"] = True
                    scripts = "".join(
                        f'<script defer src="{static}{name}"></script>' for name in (*SCRIPTS, "panel.min.js")
                    )
                shown.append(nodes.raw("", f'{scripts}<div class="output">{text}</div>', format="html"))
            else:
                shown.append(nodes.literal_block(text, text, language="none", classes=["output"]))
        return shown


def outputs(cell: Cell) -> Iterator[tuple[str, str]]:
    """Iterate over what a cell shows, as ``html`` or ``text``."""
    found = cell.get("outputs", [])
    if any(LOADING & set(one.get("data", {})) for one in found):
        return
    for one in found:
        if one["output_type"] == "stream":
            yield "text", one["text"]
        data = one.get("data", {})
        if "text/html" in data and "esms-options" not in data["text/html"]:
            yield "html", data["text/html"]
        elif "image/png" in data:
            about = "Picture that the cell above draws"
            yield "html", f'<img alt="{about}" src="data:image/png;base64,{data["image/png"].strip()}">'
        elif "text/markdown" not in data and "text/html" not in data and "text/plain" in data:
            yield "text", data["text/plain"]


def bring_scripts(app: Sphinx, problem: Exception | None) -> None:
    """Copy the scripts and style sheets that draw plots into the site."""
    if problem or app.builder.format != "html":
        return
    folder = app.outdir / "_static/panel"
    folder.mkdir(parents=True, exist_ok=True)
    for path in (*(BOKEH / name for name in SCRIPTS), PANEL / "panel.min.js"):
        shutil.copy(path, folder / path.name)
    for name in STYLES:
        shutil.copytree(PANEL / name, folder / name, dirs_exist_ok=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive and the setting."""
    app.add_config_value("execute_notebooks", True, "env", types=bool)
    app.add_config_value("notebook_cache", str(ROOT / "build/notebooks"), "env", types=str)
    app.add_directive("cell-outputs", CellOutputs)
    app.connect("build-finished", bring_scripts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
