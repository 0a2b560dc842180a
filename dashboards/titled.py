"""Titled: tabs and cards whose titles are texts.

The library makes an empty pane for the title of each of their parts, though it is a text. A page had 27 such
panes, with a row around each, and the browser made components of them that it never showed.
"""

from __future__ import annotations

from typing import Any

import panel_material_ui as pmui


class _Titled:
    """Leaves out the panes of titles; its parts stay those with which it is made."""

    def _to_objects_and_names(self, items: Any) -> tuple[list[Any], ...]:
        objects, *headers, names = super()._to_objects_and_names(items)  # type: ignore[misc]
        return (objects, *([] for _ in headers), names)


class Tabs(_Titled, pmui.Tabs):
    """Tabs with texts as titles."""

    def __init__(self, *parts: Any, **params: Any) -> None:
        super().__init__(*parts, **params)  # type: ignore[no-untyped-call]


class Card(_Titled, pmui.Card):
    """A card with a text as title."""

    def __init__(self, *parts: Any, **params: Any) -> None:
        super().__init__(*parts, **params)
