"""Missions page: its parts, one of which is visible."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import panel as pn
import panel_material_ui as pmui

from dashboards.pages.base import Page
from dashboards.pages.missions.flying import Flying
from dashboards.pages.missions.importing import Importing
from dashboards.pages.missions.library import Library
from dashboards.pages.missions.recording import RecordingPart
from dashboards.session import Session
from dashboards.style import whole_column
from dashboards.visitors import may_edit
from lab.experiment.result import Result
from lab.views.figures import TimeAxis


class Part(Protocol):
    """A part of the page, made when first shown."""

    view: pn.viewable.Viewable

    def refresh(self) -> None:
        """Show the current state; called whenever the part is shown."""

    def close(self) -> None:
        """End the part with its session."""


PARTS: dict[str, Callable[[Session], Part]] = {
    "Library": Library,
    "Import": Importing,
    "Fly": Flying,
    "X-Plane": RecordingPart,
}
"""Factory of each part, by the label of its button."""

FOR_ALL = ("Library",)
"""Parts for visitors who may not change missions; the other parts are not made."""


class Missions(Page):
    """All missions, and the sources of new ones."""

    title = "Missions"
    depends_on_window = False

    def __init__(self, axis: TimeAxis, session: Session) -> None:
        self._session = session
        self._parts: dict[str, Part] = {}
        self._titles = list(PARTS) if may_edit() else list(FOR_ALL)
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the selection of parts above the selected part."""
        self._choice = pmui.RadioButtonGroup(
            sx={"& button": {"whiteSpace": "nowrap", "padding": "4px 14px"}},
            options=self._titles,
            value=self._titles[0],
            size="small",
            color="primary",
            margin=(10, 4, 4, 4),
            visible=len(self._titles) > 1,
        )
        self._choice.param.watch(lambda _event: self._turn(), "value")
        self._stage = whole_column()
        self._turn()
        return whole_column(self._choice, self._stage, margin=(0, 12, 16, 12))

    def draw(self, result: Result) -> None:
        """Show the current state."""
        self._part.refresh()

    @property
    def _part(self) -> Part:
        title = self._choice.value
        if title not in self._titles:  # a hand-made message may contain any value
            title = self._titles[0]
        if title not in self._parts:
            self._parts[title] = PARTS[title](self._session)
        return self._parts[title]

    def _turn(self) -> None:
        """Show the selected part."""
        self._part.refresh()
        self._stage[:] = [self._part.view]

    def close(self) -> None:
        """End all parts."""
        for part in self._parts.values():
            part.close()
