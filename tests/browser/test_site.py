"""Site: `make docs` builds without a warning, no link is broken, nothing is fetched from the network.

In a browser, its pages fit a phone and have no serious finding of axe-core, and notebooks have their plots.
"""

from __future__ import annotations

import importlib.util
import inspect
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
from axe_playwright_python.sync_playwright import Axe
from PIL import Image, ImageStat
from playwright.sync_api import Browser, Page, expect

import lab
from lab.base.aid_table import AIDS
from lab.experiment.experiment import Experiment
from tests.browser.conftest import ROOT, new_context, wait_for

# Looked for, and not imported: that takes a second in each process that collects tests.
if importlib.util.find_spec("pydata_sphinx_theme") is None:
    pytest.skip("the extra docs is not installed", allow_module_level=True)

THEORY = sorted((ROOT / "docs/theory").glob("*.md"))
FETCHED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
"""Attributes of the tags whose content a browser fetches by itself."""


class Html(HTMLParser):
    """Collects the places, the links, and the addresses that a browser fetches by itself."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: set[str] = set()
        self.fetched: set[str] = set()
        self.text = file.read_text("utf-8")
        self.feed(self.text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what is in a tag."""
        given = dict(attrs)
        self.ids.add(given.get("id") or "")
        if tag == "a" and given.get("href"):
            self.links.add(given["href"] or "")
        if tag in FETCHED and given.get("rel") != "canonical" and given.get(FETCHED[tag]):
            self.fetched.add(given[FETCHED[tag]] or "")


