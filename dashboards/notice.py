"""Notice: a sentence in a coloured box, as plain text, so that file names are never interpreted as markup.

All messages of the page use this component. Panel's own boxes interpret texts as markup.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

import panel_material_ui as pmui

from dashboards.style import wide_html

LONGEST = 4000
"""Most characters of a message; a message about a value of a megabyte is cut after its beginning."""
MOST_POINTS = 50
"""Most points below a sentence."""


class Notice:
    """A box that is visible while it has a text.

    Parameters
    ----------
    closeable
        Whether a person can close it.
    margin
        Margins, vertical and horizontal [px].
    links
        Titles of pages, which are links in the text: `history_bar.js` asks for the page.

    Attributes
    ----------
    text : str
        The text.
    view : panel_material_ui.Alert
        The box to place on the page.
    """

    def __init__(
        self,
        closeable: bool = False,
        margin: tuple[int, int] = (6, 4),
        links: Sequence[str] = (),
    ) -> None:
        self.text = ""
        self._links = re.compile(rf"\b({'|'.join(links)})\b") if links else None
        self._words = wide_html(
            margin=0, styles={"white-space": "pre-line"}, stylesheets=["a { color: inherit; }"]
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
        """Show a text with a list of points below it; an empty text hides the box."""
        self.text = _bound_text(text)
        listed = "".join(f"<li>{escape(_bound_text(point))}</li>" for point in points[:MOST_POINTS])
        style = ' style="margin:4px 0 0;padding-left:18px"'
        words = escape(self.text)
        if self._links is not None:
            words = self._links.sub(r'<a href="#\1" data-page="\1">\1</a>', words)
        self._words.object = words + (f"<ul{style}>{listed}</ul>" if listed else "")
        self.view.param.update(severity=severity, closed=False, visible=bool(text))


def _bound_text(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]} …"
