"""The status line says what the navigator did with the samples, and renders no mark-up."""

from __future__ import annotations

from dashboards.pages.live.status_line import StatusLine
from lab.data.streams.intake import Counts
from lab.data.streams.source_status import LOST, STREAMING, Status
from lab.live.live_state import LiveState

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


def test_a_drift_is_shown_with_its_sigma_once_that_is_small() -> None:
    line, state = StatusLine(), LiveState(phase="navigating", reason="With fixes.")
    for sigma in (float("nan"), float("inf"), 4e-3):
        line.show(Status(STREAMING, "Streaming.", drift=-4e-3, drift_sigma=sigma), state, "", "")
        assert "ppm" not in line.view.object
    line.show(Status(STREAMING, "Streaming.", drift=1.23e-5, drift_sigma=2.5e-6), state, "", "")
    assert "+12.3 ± 2.5 ppm" in line.view.object


def test_spikes_are_counted() -> None:
    line = StatusLine()
    for spikes in (0, 7):
        state = LiveState(phase="navigating", reason="With fixes.", rows=Counts(spikes=spikes))
        line.show(Status(STREAMING, "Streaming."), state, "", "")
        assert ("Spikes</span> <b class=bad>7<" in line.view.object) == (spikes == 7)
