"""Progress: a text in the header about the current computation, for runs that take noticeably long."""

from __future__ import annotations

from html import escape

import panel as pn
import param

from dashboards.session import Session

DRAWING = "Drawing"
"""What a page does once all is computed."""
_SHORT = """
:host { flex: 1 1 0 !important; width: 0 !important; min-width: 0 !important; align-self: center; }
div { overflow: hidden; text-overflow: ellipsis; }
div:empty::before { content: "\\200b"; }
@media (max-width: 480px) { :host { margin: 0 !important; } }
"""
"""On a phone the text ends with dots: it must not push the switch of the theme out of the header.

Without a text, it is as high as with one: the browser would lay out the whole page twice for each run.
"""


class ProgressText:
    """Shows the stage and the fraction done while a session computes."""

    def __init__(self, session: Session) -> None:
        # Only its text changes. Showing or hiding a model would make the browser lay out the whole page, and
        # a rotating ring would keep it painting while it has plots to draw.
        self.view = pn.pane.HTML(
            "",
            margin=(0, 8),
            styles={"color": "white", "white-space": "nowrap"},
            css_classes=["progress"],
            stylesheets=[_SHORT],
        )
        session.param.watch(self._changed, ["stage", "fraction"])
        self._session = session

    def _changed(self, *_events: param.parameterized.Event) -> None:
        stage, fraction = self._session.stage, self._session.fraction
        share = f" · {100 * fraction:.0f} %" if 0 < fraction < 1 else ""
        stage = DRAWING if fraction == 1 else stage
        self.view.object = f"{escape(stage)} …{share}" if stage else ""
