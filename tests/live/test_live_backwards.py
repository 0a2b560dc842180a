"""A live vehicle that begins backwards, as a car that leaves its place: its course is not its heading."""

from __future__ import annotations

from functools import cache
from itertools import repeat

import numpy as np
import pymap3d
import pytest
from live_batch import assert_equal, navigator, suite
from live_rows import HOST, RATE, driven, feed, ramp

from lab.data.streams.live_log import make_log
from lab.live.live_navigator import LiveNavigator
from lab.live.live_state import HistoryCursor
from lab.missions import Recording
from lab.motion.frames.rotation import wrap
from lab.motion.truth.trajectory import Trajectory
from lab.navigation.alignment import limits
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings

FORWARD = 40.0
"""Time at which the vehicle begins to move forward [s]."""


@cache
def departure(aside: float = np.pi, rest: float = 20.0) -> Trajectory:
    """Return a drive that begins with 8 s at 1.5 m/s along a direction relative to the heading [rad].

    It turns meanwhile. After a rest, it drives forward at 10 m/s, with turns.
    """
    time = np.arange(0, 90.01, 0.05)
    slow = 1.5 * (ramp(time, rest, 2) - ramp(time, 30, 2))
    fast = 10.0 * ramp(time, FORWARD, 6)
    heading = 0.6 + 0.5 * ramp(time, 23, 7) + 1.2 * ramp(time, 55, 6) - 0.9 * ramp(time, 70, 6)
    velocity = np.zeros((time.size, 3))
    for speed, course in ((slow, heading + aside), (fast, heading)):
        velocity[:, 0] += speed * np.cos(course)
        velocity[:, 1] += speed * np.sin(course)
    path = np.cumsum(np.vstack((np.zeros(3), 0.025 * (velocity[1:] + velocity[:-1]))), axis=0)
    latitude, longitude, _ = pymap3d.enu2geodetic(path[:, 1], path[:, 0], 0 * time, 45.0, -73.5, 100.0)
    recording = Recording(
        time=time,
        latitude=np.radians(latitude),
        longitude=np.radians(longitude),
        height=np.full(time.size, 100.0),
        velocity_n=velocity,
        euler=np.column_stack((np.full(time.size, 0.02), np.full(time.size, -0.03), heading)),
    )
    return Trajectory.from_recording(recording, RATE)


def heading_error(live: LiveNavigator, trajectory: Trajectory) -> float:
    """Return the error of the heading now [rad]."""
    state = live.state
    true = trajectory.at(np.array([state.time - HOST]))
    w, x, y, z = true.q_nb[0]
    return float(wrap(state.euler[2] - np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))))


@pytest.mark.proof
@pytest.mark.parametrize("vehicle", ["car", "aeroplane"])
@pytest.mark.parametrize(
    ("aside", "rest", "kept", "period"),
    [
        (np.pi, 20.0, 1e6, 0.25),
        (np.pi, 20.0, 1e6, 1.0),
        (np.pi, -2.0, 1e6, 0.25),  # it moves backwards from the first sample on
        (1.6, 20.0, 1e6, 0.25),  # it is carried
        (np.pi, 20.0, 60.0, 0.25),
    ],
)
def test_the_first_fast_course_shows_the_heading(vehicle, aside, rest, kept, period):
    trajectory = departure(aside, rest)
    imu, fixes, _ = driven(period=period, trajectory=trajectory)
    live = navigator(vehicle=vehicle, kept=kept)
    before = fixes[fixes["time"] < HOST + FORWARD]
    part = imu[imu["time"] < HOST + FORWARD]
    for start in range(0, part.size, 100):
        now = part["time"][start : start + 100]
        live.feed(
            part[start : start + 100], before[(before["time"] > now[0] - 0.01) & (before["time"] <= now[-1])]
        )
    assert live.state.phase == "navigating"
    if aside == np.pi:  # accelerations show the other one by now
        assert abs(heading_error(live, trajectory)) > 1.0
    assert "began again" not in " ".join(live.state.remarks)
    used, cursor = live.state.fixes_used, HistoryCursor()
    cursor, shown = live.since(cursor)
    assert shown.fix_time.size == used

    rest_imu, rest_fixes = imu[part.size :], fixes[before.size :]
    for start in range(0, rest_imu.size, 100):
        now = rest_imu["time"][start : start + 100]
        due = (rest_fixes["time"] > now[0] - 0.01) & (rest_fixes["time"] <= now[-1])
        live.feed(rest_imu[start : start + 100], rest_fixes[due])
        if now[-1] > HOST + FORWARD + 8:
            state = live.state
            assert abs(heading_error(live, trajectory)) < 3 * state.euler_sigma[2] + np.radians(0.5)
    assert f"above {limits.ALIGNMENT.forward_speed:g} m/s" in " ".join(live.state.remarks)
    # Each fix is counted and shown once, although the filter went over it twice.
    _, later = live.since(cursor)
    times = np.concatenate((shown.fix_time, later.fix_time))
    assert (np.diff(times) > 0).all()
    assert times.size == live.state.fixes_used + live.state.fixes_rejected


def test_from_then_on_it_equals_the_batch():
    imu, fixes, _ = driven(late=0.2, trajectory=departure())
    live = navigator()
    feed(live, imu, fixes, repeat(100))
    log = make_log("replay", imu, fixes, vehicle="car")
    assert_equal(live, navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment))


@pytest.mark.parametrize("settings", [{}, {"initial_heading": 34.4}])
def test_what_moves_forward_begins_once(settings):
    imu, fixes, _ = driven(trajectory=departure(0.0))
    live = navigator(**settings)
    starts = []
    for start in range(0, imu.size, 100):
        now = imu["time"][start : start + 100]
        live.feed(
            imu[start : start + 100], fixes[(fixes["time"] > now[0] - 0.01) & (fixes["time"] <= now[-1])]
        )
        if live.alignment is not None and (not starts or starts[-1] is not live.alignment):
            starts.append(live.alignment)
    assert len(starts) == 1
    assert "began again" not in " ".join(live.state.remarks)
