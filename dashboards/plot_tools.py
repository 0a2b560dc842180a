"""Plot tools: what all plots of a page share: legend, values at the cursor, menus, and the lane of events."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any
from weakref import ref

import param
from bokeh.document import Document
from panel.custom import JSComponent

from dashboards.computing import LONG, LatestWins, Outcome, attempt
from dashboards.notes import Notes
from dashboards.openings import Openings
from dashboards.sending import soon
from dashboards.session import Session
from lab.analysis.events import events, merge_close_events
from lab.base.progress import Progress
from lab.experiment.result import Result
from lab.run.memory import give_back, large_blocks_given_back

_HERE = Path(__file__).parent
SETTLED = 300
"""Time after a new result until its events are looked for [ms], so that a moving slider is not slowed."""
CROWDED = 500
"""Time between two looks whether all pages that open have opened [ms]."""


class PlotTools(JSComponent):
    """Legend and values of all plots over time, and a menu in each plot; in the browser but for samples.

    As a bundle, script and style are files that a browser keeps, and no part of the messages of a page.
    """

    asked: dict[str, Any] = param.Dict(
        {}, doc="The last figure whose samples are wanted, the name of their file, and a count."
    )

    _bundle = _HERE / "plot_tools.js"


class Lane(JSComponent):
    """Events as coloured spans over the whole flight; a press on one asks for its time."""

    shown: dict[str, Any] = param.Dict(
        {"events": [], "duration": 1.0},
        doc="Kind, start, end [s] and words of the events; end of the flight.",
    )
    notes: list[list[Any]] = param.List([], doc="Start, end [s] and text of the notes.")
    opened: dict[str, Any] = param.Dict(
        {}, doc="The stretch of time [s] on which a note is to be written, and a count."
    )
    asked: dict[str, Any] = param.Dict(
        {},
        doc="The last wish: the time of an event [s]; or the number of a note, or its stretch, and its text; "
        "and a count.",
    )

    _esm = _HERE / "event_lane.js"
    _stylesheets = [(_HERE / "event_lane.css").read_text(encoding="utf-8")]  # noqa: RUF012 - Panel's own


class EventLane:
    """The events of the shown result, found once it has been shown for a moment.

    Parameters
    ----------
    session
        The session whose results are shown.
    document
        The document of the page.
    go
        Called with the time of an event that was pressed [s].
    shade
        Called with the stretches of time [s] of the notes that are shown.

    Attributes
    ----------
    view : Lane
        The lane.
    """

    def __init__(
        self,
        session: Session,
        document: Document,
        go: Callable[[float], None],
        shade: Callable[[list[tuple[float, float]]], None],
    ) -> None:
        self._document, self._go, self._shade = document, go, shade
        self._notes = Notes(session)
        self._openings = Openings.of(document)
        self._result: Result | None = None
        self._work: LatestWins[Result] = LatestWins(self._find, self._deliver, LONG)
        self.view = Lane(sizing_mode="stretch_width", margin=0)  # type: ignore[no-untyped-call]
        self.view.param.watch(self._pressed, "asked")
        session.on_run(self._wait)
        session.param.watch(self._arrived, "result", onlychanged=False)
        session.param.watch(lambda _event: self._show_notes(), "notes")

    def close(self) -> None:
        """Look for no more events."""
        self._work.close()
        self._result = None

    def _wait(self) -> None:
        """Let go of the result: that of a long flight is released before a run begins."""
        self._work.cancel()
        self._result = None

    def _arrived(self, event: param.parameterized.Event) -> None:
        self._result = event.new
        if event.new is None:
            return
        duration, wanted = float(event.new.time[-1]), ref(event.new)
        if duration != self.view.shown["duration"]:
            self._show([], duration)
        self._show_notes()
        self._document.add_timeout_callback(lambda: self._begin(wanted), SETTLED)

    def _begin(self, wanted: ref[Result]) -> None:
        """Look for the events of a result, unless another one has come, or pages open."""
        result = self._result
        if result is None or wanted() is not result:
            return
        if self._openings is not None and self._openings.busy:
            self._document.add_timeout_callback(lambda: self._begin(wanted), CROWDED)
        else:
            self._work.submit(result)

    def _find(self, result: Result, _progress: Progress) -> Outcome:
        with large_blocks_given_back(result.time.size):
            found = attempt(lambda: merge_close_events(events(result), float(result.time[-1])))
        if result.is_long:
            give_back()
        return found

    def _deliver(self, result: Result, outcome: Outcome) -> None:
        wanted = ref(result)
        soon(self._document, lambda: self._receive(wanted, outcome))

    def _receive(self, wanted: ref[Result], outcome: Outcome) -> None:
        result = self._result
        if result is not None and wanted() is result:
            rows = [
                [one.kind, round(one.start, 2), round(one.end, 2), one.words] for one in outcome.result or []
            ]
            self._show(rows, float(result.time[-1]))

    def _show(self, rows: list[list[Any]], duration: float) -> None:
        shown = {"events": rows, "duration": duration}
        if shown != self.view.shown:
            self.view.shown = shown

    def open(self, start: float, end: float) -> None:
        """Let a person write a note on a stretch of time [s]."""
        self.view.opened = {"start": start, "end": end, "count": self.view.opened.get("count", 0) + 1}

    def _show_notes(self) -> None:
        """Show the notes on the flight that is shown, as far as they are in it."""
        last = float(self.view.shown["duration"])
        stretches = [(min(one.start, last), min(one.end, last)) for one in self._notes.here]
        rows = [[*at, one.text] for at, one in zip(stretches, self._notes.here, strict=True)]
        if rows != self.view.notes:
            self.view.notes = rows
        self._shade(stretches)

    def _pressed(self, event: param.parameterized.Event) -> None:
        """Do what was asked for; a hand-made message may contain anything."""
        wish = event.new
        given = (wish.get(name) for name in ("time", "start", "end"))
        times = [one for one in given if isinstance(one, int | float)]
        if not all(map(math.isfinite, times)):
            return
        text, number = wish.get("text"), wish.get("note")
        if isinstance(text, str) and isinstance(number, int):
            self._notes.change(number, text)
        elif isinstance(text, str) and len(times) == len(("start", "end")):
            self._notes.write(times[0], times[1], text)
        elif text is None and len(times) == 1:
            self._go(float(times[0]))
