"""Percent: the notebooks, which are Python files with cells, as pages of text and code."""

from __future__ import annotations

from pathlib import Path

import jupytext
from docutils import nodes
from executed import ROOT, Cell, executed
from myst_parser.sphinx_ import Parser
from sphinx.application import Sphinx

FIRST_LINES = """{intro}

*This page is the notebook `{name}.py`. Run it with `jupyter lab`: there, the sliders compute anew.*
"""


class PercentParser(Parser):
    """Reads cells of text as Markdown, and cells of code as blocks of code with what they show."""

    supported = ("percent",)

    def parse(self, inputstring: str, document: nodes.document) -> None:
        """Parse a notebook into a document."""
        env = document.settings.env
        if env.config.execute_notebooks:
            cells, files = executed(Path(env.docname).name, inputstring, Path(env.config.notebook_cache))
            for file in files:
                env.note_dependency(str(ROOT / file))
        else:
            cells = [dict(cell) for cell in jupytext.reads(inputstring, fmt="py:percent").cells]
        env.temp_data["cells"] = cells
        super().parse(markdown(cells, env.docname), document)


def markdown(cells: list[Cell], name: str) -> str:
    """Return a notebook as Markdown.

    Parameters
    ----------
    cells
        Its cells; the first is text.
    name
        Name of its page.
    """
    parts = [
        cell["source"]
        if cell["cell_type"] == "markdown"
        else f"```python\n{cell['source']}\n```\n\n```{{cell-outputs}} {number}\n```"
        for number, cell in enumerate(cells)
    ]
    return "\n\n".join((FIRST_LINES.format(intro=parts[0], name=name), *parts[1:]))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the parser for the suffix of Python files."""
    app.add_source_parser(PercentParser)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
