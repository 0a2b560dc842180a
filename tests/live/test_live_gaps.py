"""Gaps: where samples of the IMU are missing, live navigator and batch have one solution, and say so."""

from __future__ import annotations

from itertools import repeat

import numpy as np
import pytest
from live_batch import (
    NO_FIXES,
    TOLERANCE,
    assert_equal,
    follow,
    navigator,
    random_pieces,
    recorded,
    solution_of,
    suite,
)
from live_rows import HOST, driven, feed

import lab.live
from lab.data.log.log_section import cut_section
from lab.data.streams.live_log import make_log
from lab.data.streams.recorded_log import log_of_recording, recorded_samples
from lab.motion.frames.displacement import metres_per_radian
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.sensors.cards import card
from lab.sensors.suite import SensorSuite


def lossy(rows: np.ndarray, seed: int, part: float) -> np.ndarray:
    """Drop a part of the rows, half of them in bursts of 2 to 30."""
    rng = np.random.default_rng(seed)
    kept = rng.random(rows.size) >= part / 2
    for start in rng.integers(0, rows.size, round(rows.size * part / 2 / 16)):
        kept[start : start + int(rng.integers(2, 31))] = False
    return rows[kept]


def shaken(rows: np.ndarray, seed: int, sigma: float) -> np.ndarray:
    """Let the stamps jitter [s], in their order."""
    rows = rows.copy()
    rows["time"] = np.sort(rows["time"] + np.random.default_rng(seed).normal(scale=sigma, size=rows.size))
    return rows


def without(rows: np.ndarray, start: float, end: float) -> np.ndarray:
    """Leave out the rows between two times from the first [s]."""
    return rows[(rows["time"] <= HOST + start) | (rows["time"] >= HOST + end)]


def another_rate(rows: np.ndarray) -> np.ndarray:
    """Send every fifth sample from 30 s on, and one of two lost."""
    late = np.flatnonzero(rows["time"] > HOST + 30)
    return np.concatenate((rows[: late[0]], rows[late[::5]]))


FAULTS = {
    "one gap": lambda rows: without(rows, 80.0, 81.0),
    "almost a break": lambda rows: without(rows, 26.0, 27.95),
    "before the first fix": lambda rows: without(rows, 0.05, 0.9),
    "at the end": lambda rows: without(rows, 85.0, 86.5),
    "lost": lambda rows: lossy(rows, 1, 0.05),
    "lost and shaken": lambda rows: shaken(lossy(rows, 2, 0.05), 2, 2e-3),
    "shaken much": lambda rows: shaken(rows, 3, 8e-3),
    "another rate": another_rate,
    "mostly lost": lambda rows: lossy(rows, 4, 0.6),
}
"""What happens to the rows of the IMU."""


@pytest.mark.proof
@pytest.mark.parametrize(
    ("fault", "states"),
    [*((fault, 15) for fault in FAULTS), *((fault, 21) for fault in ("almost a break", "lost and shaken"))],
)
def test_it_equals_the_batch_with_gaps(fault, states):
    imu, fixes, _ = driven(late=0.2)
    rows = FAULTS[fault](imu)
    live = navigator(states=states)
    feed(live, rows, fixes, random_pieces(1))
    counts = live.state.rows
    assert counts.gaps > 0
    assert counts.breaks == 0
    log = make_log("replay", rows, fixes, vehicle="car")
    assert counts.filled == log.time.size - rows.size
    settings = NavigatorSettings(vehicle="car", states=states)
    assert_equal(live, navigate_log(log, suite(), settings, start=live.alignment))


@pytest.mark.proof
@pytest.mark.parametrize(
    "settings",
    [
        {"latency": 0.15},
        {"latency": 0.15, "lever_arm": (1.0, -0.5, -1.2), "gate": 0.99},
        {"filter_rate": 40.0},
        {"correction_period": 3.0, "rest_updates": False},
    ],
)
def test_it_equals_the_batch_with_gaps_and_other_settings(settings):
    arm = settings.get("lever_arm", (0.0, 0.0, 0.0))
    imu, fixes, _ = driven(late=0.2, lever_arm=arm)
    fixes["time"] += settings.get("latency", 0.0)
    rows = shaken(lossy(imu, 5, 0.1), 5, 2e-3)
    live = navigator(**settings)
    feed(live, rows, fixes, random_pieces(2))
    log = make_log("replay", rows, fixes, arm, settings.get("latency", 0.0), "car")
    whole = NavigatorSettings(vehicle="car", **settings)
    assert_equal(live, navigate_log(log, suite(), whole, start=live.alignment))


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(2))
def test_the_pieces_in_which_samples_arrive_change_no_bit(seed):
    imu, fixes, _ = driven(late=0.2)
    rows = shaken(lossy(imu, seed, 0.1), seed, 3e-3)
    found = []
    for longest in (2, 150, 3000):
        live = navigator()
        feed(live, rows, fixes, random_pieces(seed, longest))
        found.append(solution_of(live))
    for other in found[1:]:
        np.testing.assert_array_equal(other.time, found[0].time)
        np.testing.assert_allclose(other.velocity_n, found[0].velocity_n, rtol=0, atol=1e-9)


