"""Entry fields: fields for the numbers and texts of a flight plan's table, made from its declaration."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.field_text import number
from dashboards.style import plain_row
from lab.flying.plan_table import Entry, Limits, entries

WRAP = ":host { flex-wrap: wrap; min-width: 0 !important; }"
"""Wraps fields that do not fit on one line."""


def layout_width(width: int) -> dict[str, Any]:
    """Return layout options for a width [px] that Panel does not turn into a minimum width of the parents."""
    return {
        "sizing_mode": "stretch_width",
        "stylesheets": [f":host {{ flex: 0 0 {width}px !important; width: {width}px !important; }}"],
    }


def fields_row(*fields: Any, **settings: Any) -> pn.Row:
    """Return a row of fields that wraps."""
    return plain_row(*fields, stylesheets=[WRAP], **settings)


class EntryFields:
    """Fields for all numbers and texts of a table.

    Parameters
    ----------
    kind
        The dataclass of the table.
    values
        Initial values of the table.
    changed
        Called after every change by a person.
    limits
        Narrower limits of some numbers, by name.
    skip
        Entries without a field.
    """

    def __init__(
        self,
        kind: type,
        values: Mapping[str, Any],
        changed: Callable[[], None],
        limits: Limits | None = None,
        skip: Sequence[str] = (),
    ) -> None:
        self._entries = {name: entry for name, entry in entries(kind).items() if name not in skip}
        defaults = {field.name: field.default for field in dataclasses.fields(kind)}
        self._fields: dict[str, Any] = {}
        for name, entry in self._entries.items():
            value = values.get(name, defaults[name])
            self._fields[name] = made = _field(entry, value, (limits or {}).get(name, entry.limits))
            made.param.watch(lambda _event: changed(), "value")
        self.view = fields_row(*self._fields.values())

    def read(self) -> dict[str, Any]:
        """Return the values of the fields, in the form of a plan's table; empty fields are omitted."""
        values = {}
        for name, field in self._fields.items():
            value = _value(self._entries[name], field.value)
            if value is not None:
                values[name] = value
        return values

    def write(self, numbers: Mapping[str, float]) -> None:
        """Set the numbers of some fields."""
        for name, value in numbers.items():
            self._fields[name].value = _text(value)


def _text(value: float) -> str:
    return f"{value:.12g}"


def _field(entry: Entry, value: Any, limits: tuple[float, float]) -> Any:
    common: dict[str, Any] = {"size": "small", "margin": (6, 4), "variant": "outlined", **layout_width(190)}
    if entry.choices:
        return pmui.Select(
            label=entry.label, options=list(entry.choices), value=value, description=entry.doc, **common
        )
    low, high = limits
    accepted = f"{low:g} to {high:g}" if math.isfinite(high) else f"{low:g} or more"
    empty = "the aircraft's own" if entry.optional else "none" if value == math.inf else accepted
    is_number = isinstance(value, int | float) and math.isfinite(value)
    return pmui.TextInput(
        label=f"{entry.label} [{entry.unit}]" if entry.unit else entry.label,
        value=_text(value) if is_number else "",
        placeholder=empty,
        description=f"{entry.doc} {accepted[0].upper()}{accepted[1:]} {entry.unit}".strip(),
        **common,
    )


def _value(entry: Entry, text: Any) -> Any:
    """Return the entered text as a TOML value; the plan itself checks it."""
    if entry.choices:
        return text
    text = str(text).strip()
    if not text:
        return None
    found = number(text)
    return int(found) if entry.whole and isinstance(found, float) and found.is_integer() else found
