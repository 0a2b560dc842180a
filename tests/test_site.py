"""Site: `make docs` builds without a warning, no link is broken, and nothing is fetched from the network."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

import lab
from lab.experiment import Experiment

pytest.importorskip("pydata_sphinx_theme", reason="the extra docs is not installed")

ROOT = Path(__file__).parent.parent
THEORY = sorted((ROOT / "docs/theory").glob("*.md"))
FETCHED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
"""Attributes of the tags whose content a browser fetches by itself."""


class Page(HTMLParser):
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


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the site, built as `make docs` does."""
    out = tmp_path_factory.mktemp("site")
    (command,) = re.findall(
        r"^\t\$\(BIN\)/python -m (sphinx .*) build/site$", (ROOT / "Makefile").read_text(), re.M
    )
    done = subprocess.run(
        [sys.executable, "-m", *command.split(), str(out)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return out


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {file: Page(file) for file in site.rglob("*.html") if "_static" not in file.parts}


def test_every_link_leads_to_a_place_that_exists(site: Path, pages: dict[Path, Page]) -> None:
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


def test_nothing_is_fetched_from_the_network(site: Path, pages: dict[Path, Page]) -> None:
    for file, page in pages.items():
        assert not [one for one in page.fetched if re.match(r"(https?:)?//", one)], file.relative_to(site)
    for sheet in site.rglob("*.css"):
        assert not re.findall(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//[^)]*", sheet.read_text("utf-8")), (
            sheet
        )


def test_every_public_name_is_in_the_reference(pages: dict[Path, Page]) -> None:
    places = set().union(*(page.ids for page in pages.values()))
    for name in set(lab.__all__) - {"__version__"}:
        module = getattr(lab, name).__name__ if name in {"allan", "budget", "plots"} else ""
        assert (f"module-{module}" if module else f"lab.{name}") in places, name


def test_every_setting_is_in_the_reference(site: Path) -> None:
    text = (site / "docs/site/reference/settings.html").read_text("utf-8")
    for path, _, _ in Experiment().leaves():
        assert text.count(f">{path}</span>") == 1, path


def test_equations_and_notebooks_are_on_their_pages(site: Path, pages: dict[Path, Page]) -> None:
    for source in THEORY:
        page = pages[site / "docs/theory" / f"{source.stem}.html"]
        assert page.text.count("<math xmlns") > 3
        assert "$$" not in page.text
    for notebook in (ROOT / "notebooks").glob("*.py"):
        text = pages[site / "notebooks" / f"{notebook.stem}.html"].text
        assert "highlight-python" in text
        assert "# %%" not in text


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
