"""Notice: a sentence in a coloured box, as plain text: what a file is called is never taken for markup.

Whatever the page has to say goes through this one component. Panel's own boxes take texts for markup.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import panel as pn
import panel_material_ui as pmui

LONGEST = 4000
"""Most characters said at once; what was wrong with a value of a megabyte is said by its beginning."""
MOST_POINTS = 50
"""Most points below a sentence."""


class Notice:
    """A box that is there while it has something to say.

    Parameters
    ----------
    closeable
        Whether a person can close it.
    margin
        Space around it, above and below and beside [px].

    Attributes
    ----------
    text : str
        What it says.
    view : panel_material_ui.Alert
        What is laid out in the page.
    """

    def __init__(self, closeable: bool = False, margin: tuple[int, int] = (6, 4)) -> None:
        self.text = ""
        self._words = pn.pane.HTML(
            "", margin=0, sizing_mode="stretch_width", styles={"white-space": "pre-line"}
        )
        self.view = pmui.Alert(
            self._words,
            severity="error",
            visible=False,
            closeable=closeable,
            margin=margin,
            sizing_mode="stretch_width",
        )

    def say(self, text: str, severity: str = "error", points: Sequence[str] = ()) -> None:
        """Say something, with points below it; nothing is shown with no text."""
        self.text = _bounded(text)
        listed = "".join(f"<li>{escape(_bounded(point))}</li>" for point in points[:MOST_POINTS])
        style = ' style="margin:4px 0 0;padding-left:18px"'
        self._words.object = escape(self.text) + (f"<ul{style}>{listed}</ul>" if listed else "")
        self.view.param.update(severity=severity, closed=False, visible=bool(text))


def _bounded(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} …"
