"""Zero velocity in a stream: where the IMU shows a rest, the live navigator uses it as the batch does."""

from __future__ import annotations

from itertools import repeat

import numpy as np
import pytest
from live_batch import assert_equal, navigator, random_pieces, suite
from live_rows import HOST, driven, feed

from lab.data.log.pressure_height import pressure_at
from lab.data.streams.live_log import make_log
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings


@pytest.mark.proof
@pytest.mark.parametrize(
    ("pieces", "barometer", "settings"),
    [
        (lambda: random_pieces(1), False, {}),
        (lambda: repeat(8000), False, {"rest_updates": False, "zero_velocity_sigma": 0.005}),
        (lambda: random_pieces(2), True, {"rest_updates": False}),
    ],
)
def test_it_equals_the_batch(pieces, barometer, settings) -> None:
    """At rest until 20 s and from 50 to 70 s, here without fixes from 62 to 80 s."""
    imu, fixes, _ = driven(late=0.2)
    imu["pressure"] = pressure_at(np.full(imu.size, 187.0))
    fixes = fixes[(fixes["time"] < HOST + 62) | (fixes["time"] > HOST + 80)]
    sensors = suite()
    sensors.barometer.fitted = barometer
    live = navigator(sensors=sensors, zero_velocity=True, **settings)
    feed(live, imu, fixes, pieces())
    log = make_log("replay", imu, fixes, vehicle="car")
    whole = NavigatorSettings(vehicle="car", zero_velocity=True, **settings)
    run = navigate_log(log, sensors, whole, start=live.alignment)
    at = run.aids.time[(run.aids.kind >= 4) & (run.aids.kind <= 6)]
    assert ((at > 63) & (at < 69)).sum() >= 15  # three a second, also without fixes
    assert not ((at > 21) & (at < 49)).any()
    assert not ((at > 72) & (at < 80)).any()
    assert_equal(live, run)
    without = navigate_log(log, sensors, NavigatorSettings(vehicle="car", **settings), start=live.alignment)
    moment = np.searchsorted(run.imu.time, 69.0)
    assert run.solution.variance[moment, 3] < 0.25 * without.solution.variance[moment, 3]
