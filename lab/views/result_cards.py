"""Result cards: what a notebook shows of settings, a sensor, a result and the outcome of an exercise."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from lab.base.parameters.setting_kinds import describe, is_changed, value_text
from lab.base.parameters.settings import Settings
from lab.classroom.exercises.exercise import Outcome
from lab.experiment.result import Result
from lab.sensors.cards import Card
from lab.sensors.datum import Datum

_LEFT_CELL = 'style="text-align:left"'
_QUIET = 'style="text-align:left;opacity:.75"'
_LEFT = "text-align:left"
_CHANGED = f"{_LEFT};font-weight:bold"
_TITLES = ("setting", "value", "accepted", "meaning")

Leaf = tuple[str, Settings, str]


def settings_html(settings: Settings, *, changed_only: bool = False) -> str:
    """Return settings as HTML tables with units and accepted values; changed ones are bold.

    Settings with groups begin with the changed ones, and each group is folded: all of them are ten screens.

    Parameters
    ----------
    settings
        Settings to show.
    changed_only
        True omits settings with their default value.
    """
    hides = bool(getattr(settings, "hidden", ""))  # a run that hides something passes its seed on to nobody
    leaves = [leaf for leaf in settings.leaves() if not (hides and leaf[0] == "seed")]
    if not settings.groups() and not changed_only:
        return _table(leaves)
    changed = [leaf for leaf in leaves if is_changed(leaf)]
    first = _table(changed) if changed else "<p>All settings have their default values.</p>"
    return first if changed_only else first + _fold_groups(leaves)


def breakable_path(path: str) -> str:
    """Return a dotted path as HTML that a narrow table may break after a dot and an underline."""
    return escape(path).replace(".", ".<wbr>").replace("_", "_<wbr>")


def _fold_groups(leaves: Sequence[Leaf]) -> str:
    """Return a folded table for each group, with the number of its settings and of the changed ones."""
    groups: dict[str, list[Leaf]] = {}
    for leaf in leaves:
        groups.setdefault(leaf[0].rpartition(".")[0], []).append(leaf)
    parts = []
    for name, group in groups.items():
        changed = sum(is_changed(leaf) for leaf in group)
        count = f"{len(group)} setting{'s' if len(group) > 1 else ''}"
        more = f", {changed} changed" if changed else ""
        parts.append(
            f"<details><summary style='cursor:pointer'><strong>{escape(name or 'general')}</strong>: "
            f"{count}{more}"
            f"</summary>{_table(group)}</details>"
        )
    return "".join(parts)


def _table(leaves: Sequence[Leaf]) -> str:
    head = "".join(f'<th style="{_LEFT}">{title}</th>' for title in _TITLES)
    return f"<table><tr>{head}</tr>{''.join(f'<tr>{_row(leaf)}</tr>' for leaf in leaves)}</table>"


def _row(leaf: Leaf) -> str:
    path, owner, name = leaf
    parameter, value = owner.param[name], getattr(owner, name)
    style = _CHANGED if is_changed(leaf) else _LEFT
    texts = (value_text(parameter, value), describe(parameter), parameter.doc or "")
    cells = (breakable_path(path), *(escape(text) for text in texts))
    styles = (style, style, _LEFT, _LEFT)
    return "".join(f'<td style="{s}">{cell}</td>' for s, cell in zip(styles, cells, strict=True))


def result_html(result: Result) -> str:
    """Return a result as HTML; for a log without reference, the innovations replace the errors."""
    remarks = "".join(f"<li>{escape(remark)}</li>" for remark in result.remarks)
    parts = (result.mission.title or result.mission.name, f"{result.time[-1]:.0f} s", result.realisation)
    title = ", ".join(part for part in parts if part)
    _, shown = result.overview
    summary = shown.to_html(index=False, border=0, float_format=lambda value: f"{value:.4g}")
    words = (
        result.missing_reason("summary")
        or f"Errors are estimate minus {result.truth_word}, over the whole flight."
    )
    return (
        f"<h4>{escape(title)}</h4>"
        f"{settings_html(result.experiment, changed_only=True)}{summary}"
        f"<p>{escape(words)}</p>"
        f"{f'<ul>{remarks}</ul>' if remarks else ''}"
    )


_SIGNS = {None: ("#777", "?"), True: ("#1a8f4c", "✓"), False: ("#b3541e", "✗")}
"""Colour and sign of an outcome; both are readable on white and on black."""


def outcome_html(outcome: Outcome) -> str:
    """Return an outcome as HTML."""
    colour, sign = _SIGNS[outcome.right]
    return (
        f'<div style="border-left: 4px solid {colour}; padding: 0.3em 0.8em; max-width: 50em">'
        f'<b style="color: {colour}">{sign}</b> {escape(str(outcome))}</div>'
    )


def sensor_html(card: Card) -> str:
    """Return a card as HTML; assumed numbers are paler, and missing ones are listed."""
    rows = [
        _datum_row(f"{group}.{name}", datum, assumed=terms is card.assumed)
        for terms in (card.terms, card.assumed)
        for group, data in terms.items()
        for name, datum in data.items()
    ]
    head = "".join(f"<th {_LEFT_CELL}>{title}</th>" for title in ("setting", "value", "source"))
    absent = [f"{group}: {', '.join(labels).lower()}" for group, labels in card.missing().items() if labels]
    rest = f"<p>Off, because they have no number: {escape('; '.join(absent))}.</p>" if absent else ""
    return (
        f"<h4>{escape(card.name)}, {escape(card.grade)} grade, {escape(card.maker)}</h4>"
        f"{f'<p>{escape(card.note)}</p>' if card.note else ''}"
        f"<table><tr>{head}</tr>{''.join(rows)}</table>{rest}"
    )


def _datum_row(path: str, datum: Datum, *, assumed: bool) -> str:
    values = datum.value if isinstance(datum.value, tuple) else (datum.value,)
    number = f"{', '.join(f'{value:g}' for value in values)} {datum.unit}"
    convention = f" ({datum.convention})" if datum.convention else ""
    source = f"{'assumed: ' if assumed else ''}{datum.source}"
    style = _QUIET if assumed else _LEFT_CELL
    cells = (breakable_path(path), escape(number + convention), escape(source))
    return f"<tr>{''.join(f'<td {style}>{cell}</td>' for cell in cells)}</tr>"
