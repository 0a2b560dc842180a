"""Time bar: the time cursor as a slider with a play button, below all pages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn
import panel_material_ui as pmui
import param
from bokeh.document import Document

from dashboards.plot_tools import EventLane, PlotTools
from dashboards.sending import together
from dashboards.session import Session
from dashboards.style import HIDDEN_LABEL, ON_SCREEN, TOOLTIP, plain_column, plain_row
from dashboards.widgets import Slider
from lab.views.figures import TimeAxis

FRAME = 50
"""Time between two frames while playing [ms]."""

OUTAGE = 20.0
"""Length of a GPS outage that starts at the cursor [s]."""

SPEEDS = {"1 ×": 1.0, "5 ×": 5.0, "20 ×": 20.0}


ROOMY = "@media (max-width: 800px) { :host { display: none !important; } }"
"""Hides labels on narrow windows, to leave room for the slider."""

ABOVE = {"position": "relative"}
"""Of the column in which the lane of events stands above the slider."""

ROW = ":host { height: max(48px, 3rem) !important; }"
"""The row grows with the letters of a browser, as its icons do."""

READOUT = """
:host { width: 120px; white-space: nowrap; }
@media (max-width: 800px) { :host { width: 66px; } span { display: none; } }
"""


class TimeBar:
    """Moves the time cursor: by hand, by playing, or by a click into a plot.

    Parameters
    ----------
    axis
        Time axis whose cursor moves.
    document
        Document of the session; its callbacks are the clock of this bar.
    follow
        Called with each new time [s].
    cut
        Called with start and end [s] of a GPS outage to add.
    session
        The session whose results have the events above the slider.
    """

    def __init__(
        self,
        axis: TimeAxis,
        document: Document,
        follow: Callable[[float], None],
        cut: Callable[[float, float], None],
        session: Session,
    ) -> None:
        self._axis = axis
        self._cut = cut
        self._document = document
        self._follow = follow
        self._playing: Any = None
        self._moving = False
        self._play = _play_button()
        self._play.param.watch(lambda event: self.play() if event.new else self.stop(), "value")
        self._speed = pmui.Select(
            label="Speed", options=SPEEDS, value=5.0, size="small", width=84, margin=4,
            stylesheets=[ROOMY, HIDDEN_LABEL],
        )  # fmt: skip
        self._slider = _time_slider()
        self._slider.param.watch(self._moved, "value")
        self._readout = pn.pane.HTML(
            "", margin=(12, 4), styles={"font-variant-numeric": "tabular-nums"}, stylesheets=[READOUT]
        )
        outage = _icon_button(
            "gps_off",
            "GPS outage over the visible stretch (drag over a plot to choose one). "
            f"If the whole flight is visible: {OUTAGE:g} s from the time cursor on.",
        )
        outage.on_click(lambda _event: self._cut_stretch())
        note = _icon_button(
            "edit_note",
            "Note on the visible stretch (drag over a plot to choose one). "
            "If the whole flight is visible: at the time cursor.",
        )
        note.on_click(lambda _event: self._write_note())
        whole = _icon_button("zoom_out_map", "Whole flight", right=10)
        whole.on_click(lambda _event: axis.whole())
        axis.cursor.on_change("location", self._clicked)
        self._lane = EventLane(session, document, self.go, axis.show_notes)
        row = plain_row(
            self._play,
            self._speed,
            plain_column(self._lane.view, self._slider, styles=ABOVE),
            self._readout,
            outage,
            note,
            whole,
            stylesheets=[ROW],
        )
        self.tools = PlotTools(sizing_mode="stretch_width", margin=0)  # type: ignore[no-untyped-call]
        self.view = plain_column(
            self.tools,
            row,
            styles={"border-top": "1px solid rgba(128,128,128,.25)", "flex": "0 0 auto"},
            stylesheets=[ON_SCREEN],
        )
        self.span()

    @property
    def plays(self) -> bool:
        """Whether the cursor moves by itself."""
        return self._playing is not None

    def span(self) -> None:
        """Make the slider end with the flight."""
        self._slider.param.update(end=self._axis.duration, value=self._axis.time)
        self._report(self._axis.time)

    def play(self) -> None:
        """Start playing; from the beginning if the cursor is at the end."""
        if self._axis.time >= self._axis.duration:
            self._go(0.0)
        self._playing = self._document.add_periodic_callback(self._advance, FRAME)

    def toggle(self) -> None:
        """Start playing, or stop."""
        self._play.value = not self._play.value

    def go(self, time: float) -> None:
        """Move the cursor to a time of the flight [s]; a later one is its end."""
        self.stop()
        self._go(time)

    def close(self) -> None:
        """End the session: look for no more events."""
        self.stop()
        self._lane.close()

    def stop(self) -> None:
        """Stop playing."""
        if self._playing is not None:
            self._document.remove_periodic_callback(self._playing)
            self._playing = None
            self._play.value = False
            self._follow(self._axis.time)

    def _advance(self) -> None:
        time = min(self._axis.time + self._speed.value * FRAME / 1000, self._axis.duration)
        with together(self._document):
            self._go(time)
        if time >= self._axis.duration:
            self.stop()

    def _cut_stretch(self) -> None:
        """Add a GPS outage over the visible stretch or from the cursor on, and show the whole flight."""
        start, end = self._axis.window
        if end - start >= self._axis.duration:
            start, end = self._axis.time, min(self._axis.time + OUTAGE, self._axis.duration)
        self._axis.whole()
        if end > start:
            self._cut(round(start, 1), round(end, 1))

    def _write_note(self) -> None:
        """Let a person write a note on the visible stretch, or at the cursor."""
        start, end = self._axis.window
        if end - start >= self._axis.duration:
            start = end = self._axis.time
        self._lane.open(start, end)

    def _moved(self, event: param.parameterized.Event) -> None:
        if not self._moving:
            self._go(float(event.new))

    def _clicked(self, _attr: str, _old: Any, new: Any) -> None:
        if not self._moving and new is not None:
            self._go(float(new))

    def _go(self, time: float) -> None:
        time = min(max(time, 0.0), self._axis.duration)
        self._moving = True
        try:
            self._axis.cursor.location = time
            self._slider.value = time
        finally:
            self._moving = False
        self._report(time)
        self._follow(time)

    def _report(self, time: float) -> None:
        self._readout.object = f"<b>{time:.2f} s</b> <span>/ {self._axis.duration:.0f} s</span>"


def _play_button() -> pmui.ToggleIcon:
    return pmui.ToggleIcon(
        icon="play_arrow",
        active_icon="pause",
        size="1.6em",
        margin=(2, 0, 0, 8),
        description="Play, or stop",
        stylesheets=[TOOLTIP],
    )


def _time_slider() -> Slider:
    return Slider(
        label="Time",
        show_value=False,
        tooltips=False,
        size="small",
        start=0.0,
        end=1.0,
        step=0.05,
        margin=(12, 6, 0, 6),
        sizing_mode="stretch_width",
        sx={"& .MuiFormLabel-root": {"display": "none"}},
    )


def _icon_button(icon: str, description: str, right: int = 0) -> pmui.IconButton:
    """Return a button with a tooltip, and with a margin to the right of it [px]."""
    return pmui.IconButton(
        icon=icon,
        size="1.2em",
        margin=(6, right, 0, 0),
        description=description,
        stylesheets=[TOOLTIP],
    )
