"""Bar style: the line of a class above all tabs, for students and teachers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import panel as pn

BAR = """
:host { align-items: center; border-bottom: 1px solid rgba(128,128,128,.25);
        background: rgba(27,98,185,.09); flex: 0 0 auto !important; max-height: none !important; }
"""
WORDS = "div { font: 14px/1.4 Roboto, sans-serif; } b { font-weight: 600; }"
BUTTON: dict[str, Any] = {"variant": "outlined", "size": "small", "margin": (6, 4), "align": "center"}
"""Options of all buttons in the line."""
TOGGLE: dict[str, Any] = {
    "& .MuiToggleButton-root, &.MuiToggleButton-root": {
        "fontSize": "0.8125rem",
        "padding": "3px 9px",
        "gap": "6px",
    }
}
"""Style of a button that stays pressed: as high as the others."""

_FLASHES = ("told", "told-again")
"""Classes of a field that flashes, in turn: an animation begins anew only under another name."""
_FLASH = "".join(
    f"@keyframes {name} {{ from {{ background: rgba(240,150,30,.55); }} to {{ background: transparent; }} }}"
    f"@media (prefers-reduced-motion: no-preference) {{ :host(.{name}) {{ animation: {name} 3s ease-in; }} }}"
    for name in _FLASHES
)


def flash(views: Iterable[pn.viewable.Viewable]) -> None:
    """Make fields flash, because a teacher has changed their settings."""
    for view in views:
        if _FLASH not in view.stylesheets:
            view.stylesheets = [*view.stylesheets, _FLASH]
        others = [one for one in view.css_classes if one not in _FLASHES]
        view.css_classes = [*others, _FLASHES[_FLASHES[0] in view.css_classes]]
