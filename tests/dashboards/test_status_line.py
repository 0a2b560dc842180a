"""The status line says what the navigator did with the samples, and renders no mark-up."""

from __future__ import annotations

from dashboards.pages.live.status_line import StatusLine
from lab.live.live_state import LiveState
from lab.live.source_status import STREAMING, Status

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
