"""Aside: a page beside the tabs, which opens and closes: a sheet over them, or a dock at their right."""

from __future__ import annotations

from collections.abc import Callable

import panel as pn
import panel_material_ui as pmui

from dashboards.pages.base import Page
from dashboards.style import ON_SCREEN, TOOLTIP, header_icon, plain_row, whole_column, wide_html

SHEET = """
:host { position: absolute !important; inset: 0; z-index: 6; overflow: hidden auto !important;
        height: auto !important; width: auto !important; min-width: 0 !important;
        background: var(--mui-palette-background-default, canvas); }
"""
"""Over all that is below the header."""
DOCK = """
:host { flex: 0 0 360px !important; overflow: hidden auto !important; min-height: 0 !important;
        min-width: 0 !important; height: auto !important; border-left: 1px solid rgba(128, 128, 128, .3); }
@media (max-width: 1000px) {
  :host { flex: 0 0 46% !important; border-left: 0; border-top: 2px solid rgba(128, 128, 128, .4); }
}
"""
"""At the right of the plots; on narrow windows below them."""
BESIDE = """
:host { flex: 1 1 0 !important; min-height: 0 !important; min-width: 0 !important; align-items: stretch; }
@media (max-width: 1000px) { :host { flex-direction: column !important; } }
@media print { :host { display: block !important; height: auto !important; } }
"""
"""The row of the plots and the dock."""


_MISSION = {
    "color": "#ffffff",
    "maxWidth": "min(240px, 34vw)",
    "whiteSpace": "nowrap",
    "overflow": "hidden",
    "@media (max-width: 480px)": {"maxWidth": "100%", "justifyContent": "flex-start"},  # of its row
}


class Aside:
    """A page that stands beside the open tab while it is open.

    Parameters
    ----------
    kind
        The page.
    button
        Opens and closes it; for the header.
    style
        `SHEET` or `DOCK`.
    turned
        Called with it when it was opened or closed.

    Attributes
    ----------
    button : Button
        As given.
    view : viewable
        Its title, the button that closes it, and the page.
    """

    def __init__(
        self,
        kind: type[Page],
        button: pmui.Button | pmui.IconButton,
        style: str,
        turned: Callable[[Aside], None],
    ) -> None:
        self.kind = kind
        self.button = button
        button.on_click(lambda _event: self._turn(not self.is_open))
        self._turned = turned
        self._place = whole_column()
        self.view = pn.Column(
            name=f"page {kind.title}", visible=False, margin=0, stylesheets=[style, ON_SCREEN]
        )

    def _head(self) -> pn.viewable.Viewable:
        """Return the title, and the button that closes it."""
        title = self.kind.title
        close = pmui.IconButton(
            icon="close", description=f"Close {title} (Esc)", size="small", stylesheets=[TOOLTIP]
        )
        close.on_click(lambda _event: self.close())
        heading = wide_html(f"<h2>{title}</h2>", margin=(4, 8), stylesheets=[_HEADING])
        return plain_row(heading, close, margin=(4, 8))

    @property
    def is_open(self) -> bool:
        """Whether it is open."""
        return bool(self.view.visible)

    def open(self) -> None:
        """Open it."""
        self._turn(True)

    def close(self) -> None:
        """Close it."""
        self._turn(False)

    def show(self, view: pn.viewable.Viewable) -> None:
        """Show the layout of the page."""
        if self._place.objects != [view]:
            self._place[:] = [view]

    def _turn(self, is_open: bool) -> None:
        if is_open != self.is_open:
            if not self.view.objects:
                self.view[:] = [self._head(), self._place]
            self.view.visible = is_open
            self._place.clear()  # what is hidden costs nothing, and is made anew
            self._turned(self)


def mission_button() -> pmui.Button:
    """Return the button with the title of the mission, which opens the library."""
    return pmui.Button(
        label="Missions",
        end_icon="arrow_drop_down",
        description="Missions: choose, import, fly, record",
        variant="text",
        size="small",
        margin=(8, 0),
        css_classes=["mission"],
        stylesheets=[TOOLTIP],
        sx=_MISSION,
    )


def lessons_button() -> pmui.IconButton:
    """Return the button that opens the lessons."""
    return header_icon("school", "Lessons, beside the plots")


_HEADING = "h2 { margin: 4px 0; font-size: 1.1rem; font-weight: 500; }"
