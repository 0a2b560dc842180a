"""The status strip, its one hint and its folded details; the large digits of the attitude; no mark-up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashboards.pages.live.attitude_readout import UNKNOWN, AttitudeReadout
from dashboards.pages.live.status_line import StatusLine
from lab.data.streams.intake import Counts
from lab.data.streams.reception import Loss
from lab.data.streams.source_status import ENDED, LOST, STALE, STREAMING, Status
from lab.live.live_start import HOW
from lab.live.live_state import ALIGNING, ATTITUDE_ONLY, COASTING, NAVIGATING, LiveState

FILLED = "1 gap of the IMU was filled linearly with 20 samples; the filter got large variances there."
NAVIGATES = LiveState(phase=NAVIGATING, reason="With fixes.")
CONSISTENT = "Consistent: the innovations are white."


def opened() -> StatusLine:
    """Return a line whose details are open."""
    line = StatusLine()
    line.show(Status(STREAMING, "Streaming."), NAVIGATES, "", "")
    line._turn()
    return line


def test_what_the_navigator_remarks_is_in_the_details() -> None:
    line = opened()
    state = LiveState(phase=NAVIGATING, reason="With fixes.", remarks=(FILLED, "<img src=x>"))
    line.show(Status(STREAMING, "Streaming."), state, "", "", "<b>car")
    assert FILLED in line.details.object
    assert "&lt;img src=x&gt;" in line.details.object
    assert "&lt;b&gt;car" in line.details.object
    assert "<img" not in line.details.object
    line.show(Status(STREAMING, "Streaming."), NAVIGATES, "", "")
    assert "gap" not in line.details.object
    line._turn()
    line.show(Status(STREAMING, "Streaming."), state, "", "")
    assert "gap" not in line.details.object  # what is folded costs nothing
    assert not line.details.visible


def test_the_state_stands_once_and_settings_have_the_names_of_their_fields() -> None:
    line = opened()
    state = LiveState(phase=ALIGNING, reason="The heading may be given (navigator.initial_heading).")
    line.show(Status(LOST, "Lost: no such file; it is tried again."), state, "", "")
    assert ">lost<" in line.strip.object
    assert line.hint.object == "<p>No such file; it is tried again.</p>"
    assert "(“Navigator and filter: Initial heading of a log or stream”)" in line.details.object
    line.show(Status(STREAMING, "Streaming."), NAVIGATES, "navigator.nonsense", "")
    assert "navigator.nonsense" in line.hint.object  # no setting


def test_the_strip_has_rates_latency_and_losses() -> None:
    line = StatusLine()
    status = Status(STREAMING, "Streaming.", samples=900, fixes=9, rate=99.98, fix_rate=1.0, latency=0.025)
    line.show(status, NAVIGATES, "", "")
    for words in ("streaming", "100 Hz", "1 fix/s", "25 ms", "0 lost"):
        assert words in line.strip.object
    assert "bad" not in line.strip.object
    state = LiveState(phase=NAVIGATING, reason="", rows=Counts(spikes=7))
    line.show(Status(STREAMING, "Streaming.", samples=9, loss=Loss(3, 0, 0, 1)), state, "", "")
    for words in ("3 lost", "7 spikes", "1 clock change<", "no fixes"):
        assert words in line.strip.object
    assert "corrupt" not in line.strip.object
    assert "0 lost" not in line.strip.object
    line.show(
        replace(status, interruptions=2), NAVIGATES, "", ""
    )  # what went while it was unplugged is unknown
    assert "2 interruptions" in line.strip.object
    assert "0 lost" not in line.strip.object


@pytest.mark.parametrize(
    ("status", "phase", "shown"),
    [
        (Status(STREAMING, "Streaming."), NAVIGATING, CONSISTENT),
        (Status(STREAMING, "Streaming."), ALIGNING, "It moves."),
        (Status(STREAMING, "Streaming."), COASTING, "It moves."),
        (Status(STREAMING, "Streaming.", warning="The disk is full."), NAVIGATING, "The disk is full."),
        (Status(STALE, "No data for 0.7 s."), NAVIGATING, "No data for 0.7 s."),
        (Status(ENDED, "The flight has ended."), NAVIGATING, "The flight has ended."),
        (Status(ENDED, "Closed."), ALIGNING, "Closed."),
    ],
)
def test_one_hint_at_a_time_and_no_verdict_on_what_is_not_navigated(
    status: Status, phase: str, shown: str
) -> None:
    line = StatusLine()
    line.show(status, LiveState(phase=phase, reason="It moves."), CONSISTENT, "")
    assert shown in line.hint.object
    others = {"It moves.", CONSISTENT} - {shown}
    assert not any(one in line.hint.object for one in others)
    line.show(status, LiveState(phase=phase, reason="It moves."), CONSISTENT, "The navigator failed.")
    assert "failed" in line.hint.object
    line.say("Disconnected.")
    assert not line.strip.visible
    assert "Disconnected." in line.hint.object


def test_the_hint_is_one_sentence_and_the_details_have_them_all() -> None:
    line = opened()
    unknown = f"The position is that of the last fix. The heading is unknown: {HOW}. The heading is relative."
    line.show(Status(STREAMING, "Streaming."), LiveState(phase=ATTITUDE_ONLY, reason=unknown), "", "")
    assert line.hint.object == (
        "<p><b>Attitude only</b> The heading is unknown: the vehicle must move faster than 1 m/s.</p>"
    )
    assert "The heading is relative." in line.details.object
    late = Status(STREAMING, "Streaming. The device delivers 0.3 s late.")
    line.show(late, NAVIGATES, CONSISTENT, "")
    assert CONSISTENT in line.hint.object
    assert "The device delivers 0.3 s late." in line.hint.object
    old = "The last fix is 40 s old."
    line.show(Status(STREAMING, "Streaming."), LiveState(phase=ATTITUDE_ONLY, reason=old), "", "")
    assert old in line.hint.object


def test_a_drift_is_shown_with_its_sigma_once_that_is_small() -> None:
    line = opened()
    for sigma in (float("nan"), float("inf"), 4e-3):
        line.show(Status(STREAMING, "Streaming.", drift=-4e-3, drift_sigma=sigma), NAVIGATES, "", "")
        assert "ppm" not in line.details.object
    line.show(Status(STREAMING, "Streaming.", drift=1.23e-5, drift_sigma=2.5e-6), NAVIGATES, "", "")
    assert "+12.3 ± 2.5 ppm" in line.details.object


def test_the_attitude_is_read_out_with_its_sigma_and_a_dash_stands_for_what_is_unknown() -> None:
    readout = AttitudeReadout()
    assert not readout.view.visible
    readout.show(LiveState(phase=ALIGNING, reason=""), STREAMING)
    assert readout.view.object.count(f"<b>{UNKNOWN}</b>") == 3
    assert "σ" not in readout.view.object

    euler, sigma = np.radians([-0.01, -3.16, -0.02]), np.radians([0.1234, 1.26, 200.0])
    readout.show(LiveState(phase=ATTITUDE_ONLY, reason="", euler=euler, euler_sigma=sigma))
    for words in ("<b>0.0°</b>", "σ 0.12°", "<b>\u22123.2°</b>", "σ 1.3°", f"<b>{UNKNOWN}</b><span>Heading"):
        assert words in readout.view.object

    # North is 0, not 360, and decimals that mean nothing are left out.
    for spread, heading in ((0.5, "0.0°"), (12.0, "0°")):
        sigma[2] = np.radians(spread)
        known = LiveState(phase=NAVIGATING, reason="", euler=euler, euler_sigma=sigma)
        readout.show(known)
        assert f"<b>{heading}</b><span>Heading" in readout.view.object
    assert "stands" not in readout.view.object
    readout.show(known, LOST)
    assert "stands" in readout.view.object
    readout.show(known, ENDED)
    assert readout.view.object.count(f"<b>{UNKNOWN}</b>") == 3
    readout.clear()
    assert not readout.view.visible
