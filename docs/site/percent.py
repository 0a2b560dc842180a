"""Percent: the notebooks, which are Python files with cells, as pages of text and code."""

from __future__ import annotations

import jupytext
from docutils import nodes
from myst_parser.sphinx_ import Parser
from sphinx.application import Sphinx

FIRST_LINES = """{intro}

*This page is the notebook `{name}`, which you can run: `jupyter lab` opens it.*
"""


class PercentParser(Parser):
    """Reads cells of text as Markdown and cells of code as blocks of code."""

    supported = ("percent",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse a notebook into a document."""
        super().parse(markdown(inputstring, document.settings.env.docname), document)


def markdown(source: str, name: str) -> str:
    """Return a notebook as Markdown.

    Parameters
    ----------
    source
        The Python file, with cells in the percent format.
    name
        Name of its page.
    """
    cells = jupytext.reads(source, fmt="py:percent").cells
    parts = [
        cell.source if cell.cell_type == "markdown" else f"```python\n{cell.source}\n```" for cell in cells
    ]
    return "\n\n".join((FIRST_LINES.format(intro=parts[0], name=f"{name}.py"), *parts[1:]))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the parser for the suffix of Python files."""
    app.add_source_parser(PercentParser)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
