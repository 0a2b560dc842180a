"""Gyros with a wrong sign or order on vehicles that nobody named, or that go where they like."""

from __future__ import annotations

import numpy as np
import pytest
from copter_logs import copter
from sensor_logs import IMU, described, write, write_csv

from lab.logs.gyro_check import GyroError
from lab.logs.sensor_log_csv import read_sensor_log


def with_gyros(folder, log, order=(0, 1, 2), signs=(1, 1, 1)):
    """Write a log whose gyro columns a recorder has swapped or negated."""
    imu = log.imu.copy()
    imu[:, 1:4] = imu[:, 1:4][:, order] * signs
    return write(folder, log._replace(imu=imu), 'vehicle = "copter"')


@pytest.mark.parametrize(
    ("order", "signs"),
    [((0, 1, 2), (1, 1, -1)), ((0, 1, 2), (-1, 1, 1)), ((0, 1, 2), (1, -1, 1)), ((1, 0, 2), (1, 1, 1)),
     ((0, 2, 1), (1, 1, 1)), ((0, 1, 2), (-1, -1, -1))],
)  # fmt: skip
def test_a_copters_wrong_gyros_are_found(tmp_path, order, signs):
    """Which way it points is unknown, but what it feels and how its course turns is not."""
    log = copter(60, nose=0.7, aside=1.0)
    read_sensor_log(with_gyros(tmp_path / "right", log))
    with pytest.raises(GyroError, match=r"wrong sign|swapped axes"):
        read_sensor_log(with_gyros(tmp_path / "wrong", log, order, signs))


def test_a_copter_that_looks_against_its_turns_passes(tmp_path):
    """Its course turns against its gyros, but what it feels shows that they are right."""
    read_sensor_log(with_gyros(tmp_path, copter(60, nose=0.7, aside=-1.0)))


@pytest.mark.parametrize("signs", [(1, 1, -1), (-1, 1, 1), (1, -1, 1), (-1, 1, -1)])
def test_a_walkers_wrong_gyros_are_found(recordings, tmp_path, signs):
    folder = described(tmp_path / "walk", recordings / "rtkx_walk")
    imu = np.loadtxt(folder / "imu.csv", delimiter=",", skiprows=1)
    imu[:, 1:4] *= signs
    write_csv(folder / "imu.csv", IMU, imu)
    with pytest.raises(GyroError, match=r"wrong sign|swapped axes"):
        read_sensor_log(folder)


def test_positions_alone_show_the_sign_of_the_vertical_gyro(recordings, tmp_path):
    folder = described(tmp_path / "walk", recordings / "rtkx_walk")
    gnss = (folder / "gnss.csv").read_text().splitlines()
    places = [",".join(line.split(",")[:4]) for line in gnss]
    (folder / "gnss.csv").write_text("\n".join(places) + "\n")
    read_sensor_log(folder)
    imu = np.loadtxt(folder / "imu.csv", delimiter=",", skiprows=1)
    imu[:, 3] *= -1
    write_csv(folder / "imu.csv", IMU, imu)
    with pytest.raises(GyroError, match="wrong sign"):
        read_sensor_log(folder)
