"""Naming: name and title of a new mission."""

from __future__ import annotations

from typing import Any

import panel_material_ui as pmui

from dashboards.pages.missions.dialog import fill
from dashboards.pages.missions.entry_fields import WRAP
from dashboards.style import plain_row
from lab.missions import MissionError
from lab.missions.library import free_name
from lab.missions.mission_name import accepted_name, without_archive

_FIELD: dict[str, Any] = {
    "size": "small",
    "variant": "outlined",
    "sizing_mode": "stretch_width",
    "margin": (8, 4),
}
_ROOM = ":host {{ flex: {} 1 {}px !important; width: auto !important; }}"


class Naming:
    """Name and title of a new mission.

    Parameters
    ----------
    name, title
        Initial values; a name that is in use gets a number.
    """

    def __init__(self, name: str, title: str) -> None:
        self._name = pmui.TextInput(label="Name", stylesheets=[_ROOM.format(1, 130)], **_FIELD)
        self._title = pmui.TextInput(label="Title", stylesheets=[_ROOM.format(3, 170)], **_FIELD)
        self.view = plain_row(self._name, self._title, stylesheets=[WRAP, _ROOM.format(1, 310)])
        self.suggest(name, title)

    def suggest(self, name: str, title: str) -> None:
        """Suggest another name and title."""
        fill(self._name, free_name(without_archive(name)))
        self.retitle(title)

    def retitle(self, title: str) -> None:
        """Suggest another title."""
        fill(self._title, title)

    def checked_name(self) -> str:
        """Return the current name.

        Raises
        ------
        MissionError
            If the name is not accepted or in use.
        """
        name = accepted_name(str(self._name.value_input).strip())
        if free_name(name) != name:
            raise MissionError(f"name {name!r}: a mission already has this name; choose another one")
        return name

    @property
    def title(self) -> str:
        """The current title; the name if the title is empty."""
        return str(self._title.value_input).strip() or str(self._name.value_input).strip()
