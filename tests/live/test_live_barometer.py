"""A barometer in a stream: the live navigator uses its pressures as the batch does those of the log."""

from __future__ import annotations

import numpy as np
import pytest
from live_batch import assert_equal, follow, navigator, random_pieces, recorded, suite
from live_rows import driven, feed

import lab.live
from lab.data.clock.timed_samples import TIMED_IMU
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.data.files.sensor_log_writer import write_sensor_log
from lab.data.log.pressure_height import Heights, height_of, pressure_at
from lab.data.streams.live_log import make_log
from lab.data.streams.recorded_log import log_of_recording
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite


def fitted() -> SensorSuite:
    """Return sensors with a barometer."""
    sensors = suite()
    sensors.barometer.fitted = True
    return sensors


@pytest.mark.parametrize(
    ("height", "pressure"),
    [(0, 101325.0), (1000, 89874.6), (5000, 54019.9), (11000, 22632.1), (-1000, 113929.0)],
)
def test_heights_are_those_of_the_standard_atmosphere(height: float, pressure: float) -> None:
    """Doc 7488 tabulates the pressure by geopotential height."""
    assert height_of(np.array([pressure]))[0] == pytest.approx(height, abs=0.1)
    assert pressure_at(np.array([height]))[0] == pytest.approx(pressure, rel=1e-5)


def test_one_reading_a_second_is_used_and_bad_ones_are_not() -> None:
    rows = np.zeros(500, TIMED_IMU)
    rows["time"], rows["pressure"] = 100.005 + np.arange(500) / 100, 95000.0
    rows["pressure"][100:150], rows["pressure"][250] = np.nan, 0.0
    rows["time"][320] = 0.0  # a row that is late
    whole, pieces = Heights(), Heights()
    time, height = whole.accept(rows)
    np.testing.assert_allclose(time, [100.005, 101.505, 102.005, 103.005, 104.005])
    parts = [pieces.accept(rows[a : a + 7]) for a in range(0, 500, 7)]
    np.testing.assert_array_equal(np.concatenate([part[0] for part in parts]), time)
    whole.begin_at(102.9, 300.0, time, height)
    whole.begin_at(104.9, 999.0, time, height)
    assert height[2] + whole.shift == pytest.approx(300.0)


@pytest.mark.proof
@pytest.mark.parametrize(
    ("seed", "late", "settings"),
    [(1, 0.2, {}), (3, 1.7, {"latency": 0.15, "aiding_scale": 4.0}), (4, 0.2, {"correction": "feedforward"})],
)
def test_it_equals_the_batch(seed: int, late: float, settings: dict, tmp_path) -> None:
    imu, fixes, _ = driven(late=late)
    rng = np.random.default_rng(seed)
    imu["pressure"] = pressure_at(187.0 + 0.3 * rng.normal(size=imu.size))
    imu["pressure"][2000:2500] = np.nan
    live = navigator(sensors=fitted(), **settings)
    feed(live, imu, fixes, random_pieces(seed))
    log = make_log("replay", imu, fixes, vehicle="car", latency=settings.get("latency", 0.0))
    whole = NavigatorSettings(vehicle="car", **settings)
    run = navigate_log(log, fitted(), whole, start=live.alignment)
    assert run.solution.states == 16
    assert (run.solution.aid_sample >= 0).sum() > 70
    assert_equal(live, run)
    without = navigate_log(log, suite(), whole, start=live.alignment)
    assert run.solution.variance[-1, 2] < 0.95 * without.solution.variance[-1, 2]
    np.testing.assert_array_equal(live.log().auxiliary.barometer.value, log.auxiliary.barometer.value)
    assert "Barometer: the last innovation is" in " ".join(live.state.remarks)
    write_sensor_log(tmp_path / "drive", log, title="Drive")
    again = read_sensor_log(tmp_path / "drive").auxiliary.barometer
    np.testing.assert_allclose(again.value, log.auxiliary.barometer.value, atol=1e-3)


def test_following_a_device_with_a_barometer_equals_the_batch_on_its_recording(tmp_path) -> None:
    path = recorded(tmp_path / "flight.inslab")
    live = navigator(sensors=fitted())
    with lab.live.open(f"replay:{path}?speed=max") as source:
        follow(live, source)
    run = navigate_log(
        log_of_recording(path), fitted(), NavigatorSettings(vehicle="car"), start=live.alignment
    )
    assert (run.solution.aid_sample >= 0).sum() > 30
    assert_equal(live, run)


def test_pressures_that_are_not_used_and_wanted_ones_that_are_missing_are_told() -> None:
    imu, fixes, _ = driven(late=0.2)
    missing = navigator(sensors=fitted())
    feed(missing, imu[:3000], fixes[:20], random_pieces(1))
    assert "no pressure for sensors.barometer.fitted" in " ".join(missing.state.remarks)
    imu["pressure"] = 95000.0
    unused = navigator()
    feed(unused, imu[:3000], fixes[:20], random_pieces(1))
    assert "sensors.barometer.fitted = true uses them" in " ".join(unused.state.remarks)
