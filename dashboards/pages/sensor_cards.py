"""Sensor cards: all cards of sensors in one table, and the terms of the one in use."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import panel as pn
import param
from panel.custom import JSComponent

from dashboards.card_chooser import load_card
from dashboards.field_text import shown
from dashboards.pages.base import Page
from dashboards.pages.sheet_form import SheetForm
from dashboards.pages.summary import TABLE_STYLE
from dashboards.session import Session
from dashboards.style import whole_column, wide_html
from lab.experiment.experiment import Experiment
from lab.experiment.result import Result
from lab.sensors.cards import GRADES, KEY_TERMS, Card, card, card_in_force, cards
from lab.sensors.suite import TRIADS, SensorSuite
from lab.views.ensemble_cards import scroll_box
from lab.views.figures import TimeAxis

_STYLE = """
div { overflow-x: auto; } table { border-collapse: collapse; font: 14px/1.4 Roboto, sans-serif; }
th, td { padding: 4px 12px; text-align: right; white-space: nowrap;
         border-bottom: 1px solid rgba(128,128,128,.18); }
th:nth-child(-n+2), td:nth-child(-n+2) { text-align: left; } td { font-variant-numeric: tabular-nums; }
button { border: 0; background: none; font: inherit; color: inherit; cursor: pointer; padding: 2px 0; }
.sort { font-weight: 500; opacity: .75; } .load { color: var(--mui-palette-primary-main, #1b62b9); }
th[aria-sort=ascending] .sort::after { content: " ↑"; }
th[aria-sort=descending] .sort::after { content: " ↓"; }
.chosen td { background: rgba(90, 162, 242, .16); } .assumed { opacity: .62; font-style: italic; }
"""
_TRIADS = {"gyro": "Gyros", "accelerometer": "Accelerometers"}
_WORDS = (
    "<h3>Cards</h3><p>Press a name to load the sensor with the filter that suits it. Numbers in italics are "
    "typical of the grade, because the datasheet lacks them. The last column is the number of states of that "
    "filter.</p>"
)


class CardTable(JSComponent):
    """The table of all cards.

    Parameters
    ----------
    load
        Called with the name of a card that a person asks for.
    """

    cards: dict[str, Any] = param.Dict({"heads": [], "rows": []}, doc="Headings and rows.")
    chosen: str = param.String("", doc="Name of the card in use; empty without one.")
    asked: dict[str, Any] = param.Dict({}, doc="The last wish: the name of a card, and a count.")

    _esm = Path(__file__).with_name("sensor_cards.js")
    _stylesheets = [_STYLE]  # noqa: RUF012 - Panel's own

    def __init__(self, load: Callable[[str], None], **params: Any) -> None:
        super().__init__(**params)  # type: ignore[no-untyped-call]
        self.param.watch(lambda event: load(str(event.new.get("name"))), "asked")


class SensorCards(Page):
    """All cards, and what each term of the sensors is, by the settings and by the card in use."""

    title = "Cards"
    contents = "the sensor cards and the terms of the one in use"
    depends_on_window = False
    over_time = False

    def __init__(self, axis: TimeAxis, session: Session) -> None:
        self._session = session
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the two tables."""
        self._table = CardTable(self._load, cards=card_table(), sizing_mode="stretch_width", margin=(0, 16))
        self._terms = wide_html(margin=(8, 16), stylesheets=[TABLE_STYLE, _TERMS])
        words = wide_html(_WORDS, margin=(8, 16, 0, 16), stylesheets=[_TERMS])
        self._form = SheetForm(self._session)
        return whole_column(words, self._table, self._terms, self._form.view)

    def draw(self, result: Result) -> None:
        """Show the terms of the sensors, and mark the card in use."""
        sensors = self._session.experiment.sensors
        name = card_in_force(sensors) or ""
        self._table.chosen = name
        self._terms.object = terms_html(sensors, card(name) if name else None)

    @property
    def is_complete(self) -> bool:
        """Whether the page shows all it can show without a result: it needs none."""
        return True

    def _load(self, name: str) -> None:
        """Load a card; a hand-made message may name none that there is."""
        if name in cards():
            load_card(self._session, name)


def card_table() -> dict[str, Any]:
    """Return headings and rows of all cards: texts, what they are sorted by, and which are assumed."""
    suite = SensorSuite().groups()
    heads = ["Sensor", "Grade"]
    heads += [f"{title} [{suite[group].param[term].unit}]" for group, term, title in KEY_TERMS]
    known = cards()
    priced = any(one.price for one in known.values())
    heads += ["Price"] if priced else []
    return {"heads": [*heads, "States"], "rows": [_row(name, one, priced) for name, one in known.items()]}


def _row(name: str, one: Card, priced: bool) -> dict[str, Any]:
    trial = Experiment()
    one.load(trial)
    values = [one.value(group, term) for group, term, _ in KEY_TERMS]
    states = int(trial.navigator.states)
    texts = [shown(_short(value)) or "–" for value in values]
    keys = [None if value is None else float(np.max(value)) for value in values]
    if priced:  # as one more figure, which is never assumed
        texts.append(f"{one.price.value:g} {one.price.unit}" if one.price else "–")
        keys.append(float(np.max(one.price.value)) if one.price else None)
    return {
        "name": name,
        "texts": [name, one.grade, *texts, str(states)],
        "keys": [
            name.casefold(),
            GRADES.index(one.grade),
            *keys,
            states,
        ],
        "assumed": [
            *(False, False),
            *(one.is_assumed(group, term) for group, term, _ in KEY_TERMS),
            *[False] * (1 + priced),
        ],
    }


def terms_html(sensors: SensorSuite, one: Card | None) -> str:
    """Return each term of the triads: as set, by the card, and where the card has it from."""
    name = one.name if one is not None else "no card as loaded"
    rows = []
    for triad in TRIADS:
        group = sensors.groups()[triad]
        rows.append(f'<tr class="group"><td colspan="5"><b>{_TRIADS[triad]}</b></td></tr>')
        for _path, _owner, term in group.leaves():
            declaration = group.param[term]
            datum = one.datum(triad, term) if one is not None else None
            value = shown(_short(getattr(group, term)))
            if datum is None and value in ("", "0"):
                continue
            assumed = one is not None and one.is_assumed(triad, term)
            by_card = "–" if one is None or datum is None else shown(_short(one.value(triad, term)))
            source = "" if datum is None else f"{'assumed: ' if assumed else ''}{datum.source}"
            unit = getattr(declaration, "unit", "")
            rows.append(
                f'<tr class="{"quiet" if assumed else ""}"><td>{escape(str(declaration.label))}</td>'
                f'<td>{escape(value)}</td><td>{escape(by_card)}</td><td class="unit">{escape(unit)}</td>'
                f'<td class="words">{escape(source)}</td></tr>'
            )
    table = (
        '<table><tr><th></th><th>set</th><th>card</th><th class="unit">unit</th><th class="words">source</th>'
        f"</tr>{''.join(rows)}</table>"
    )
    return f"<h3>Sensors in use: {escape(name)}</h3>{scroll_box(table, 'Sensors in use')}"


def _short(value: Any) -> Any:
    """Round the numbers of a value to four digits, for a table."""
    if isinstance(value, tuple | list):
        return tuple(_short(one) for one in value)
    return float(f"{value:.4g}") if isinstance(value, float) else value


_TERMS = """
p { margin: 4px 0; font: 14px/1.45 Roboto, sans-serif; }
h3 { font: 500 17px/1.3 Roboto, sans-serif; margin: 6px 0 8px; } .quiet { opacity: .68; font-style: italic; }
td.words { white-space: normal; font-size: 12.5px; }
"""
