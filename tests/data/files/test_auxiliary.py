"""What autopilot logs hold beside IMU and GPS: vehicle, magnetometer, headings, their own solution."""

from __future__ import annotations

import numpy as np
import pytest
from writers import WRITERS

from lab.data.files.ardupilot import headings_of, magnetometer_of
from lab.data.files.dataflash_time import TIME
from lab.data.log.vehicle import vehicle_of
from lab.missions import mission
from lab.missions.flight_import import read_log
from lab.motion.frames.rotation import wrap


@pytest.mark.proof
@pytest.mark.parametrize("name", ["PX4 ULog", "ArduPilot DataFlash"])
def test_vehicle_and_own_solution(name, tmp_path):
    path = tmp_path / "flight.log"
    recording = mission("montreal").recording
    path.write_bytes(WRITERS[name](recording))
    log = read_log([path])
    assert vehicle_of(log.auxiliary.vehicle).name == "aeroplane"
    (own,) = log.auxiliary.comparisons
    assert name in own.name
    assert log.reference is None
    # At the times of the file, it is the flight that was written.
    at = own.time + log.epoch
    assert at[0] > 1
    heading = np.interp(
        own.time - own.time[0], recording.time - recording.time[0], np.unwrap(recording.euler[:, 2])
    )
    assert np.degrees(np.abs(wrap(own.euler[20:-20, 2] - heading[20:-20])).max()) < 20
    np.testing.assert_allclose(
        own.position[:, 2].max() - own.position[:, 2].min(), np.ptp(recording.height), rtol=0.01
    )


def test_a_compass_is_in_microtesla_where_it_is_healthy():
    count = 8
    messages = {
        TIME: np.arange(float(count)),
        "MagX": np.full(count, 215.0),
        "MagY": np.full(count, 73.0),
        "MagZ": np.full(count, -538.0),
        "Health": np.array([1, 1, 0, 1, 1, 1, 1, 1.0]),
    }
    found = magnetometer_of(messages)
    np.testing.assert_array_equal(found.time, [0, 1, 3, 4, 5, 6, 7])
    np.testing.assert_allclose(found.field, np.tile((21.5, 7.3, -53.8), (7, 1)))
    assert np.isnan(found.declination)
    assert magnetometer_of(None) is None
    assert magnetometer_of({TIME: np.arange(3.0)}) is None


def test_two_antennas_give_headings_and_one_none():
    gps = {TIME: np.arange(6.0), "Yaw": np.array([0, 90, 180, 360, 270, 45.0])}
    fixed = np.array([True, True, True, True, True, False])
    found = headings_of(gps, fixed)
    np.testing.assert_array_equal(found.time, [1, 2, 3, 4])
    np.testing.assert_allclose(found.heading, np.radians([90, 180, 360, 270]))
    assert headings_of({**gps, "Yaw": np.zeros(6)}, fixed) is None
    assert headings_of({TIME: gps[TIME]}, fixed) is None