def build(*options: str) -> None:
    """Run Sphinx; a warning is an error."""
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the site, built as `make docs` does, but for the outputs of the notebooks."""
    out = tmp_path_factory.mktemp("site")
    (command,) = re.findall(
        r"^\t\$\(BIN\)/python -m (sphinx .*) build/site$", (ROOT / "Makefile").read_text(), re.M
    )
    _, *options = command.split()
    build(*options, "-D", "execute_notebooks=0", str(out))
    return out


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Html]:
    return {file: Html(file) for file in site.rglob("*.html") if "_static" not in file.parts}


@pytest.mark.proof
def test_every_link_leads_to_a_place_that_exists(site: Path, pages: dict[Path, Html]) -> None:
    assert len(pages) > 35
    for file, page in pages.items():
        for link in page.links | page.fetched:
            if re.match(r"https?:|mailto:", link):
                continue
            path, _, place = unquote(link).partition("#")
            target = (file.parent / path.partition("?")[0]).resolve() if path else file
            assert target.is_file(), f"{file.relative_to(site)}: {link}"
            if place and target.suffix == ".html":
                assert place in pages[target].ids, f"{file.relative_to(site)}: {link}"


@pytest.mark.proof
def test_nothing_is_fetched_from_the_network(site: Path, pages: dict[Path, Html]) -> None:
    for file, page in pages.items():
        assert not [one for one in page.fetched if re.match(r"(https?:)?//", one)], file.relative_to(site)
    for sheet in site.rglob("*.css"):
        assert not re.findall(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//[^)]*", sheet.read_text("utf-8")), (
            sheet
        )


@pytest.mark.proof
def test_every_public_name_is_in_the_reference(pages: dict[Path, Html]) -> None:
    places = set().union(*(page.ids for page in pages.values()))
    for name in set(lab.__all__) - {"__version__"}:
        module = getattr(lab, name).__name__ if inspect.ismodule(getattr(lab, name)) else ""
        assert (f"module-{module}" if module else f"lab.{name}") in places, name


@pytest.mark.proof
def test_every_setting_is_in_the_reference(site: Path) -> None:
    text = (site / "docs/site/reference/settings.html").read_text("utf-8")
    for path, _, _ in Experiment().leaves():
        assert text.count(f">{path}</span>") == 1, path


@pytest.mark.proof
def test_equations_and_notebooks_are_on_their_pages(site: Path, pages: dict[Path, Html]) -> None:
    for source in THEORY:
        page = pages[site / "docs/theory" / f"{source.stem}.html"]
        assert page.text.count("<math xmlns") > 3
        assert "$$" not in page.text
    for notebook in (ROOT / "notebooks").glob("*.py"):
        text = pages[site / "notebooks" / f"{notebook.stem}.html"].text
        assert "highlight-python" in text
        assert "# %%" not in text


@pytest.mark.proof
def test_names_below_equations_lead_to_their_source(site: Path, pages: dict[Path, Html]) -> None:
    """That the place exists is tested with all links."""
    for source in THEORY:
        named = set(re.findall(r"^Function: `(lab\.[\w.]+)`", source.read_text("utf-8"), re.M))
        assert named
        links = {
            link for link in pages[site / "docs/theory" / f"{source.stem}.html"].links if "/source/" in link
        }
        # The module may be one that imports the function, so that the last word alone is the same.
        assert {name.rpartition(".")[2] for name in named} <= {re.split("[#.]", link)[-1] for link in links}
    text = pages[site / "source/lab/navigation/strapdown.html"].text
    assert '<span id="step"></span>' in text
    assert "Savage" in text


@pytest.mark.proof
def test_links_have_titles_and_not_paths(site: Path, pages: dict[Path, Html]) -> None:
    assert ">Does the filter tell the truth?<" in pages[site / "README.html"].text
    for file, page in pages.items():
        article = page.text.partition("<article")[2].partition("</article>")[0]
        shown = re.findall(r"<a [^>]*>((?:<[^>]+>)*)([^<]*)", article)
        assert not [text for _, text in shown if re.fullmatch(r"[\w./-]+\.md", text)], file.name


@pytest.mark.proof
def test_the_search_knows_the_pages_without_a_server(site: Path) -> None:
    script = (site / "searchindex.js").read_text("utf-8")
    index = json.loads(script.removeprefix("Search.setIndex(").removesuffix(")"))
    found = next(found for stem, found in index["terms"].items() if stem.startswith("scull"))
    names = {index["docnames"][at] for at in (found if isinstance(found, list) else [found])}
    assert "docs/theory/strapdown" in names


def equations(text: str) -> Iterator[tuple[str, str]]:
    """Iterate over displayed equations with the paragraph of functions that follows them."""
    parts = re.split(r"^\$\$\n(.*?)\n\$\$$", text, flags=re.M | re.S)
    for at in range(1, len(parts), 2):
        rest = next(part for part in parts[at + 1 :: 2] if part.strip())
        yield parts[at], rest.strip().partition("\n\n")[0]


@pytest.mark.proof
@pytest.mark.parametrize("document", THEORY, ids=lambda path: path.stem)
def test_every_equation_names_its_function(document: Path) -> None:
    text = document.read_text("utf-8")
    for equation, after in equations(text):
        assert after.startswith("Function: "), equation
        assert re.search(r"`lab\.[\w.]+`", after), equation
    for name in re.findall(r"`(lab\.[\w.]+)`", text):
        found, parts = lab, name.split(".")
        for count, part in enumerate(parts[1:], 2):
            try:
                found = importlib.import_module(".".join(parts[:count]))
            except ModuleNotFoundError:
                found = getattr(found, part)


SITE = ROOT / "docs/site"
THEMES = ("light", "dark")
WIDTHS = (400, 1440)
"""A phone and a laptop [px]."""
PAGES = (
    "README.html",
    "docs/site/index.html",
    "docs/site/tutorials.html",
    "docs/installing.html",
    "source/lab/navigation/strapdown.html",
    "docs/command-line.html",
    "docs/limits.html",
    "docs/theory/frames.html",
    "docs/site/reference/running.html",
    "missions/README.html",
)
"""Pages with pictures, code, equations, signatures, wide tables, and a long word in the link to the next."""
SERIOUS = {"serious", "critical"}
NOTEBOOK = """\
# %% [markdown]
# # Short

# %%
import holoviews as hv
import pandas as pd
import panel as pn
from lab import card, earth

hv.extension("bokeh", inline=pn.config.inline)
pn.extension()

# %% [markdown]
# A plot, a slider, a table and a word, with $\\int_0^1 t^2 dt$:

# %%
pn.Column(pn.widgets.FloatSlider(label="Noise", start=0, end=1), hv.Curve([(0, 1), (1, 3), (2, 2)]))

# %%
print("said aloud")
card("BMI270")
pd.DataFrame({"wide": [1.5]})
"""
ORPHAN = "---\norphan: true\n---\n\n"
CONF = f"""\
import json
import sys
from pathlib import Path

sys.path.insert(0, {str(SITE)!r})
extensions = ["myst_parser", "executed", "mathml", "percent", "settings_list", "source_links"]
source_suffix = {{".md": "markdown", ".py": "percent", ".rst": "restructuredtext"}}
include_patterns = ["notebooks/*.py", "places.md", "settings.rst"]
exclude_patterns = ["conf.py"]
root_doc = "notebooks/short"
myst_enable_extensions = ["dollarmath"]
html_math_renderer = "mathml"
html_theme, html_title = "pydata_sphinx_theme", "Short"
html_static_path = [{str(SITE / "static")!r}]
html_css_files, html_js_files = ["site.css"], ["site.js"]


