"""Progress: a word in the header about what is being computed, for runs that take long enough to notice."""

from __future__ import annotations

import panel as pn
import panel_material_ui as pmui
import param

from dashboards.session import Session


class Progress:
    """Shows the stage and the share that is done while a session computes."""

    def __init__(self, session: Session) -> None:
        self._ring = pmui.CircularProgress(value=True, size=20, color="light", margin=(14, 8), visible=False)
        self._words = pn.pane.HTML("", margin=(14, 0), styles={"color": "white", "white-space": "nowrap"})
        self.view = pn.Row(self._ring, self._words, margin=0, css_classes=["progress"])
        session.param.watch(self._changed, ["stage", "fraction"])
        self._session = session

    def _changed(self, *_events: param.parameterized.Event) -> None:
        stage, fraction = self._session.stage, self._session.fraction
        self._ring.visible = bool(stage)
        share = f" · {fraction:.0%}" if 0 < fraction < 1 else ""
        self._words.object = f"{stage} …{share}" if stage else ""
