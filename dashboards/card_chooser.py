"""Card chooser: the current sensor card, whether it was changed since, and all other cards by grade."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from html import escape

import numpy as np
import panel as pn
import panel_material_ui as pmui
import param

from dashboards.session import Session
from dashboards.style import plain_column, whole_column, wide_html
from dashboards.widgets import SETTING
from lab.experiment.experiment import Experiment
from lab.sensors.cards import card, card_in_force, cards
from lab.sensors.suite import SensorSuite

_DENSE = {
    "& .MuiFormControlLabel-root": {"height": "24px"},
    "& .MuiFormControlLabel-label": {"fontSize": "0.8125rem", "whiteSpace": "nowrap"},
}
_SHORT = "@media (max-width: 600px) { :host { max-height: 40vh; overflow-y: auto; } }"
"""On a phone, the list scrolls, so that the table below it can be seen."""
OWN = "Own settings"
"""Shown if the settings come from elsewhere and match no card."""
IN_FORCE = "current"
"""Heading of the current settings if they match no card."""
MOST_CARDS = 6
"""Most cards that are compared at a time."""
ABOUT = (
    f"Up to {MOST_CARDS} cards, each loaded with the filter that suits it. The numbers are the white noise "
    "and the bias instability of the gyros. A star marks values typical of the grade, which the datasheet "
    "lacks."
)


class CardChooser:
    """The cards of real sensors, by grade, with the current one selected.

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
            tags=[SETTING],
        )
        self._switch = pmui.Switch(
            label="Fill gaps in the datasheet with typical values",
            value=True,
            description="On: terms without a number in the datasheet get values typical of the sensor's "
            "grade. Off: they are zero.",
            size="small",
            margin=(0, 0),
            sizing_mode="stretch_width",
            tags=[SETTING],
        )
        self._note = wide_html(margin=(0, 0, 4, 0), visible=False)
        self._widget.param.watch(self._chosen, "value")
        self._switch.param.watch(lambda _event: self._fill_assumed_terms(), "value")
        session.on_settings(self._arrived)
        self._arrived()

    @property
    def view(self) -> pn.viewable.Viewable:
        """The widgets to place on the page."""
        return plain_column(self._widget, self._switch, self._note)

    @property
    def base(self) -> Experiment:
        """The settings before changes: those of the card in use as loaded, or else the first ones."""
        return _load_card(self._name, bool(self._switch.value))

    def refresh(self) -> None:
        """Show whether the sensors still match the card, and which of their terms are assumed or lacking."""
        sensors = self._session.experiment.sensors
        note = sensors.card_remark()
        self._note.param.update(object=f"<small>{escape(note)}</small>", visible=bool(note))
        found = card_in_force(sensors)
        self._name = found or self._name
        if found and card(found).assumed:
            self._turn(bool(sensors.assumed_terms()))
        self._show_text(found or (f"{self._name}, changed" if self._name else OWN))

    def _arrived(self) -> None:
        """Show a complete new set of settings, whose original card is unknown."""
        self._name = None
        self.refresh()

    def _turn(self, assumed: bool) -> None:
        """Show whether the sensors match the card with its assumed terms."""
        self._showing = True
        try:
            self._switch.value = assumed
        finally:
            self._showing = False

    def _show_text(self, text: str) -> None:
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

    def _fill_assumed_terms(self) -> None:
        self._session.fills_gaps = bool(self._switch.value)
        self._reload()

    def _reload(self) -> None:
        """Reload the current card if it has assumed terms; a changed card stays as it is."""
        found = card_in_force(self._session.experiment.sensors)
        if not self._showing and found and card(found).assumed:
            self._load(found)

    def _load(self, name: str) -> None:
        load_card(self._session, name)


def load_card(session: Session, name: str) -> None:
    """Load a card, with what its datasheet lacks if the session fills such gaps."""
    trial = session.experiment.copy()
    card(name, assumed=session.fills_gaps).load(trial)
    session.accept(trial, called=f"Sensors: {name}")


@cache
def _load_card(name: str | None, assumed: bool) -> Experiment:
    """Return the first settings with a card, which nobody changes; None is no card."""
    base = Experiment()
    if name:
        card(name, assumed=assumed).load(base)
    return base


def _by_grade() -> dict[str, list[str]]:
    groups: dict[str, list[str]] = {}
    for name, entry in cards().items():
        groups.setdefault(f"{entry.grade} grade", []).append(name)
    return groups


class CardChoice:
    """Sensor cards to compare: a box for each, by grade, with noise and bias instability of its gyros.

    Parameters
    ----------
    changed
        Called when another card is chosen, or one is left out.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._boxes = [
            pmui.CheckBoxGroup(
                label=grade.capitalize(),
                options={_line(name): name for name in names},
                value=[],
                size="small",
                margin=(4, 6),
                width=248,
                sx=_DENSE,
            )
            for grade, names in _by_grade().items()
        ]
        for box in self._boxes:
            box.param.watch(self._chosen, "value")
        self._note = pn.pane.HTML(f"<small>{escape(ABOUT)}</small>", margin=(0, 16))
        boxes = pn.FlexBox(*self._boxes, margin=(0, 8), stylesheets=[_SHORT])
        self.view = whole_column(self._note, boxes, visible=False)

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of the chosen cards, grade by grade; a browser may send others, even paths."""
        return tuple(name for box in self._boxes for name in box.options.values() if name in box.value)

    def choose(self, names: Iterable[str]) -> None:
        """Choose cards by their names, as many as may be compared; what is no card is left out."""
        known = [name for name in dict.fromkeys(names) if name in cards()][:MOST_CARDS]
        for box in self._boxes:
            box.value = [name for name in box.options.values() if name in known]

    def _chosen(self, event: param.parameterized.Event) -> None:
        if len(self.chosen) > MOST_CARDS:
            event.obj.value = list(event.old)
        elif event.new != event.old:
            self._changed()


def _line(name: str) -> str:
    """Return a card in one line.

    >>> _line("ADIS16470")
    'ADIS16470 · 0.0057 °/s/√Hz · 8 °/h'
    """
    entry, gyro = cards()[name], SensorSuite().gyro
    parts = [name]
    for term in ("noise_density", "flicker"):
        value = entry.value("gyro", term)
        if value is not None:
            mark = "*" if entry.is_assumed("gyro", term) else ""
            parts.append(f"{np.max(value):.2g}{mark} {gyro.param[term].unit}")
    return " · ".join(parts)
