"""Settings card: settings shown in Jupyter: value, unit, accepted values and meaning of each."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from lab.base.parameters.setting_help import is_changed, value_text
from lab.base.parameters.setting_kinds import describe
from lab.base.parameters.settings import Settings

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
    leaves = list(settings.leaves())
    if not settings.groups() and not changed_only:
        return _table(leaves)
    changed = [leaf for leaf in leaves if is_changed(leaf)]
    first = _table(changed) if changed else "<p>All settings have their default values.</p>"
    return first if changed_only else first + _folded(leaves)


def breakable(path: str) -> str:
    """Return a dotted path as HTML that a narrow table may break after a dot and an underline."""
    return escape(path).replace(".", ".<wbr>").replace("_", "_<wbr>")


def _folded(leaves: Sequence[Leaf]) -> str:
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
    cells = (breakable(path), *(escape(text) for text in texts))
    styles = (style, style, _LEFT, _LEFT)
    return "".join(f'<td style="{s}">{cell}</td>' for s, cell in zip(styles, cells, strict=True))
