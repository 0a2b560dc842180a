"""Sensor card: a card of a real sensor in Jupyter: each number with its unit and source."""

from __future__ import annotations

from html import escape

from lab.sensors.cards import Card
from lab.sensors.datum import Datum
from lab.views.result_cards import breakable

_LEFT = 'style="text-align:left"'
_QUIET = 'style="text-align:left;opacity:.75"'


def sensor_html(card: Card) -> str:
    """Return a card as HTML; assumed numbers are paler, and missing ones are listed."""
    rows = [
        _row(f"{group}.{name}", datum, assumed=terms is card.assumed)
        for terms in (card.terms, card.assumed)
        for group, data in terms.items()
        for name, datum in data.items()
    ]
    head = "".join(f"<th {_LEFT}>{title}</th>" for title in ("setting", "value", "source"))
    absent = [f"{group}: {', '.join(labels).lower()}" for group, labels in card.missing().items() if labels]
    rest = f"<p>Neither given nor assumed, and off: {escape('; '.join(absent))}.</p>" if absent else ""
    return (
        f"<h4>{escape(card.name)}, {escape(card.grade)} grade, {escape(card.maker)}</h4>"
        f"{f'<p>{escape(card.note)}</p>' if card.note else ''}"
        f"<table><tr>{head}</tr>{''.join(rows)}</table>{rest}"
    )


def _row(path: str, datum: Datum, *, assumed: bool) -> str:
    values = datum.value if isinstance(datum.value, tuple) else (datum.value,)
    number = f"{', '.join(f'{value:g}' for value in values)} {datum.unit}"
    convention = f" ({datum.convention})" if datum.convention else ""
    source = f"{'assumed: ' if assumed else ''}{datum.source}"
    style = _QUIET if assumed else _LEFT
    cells = (breakable(path), escape(number + convention), escape(source))
    return f"<tr>{''.join(f'<td {style}>{cell}</td>' for cell in cells)}</tr>"
