"""``ins-lab cards``: the sensors there are, with the sources of their numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lab.cli.app import print_json
from lab.cli.options import AsJson
from lab.cli.terminal import table

if TYPE_CHECKING:
    from lab.sensors.cards import Card

EXAMPLES = """\b
Examples:
  ins-lab cards
  ins-lab cards ADIS16470
  ins-lab run montreal --card ADIS16470"""

NOTHING = "–"
"""Stands where a card has no number."""

_COLUMNS = (
    ("gyro", "noise_density", "gyro noise"),
    ("gyro", "flicker", "gyro bias"),
    ("accelerometer", "noise_density", "accel. noise"),
    ("accelerometer", "flicker", "accel. bias"),
)


def list_cards(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]", help="A card, by name or .toml file: all of it.", show_default=False
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the cards of real sensors there are, or show one with its sources and what is missing."""
    from lab.sensors.cards import card, cards  # noqa: PLC0415 - takes half a second

    if name is None:
        found = cards()
        if as_json:
            print_json([_facts(entry) for entry in found.values()])
        else:
            print(_cards(found))
    elif as_json:
        print_json(_facts(card(name)))
    else:
        print(_card(card(name)))


def _cards(cards: Mapping[str, Card]) -> str:
    """Return the cards as a table: white noise and bias instability, in the units of the settings."""
    from lab.sensors.suite import SensorSuite  # noqa: PLC0415 - takes half a second

    suite = SensorSuite().groups()
    units = [suite[group].param[term].unit for group, term, _ in _COLUMNS]
    titles = [f"{title} [{unit}]" for (_, _, title), unit in zip(_COLUMNS, units, strict=True)]
    rows = [
        (card.name, card.grade, *(number(card.value(group, term)) for group, term, _ in _COLUMNS))
        for card in cards.values()
    ]
    return table(("name", "grade", *titles), rows, right={2, 3, 4, 5})


def _card(card: Card) -> str:
    """Return a whole card: every number with its source, and what is missing."""
    from lab.sensors.suite import SensorSuite  # noqa: PLC0415 - takes half a second

    suite = SensorSuite().groups()
    rows = [
        (group, suite[group].param[name].label, number(datum.value), datum.unit, datum.source)
        for group, terms in card.terms.items()
        for name, datum in terms.items()
    ]
    missing = [
        f"No source, off when loaded: {triad}: {'; '.join(labels)}"
        for triad, labels in card.missing().items()
        if labels
    ]
    head = [f"{card.name}: {', '.join(text for text in (card.maker, f'{card.grade} grade') if text)}"]
    head += [card.note] if card.note else []
    return "\n".join([*head, table(("group", "term", "value", "unit", "source"), rows, right={2}), *missing])


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
