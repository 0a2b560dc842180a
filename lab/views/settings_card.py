"""Settings card: settings shown in Jupyter: value, unit, accepted values and meaning of each."""

from __future__ import annotations

from html import escape

from lab.setting_help import value_text
from lab.setting_kinds import describe
from lab.settings import Settings

_LEFT = "text-align:left"
_CHANGED = f"{_LEFT};font-weight:bold"


def settings_html(settings: Settings, *, changed_only: bool = False) -> str:
    """Return settings as an HTML table with units and accepted values; changed ones are bold.

    Parameters
    ----------
    settings
        Settings to show.
    changed_only
        True omits settings with their default value.
    """
    rows = []
    for path, owner, name in settings.leaves():
        parameter, value = owner.param[name], getattr(owner, name)
        if changed_only and value == parameter.default:
            continue
        style = _LEFT if value == parameter.default else _CHANGED
        cells = (path, value_text(parameter, value), describe(parameter), parameter.doc or "")
        styles = (style, style, _LEFT, _LEFT)
        rows.append("".join(f'<td style="{s}">{escape(c)}</td>' for s, c in zip(styles, cells, strict=True)))
    if not rows:
        return "<p>All settings have their default values.</p>"
    head = "".join(
        f'<th style="{_LEFT}">{title}</th>' for title in ("setting", "value", "accepted", "meaning")
    )
    return f"<table><tr>{head}</tr>{''.join(f'<tr>{row}</tr>' for row in rows)}</table>"
