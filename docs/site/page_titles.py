"""Page titles: a link whose text is the path of a document has the title of that document instead.

Where the code is hosted, a path says which file opens. A reader of the site looks for a subject.
"""

from __future__ import annotations

import posixpath
import re

from docutils import nodes
from sphinx.application import Sphinx

PATH = re.compile(r"[\w./-]+\.(?:md|py)")


def name_pages(app: Sphinx, doctree: nodes.document, here: str) -> None:
    """Give the links of a document the titles of the pages that they lead to."""
    for link in doctree.findall(nodes.reference):
        path = link.get("refuri", "").partition("#")[0]
        if PATH.fullmatch(link.astext()) and path.endswith(".html"):
            name = posixpath.normpath(posixpath.join(posixpath.dirname(here), path.removesuffix(".html")))
            if name in app.env.titles:
                link.clear()
                link.append(nodes.inline("", app.env.titles[name].astext()))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the step."""
    app.connect("doctree-resolved", name_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
