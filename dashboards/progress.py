"""Progress: a word in the header about what is being computed, for runs that take long enough to notice."""

from __future__ import annotations

from html import escape

import panel as pn
import param

from dashboards.session import Session


class Progress:
    """Shows the stage and the share that is done while a session computes."""

    def __init__(self, session: Session) -> None:
        # Only its text changes: to show or hide a model has the browser lay the whole page out, and a ring
        # that turns keeps it painting while it has plots to draw.
        self.view = pn.pane.HTML(
            "",
            margin=(0, 8),
            styles={"color": "white", "white-space": "nowrap"},
            css_classes=["progress"],
        )
        session.param.watch(self._changed, ["stage", "fraction"])
        self._session = session

    def _changed(self, *_events: param.parameterized.Event) -> None:
        stage, fraction = self._session.stage, self._session.fraction
        share = f" · {fraction:.0%}" if 0 < fraction < 1 else ""
        self.view.object = f"{escape(stage)} …{share}" if stage else ""
