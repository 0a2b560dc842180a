"""The live navigator and the batch: one solution of the same data."""

from __future__ import annotations

from itertools import repeat

import numpy as np
import pytest
from live_batch import assert_equal, follow, navigator, random_pieces, recorded, solution_of, suite
from live_rows import HOST, driven, feed

import lab.live
from lab.data.streams.live_log import make_log
from lab.data.streams.recorded_log import log_of_recording
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings


@pytest.mark.proof
@pytest.mark.parametrize(
    ("pieces", "late", "settings"),
    [
        (lambda: repeat(1), 0.2, {}),
        (lambda: random_pieces(1), 0.2, {}),
        (lambda: repeat(8000), 0.0, {}),
        (lambda: random_pieces(3), 1.7, {"lever_arm": (1.0, -0.5, -1.2)}),
        (lambda: random_pieces(4), 0.2, {"gate": 0.9}),
        (lambda: random_pieces(5), 0.2, {"correction": "feedforward", "rest_updates": False}),
        (lambda: random_pieces(6), 0.2, {"correction_period": 3.0}),
    ],
)
def test_it_equals_the_batch(pieces, late, settings):
    imu, fixes, _ = driven(late=late, lever_arm=settings.get("lever_arm", (0.0, 0.0, 0.0)))
    live = navigator(**settings)
    feed(live, imu, fixes, pieces())
    log = make_log("replay", imu, fixes, settings.get("lever_arm"), vehicle="car")
    whole = NavigatorSettings(vehicle="car", **settings)
    assert_equal(live, navigate_log(log, suite(), whole, start=live.alignment))
    # The batch sees the whole log, and finds the same start here.
    assert_equal(live, navigate_log(log, suite(), whole))
    own = live.log()
    np.testing.assert_array_equal(own.time, log.time)
    np.testing.assert_array_equal(own.dtheta, log.dtheta)
    np.testing.assert_array_equal(own.gnss.velocity_sigma, log.gnss.velocity_sigma)
    if settings.get("rest_updates", True):
        assert solution_of(live).variance[6500, 9:12].max() < np.radians(0.01) ** 2  # at rest, the bias shows


@pytest.mark.parametrize("settings", [{"filter_rate": 20.0}, {"model": "invariant"}])
def test_it_equals_the_batch_with_another_kernel(settings):
    imu, fixes, _ = driven(late=0.2)
    live = navigator(**settings)
    feed(live, imu[:6000], fixes[fixes["time"] < HOST + 59], random_pieces(1))
    log = make_log("replay", imu[:6000], fixes[fixes["time"] < HOST + 59], vehicle="car")
    whole = NavigatorSettings(vehicle="car", **settings)
    assert_equal(live, navigate_log(log, suite(), whole, start=live.alignment))


def test_stamps_that_are_late_are_brought_to_their_time():
    imu, fixes, _ = driven()
    fixes["time"] += 0.15
    fixes["arrival"] += 0.15
    live = navigator(latency=0.15)
    feed(live, imu, fixes, random_pieces(1))
    log = make_log("replay", imu, fixes, latency=0.15, vehicle="car")
    assert_equal(live, navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment))
    assert np.abs(np.mean(solution_of(live).innovation[120:190, :2], axis=0)).max() < 0.3


@pytest.mark.parametrize("axes", [(2,), (0, 1, 2)])
def test_velocities_that_the_receiver_does_not_measure(axes):
    imu, fixes, _ = driven(late=0.2)
    for axis in axes:
        fixes["velocity_n"][:, axis] = np.nan
    fixes["velocity_n"][100, 2] = np.nan
    live = navigator(gate=0.99)
    feed(live, imu, fixes, random_pieces(1))
    log = make_log("replay", imu, fixes, vehicle="car")
    whole = NavigatorSettings(vehicle="car", gate=0.99)
    assert_equal(live, navigate_log(log, suite(), whole, start=live.alignment))
    assert np.isnan(solution_of(live).innovation[:, 5]).all()


def test_rows_that_cannot_be_used_are_counted_and_change_nothing():
    imu, fixes, _ = driven(late=0.2)
    bad = np.concatenate((imu[:3000], imu[2990:3000], imu[3000:]))  # ten rows again
    bad["rate"][4000, 1] = np.nan
    bad["time"][5000] = np.nan
    broken = np.insert(fixes, [40, 80], fixes[[39, 80]])
    broken["latitude"][80] = np.nan
    live = navigator()
    feed(live, bad, broken, random_pieces(1))
    state = live.state
    assert (state.rows.late, state.rows.unusable, state.fixes_refused) == (10, 2, 3)
    assert "3 fixes were not used" in " ".join(state.remarks)
    log = make_log("replay", bad, broken, vehicle="car")
    assert_equal(live, navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment))


@pytest.mark.proof
def test_a_polled_sensor_repeats_samples():
    imu, fixes, _ = driven(late=0.2)
    doubled = np.repeat(imu, np.tile((1, 2, 3), 3000))
    doubled["time"] = HOST + np.arange(1, doubled.size + 1) / 200
    doubled["arrival"] = doubled["time"]
    doubled[9000:9040] = doubled[9000]  # a sensor that is stuck
    doubled["time"] = HOST + np.arange(1, doubled.size + 1) / 200
    live = navigator()
    feed(live, doubled, fixes, random_pieces(1, 9))
    log = make_log("replay", doubled, fixes, vehicle="car")
    assert live.state.rows.repeated == doubled.size - log.time.size > 8000
    assert_equal(live, navigate_log(log, suite(), NavigatorSettings(vehicle="car"), start=live.alignment))


def test_following_a_replay_equals_the_batch_on_the_recorded_log(tmp_path):
    path = recorded(tmp_path / "flight.inslab")
    live = navigator()
    with lab.live.open(f"replay:{path}?speed=max") as source:
        follow(live, source)
    assert live.state.phase == "navigating"
    settings = NavigatorSettings(vehicle="car")
    assert_equal(live, navigate_log(log_of_recording(path), suite(), settings, start=live.alignment))
