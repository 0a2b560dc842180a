"""Ledger: the table of what the lab claims of itself, from docs/measurements.toml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from lab.base.parameters.toml_file import read_toml

LEDGER = Path(__file__).parents[1] / "measurements.toml"


class Ledger(SphinxDirective):
    """``.. ledger::`` makes a table of the rows: claim, figure, what it rests on, command and date."""

    def run(self) -> list[nodes.Node]:
        """Return a sentence with the counts, and the table."""
        self.env.note_dependency(str(LEDGER))
        rows = read_toml(LEDGER)["row"]
        validated = sum(bool(row.get("oracle") and row.get("command")) for row in rows)
        lines = [
            f"{len(rows)} claims, {validated} validated.",
            "",
            "| what | figure | rests on | shown by | on |",
            "|---|---|---|---|---|",
            *(_line(row) for row in rows),
        ]
        container = nodes.container()
        self.state.nested_parse(StringList(lines, str(LEDGER)), self.content_offset, container)
        return list(container.children)


def _line(row: dict[str, Any]) -> str:
    command = f"`{row['command']}`" if row.get("command") else "no command yet"
    oracle = row.get("oracle", "")
    rests = f"validated: {oracle}" if oracle and row.get("command") else oracle or "modelled"
    figure = f"{row['figure']}; misses {row['missed']}" if row.get("missed") else row["figure"]
    cells = (row["claim"], figure, rests, command, str(row["date"]))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("ledger", Ledger)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
