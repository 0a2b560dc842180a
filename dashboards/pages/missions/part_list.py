"""Part list: ordered tables of a flight plan, such as its manoeuvres, to add, remove and move."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import panel as pn
import panel_material_ui as pmui

from dashboards.pages.missions.entry_fields import EntryFields, layout_width
from dashboards.style import TOOLTIP, plain_row, whole_column
from lab.flying.plan_table import Limits

ROW = """
:host { border: 1px solid rgba(128,128,128,.3); border-radius: 6px; }
@media (max-width: 1000px) {
  :host { flex-wrap: wrap; min-width: 0 !important; }
  .bk-Row { flex: 1 1 100% !important; order: 1; }  /* the fields, below title and tools */
}
"""


class _Part(NamedTuple):
    word: str
    fields: EntryFields


class PartList:
    """An ordered list of tables.

    Parameters
    ----------
    kinds
        The dataclasses of the tables, by their words in a plan.
    noun
        Name of one table.
    changed
        Called after every change by a person.
    """

    def __init__(self, kinds: Mapping[str, type], noun: str, changed: Callable[[], None]) -> None:
        self._kinds = dict(kinds)
        self._changed = changed
        self._limits: Limits | None = None
        self._parts: list[_Part] = []
        self._rows = whole_column()
        self._kind = pmui.Select(
            label=noun.capitalize(),
            options={spoken(word): word for word in kinds},
            value=next(iter(kinds)),
            size="small",
            margin=(6, 4),
            visible=len(kinds) > 1,
            **layout_width(170),
        )
        add = pmui.Button(label=f"Add {noun}", icon="add", size="small", variant="outlined", margin=(10, 4))
        add.on_click(lambda _event: self._add())
        self.view = whole_column(self._rows, plain_row(self._kind, add))

    def load(self, tables: Sequence[tuple[str, Mapping[str, Any]]], limits: Limits | None = None) -> None:
        """Show tables, each with its word."""
        self._limits = limits
        self._parts = [self._make(word, values) for word, values in tables]
        self._show()

    def read(self) -> list[tuple[str, dict[str, Any]]]:
        """Return the current tables, each with its word."""
        return [(part.word, part.fields.read()) for part in self._parts]

    def _make(self, word: str, values: Mapping[str, Any]) -> _Part:
        return _Part(word, EntryFields(self._kinds[word], values, self._changed, self._limits))

    def _add(self) -> None:
        self._parts.append(self._make(self._kind.value, {}))
        self._show()
        self._changed()

    def _show(self) -> None:
        self._rows[:] = [self._row(number, part) for number, part in enumerate(self._parts)]

    def _row(self, number: int, part: _Part) -> pn.viewable.Viewable:
        title = pn.pane.HTML(
            f"<b>{number + 1}</b>&ensp;{escape(spoken(part.word))}", width=120, margin=(16, 6, 4, 10)
        )
        tools = [
            self._tool("arrow_upward", "Earlier", number, -1, number == 0),
            self._tool("arrow_downward", "Later", number, 1, number == len(self._parts) - 1),
            self._tool("delete", "Remove", number, 0, False),
        ]
        return plain_row(title, part.fields.view, *tools, stylesheets=[ROW], margin=(3, 4))

    def _tool(self, icon: str, word: str, number: int, step: int, disabled: bool) -> pn.viewable.Viewable:
        what = f"{word}: {number + 1} {spoken(self._parts[number].word)}"
        button = pmui.IconButton(
            icon=icon,
            description=what,
            size="1em",
            margin=(12, 0),
            disabled=disabled,
            color="default",
            stylesheets=[TOOLTIP],
        )
        button.on_click(lambda _event: self._move(number, step))
        return button

    def _move(self, number: int, step: int) -> None:
        part = self._parts.pop(number)
        if step:
            self._parts.insert(number + step, part)
        self._show()
        self._changed()


def spoken(word: str) -> str:
    """Return a word of a plan as displayed text."""
    return word.replace("_", " ").capitalize()
