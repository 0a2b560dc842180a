"""Sensor answers: what the command line says of cards and of records at rest, as tables and as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.sensors.cards import TRIADS, Card
from lab.sensors.suite import SensorSuite
from lab.terminal import table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lab.analysis.rest import Record

NOTHING = "–"
"""Stands where a card has no number."""

_COLUMNS = (
    ("gyro", "noise_density", "gyro noise"),
    ("gyro", "flicker", "gyro bias"),
    ("accelerometer", "noise_density", "accel. noise"),
    ("accelerometer", "flicker", "accel. bias"),
)


def cards_table(cards: Mapping[str, Card]) -> str:
    """Return the cards as a table: white noise and bias instability, in the units of the settings."""
    suite = SensorSuite().groups()
    units = [suite[group].param[term].unit for group, term, _ in _COLUMNS]
    titles = [f"{title} [{unit}]" for (_, _, title), unit in zip(_COLUMNS, units, strict=True)]
    rows = [
        (card.name, card.grade, *(_shown(card.value(group, term)) for group, term, _ in _COLUMNS))
        for card in cards.values()
    ]
    return table(("name", "grade", *titles), rows, right={2, 3, 4, 5})


def card_text(card: Card) -> str:
    """Return a whole card: every number with its source, and what is missing."""
    suite = SensorSuite().groups()
    rows = [
        (group, suite[group].param[name].label, _shown(datum.value), datum.unit, datum.source)
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


def card_json(card: Card) -> dict[str, Any]:
    """Return a card with its settings and what is missing, ready for JSON."""
    (facts,) = card.to_dict().values()
    return {"name": card.name, **facts, "settings": card.settings(), "missing": card.missing()}


def cards_json(cards: Mapping[str, Card]) -> str:
    """Return all cards as JSON."""
    return json.dumps([card_json(card) for card in cards.values()], indent=2)


def noise_table(records: Mapping[str, Record], card: Card | None) -> str:
    """Return the fitted noise terms of a record at rest as a table, beside those of the card simulated."""
    suite = SensorSuite().groups()
    rows = []
    for triad, fitted in _fitted(records).items():
        for name, term in fitted.items():
            declaration = suite[triad].param[name]
            for axis, value, sigma in zip(declaration.axes, term["value"], term["sigma"], strict=True):
                own = card.value(triad, name) if card else None
                own = own[declaration.axes.index(axis)] if isinstance(own, list) else own
                rows.append(
                    (
                        triad,
                        axis,
                        declaration.label,
                        f"{value:.4g}",
                        f"{sigma:.2g}",
                        term["unit"],
                        _shown(own),
                    )
                )
    header = ("group", "axis", "term", "fitted", "σ", "unit", "card")
    width = len(header) if card else len(header) - 1
    return table(header[:width], [row[:width] for row in rows], right={3, 4, 6})


def noise_json(name: str, records: Mapping[str, Record]) -> str:
    """Return the Allan deviation of a record at rest, its 95 % intervals and the fitted terms as JSON.

    Deviations are in SI units, the terms in the units of the settings.
    """
    from lab.analysis import allan  # noqa: PLC0415 - only this answer needs it

    answer: dict[str, Any] = {"record": name}
    fitted = _fitted(records)
    for triad in TRIADS:
        record = records[triad]
        found = allan.deviation(record.rates, record.dt)
        low, high = found.interval()
        answer[triad] = {
            "samples": len(record.rates),
            "dt_s": record.dt,
            "unit": "rad/s" if triad == "gyro" else "m/s²",
            "tau_s": found.tau.tolist(),
            "deviation": found.deviation.tolist(),
            "low": low.tolist(),
            "high": high.tolist(),
            "terms": {
                term: {key: value if key == "unit" else value.tolist() for key, value in facts.items()}
                for term, facts in fitted[triad].items()
            },
        }
    return json.dumps(answer, indent=2)


def write_card(path: Path, records: Mapping[str, Record], source: str) -> None:
    """Write the card of a record at rest, named as the file."""
    from lab.analysis import rest  # noqa: PLC0415 - only this answer needs it
    from lab.missions.atomic_file import atomic_file  # noqa: PLC0415 - only this answer needs it

    with atomic_file(path) as file:
        file.write(rest.card_of(path.stem, records, source).to_toml().encode())


def _fitted(records: Mapping[str, Record]) -> dict[str, dict[str, dict[str, Any]]]:
    from lab.analysis import rest  # noqa: PLC0415 - takes half a second

    return {triad: rest.in_setting_units(triad, terms) for triad, terms in rest.noise_terms(records).items()}


def _shown(value: Any) -> str:
    if value is None:
        return NOTHING
    if isinstance(value, list | tuple):
        return ", ".join(_shown(number) for number in value)
    return f"{value:.4g}"
