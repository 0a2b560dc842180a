"""View in three dimensions: a viser scene in a frame, with the aircraft at the time cursor."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import ClassVar

import panel as pn
import panel_material_ui as pmui
from bokeh.document import Document
from bokeh.events import DocumentReady

from dashboards.pages.base import AROUND, Page
from dashboards.style import HIDDEN_LABEL, choice_row, plain_column, wide_html
from dashboards.upstream.server import serving_application
from dashboards.viser_proxy import ServedScene
from lab.experiment.result import Result
from lab.views.figures import TimeAxis
from lab.views.quantities import ESTIMATE, FIXES, TRUTH
from lab.views.scene import Scene

FACTORS = {"Heights × 1": 1.0, "Heights × 2": 2.0, "Heights × 5": 5.0}


class View3D(Page):
    """Paths, fixes, ellipsoids and the aircraft, from a viser server that runs as long as the session."""

    title = "3-D"
    contents = "the flight in three dimensions"
    seen = ("solution", "truth")
    depends_on_window = False
    frame_style: ClassVar[str] = f"""
    iframe {{ border: 0; width: 100%; height: calc(100vh - {AROUND + 46}px); min-height: 360px;
              display: block; border-radius: 6px; }}
    """

    def __init__(self, axis: TimeAxis, _session: object = None) -> None:
        self._served: ServedScene | None = None
        self._scene: Scene | None = None
        self._document: Document | None = None
        self._dark = True
        super().__init__(axis)

    def make(self) -> pn.viewable.Viewable:
        """Return the frame, which shows a viser server once a browser is there."""
        self._document = pn.state.curdoc
        self._frame = wide_html(css_classes=["frame"], margin=0, stylesheets=[self.frame_style])
        self._begin()
        if self._served is None and self._document is not None:  # a link opens this page
            self._document.on_event(DocumentReady, lambda _event: self.draw_again())
        heights = pmui.Select(
            label="Heights",
            options=FACTORS,
            value=1.0,
            size="small",
            width=140,
            margin=(4, 10),
            stylesheets=[HIDDEN_LABEL],
        )  # fmt: skip
        heights.param.watch(lambda event: self._exaggerate(event.new), "value")
        self._legend = pn.pane.HTML("", margin=(10, 4))
        return plain_column(choice_row(heights, self._legend), self._frame, margin=(4, 8))

    def _begin(self) -> None:
        """Start the viser server if a browser is there, and it is not started yet."""
        if self._served is not None or self._document is None or serving_application(self._document) is None:
            return
        self._served = ServedScene(self._document)
        self._scene = Scene(self._served.server, dark=self._dark)
        self._frame.object = (
            f'<iframe src="{self._served.address}" title="Flight in three dimensions" allow="fullscreen">'
            "</iframe>"
        )

    def prepare(self, result: Result) -> None:
        """Compute the projected paths of the result."""
        _ = result.drawn_track, result.gps, result.position_covariance

    def draw(self, result: Result) -> None:
        """Draw a result."""
        self._begin()
        if self._scene is not None:
            self._scene.show(result, self.axis.time, self.held())
            self._legend.object = legend_html(result, self._scene.scale, self._scene.held)

    def release(self) -> None:
        """Refer to no result any more; the aircraft stays where it is."""
        super().release()
        if self._scene is not None:
            self._scene.release()

    def show_time(self, time: float) -> None:
        """Move the aircraft."""
        if self._scene is not None:
            self._scene.show_time(time)

    def dress(self, dark: bool) -> None:
        """Give the scene the background of the theme."""
        self._dark = dark
        if self._scene is not None:
            self._scene.dress(dark)
            self.draw_again()

    def close(self) -> None:
        """Stop the viser server."""
        if self._served is not None:
            self._served.end()
        self._served = self._scene = self._document = None

    def _exaggerate(self, factor: float) -> None:
        if self._scene is not None:
            self._scene.exaggeration = factor
            self.draw_again()


def legend_html(result: Result, scale: float, held: Sequence[tuple[str, str]]) -> str:
    """Return what the colours of a scene mean, with letter and colour of each held result in it, as HTML."""
    true = () if result.truth_arrays is None else ((TRUTH, f"{result.truth_word}"),)
    drawn = [(colour, f"{letter}, held") for letter, colour in held]
    entries = (*true, (ESTIMATE, f"estimate, 3σ ellipsoids × {scale:g}"), (FIXES, "GPS fixes"), *drawn)
    return " &emsp; ".join(
        f'<span style="color:{colour}">●</span> {escape(label)}' for colour, label in entries
    )
