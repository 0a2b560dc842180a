"""What tests of foreign tables compare with."""

import pytest
from sensor_logs import IMU, POSITION, VELOCITY, tables, write_csv

from lab.data.files.sensor_log_csv import read_sensor_log


@pytest.fixture(scope="module")
def made():
    """Return what sensors log on the mission montreal: IMU and GPS, in the lab's own units and axes."""
    source = tables(30, 90)
    return source.imu, source.gnss


@pytest.fixture(scope="module")
def expected(made, tmp_path_factory):
    """Return the log as the lab's own files give it."""
    folder = tmp_path_factory.mktemp("own")
    write_csv(folder / "imu.csv", IMU, made[0])
    write_csv(folder / "gnss.csv", (*POSITION, *VELOCITY[:2]), made[1][:, :6])
    return read_sensor_log(folder)
