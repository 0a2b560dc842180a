"""Card chooser: which sensor's card is in force, whether it was changed since, and all others by grade."""

from __future__ import annotations

from html import escape

import panel as pn
import panel_material_ui as pmui
import param

from dashboards.session import Session
from lab.sensors.cards import card, card_in_force, cards

OWN = "Own settings"
"""Shown where the settings came from elsewhere and are those of no card."""
IN_FORCE = "current"
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
            description="Loads the datasheet of a real sensor, and the number of filter states it needs.",
        )
        self._switch = pmui.Switch(
            label="Assume what the datasheet lacks",
            value=True,
            description="On: terms without a number in the datasheet get values typical of the sensor's "
            "grade. Off: they are zero.",
            size="small",
            margin=(0, 0),
            sizing_mode="stretch_width",
        )
        self._note = pn.pane.HTML("", margin=(0, 0, 4, 0), sizing_mode="stretch_width", visible=False)
        self._widget.param.watch(self._chosen, "value")
        self._switch.param.watch(lambda _event: self._reload(), "value")
        session.on_settings(self._arrived)
        self._arrived()

    @property
    def view(self) -> pn.viewable.Viewable:
        """What is laid out in the page."""
        return pn.Column(self._widget, self._switch, self._note, margin=0, sizing_mode="stretch_width")

    def refresh(self) -> None:
        """Show whether the sensors are still those of the card, and which of their terms are assumed."""
        note = self._session.experiment.sensors.assumed_remark()
        self._note.param.update(object=f"<small>{escape(note)}</small>", visible=bool(note))
        found = card_in_force(self._session.experiment.sensors)
        self._name = found or self._name
        if found and card(found).assumed:
            self._turn(bool(note))
        self._show(found or (f"{self._name}, changed" if self._name else OWN))

    def _arrived(self) -> None:
        """Show settings that came as a whole: of these nobody knows what they were changed from."""
        self._name = None
        self.refresh()

    def _turn(self, assumed: bool) -> None:
        """Show whether the sensors are those of the card with what is assumed."""
        self._showing = True
        try:
            self._switch.value = assumed
        finally:
            self._showing = False

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
        self._load(event.new)

    def _reload(self) -> None:
        """Load the card in force anew where it has something to assume; one that was changed stays."""
        found = card_in_force(self._session.experiment.sensors)
        if not self._showing and found and card(found).assumed:
            self._load(found)

    def _load(self, name: str) -> None:
        trial = self._session.experiment.copy()
        card(name, assumed=bool(self._switch.value)).load(trial)
        self._session.take(trial)


def _by_grade() -> dict[str, list[str]]:
    groups: dict[str, list[str]] = {}
    for name, entry in cards().items():
        groups.setdefault(f"{entry.grade} grade", []).append(name)
    return groups
