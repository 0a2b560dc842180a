"""Recording: the part of the page that records a flight from a running X-Plane as a mission."""

from __future__ import annotations

from typing import Any

import panel as pn
import panel_material_ui as pmui

from dashboards.field_text import number
from dashboards.pages.missions.draft import Draft
from dashboards.pages.missions.entry_fields import fields_row, layout_width
from dashboards.pages.missions.job import Job
from dashboards.session import Session
from dashboards.style import whole_column, wide_html
from lab.base.progress import Progress
from lab.data.rebuild.raw_flight import RawFlight
from lab.data.streams.xplane_live import PORT, XPlaneRecorder

TELL = 500
"""Time between two updates of the recording's state [ms]."""
_FIELD: dict[str, Any] = {"size": "small", "variant": "outlined", "margin": (8, 4)}


class RecordingPart:
    """Records from X-Plane over the network.

    Parameters
    ----------
    session
        Session that then runs the mission.
    """

    def __init__(self, session: Session) -> None:
        self._document = pn.state.curdoc
        self._recorder: XPlaneRecorder | None = None
        self._watch: Any = None
        self._closed = False
        self._host = pmui.TextInput(label="Host", value="127.0.0.1", **_FIELD, **layout_width(200))
        self._port = pmui.TextInput(label="Port", value=str(PORT), **_FIELD, **layout_width(110))
        self._rate = pmui.TextInput(label="Rate [Hz]", value="50", **_FIELD, **layout_width(110))
        self._start = pmui.Button(label="Start", icon="fiber_manual_record", color="error", margin=(10, 4))
        self._start.on_click(lambda _event: self._begin())
        self._stop = pmui.Button(label="Stop", icon="stop", margin=(10, 4), disabled=True)
        self._stop.on_click(lambda _event: self._end())
        self._counter = pn.pane.HTML("", margin=(16, 8), styles={"font-variant-numeric": "tabular-nums"})
        self._job = Job()
        self._draft = Draft(session)
        note = wide_html(
            "<p>X-Plane sends position and attitude on request. Allow incoming connections in X-Plane "
            "(Settings, Network).</p>",
            margin=(0, 6),
            styles={"opacity": "0.7", "font-size": "13px"},
        )
        self.view = whole_column(
            fields_row(self._host, self._port, self._rate, self._start, self._stop, self._counter),
            note,
            self._job.view,
            self._draft.view,
        )

    def refresh(self) -> None:
        """Do nothing: this part does not depend on the missions."""

    def close(self) -> None:
        """End the recording and its draft."""
        self._closed = True
        if self._recorder is not None:
            self._recorder.close()
        self._job.close()
        self._draft.close()

    def _begin(self) -> None:
        host = str(self._host.value_input or self._host.value).strip()
        port, rate = number(str(self._port.value)), number(str(self._rate.value))
        if isinstance(port, str) or isinstance(rate, str) or not port.is_integer():
            self._job.say("Port and rate must be numbers, such as port 49000 and 50 Hz.")
            return

        def work(_progress: Progress) -> XPlaneRecorder:
            recorder = XPlaneRecorder(host, int(port), rate)  # resolves the host name
            recorder.start()
            if self._closed:
                recorder.close()
            return recorder

        if not self._job.busy:
            self._job.start("Sending a request to X-Plane", work, self._started)

    def _started(self, recorder: XPlaneRecorder) -> None:
        self._recorder = recorder
        self._start.disabled, self._stop.disabled = True, False
        assert self._document is not None
        self._watch = self._document.add_periodic_callback(self._report, TELL)
        self._report()

    def _report(self) -> None:
        recorder = self._recorder
        if recorder is not None:
            self._counter.object = f"<b>{recorder.seconds:.1f} s</b>, {recorder.samples} samples"
            self._job.say(recorder.problem, "warning")

    def _end(self) -> None:
        recorder, self._recorder = self._recorder, None
        self._unwatch()
        self._start.disabled, self._stop.disabled = False, True
        self._job.say("")
        if recorder is not None:
            self._job.start("Ending the recording", lambda _progress: recorder.stop(), self._recorded)

    def _unwatch(self) -> None:
        if self._watch is not None and self._document is not None:
            self._document.remove_periodic_callback(self._watch)
        self._watch = None

    def _recorded(self, raw: RawFlight) -> None:
        self._draft.accept(raw, "xplane", "Flight in X-Plane")