def write_watched(app, _problem):
    watched = {{page: list(map(str, files)) for page, files in app.env.dependencies.items()}}
    (Path(app.outdir) / "watched.json").write_text(json.dumps(watched), "utf-8")


def setup(app):
    app.connect("build-finished", write_watched)
"""


def in_both_themes_on_both_screens(test: Callable[..., None]) -> Callable[..., None]:
    """Mark a test that runs in the browser with each theme at each width."""
    for mark in (pytest.mark.browser, *map(pytest.mark.parametrize, ("width", "theme"), (WIDTHS, THEMES))):
        test = mark(test)
    return test


@pytest.fixture(scope="module")
def visit(chromium: Browser) -> Iterator[Callable[[Path, str, int], Page]]:
    """Return a function that opens a page of a site from its folder; nothing else may be asked for."""
    asked: list[str] = []
    contexts = []

    def open_it(file: Path, theme: str, width: int) -> Page:
        options: Any = {"viewport": {"width": width, "height": 900}, "color_scheme": theme}
        contexts.append(new_context(chromium, **options))
        page = contexts[-1].new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.goto(file.as_uri())
        return page

    yield open_it
    for context in contexts:
        context.close()
    assert not [url for url in asked if not url.startswith(("file:", "data:", "blob:"))]


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the page of a short notebook, executed, as Sphinx builds it."""
    folder = tmp_path_factory.mktemp("short")
    (folder / "notebooks").mkdir()
    (folder / "notebooks/short.py").write_text(NOTEBOOK, "utf-8")
    (folder / "conf.py").write_text(CONF, "utf-8")
    (folder / "places.md").write_text(f"{ORPHAN}# Places\n\n`lab.navigation.strapdown.step`\n", "utf-8")
    (folder / "settings.rst").write_text(":orphan:\n\nSettings\n========\n\n.. sensor-lists::\n", "utf-8")
    build("-b", "html", "-D", f"notebook_cache={folder / 'cache'}", str(folder), str(folder / "html"))
    return folder / "html/notebooks/short.html"


@pytest.mark.proof
def test_a_page_is_made_anew_when_what_it_shows_changes(short: Path) -> None:
    """Code and cards that a notebook used, sources of links, and declarations of settings."""
    folder = short.parents[1]
    watched = json.loads((folder / "watched.json").read_text("utf-8"))
    for name, files in {
        "notebooks/short": ("motion/frames/earth.py", "sensors/cards.toml"),
        "places": ("navigation/strapdown.py",),
        "settings": ("sensors/readings.py", "sensors/airspeed.py", "base/aid_table.py"),
    }.items():
        known = {(folder.parent / file).resolve() for file in watched[name]}
        assert known >= {ROOT / "lab" / file for file in files}, name
    text = (folder / "settings.html").read_text("utf-8")
    assert [text.count(f">sensors.{aid.name}.fitted</span>") for aid in AIDS] == [1] * len(AIDS)


@pytest.mark.proof
@in_both_themes_on_both_screens
def test_an_executed_notebook_has_its_plots_without_network(
    short: Path, visit: Callable[[Path, str, int], Page], theme: str, width: int
) -> None:
    page = visit(short, theme, width)
    expect(page.get_by_text("said aloud", exact=True)).to_be_visible()
    expect(page.get_by_role("cell", name="1.5")).to_be_visible()
    expect(page.get_by_text("Noise:")).to_be_visible()
    plot = page.locator(".output canvas").first
    expect(plot).to_be_visible()
    expect(page.get_by_role("slider", name="Noise")).to_be_visible()
    drawn = "(canvas) => canvas.getContext('2d').getImageData(canvas.width >> 1, 20, 1, 1).data[3] === 255"
    wait_for(page, drawn, arg=plot.element_handle())
    brightness = ImageStat.Stat(Image.open(BytesIO(plot.screenshot())).convert("L")).mean[0]
    assert brightness > 200 if theme == "light" else brightness < 60
    accessible(page, f"short notebook, {theme}, {width} px")


@pytest.mark.proof
@pytest.mark.browser
@pytest.mark.parametrize("theme", THEMES)
def test_a_plot_of_a_notebook_is_taken_in_the_theme(
    short: Path, visit: Callable[[Path, str, int], Page], theme: str, tmp_path: Path
) -> None:
    spec = importlib.util.spec_from_file_location("pictures", ROOT / "docs/pictures.py")
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.photograph_plot(visit(short, theme, 1440), 0, tmp_path / "plot.png")
    picture = Image.open(tmp_path / "plot.png").convert("RGB")
    assert picture.size == script.SMALL
    brightness = ImageStat.Stat(picture.convert("L")).mean[0]
    assert brightness > 200 if theme == "light" else brightness < 60
    # The curve is a thin blue line.
    blue = sum(count for count, (r, _, b) in picture.getcolors(2**20) or [] if b > r + 60)
    assert 200 < blue < picture.width * picture.height / 20


