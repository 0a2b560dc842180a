"""Card table: cards of sensors as text and as plain data, for the commands that print them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from lab.cli.terminal import table

if TYPE_CHECKING:
    from lab.sensors.cards import Card, Terms

NOTHING = "–"
"""Placeholder for a missing number."""
ASSUMED = "*"
"""Mark after an assumed number."""
FOOT = f"{ASSUMED} assumed: a value typical of the grade, since the card has no source"
"""Legend of the mark, below a table."""


def cards_text(cards: Sequence[Card]) -> str:
    """Return cards as a table: white noise and bias instability, in the units of the settings."""
    from lab.sensors.cards import KEY_TERMS  # noqa: PLC0415 - takes half a second
    from lab.sensors.suite import SensorSuite  # noqa: PLC0415 - takes half a second

    suite = SensorSuite().groups()
    titles = [f"{title} [{suite[group].param[term].unit}]" for group, term, title in KEY_TERMS]
    rows = [
        (card.name, card.grade, *(_format_marked(card, group, term) for group, term, _ in KEY_TERMS))
        for card in cards
    ]
    text = table(("name", "grade", *titles), rows, right={2, 3, 4, 5})
    if any(card.assumed for card in cards):
        text += f"\n\n{FOOT}"
    return text


def _format_marked(card: Card, group: str, term: str) -> str:
    """Return a number of a card in the unit of its setting, marked if assumed."""
    return number(card.value(group, term)) + (ASSUMED if card.is_assumed(group, term) else "")


def card_text(card: Card) -> str:
    """Return a whole card as text: every number with its source, the assumed and the missing terms."""
    head = [f"{card.name}: {', '.join(text for text in (card.maker, f'{card.grade} grade') if text)}"]
    head += [card.note] if card.note else []
    lines = [*head, _terms(card.terms)]
    if card.assumed:
        lines += ["", "Assumed, since the card has no source (--no-assumed omits these):"]
        lines.append(_terms(card.assumed))
    missing = [
        f"No source, off when loaded: {triad}: {'; '.join(labels)}"
        for triad, labels in card.missing().items()
        if labels
    ]
    return "\n".join([*lines, *([""] if missing else []), *missing])


def _terms(terms: Terms) -> str:
    """Return data as a table in the units of the source; a density with its convention."""
    from lab.sensors.suite import SensorSuite  # noqa: PLC0415 - takes half a second

    suite = SensorSuite().groups()
    rows = []
    for group, data in terms.items():
        for name, datum in data.items():
            unit = f"{datum.unit}, {datum.convention}" if datum.convention else datum.unit
            rows.append((group, suite[group].param[name].label, number(datum.value), unit, datum.source))
    return table(("group", "term", "value", "unit", "source"), rows, right={2})


def facts(card: Card) -> dict[str, Any]:
    """Return a card as plain data, with its settings and what is missing."""
    (entries,) = card.to_dict().values()
    return {"name": card.name, **entries, "settings": card.settings(), "missing": card.missing()}


def number(value: Any) -> str:
    """Return a number of a card, one for each axis, or none, as text."""
    if value is None:
        return NOTHING
    if isinstance(value, list | tuple):
        return ", ".join(number(component) for component in value)
    return f"{value:.4g}"
