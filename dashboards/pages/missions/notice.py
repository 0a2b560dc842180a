"""Notice: a sentence in a coloured box, as plain text: what a file is called is never taken for markup."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import panel as pn
import panel_material_ui as pmui


class Notice:
    """A box that is there while it has something to say.

    Parameters
    ----------
    closeable
        Whether a person can close it.

    Attributes
    ----------
    view : panel_material_ui.Alert
        What is laid out in the page.
    """

    def __init__(self, closeable: bool = False) -> None:
        # Panel's Alert takes its own text for markdown, and at times escapes it twice.
        self._text = pn.pane.HTML("", margin=0, sizing_mode="stretch_width")
        self.view = pmui.Alert(
            self._text,
            severity="error",
            visible=False,
            closeable=closeable,
            margin=(6, 4),
            sizing_mode="stretch_width",
        )

    def say(self, text: str, severity: str = "error", points: Sequence[str] = ()) -> None:
        """Say something, with points below it; nothing is shown with no text."""
        listed = "".join(f"<li>{escape(point)}</li>" for point in points)
        style = ' style="margin:4px 0 0;padding-left:18px"'
        self._text.object = escape(text) + (f"<ul{style}>{listed}</ul>" if listed else "")
        self.view.param.update(severity=severity, closed=False, visible=bool(text))
