"""The lane of events: of the shown result, found beside it, and a way to their times."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from bokeh.server.callbacks import TimeoutCallback
from panel.io.state import set_curdoc
from walking import PAUSE, Walk, walking

from dashboards.plot_tools import EventLane
from lab.experiment.experiment import Experiment

PATIENCE = 300.0
"""Longest wait for the events [s]; the first run compiles kernels."""


@pytest.fixture
def walk() -> Iterator[Walk]:
    """Return an open page."""
    with pytest.MonkeyPatch.context() as patch, walking(patch) as opened:
        yield opened


def show(walk: Walk, made: Experiment) -> None:
    """Show the result of an experiment."""
    walk.page.session.experiment = made.copy()
    assert walk.run(made).problem == ""


def settled(walk: Walk) -> EventLane:
    """Run what waits for its time, and return the lane with the events of what is shown."""
    lane = walk.page._time_bar._lane
    for one in [one for one in walk._document.session_callbacks if isinstance(one, TimeoutCallback)]:
        callback = one.callback
        walk._document.remove_timeout_callback(one)
        with set_curdoc(walk._document):
            callback()
    end = time.monotonic() + PATIENCE
    while lane._work.busy:
        assert time.monotonic() < end
        time.sleep(PAUSE)
    walk.settle()
    return lane


def test_the_lane_has_the_events_of_the_shown_result_and_a_press_goes_there(walk: Walk) -> None:
    made = Experiment(mission="los_angeles")
    made.set("trajectory.imu_rate", 50.0)
    show(walk, made)
    lane = settled(walk)
    assert not [one for one in lane.view.shown["events"] if one[0] == "outage"]
    assert [one for one in lane.view.shown["events"] if "turn" in one[0]]
    made.set("sensors.gps.outages", [(30.0, 40.0)])
    show(walk, made)
    lane = settled(walk)
    assert [one for one in lane.view.shown["events"] if one[0] == "outage"] == [
        ["outage", 30.0, 40.0, "outage"]
    ]
    with set_curdoc(walk._document):
        lane.view.asked = {"time": 30.0, "count": 1}
    assert walk.page.axis.time == 30.0


def test_events_of_another_flight_are_not_shown_meanwhile_and_no_result_is_kept(walk: Walk) -> None:
    made = Experiment(mission="los_angeles")
    made.set("trajectory.imu_rate", 50.0)
    show(walk, made)
    lane = settled(walk)
    assert lane.view.shown["events"]
    other = Experiment(mission="montreal")
    other.set("trajectory.imu_rate", 50.0)
    show(walk, other)
    assert lane.view.shown["events"] == []
    assert settled(walk).view.shown["events"]
    walk.page.session.release()
    lane._wait()  # as a run begins
    assert lane._result is None and not lane._work.busy
