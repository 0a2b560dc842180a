"""The live navigator: when it starts, coasts, stops and begins again, and what it says."""

from __future__ import annotations

from itertools import repeat

import numpy as np
import pytest
from live_batch import NO_FIXES, TOLERANCE, navigator, solution_of, suite
from live_rows import HOST, RATE, driven, feed

from lab.base.parameters.setting_error import SettingError
from lab.data.log.sensor_log import MIN_OVERLAP
from lab.data.streams.axis_map import AxisMap
from lab.live import live_navigator
from lab.live.live_navigator import LiveNavigator
from lab.live.live_state import HistoryCursor
from lab.live.live_stream import POSITION_LIMIT
from lab.live.live_view import COASTS_AFTER
from lab.live.simulated.simulated_flight import SimulatedFlight
from lab.motion.frames.rotation import wrap
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings


def test_fixes_that_stop_let_it_coast_until_the_position_means_nothing():
    imu, fixes, _ = driven()
    more = np.concatenate((imu, imu[-2000:], imu[-2000:], imu[-2000:], imu[-2000:]))
    more["time"] = more["arrival"] = HOST + np.arange(1, more.size + 1) / 100
    live = navigator(kept=60.0)
    early = fixes[fixes["time"] < HOST + 50]
    seen = {}
    for start in range(0, more.size, 100):
        part = more[start : start + 100]
        due = (early["arrival"] <= part["time"][-1]) & (early["arrival"] > part["time"][0] - 0.01)
        live.feed(part, early[due])
        state = live.state
        seen.setdefault(state.phase, (state.time - HOST, state))
    age = seen["coasting"][0] - 50
    assert COASTS_AFTER - 0.5 < age < COASTS_AFTER + 1.5
    assert "last fix" in seen["coasting"][1].reason
    last = live.state
    assert last.phase == "attitude only"
    assert f"up to {POSITION_LIMIT:g} m" in last.reason
    assert np.isnan(last.position).all()
    assert np.isfinite(last.euler).all()
    assert seen["coasting"][1].position_sigma[0] > seen["navigating"][1].position_sigma[0] * 0.5


def test_a_wait_longer_than_the_memory_starts_later():
    """The vehicle stands for longer than samples are kept: the start moves with the oldest ones."""
    imu, fixes, _ = driven()
    wait = 100.0
    count = round(wait * 100)
    before = np.concatenate([imu[:1900]] * 6)[:count]
    standing_fixes = np.concatenate([fixes[:72]] * 6)[: round(wait * 4)]
    rows = np.concatenate((before, imu))
    rows["time"] = rows["arrival"] = HOST + np.arange(1, rows.size + 1) / 100
    fixes["time"] += wait
    known = np.concatenate((standing_fixes, fixes))
    known["time"][: standing_fixes.size] = HOST + 0.1 + 0.25 * np.arange(standing_fixes.size)
    known["arrival"] = known["time"]
    live = navigator(kept=60.0)
    keeper = []
    for start in range(0, rows.size, 100):
        part = rows[start : start + 100]
        due = (known["time"] <= part["time"][-1]) & (known["time"] > part["time"][0] - 0.01)
        live.feed(part, known[due])
        if live.alignment is not None and not keeper:
            keeper.append(live.log())
            run = navigate_log(keeper[0], suite(), NavigatorSettings(vehicle="car"), start=live.alignment)
            mine = solution_of(live)
            assert mine.time.size == run.imu.time.size < 62 * 100
            assert np.abs(mine.velocity_n - run.solution.velocity_n).max() < TOLERANCE
            assert np.abs(mine.q_nb - run.solution.q_nb).max() < TOLERANCE
    assert keeper[0].epoch > HOST + 55
    assert live.alignment.rest > 50
    assert live.state.phase == "navigating"


