"""Column table: what each column of an uploaded csv is taken for, to be corrected, undone and kept."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import panel_material_ui as pmui
import param
from panel.custom import JSComponent

from dashboards.pages.missions.entry_fields import fields_row, layout_width
from dashboards.style import whole_column, wide_html
from dashboards.titled import Card
from lab.data.files.unit_names import UNITS
from lab.data.sheets.column_names import IGNORED, SCALARS, VECTORS, kind_of
from lab.data.sheets.column_proposals import ANSWERED, Proposal
from lab.data.sheets.profile_check import profile_toml

_HERE = Path(__file__).parent
_SIGNED = ("angle", "speed", "length")
"""Kinds of units of quantities that some files write with the other sign."""
_LABELS = {
    IGNORED: "not read", "rate": "angular rate", "force": "specific force", "field": "magnetic field",
    "seconds": "whole seconds", "fraction": "fraction of seconds", "north": "velocity north",
    "east": "velocity east", "down": "velocity down", "up": "velocity up", "place": "latitude and longitude",
    "side": "hemisphere", "instance": "number of the sensor", "q0": "quaternion, scalar",
    "q1": "quaternion, x", "q2": "quaternion, y", "q3": "quaternion, z",
}  # fmt: skip
_MAX_KEPT = 20
"""Most profiles that a page keeps."""
_MAX_NAME = 60
"""Longest name of a profile [characters]."""
_NOTE = (
    "Columns that are guessed, or that the data do not decide, are marked. A change counts once it is "
    "applied, and Undo takes it back. A profile keeps what the columns are: this page then reads files with "
    "the same headings with it, and the downloaded TOML file does so in any other laboratory."
)


def _quantities() -> dict[str, dict[str, Any]]:
    """Return what a column may be: its label, its axes or signs, and its units."""
    found: dict[str, dict[str, Any]] = {}
    for name in (IGNORED, *VECTORS, *SCALARS):
        kind = kind_of(name)
        signs = ["+", "-"] if kind in _SIGNED else []
        found[name] = {
            "label": _LABELS.get(name, name.replace("_", " ")),
            "axes": [f"{sign}{axis}" for sign in ("", "-") for axis in "xyz"] if name in VECTORS else signs,
            "units": list(UNITS.get(kind, ())),
        }
    return found


_QUANTITIES = _quantities()


class ColumnRows(JSComponent):
    """The rows of the table; what a person chooses arrives in `edits`, by the place of the row."""

    columns: list[dict[str, Any]] = param.List(doc="The rows.")
    quantities: dict[str, dict[str, Any]] = param.Dict(_QUANTITIES, doc="What a column may be.")
    edits: dict[str, Any] = param.Dict({}, doc="What a person chose since the rows were shown.")

    _esm = _HERE / "column_table.js"
    _stylesheets = [(_HERE / "column_table.css").read_text(encoding="utf-8")]  # noqa: RUF012 - Panel's own


class ColumnTable:
    """The columns of a csv with a proposal for each.

    Parameters
    ----------
    apply
        Called with what a person says of columns, by heading, as ``--column`` takes it.
    undo
        Called to take back what was applied last.
    """

    def __init__(self, apply: Callable[[Mapping[str, str]], None], undo: Callable[[], None]) -> None:
        self._apply = apply
        self._proposals: list[Proposal] = []
        self._kept: dict[frozenset[str], dict[str, str]] = {}
        self._table = ColumnRows(sizing_mode="stretch_width", margin=(4, 0))  # type: ignore[no-untyped-call]
        self._back = self._button("Undo", undo)
        self._back.disabled = True
        self._name = pmui.TextInput(
            label="Profile called", value="My logger", size="small", variant="outlined", margin=(6, 4),
            max_length=_MAX_NAME, **layout_width(190),
        )  # fmt: skip
        self._said = wide_html(margin=(0, 4))
        download = pmui.FileDownload(
            callback=self._toml, filename="profile.toml", label="Download", variant="outlined", size="small",
            margin=(8, 4),
        )  # fmt: skip
        note = wide_html(f"<p style='margin:0'>{_NOTE}</p>", styles={"font-size": "13px"})
        buttons = fields_row(
            self._button("Apply", self._applied, "contained"),
            self._back,
            self._name,
            self._button("Keep as a profile", self._keep),
            download,
        )
        self.view = Card(
            whole_column(note, self._table, buttons, self._said, margin=(0, 8, 8, 8)),
            title="What the columns are",
            title_variant="subtitle2",
            variant="outlined",
            margin=(4, 0),
            sizing_mode="stretch_width",
            visible=False,
        )  # fmt: skip

    @staticmethod
    def _button(label: str, press: Callable[[], None], variant: str = "outlined") -> pmui.Button:
        made = pmui.Button(label=label, variant=variant, size="small", margin=(8, 4))
        made.on_click(lambda _event: press())
        return made

    def show(self, proposals: Sequence[Proposal], undoable: bool) -> None:
        """Show the columns of a file; none hide the table."""
        self._proposals = list(proposals)
        several = len({one.file for one in proposals}) > 1
        self._table.edits = {}
        self._table.columns = [_row(one, several) for one in proposals]
        self._back.disabled = not undoable
        self._said.object = _describe_repeated(proposals)
        self.view.visible = bool(proposals)

    def kept_for(self, proposals: Sequence[Proposal]) -> dict[str, str]:
        """Return what the profiles of this page say of columns, where it is not what is proposed."""
        found: dict[str, str] = {}
        for file in dict.fromkeys(one.file for one in proposals):
            mine = {one.heading: one.said for one in proposals if one.file == file}
            kept = self._kept.get(frozenset(mine), {})
            found |= {heading: said for heading, said in kept.items() if said != mine[heading]}
        return found

    def answers(self) -> dict[str, str]:
        """Return what a person chose, by heading, as ``--column`` takes it."""
        found = {}
        for place, chosen in self._table.edits.items():
            if not str(place).isdigit() or int(place) >= len(self._proposals) or not isinstance(chosen, dict):
                continue
            said = _column_option(chosen)
            if said is not None and said != self._proposals[int(place)].said:
                found[self._proposals[int(place)].heading] = said
        return found

    def _applied(self) -> None:
        if answers := self.answers():
            self._apply(answers)
        else:
            self._said.object = "Nothing is changed."

    def _columns(self, file: str) -> dict[str, str]:
        """Return what the table says now of all columns of a file."""
        answers = self.answers()
        return {
            one.heading: answers.get(one.heading, one.said) for one in self._proposals if one.file == file
        }

    def _keep(self) -> None:
        for file in dict.fromkeys(one.file for one in self._proposals):
            columns = self._columns(file)
            if len(self._kept) >= _MAX_KEPT:
                self._kept.pop(next(iter(self._kept)))
            self._kept[frozenset(columns)] = columns
        self._said.object = "From now on, this page reads files with these headings with the profile."

    def _toml(self) -> io.BytesIO:
        """Return the profile of the file of which most columns are guessed or changed."""
        answers = self.answers()
        doubtful = Counter(one.file for one in self._proposals if one.unsure or one.heading in answers)
        file = next((name for name, _ in doubtful.most_common(1)), self._proposals[0].file)
        columns = self._columns(file)
        named = {heading: said for heading, said in columns.items() if said != IGNORED or heading in answers}
        return io.BytesIO(profile_toml(self._name_profile(), list(columns), named).encode())

    def _name_profile(self) -> str:
        return str(self._name.value or "").strip()[:_MAX_NAME] or "My logger"


def _describe_repeated(proposals: Sequence[Proposal]) -> str:
    """Return which columns of one file a person says are the same quantity, as HTML."""
    found: dict[tuple[str, str], list[str]] = {}
    for one in proposals:
        if one.said != IGNORED and one.evidence == ANSWERED:
            found.setdefault((one.file, one.said.lstrip("-").partition("[")[0]), []).append(one.heading)
    return " ".join(
        f"More than one column is said to be {escape(_LABELS.get(name, name.replace('_', ' ')))}: "
        f"{escape(', '.join(headings))}."
        for (_, name), headings in found.items()
        if len(headings) > 1
    )


def _row(one: Proposal, with_file: bool) -> dict[str, Any]:
    name, _, unit = one.said.removeprefix("-").rstrip("]").partition("[")
    sign = "-" if one.said.startswith("-") and name else ""
    quantity = name[:-2] if name[:-2] in VECTORS else name or IGNORED
    axis = f"{sign}{name[-1]}" if quantity in VECTORS else sign or "+"
    return {
        "file": one.file if with_file else "", "heading": one.heading, "quantity": quantity, "axis": axis,
        "unit": unit, "evidence": one.evidence, "unsure": one.unsure,
    }  # fmt: skip


def _column_option(chosen: Mapping[str, Any]) -> str | None:
    """Return a choice as ``--column`` takes it; None for what the table does not offer."""
    quantity, axis, unit = (str(chosen.get(name, "")) for name in ("quantity", "axis", "unit"))
    if quantity == IGNORED:
        return IGNORED
    offered = _QUANTITIES.get(quantity)
    if offered is None or (unit and unit not in offered["units"]):
        return None
    if offered["axes"] and axis not in offered["axes"]:
        return None
    name = f"{quantity}_{axis[-1]}" if quantity in VECTORS else quantity
    sign = "-" if offered["axes"] and axis.startswith("-") else ""
    return f"{sign}{name}{f'[{unit}]' if unit else ''}"