def test_after_a_break_each_piece_equals_the_batch_on_it():
    imu, fixes, _ = driven(late=0.2)
    rows = without(imu, 40.0, 43.0)
    live = navigator()
    early = rows["time"] < HOST + 42
    feed(live, rows[early], fixes[fixes["time"] < HOST + 40], random_pieces(1))
    log = make_log("replay", rows, fixes, vehicle="car")
    assert len(log.breaks) == 1
    settings = NavigatorSettings(vehicle="car")
    first = cut_section(log, end=HOST + 40.0)
    assert_equal(live, navigate_log(first, suite(), settings, start=live.alignment))
    live = navigator()
    feed(live, rows, fixes, random_pieces(2))
    assert live.state.rows.breaks == 1
    second = cut_section(log, start=HOST + 43.0)
    assert_equal(live, navigate_log(second, suite(), settings, start=live.alignment))


@pytest.mark.proof
@pytest.mark.parametrize("name", ["ADIS16470", "MPU-6000"])
@pytest.mark.parametrize("states", [15, 21])
@pytest.mark.parametrize(("damage", "unplugged"), [(1e-3, 0.0), (0.0, 1.5), (1e-4, 3.0)])
def test_a_damaged_recording_replayed_equals_the_batch(tmp_path, name, states, damage, unplugged):
    path = recorded(tmp_path / "flight.inslab", name, damage=damage, unplugged=unplugged)
    sensors = SensorSuite()
    sensors.update(card(name).settings())
    live = navigator(sensors=sensors, vehicle="aeroplane", states=states)
    with lab.live.open(f"replay:{path}?speed=max") as source:
        follow(live, source)
    assert live.state.phase == "navigating"
    log, cut = log_of_recording(path), 0.0
    assert recorded_samples(path).imu.size < 7990
    if live.state.rows.breaks:
        # In motion, the start depends on when it is sought, and that on how fast the recording is read.
        cut = float(solution_of(live).time[0])
        log = cut_section(log, start=live.log().epoch + cut - 1e-3)
    else:
        assert live.state.rows.gaps > 0
    settings = NavigatorSettings(vehicle="aeroplane", states=states)
    assert_equal(live, navigate_log(log, sensors, settings, start=live.alignment), cut)


def test_a_short_gap_is_filled_as_in_a_log_and_marked():
    imu, fixes, trajectory = driven(late=0.2)
    rows = np.delete(imu, slice(8000, 8100))
    live = navigator()
    feed(live, rows, fixes, random_pieces(1))
    state = live.state
    assert (state.rows.gaps, state.rows.filled, state.rows.breaks) == (1, 100, 0)
    assert "1 gap" in " ".join(state.remarks)
    log = make_log("replay", rows, fixes, vehicle="car")
    np.testing.assert_allclose(live.log().gaps, log.gaps, atol=TOLERANCE)
    np.testing.assert_allclose(live.log().dtheta, log.dtheta, atol=1e-15)
    run = navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment)
    mine = solution_of(live)
    before = slice(0, 8000)
    np.testing.assert_array_equal(mine.q_nb[before], run.solution.q_nb[before])
    # In the gap the batch takes its noise from the whole log; both know little, and recover.
    sigma = np.sqrt(mine.variance[:, :3])
    whole = navigator()
    feed(whole, imu, fixes, repeat(200))
    assert np.sqrt(mine.variance[8098, 3:6] / solution_of(whole).variance[8098, 3:6]).max() > 1.5
    truth = trajectory.at(mine.time[8000:] + 0.01)
    miss = (mine.position[8000:] - np.stack((truth.latitude, truth.longitude, truth.height), axis=-1)) * [
        *map(float, metres_per_radian(truth.latitude[0], 0.0)), 1.0,
    ]  # fmt: skip
    assert (np.abs(miss) < 4 * sigma[8000:] + 0.05).all()


def test_a_long_gap_breaks_the_stream_and_is_said():
    imu, fixes, _ = driven(late=0.2)
    away = (imu["time"] > HOST + 48) & (imu["time"] < HOST + 53)
    live = navigator()
    feed(live, imu[~away], fixes, random_pieces(1))
    state = live.state
    assert state.rows.breaks == 1
    assert "silent for 5.0 s" in " ".join(state.remarks)
    assert state.phase == "navigating"
    assert live.log().epoch == pytest.approx(HOST + 53, abs=0.02)
    history = live.since()[1]
    assert not ((history.time > HOST + 48.1) & (history.time < HOST + 52.9)).any()


def test_a_clock_that_is_set_back_begins_a_new_stream():
    imu, _, _ = driven()
    again = imu[:4000].copy()
    live = navigator()
    feed(live, np.concatenate((imu[:4000], again)), NO_FIXES, random_pieces(1, 40))
    state = live.state
    assert 50 <= state.rows.late < 100
    assert "The clock was set back" in " ".join(state.remarks)
    assert state.time == pytest.approx(imu["time"][3999])
