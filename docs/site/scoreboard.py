"""Scoreboard: the tables of the results on record, from the JSON file of the lab."""

from __future__ import annotations

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from lab.experiment.scoreboard.comparison import RUN
from lab.experiment.scoreboard.registry import REGISTRY, data_sets
from lab.experiment.scoreboard.results import (
    RESULTS,
    describe_standing,
    kept_rows,
    list_notes,
    of_set,
    program_notes,
    tabulate_rows,
)


class Scoreboard(SphinxDirective):
    """``.. scoreboard::`` makes a table of each set, with a sentence and what it rests on."""

    def run(self) -> list[nodes.Node]:
        """Return the tables."""
        for file in (RESULTS, REGISTRY):
            self.env.note_dependency(str(file))
        container = nodes.container()
        self.state.nested_parse(StringList(_lines(), str(RESULTS)), self.content_offset, container)
        return list(container.children)


def _lines() -> list[str]:
    """Return the tables as Markdown."""
    kept, lines = kept_rows(), []
    for about in data_sets().values():
        rows = of_set(kept, about.name)
        titles, cells = tabulate_rows(about, rows)
        sentence, basis = describe_standing(about, rows)
        lines += [f"**{about.name}**: {about.title}. {about.source}, {about.licence}.", ""]
        lines += ["| " + " | ".join(line) + " |" for line in (titles, ["---"] * len(titles), *cells)]
        dates = sorted({row.date for row in rows if row.outcome == RUN})
        on = f" On {', '.join(dates)}." if dates else ""
        lines += ["", f"{sentence} *{basis}.*{on}", ""]
        lines += [*(f"- {note}" for note in list_notes(about)), ""]
    notes = program_notes([one.row for one in kept])
    return [*lines, *(f"- {note}" for note in notes), ""]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("scoreboard", Scoreboard)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
