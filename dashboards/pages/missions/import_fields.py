"""Import fields: fields for the settings of an import, and for the units of the columns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.style import WHOLE
from dashboards.titled import Card
from dashboards.widgets import Field, field
from lab.importing.import_settings import ImportSettings
from lab.readers.unit_names import UNITS
from lab.repair.raw_flight import ColumnUnit
from lab.settings import SettingError


class SettingFields:
    """The settings of an import.

    Parameters
    ----------
    settings
        Settings to show and change.
    changed
        Called when one was changed.
    refused
        Called with the reason when a value is not accepted.
    """

    def __init__(
        self, settings: ImportSettings, changed: Callable[[], None], refused: Callable[[str], None]
    ) -> None:
        self._settings = settings
        self._changed = changed
        self._refused = refused
        fields = [self._make(path, name) for path, _, name in settings.leaves()]
        self.view = _card("Reconstruction", *(made.view for made in fields))

    def _make(self, path: str, name: str) -> Field:
        def change(value: Any) -> bool:
            try:
                self._settings.set(path, value)
            except SettingError as error:
                self._refused(str(error))
                return False
            self._changed()
            return True

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
        self._list = pn.Column(margin=0, sizing_mode="stretch_width", stylesheets=[WHOLE])
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


def _alike(unit: str) -> list[str]:
    """Return the units of the same quantity."""
    return next((list(units) for units in UNITS.values() if unit in units), [])


def _card(title: str, *content: pn.viewable.Viewable) -> pn.viewable.Viewable:
    return Card(
        pn.Column(*content, margin=(0, 8, 8, 8), sizing_mode="stretch_width", stylesheets=[WHOLE]),
        title=title,
        title_variant="subtitle2",
        variant="outlined",
        margin=(4, 0),
        sizing_mode="stretch_width",
    )
