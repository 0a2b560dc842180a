"""The status line says what the navigator did with the samples, and renders no mark-up."""

from __future__ import annotations

from dashboards.pages.live.status_line import StatusLine
from lab.live.live_state import LiveState
from lab.live.source_status import LOST, STREAMING, Status

FILLED = "1 gap of the IMU was filled linearly with 20 samples; the filter got large variances there."


def test_what_the_navigator_remarks_is_on_the_page() -> None:
    line = StatusLine()
    state = LiveState(phase="navigating", reason="With fixes.", remarks=(FILLED, "<img src=x>"))
    line.show(Status(STREAMING, "Streaming."), state, "", "")
    assert FILLED in line.view.object
    assert "&lt;img src=x&gt;" in line.view.object
    assert "<img" not in line.view.object
    line.show(Status(STREAMING, "Streaming."), LiveState(phase="navigating", reason="With fixes."), "", "")
    assert "gap" not in line.view.object


def test_the_state_stands_once_and_settings_have_the_names_of_their_fields() -> None:
    line = StatusLine()
    state = LiveState(phase="aligning", reason="The heading may be given (navigator.initial_heading).")
    line.show(Status(LOST, "Lost: no such file; it is tried again."), state, "navigator.nonsense", "")
    assert "Lost" not in line.view.object
    assert ">No such file; it is tried again." in line.view.object
    assert "(“Navigator and filter: Initial heading of a log or stream”)" in line.view.object
    assert "navigator.nonsense" in line.view.object  # no setting