def test_after_a_long_outage_it_starts_again(monkeypatch):
    """Without fixes the position is lost; with them the navigator aligns again, from the heading it kept."""
    imu, fixes, trajectory = driven(late=0.0)
    out = (fixes["time"] > HOST + 24) & (fixes["time"] < HOST + 70)
    monkeypatch.setattr(live_navigator, "STOPS_AT", 30.0)  # reached within 46 s instead of minutes
    live = navigator()
    phases = []
    for start in range(0, imu.size, 100):
        part = imu[start : start + 100]
        due = ~out & (fixes["time"] <= part["time"][-1]) & (fixes["time"] > part["time"][0] - 0.01)
        live.feed(part, fixes[due])
        if not phases or phases[-1] != live.state.phase:
            phases.append(live.state.phase)
    assert phases[-1] == "navigating"
    assert "attitude only" in phases[phases.index("coasting") :]
    assert "stopped, since the σ of the position" in " ".join(live.state.remarks)
    true = trajectory.at(np.array([live.state.time - HOST]))
    assert abs(wrap(live.state.euler[2] - true.euler[0, 2])) < 3 * live.state.euler_sigma[2]


def test_memory_is_bounded_and_a_history_is_read_once():
    imu, fixes, _ = driven(late=0.2)
    live = navigator(kept=60.0)
    feed(live, imu, fixes, repeat(50))
    assert solution_of(live).time.size < 62 * 100
    assert solution_of(live).time[-1] == pytest.approx(imu["time"][-1] - imu["time"][0])
    cursor, first = live.since()
    assert first.time.size > 20 * 60
    assert first.innovation.shape[0] == live.state.fixes_used
    again, nothing = live.since(cursor)
    assert again == cursor
    assert nothing.time.size == nothing.fix_time.size == 0
    assert live.since(HistoryCursor(10, 5))[1].time[0] == first.time[10]
    assert (np.diff(first.time) > 0).all()


def test_other_axes_begin_the_navigation_again():
    flight = SimulatedFlight.of("rest", RATE, rest=40.0)
    imu, _ = flight.timed()
    truth = np.degrees(flight.result.truth_arrays.euler[0])
    device = AxisMap.of("y,-x,z")  # turned by 90° about the vertical
    later = imu["time"] > 20
    imu["rate"][~later] = device.mapped(imu["rate"][~later])
    imu["force"][~later] = device.mapped(imu["force"][~later])
    live = navigator()
    live.feed(imu[~later])
    before = np.degrees(live.state.euler[:2])
    assert np.abs(before - truth[:2]).max() > 3
    live.restart("The axes were changed")
    live.feed(imu[later])
    assert np.abs(np.degrees(live.state.euler[:2]) - truth[:2]).max() < 1
    assert "The axes were changed, so the navigator aligned again." in live.state.remarks


def test_settings_that_a_stream_cannot_use_are_refused():
    for settings in ({"model": "nonlinear"}, {"engine": "filterpy"}):
        with pytest.raises(SettingError, match="accepted for a stream"):
            LiveNavigator(suite(), NavigatorSettings(**settings))


def test_nothing_came():
    live = navigator()
    live.feed(NO_FIXES[:0], NO_FIXES)
    live.finish()
    assert (live.state.phase, live.since()[1].time.size) == ("waiting", 0)
    assert "waits for samples" in live.state.reason


def test_a_start_is_sought_as_soon_as_the_imu_and_the_receiver_have_enough_in_common():
    """At whole times, which have no rounding: after exactly 5 s, no 5 s are missing."""
    imu, fixes, _ = driven(period=1.0)
    fixes["time"] = fixes["arrival"] = HOST + 12.0 + np.arange(fixes.size)
    said = {}
    for last in (5, 6):
        live = navigator()
        live.feed(imu[: 1100 + 100 * last], fixes[:last])
        said[last] = live.state.reason
    assert f"IMU and GPS have 4 s in common; it takes {MIN_OVERLAP:g} s" in said[5]
    assert "in common" not in said[6]


def test_the_course_of_an_unknown_vehicle_is_compared_first():
    imu, fixes, _ = driven()
    live = navigator(vehicle="auto")
    said = set()
    for start in range(0, 4500, 100):
        part = imu[start : start + 100]
        due = (fixes["time"] <= part["time"][-1]) & (fixes["time"] > part["time"][0] - 0.01)
        live.feed(part, fixes[due])
        if 30 <= live.state.time - HOST < 40:
            said.add(live.state.reason)
            assert live.state.position_sigma[0] == pytest.approx(0.5)  # that of the fix
            assert live.state.reason.startswith("The position is that of the last fix. The fixes show")
    assert all("unknown vehicle (navigator.vehicle) is compared" in reason for reason in said)
    assert live.state.phase == "navigating"
