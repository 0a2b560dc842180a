"""``ins-lab cards``: the cards of sensors, with the sources of their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli.app import print_json
from lab.cli.options import AsJson, Assumed
from lab.cli.terminal import table

if TYPE_CHECKING:
    from lab.sensors.cards import Card, Terms

EXAMPLES = """\b
Examples:
  ins-lab cards
  ins-lab cards ADIS16470
  ins-lab run montreal --card ADIS16470
  ins-lab run montreal --card ADIS16470 --no-assumed
Numbers without a source are assumed, typical of the grade, and marked; --no-assumed omits them.
White noise is the two-sided N of IEEE 952, which is 1/√2 of a one-sided noise density."""

NOTHING = "–"
"""Placeholder for a missing number."""
ASSUMED = "*"
"""Mark after an assumed number."""
FOOT = f"{ASSUMED} assumed: a value typical of the grade, since the card has no source"
"""Legend of the mark, below a table."""


def list_cards(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]", help="Card to show in full, by name or .toml file.", show_default=False
        ),
    ] = None,
    assumed: Assumed = True,
    as_json: AsJson = False,
) -> None:
    """List the cards of real sensors, or show one with its sources, assumed and missing terms."""
    from lab.sensors.cards import card, cards  # noqa: PLC0415 - takes half a second

    if name is None:
        found = [entry if assumed else entry.without_assumed() for entry in cards().values()]
        if as_json:
            print_json([_facts(entry) for entry in found])
        else:
            print(_cards(found))
        return
    one = card(name, assumed=assumed)
    if as_json:
        print_json(_facts(one))
    else:
        print(_card(one))


def _cards(cards: Sequence[Card]) -> str:
    """Return the cards as a table: white noise and bias instability, in the units of the settings."""
    from lab.sensors.cards import KEY_TERMS  # noqa: PLC0415 - takes half a second
    from lab.sensors.suite import SensorSuite  # noqa: PLC0415 - takes half a second

    suite = SensorSuite().groups()
    titles = [f"{title} [{suite[group].param[term].unit}]" for group, term, title in KEY_TERMS]
    rows = [
        (card.name, card.grade, *(_marked(card, group, term) for group, term, _ in KEY_TERMS))
        for card in cards
    ]
    text = table(("name", "grade", *titles), rows, right={2, 3, 4, 5})
    if any(card.assumed for card in cards):
        text += f"\n\n{FOOT}"
    return text


def _marked(card: Card, group: str, term: str) -> str:
    """Return a number of a card in the unit of its setting, marked if assumed."""
    return number(card.value(group, term)) + (ASSUMED if card.is_assumed(group, term) else "")


def _card(card: Card) -> str:
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


def _facts(card: Card) -> dict[str, Any]:
    (facts,) = card.to_dict().values()
    return {"name": card.name, **facts, "settings": card.settings(), "missing": card.missing()}


def number(value: Any) -> str:
    """Return a number of a card, one for each axis, or none, as text."""
    if value is None:
        return NOTHING
    if isinstance(value, list | tuple):
        return ", ".join(number(component) for component in value)
    return f"{value:.4g}"
