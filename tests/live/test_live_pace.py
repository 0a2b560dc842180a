"""Live pace: states at a wanted rate, what they say beside the truth, and the same solution as ever."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_batch import assert_equal, suite
from live_rows import HOST, driven

from lab.data.streams.live_log import make_log
from lab.live.live_navigator import LiveNavigator
from lab.live.live_state import LiveState
from lab.live.outlets.publisher import sent_solution
from lab.live.pace import Pace
from lab.motion.frames.displacement import metres_per_radian
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings

UTC = 1_767_312_000.0
"""UTC at time 0 of the host's clock here [s]."""


def followed(step: float, **columns: Any) -> tuple[LiveNavigator, list[LiveState], Any]:
    """Return a navigator that was fed sample by sample for 40 s of a drive, its states, and the drive."""
    imu, fixes, trajectory = driven(late=0.2)
    for name, value in columns.items():
        fixes[name] = value
    live = LiveNavigator(suite(), NavigatorSettings(vehicle="car"), kept=1e6, step=step)
    states, fix = [], 0
    for k in range(4000):
        due = int(np.searchsorted(fixes["arrival"], imu["arrival"][k], "right"))
        if live.feed(imu[k : k + 1], fixes[fix:due]):
            states.append(live.state)
        fix = due
    live.finish()
    return live, states, trajectory


@pytest.fixture(scope="module")
def fine() -> tuple[LiveNavigator, list[LiveState], Any]:
    _, fixes, _ = driven(late=0.2)
    return followed(0.02, utc=fixes["time"] + UTC)


def test_states_come_at_the_wanted_rate_and_the_solution_is_that_of_the_batch(fine: Any) -> None:
    live, states, _ = fine
    times = np.array([state.time for state in states if state.phase != "waiting"])
    assert np.diff(np.unique(times)).max() == pytest.approx(0.02, abs=1e-6)
    imu, fixes, _ = driven(late=0.2)
    come = fixes[fixes["arrival"] <= imu["arrival"][3999]]
    whole = NavigatorSettings(vehicle="car")
    log = make_log("replay", imu[:4000], come, vehicle="car")
    assert_equal(live, navigate_log(log, suite(), whole, start=live.alignment))


def test_covariance_and_rates_are_those_of_the_motion(fine: Any) -> None:
    _, states, trajectory = fine
    found = [state for state in states if state.phase == "navigating" and state.time > HOST + 25]
    assert len(found) > 700
    times = np.array([state.time for state in found]) - HOST
    truth = trajectory.at(times)
    scale = np.array([*map(float, metres_per_radian(0.7854, 100.0)), -1.0])
    error = (np.array([state.position for state in found]) - truth.position) * scale
    P = np.array([state.position_covariance for state in found])
    np.testing.assert_allclose(P, P.swapaxes(1, 2))
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(P, axis1=1, axis2=2)), [state.position_sigma for state in found]
    )
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(P), error)
    assert 0.5 < np.median(nees) < 7  # 2.4 of three free errors; those of one drive go together
    A = np.array([state.attitude_covariance for state in found])
    assert (np.linalg.eigvalsh(A) > 0).all()
    rate, _ = trajectory.rates(times - 0.005)  # the mean over the last step of 10 ms
    seen = np.array([state.rate for state in found])
    assert np.sqrt(np.mean((seen - rate) ** 2, axis=0)) == pytest.approx([1e-3] * 3, rel=0.3)  # the noise


def test_utc_is_that_of_the_fixes_and_heights_are_above_what_they_say(fine: Any) -> None:
    _, states, _ = fine
    assert states[-1].utc_offset == pytest.approx(UTC, abs=1e-6)
    assert states[-1].is_above_sea is False
    assert sent_solution(states[-1]).utc == pytest.approx(states[-1].time + UTC)
    assert states[0].is_above_sea is None


@pytest.mark.parametrize("utc", [np.nan, 3600.0, 1e18, -5.0])
def test_a_time_of_day_is_no_date(utc: float) -> None:
    imu, fixes, _ = driven()
    fixes["utc"], fixes["sea_level"] = utc, 1
    live = LiveNavigator(suite(), NavigatorSettings(vehicle="car"))
    live.feed(imu[:100], fixes[:3])
    assert np.isnan(live.state.utc_offset)
    assert live.state.is_above_sea is True
    assert np.isnan(sent_solution(live.state).utc)
    assert sent_solution(live.state, by_computer=True).utc > UTC


@given(st.floats(0.5, 2.0), st.floats(0, 0.2), st.integers(0, 1000))
def test_the_mean_rate_is_kept_though_stamps_jitter(ratio: float, jitter: float, seed: int) -> None:
    period, rng = 0.02, np.random.default_rng(seed)
    step = period / ratio if ratio > 1 else period * ratio
    times = step * (np.arange(2000) + jitter * rng.uniform(-0.5, 0.5, 2000))
    pace = Pace(period)
    taken = [time for time in times.tolist() if pace.is_due(time)]
    assert len(taken) == pytest.approx(times[-1] / period, rel=0.03)
    assert np.diff(taken).max() < 2.1 * period


def test_a_clock_that_is_set_back_is_followed() -> None:
    pace = Pace(0.02)
    assert [pace.is_due(time) for time in (100.0, 100.02, 5.0, 5.01, 5.02)] == [True, True, True, False, True]
