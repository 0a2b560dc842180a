"""A magnetometer in a stream: the live navigator uses its field as the batch does that of the log."""

from __future__ import annotations

import numpy as np
import pytest
from live_batch import assert_equal, navigator, random_pieces, suite
from live_rows import driven, feed
from scipy.spatial.transform import Rotation

from lab.data.files.sensor_log_csv import read_sensor_log
from lab.data.files.sensor_log_writer import write_sensor_log
from lab.data.streams.live_log import make_log
from lab.motion.frames.magnetic_field import magnetic_field
from lab.navigation.log_navigation import navigate_log
from lab.navigation.settings import NavigatorSettings
from lab.sensors.suite import SensorSuite

IRON = 0.03
"""What the iron of the vehicle adds, in parts of the field: a heading that is wrong by some 2°."""


def fitted(**settings) -> SensorSuite:
    """Return sensors with a magnetometer."""
    sensors = suite()
    sensors.heading.update({"fitted": True, "source": "magnetometer"} | settings)
    return sensors


def driven_with_field(seed: int, late: float = 0.2):
    """Return rows of the drive with the field of the Earth and of the vehicle's iron, and the trajectory."""
    imu, fixes, trajectory = driven(late=late)
    truth = trajectory.at(imu["time"] - 5000.0)
    first = np.array([fixes[name][0] for name in ("latitude", "longitude", "height")])
    field = magnetic_field(first) * 1e-6
    seen = Rotation.from_quat(truth.q_nb, scalar_first=True).inv().apply(field)
    noise = np.random.default_rng(seed).normal(scale=3e-7, size=seen.shape)
    imu["magnetic"] = seen + noise + (0.0, IRON * np.linalg.norm(field), 0.0)
    return imu, fixes, trajectory


@pytest.mark.proof
@pytest.mark.parametrize(
    ("seed", "late", "settings"),
    [(1, 0.2, {}), (3, 1.7, {"latency": 0.15, "aiding_scale": 4.0}), (4, 0.2, {"correction": "feedforward"})],
)
def test_it_equals_the_batch(seed: int, late: float, settings: dict, tmp_path) -> None:
    imu, fixes, _ = driven_with_field(seed, late)
    imu["magnetic"][2000:2500] = np.nan
    imu["magnetic"][3000:3250] = 0.0
    imu["force"][1234, 0] = 157.0  # a spike of the IMU leaves the field as it is
    live = navigator(sensors=fitted(), **settings)
    feed(live, imu, fixes, random_pieces(seed))
    log = make_log("replay", imu, fixes, vehicle="car", latency=settings.get("latency", 0.0))
    whole = NavigatorSettings(vehicle="car", **settings)
    run = navigate_log(log, fitted(), whole, start=live.alignment)
    assert run.solution.states == 16
    assert (run.solution.aid_sample >= 0).sum() > 70
    assert_equal(live, run)
    without = navigate_log(log, suite(), whole, start=live.alignment)
    assert run.solution.variance[-1, 8] < 0.95 * without.solution.variance[-1, 8]
    assert "Magnetometer: the last innovation of the heading is" in " ".join(live.state.remarks)
    shown = live._stream.readings["field"].column("innovation")
    used = run.solution.aid_sample >= 0
    np.testing.assert_allclose(shown[np.isfinite(shown)], run.solution.aid_innovation[used], atol=1e-9)
    write_sensor_log(tmp_path / "drive", log, title="Drive")
    again = read_sensor_log(tmp_path / "drive").auxiliary.magnetometer
    np.testing.assert_allclose(again.field, log.auxiliary.magnetometer.field, atol=1e-4)


@pytest.mark.proof
def test_with_barometer_rests_and_other_times_it_equals_the_batch() -> None:
    imu, fixes, _ = driven_with_field(2)
    imu["pressure"] = 95_000.0 + np.random.default_rng(1).normal(size=imu.size)
    sensors = fitted(period=0.3, declination=-12.0)
    sensors.barometer.fitted = True
    live = navigator(sensors=sensors, zero_velocity=True)
    feed(live, imu, fixes, random_pieces(2))
    log = make_log("replay", imu, fixes, vehicle="car")
    settings = NavigatorSettings(vehicle="car", zero_velocity=True)
    run = navigate_log(log, sensors, settings, start=live.alignment)
    assert run.solution.states == 17
    assert_equal(live, run)


def test_the_heading_at_rest_stays_known() -> None:
    imu, fixes, trajectory = driven_with_field(5)
    rest = imu["time"] - 5000.0 < 69.0  # at rest for 19 s
    found = []
    for sensors in (suite(), fitted()):
        live = navigator(sensors=sensors)
        feed(live, imu[rest], fixes[fixes["time"] < 5068.5], random_pieces(1))
        found.append(live.state)
    assert found[1].euler_sigma[2] < found[0].euler_sigma[2]
    true = trajectory.at(imu["time"][rest][-1:] - 5000.0).euler[0, 2]
    assert abs(found[1].euler[2] - true) < 3 * found[1].euler_sigma[2]


def test_a_field_that_is_not_used_and_a_wanted_one_that_is_missing_are_told() -> None:
    imu, fixes, _ = driven_with_field(1)
    unused = navigator()
    feed(unused, imu[:3000], fixes[:20], random_pieces(1))
    assert "used at the start only; sensors.heading.fitted = true" in " ".join(unused.state.remarks)
    imu["magnetic"] = np.nan
    missing = navigator(sensors=fitted())
    feed(missing, imu[:3000], fixes[:20], random_pieces(1))
    assert "no magnetic field for sensors.heading.fitted" in " ".join(missing.state.remarks)