@pytest.mark.proof
@in_both_themes_on_both_screens
def test_pages_fit_the_screen_and_axe_finds_nothing_serious(
    site: Path, visit: Callable[[Path, str, int], Page], theme: str, width: int
) -> None:
    page = visit(site / PAGES[0], theme, width)
    for name in PAGES:
        page.goto((site / name).as_uri())
        accessible(page, f"{name}, {theme}, {width} px")


@pytest.mark.proof
@pytest.mark.browser
def test_pictures_are_those_of_the_theme(site: Path, visit: Callable[[Path, str, int], Page]) -> None:
    for theme, other in (THEMES, THEMES[::-1]):
        page = visit(site / "README.html", theme, 1440)
        expect(page.locator(f"img[src$='errors-{theme}.png']")).to_be_visible()
        expect(page.locator(f"img[src$='errors-{other}.png']")).to_be_hidden()


@pytest.mark.proof
@pytest.mark.browser
def test_the_search_finds_a_page_in_a_folder(site: Path, visit: Callable[[Path, str, int], Page]) -> None:
    page = visit(site / "search.html", "light", 1440)
    page.goto((site / "search.html").as_uri() + "?q=sculling")
    expect(page.locator("#search-results a[href^='docs/theory/strapdown']").first).to_be_visible()


BEYOND_THE_EDGE = """
() => [...document.querySelectorAll(".prev-next-area a *")]
  .filter((part) => part.getBoundingClientRect().right > document.documentElement.clientWidth)
  .map((part) => part.textContent)
"""
"""Returns the texts of links to the pages before and after that are cut off; they do not scroll."""


def accessible(page: Page, what: str) -> None:
    """Check that a page has no serious finding of axe-core, and that its body does not scroll sideways."""
    wide = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert wide <= 0, what
    assert page.evaluate(BEYOND_THE_EDGE) == [], what
    assert page.evaluate("document.documentElement.dataset.theme") in what
    found = Axe().run(page, options={"resultTypes": ["violations"], "preload": False}).response["violations"]
    texts = [f"{one['id']}: {one['nodes'][0]['html'][:200]}" for one in found if one["impact"] in SERIOUS]
    assert texts == [], what


@pytest.mark.proof
@pytest.mark.browser
def test_outputs_are_kept_until_the_notebook_changes(
    short: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.syspath_prepend(str(SITE))
    module: Any = sys.modules.get("executed") or __import__("executed")

    class Refusing:
        def __init__(self, *_arguments: Any, **_options: Any) -> None:
            raise AssertionError("executed again")

    monkeypatch.setattr(module, "NotebookClient", Refusing)
    cache = short.parents[2] / "cache"
    again = module.executed("short", NOTEBOOK, cache)
    assert "said aloud\n" in [text for cell in again.cells for _kind, text in module.outputs(cell)]
    for changed, name in ((NOTEBOOK.replace("aloud", "again"), "short"), (NOTEBOOK, "other")):
        with pytest.raises(AssertionError, match="executed again"):
            module.executed(name, changed, cache)
    # Of the lab, only what the notebook imported counts.
    assert module.is_current(again)
    assert "lab/motion/frames/earth.py" in again.files
    assert "lab/cli/app.py" not in again.files
    for file in ("lab/motion/frames/earth.py", "lab/that_was_removed.py"):
        assert not module.is_current(again._replace(files={**again.files, file: "of another content"}))


@pytest.mark.proof
@pytest.mark.skipif(not hasattr(os, "getloadavg"), reason="Windows reports no load")
def test_a_cell_has_more_time_on_a_computer_with_other_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(SITE))
    module: Any = sys.modules.get("executed") or __import__("executed")
    given: list[int] = []

    class Client:
        def __init__(self, *_arguments: Any, timeout_func: Callable[[object], int], **_options: Any) -> None:
            given.append(timeout_func(None))
            raise AssertionError("asked")

    monkeypatch.setattr(module, "NotebookClient", Client)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    for load in (0.1, 2.0, 20.0):
        monkeypatch.setattr(os, "getloadavg", lambda load=load: (load, 0.0, 0.0))
        with pytest.raises(AssertionError, match="asked"):
            module.executed("never", "1", SITE / "never")
    assert given == [module.SECONDS, module.SECONDS, 10 * module.SECONDS]
