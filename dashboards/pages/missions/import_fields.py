"""Import fields: fields for the settings of an import, and for the units of the columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.style import whole_column
from dashboards.titled import Card
from dashboards.widgets import Field, field
from lab.data.files.unit_names import UNITS
from lab.data.rebuild.import_settings import ImportSettings
from lab.data.rebuild.raw_flight import ColumnUnit

_COLUMNS = "Columns of a csv"


class SettingFields:
    """The settings of an import.

    Parameters
    ----------
    settings
        Settings to show and change.
    changed
        Called when one was changed.
    """

    def __init__(self, settings: ImportSettings, changed: Callable[[], None]) -> None:
        self._settings = settings
        self._changed = changed
        fields = [self._make(path, name) for path, _, name in settings.leaves()]
        self.view = _card("Reconstruction", *(made.view for made in fields))

    def located(self, message: str) -> str:
        """Return a message with the names of these fields in place of the options of ``ins-lab import``."""
        for _path, _owner, name in self._settings.leaves():
            message = message.replace(f"--set {name}=", f"“{self._settings.param[name].label}” = ")
        return message

    def _make(self, path: str, name: str) -> Field:
        def change(value: Any) -> None:
            self._settings.set(path, value)
            self._changed()

        made = field(self._settings.param[name], change)
        made.show(getattr(self._settings, name))
        return made


class UnitFields:
    """The units of the used columns; a selected unit overrides the detected one.

    Parameters
    ----------
    changed
        Called when one was changed.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._chosen: dict[str, str] = {}
        self._columns: tuple[str, ...] = ()
        self._list = whole_column()
        self.view = _card("Units", self._list)

    def chosen(self) -> Mapping[str, str]:
        """Return the selected units by column."""
        return dict(self._chosen)

    def clear(self) -> None:
        """Reset the selection for another file."""
        self._chosen, self._columns, self._list[:] = {}, (), []
        self.view.visible = False

    def show(self, units: Sequence[ColumnUnit]) -> None:
        """Show the units of a file."""
        columns = tuple(one.column for one in units)
        if columns == self._columns:
            return
        self._columns = columns
        fields = [self._make(one) for one in units if _alike(one.unit)]
        self._list[:] = fields
        self.view.visible = bool(fields)

    def _make(self, one: ColumnUnit) -> pn.viewable.Viewable:
        made = pmui.Select(
            label=f"{one.column} ({one.source})",
            options=_alike(one.unit),
            value=one.unit,
            size="small",
            variant="outlined",
            margin=(8, 0),
            sizing_mode="stretch_width",
        )
        made.param.watch(lambda event: self._choose(one.column, event.new), "value")
        return made

    def _choose(self, column: str, unit: str) -> None:
        self._chosen[column] = unit
        self._changed()


class ColumnField:
    """What a person says of the columns of a csv, one in a line, and of the axes of its IMU.

    Parameters
    ----------
    changed
        Called when the text was changed.
    refused
        Called with the reason when a line is not accepted.
    """

    _AXES = "axes"
    _OPTIONS = ("--column", "--unit", "--axes")
    """The options of ``ins-lab import`` whose text this field takes."""

    def __init__(self, changed: Callable[[], None], refused: Callable[[str], None]) -> None:
        self._changed = changed
        self._refused = refused
        self._clearing = False
        self._before: list[str] = []
        self._text = pmui.TextAreaInput(
            label=_COLUMNS,
            placeholder="A1 = force_x[g]\nA2 = -force_y[g]\nspeed = km/h\naxes = y,x,-z",
            description="One line for each column whose heading does not say enough: what it is, with its "
            "unit, or its unit alone; - for a column that is not read. axes names the axes of the IMU that "
            "point forward, right and down.",
            size="small",
            variant="outlined",
            margin=(8, 0),
            sizing_mode="stretch_width",
        )
        self._text.param.watch(self._accept, "value")
        self.view = _card("Columns", self._text)
        self.view.visible = False

    def offer(self, names: Sequence[str]) -> None:
        """Show the field for files that may be tables, without a text."""
        self._before = []
        self._write("")
        self.view.visible = any(name.lower().endswith((".csv", ".txt", ".tsv", ".zip")) for name in names)

    def add(self, answers: Mapping[str, str], *, read: bool = True) -> None:
        """Add lines about columns, in place of those about the same, and read the file again if wanted."""
        self._before.append(str(self._text.value or ""))
        lines = {**dict(self._lines()), **answers}
        text = "\n".join(f"{name} = {said}" for name, said in lines.items())
        if read:
            self._text.value = text
        else:
            self._write(text)

    @property
    def undoable(self) -> bool:
        """Whether lines were added that `undo` takes back."""
        return bool(self._before)

    def undo(self) -> None:
        """Take back the lines that were added last, and read the file again."""
        if self._before:
            self._text.value = self._before.pop()

    def _write(self, text: str) -> None:
        self._clearing = True
        self._text.value = text
        self._clearing = False

    def located(self, message: str) -> str:
        """Return a message with the place of this field, if it names an option whose text the field takes."""
        if not self.view.visible or not any(option in message for option in self._OPTIONS):
            return message
        return (
            f"{message.removesuffix('.')}. Here, the field {_COLUMNS!r} takes it: HEADING = QUANTITY[UNIT], "
            "HEADING = UNIT or axes = X,Y,Z, one in a line."
        )

    @property
    def columns(self) -> dict[str, str]:
        """Quantities and units by heading."""
        return {name: text for name, text in self._lines() if name != self._AXES}

    @property
    def axes(self) -> tuple[str, ...]:
        """The axes that point forward, right and down; empty if none are given."""
        given = dict(self._lines()).get(self._AXES, "")
        return tuple(part.strip() for part in given.split(",")) if given else ()

    def _lines(self) -> list[tuple[str, str]]:
        parts = [line.rpartition("=") for line in str(self._text.value or "").splitlines() if line.strip()]
        return [(name.strip(), text.strip()) for name, _, text in parts]

    def _accept(self, _event: object) -> None:
        if self._clearing:
            return
        wrong = next((text for name, text in self._lines() if not name or not text), None)
        if wrong is not None:
            line = wrong or "a line"
            self._refused(f"{line}: accepted is HEADING = QUANTITY[UNIT], such as A1 = force_x[g]")
            return
        self._changed()


def _alike(unit: str) -> list[str]:
    """Return the units of the same quantity."""
    return next((list(units) for units in UNITS.values() if unit in units), [])


def _card(title: str, *content: pn.viewable.Viewable) -> pn.viewable.Viewable:
    return Card(
        whole_column(*content, margin=(0, 8, 8, 8)),
        title=title,
        title_variant="subtitle2",
        variant="outlined",
        margin=(4, 0),
        sizing_mode="stretch_width",
    )
