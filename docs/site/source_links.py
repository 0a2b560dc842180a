"""Source links: a name such as ``lab.navigation.strapdown.step`` leads to its source, a page of this site."""

from __future__ import annotations

import importlib
import importlib.util
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.osutil import relative_uri

NAME = re.compile(r"lab(\.\w+){2,}")
FOLDER = "source"


@cache
def place_of(name: str) -> tuple[str, str, int] | None:
    """Return the module of a name, the name in it, and its line, from 1; None for a name without source."""
    parts = name.split(".")
    for count in range(len(parts) - 1, 1, -1):
        module, inside = ".".join(parts[:count]), ".".join(parts[count:])
        try:
            found = importlib.util.find_spec(module)
        except ModuleNotFoundError:
            continue
        if found is None:
            continue
        value = getattr(importlib.import_module(module), parts[count], None)
        home = getattr(value, "__module__", None)
        if home and home != module and home.startswith("lab."):  # it is imported there from where it stands
            return place_of(".".join([home, *parts[count:]]))
        analyzer = ModuleAnalyzer.for_module(module)
        analyzer.find_tags()
        if inside in analyzer.tags:
            return module, inside, analyzer.tags[inside][1]
        begin = analyzer.tags.get(inside.rpartition(".")[0], ("", 1, 0))[1]  # of the class of an attribute
        for line, text in enumerate(analyzer.code.splitlines()[begin - 1 :], begin):
            if re.match(rf"\s*{parts[-1]}\b.*[:=]", text):
                return module, inside, line
        return None
    return None


def find_names(app: Sphinx, doctree: nodes.document) -> None:
    """Make the names of a document links, and remember whose source is wanted."""
    wanted = vars(app.env).setdefault("source_places", {})
    here = app.env.current_document.docname
    for literal in list(doctree.findall(nodes.literal)):
        place = place_of(literal.astext()) if NAME.fullmatch(literal.astext()) else None
        if place and not isinstance(literal.parent, nodes.reference):
            module, inside, _ = place
            wanted.setdefault(here, set()).add(place)
            app.env.note_dependency(str(ModuleAnalyzer.for_module(module).srcname))
            target = f"{FOLDER}/{module.replace('.', '/')}.html"
            link = nodes.reference(
                "", "", internal=True, refuri=f"{relative_uri(f'{here}.html', target)}#{inside}"
            )
            literal.replace_self(link)
            link += literal


def forget(app: Sphinx, env: BuildEnvironment, name: str) -> None:
    """Forget what a document that is read again wanted."""
    vars(env).get("source_places", {}).pop(name, None)


def merge(app: Sphinx, env: BuildEnvironment, names: set[str], other: BuildEnvironment) -> None:
    """Take over what a process that reads other documents found."""
    vars(env).setdefault("source_places", {}).update(vars(other).get("source_places", {}))


def pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Make a page of each module that is wanted, with an anchor at each wanted name."""
    lines_of: dict[str, dict[int, str]] = {}
    for module, inside, line in set().union(*vars(app.env).get("source_places", {}).values()):
        lines_of.setdefault(module, {})[line] = inside
    for module, wanted in sorted(lines_of.items()):
        code = ModuleAnalyzer.for_module(module).code
        lines = app.builder.highlighter.highlight_block(code, "python").splitlines()  # type: ignore[attr-defined]
        first, rest = lines[0].split("<pre>")
        lines[:1] = [f"{first}<pre>", rest]  # so that lines are counted from 1
        for line, inside in wanted.items():
            lines[line] = f'<span id="{inside}"></span>{lines[line]}'
        path = module.replace(".", "/")
        body = f"<h1>{module}</h1>\n<p>The source, <code>{path}.py</code>.</p>\n" + "\n".join(lines)
        yield f"{FOLDER}/{path}", {"title": module, "body": body}, "page.html"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the steps."""
    app.connect("doctree-read", find_names)
    app.connect("env-purge-doc", forget)
    app.connect("env-merge-info", merge)
    app.connect("html-collect-pages", pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
