"""Card chooser: which sensor's card is in force, whether it was changed since, and all others by grade."""

from __future__ import annotations

import panel as pn
import panel_material_ui as pmui
import param

from dashboards.session import Session
from lab.sensors.cards import card, card_in_force, cards

OWN = "Own settings"
"""Shown where the settings came from elsewhere and are those of no card."""
IN_FORCE = "in force"
"""Title over what is in force without being a card."""


class CardChooser:
    """The cards of real sensors, by grade, with the one in force shown.

    Parameters
    ----------
    session
        Whose sensors are shown and changed.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._name: str | None = None
        self._showing = False
        self._widget = pmui.Select(
            label="Sensors",
            groups=_by_grade(),
            size="small",
            variant="outlined",
            margin=(8, 0),
            sizing_mode="stretch_width",
            description="Loads the datasheet of a real sensor; terms it has no number for are off.",
        )
        self._widget.param.watch(self._chosen, "value")
        session.on_settings(self._arrived)
        self._arrived()

    @property
    def view(self) -> pn.viewable.Viewable:
        """What is laid out in the page."""
        return self._widget

    def refresh(self) -> None:
        """Show whether the sensors are still those of the card."""
        found = card_in_force(self._session.experiment.sensors)
        self._name = found or self._name
        self._show(found or (f"{self._name}, changed" if self._name else OWN))

    def _arrived(self) -> None:
        """Show settings that came as a whole: of these nobody knows what they were changed from."""
        self._name = None
        self.refresh()

    def _show(self, text: str) -> None:
        groups = _by_grade() if text in cards() else {IN_FORCE: [text], **_by_grade()}
        if (text, groups) == (self._widget.value, self._widget.groups):
            return
        self._showing = True
        try:
            self._widget.param.update(groups=groups, value=text)
        finally:
            self._showing = False

    def _chosen(self, event: param.parameterized.Event) -> None:
        if self._showing or event.new not in cards():
            return
        trial = self._session.experiment.copy()
        self._session.take(trial.update({"sensors": card(event.new).settings()}))


def _by_grade() -> dict[str, list[str]]:
    groups: dict[str, list[str]] = {}
    for name, entry in cards().items():
        groups.setdefault(f"{entry.grade} grade", []).append(name)
    return groups
