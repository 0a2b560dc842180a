"""Gyros with a wrong sign or order on vehicles that nobody named, or that go where they like."""

from __future__ import annotations

import re

import numpy as np
import pytest
from copter_logs import copter
from sensor_logs import IMU, described, write, write_csv

from lab.data.checks.gyro_check import GyroError
from lab.data.files.sensor_log_csv import read_sensor_log


@pytest.mark.proof
@pytest.mark.parametrize(
    ("order", "signs"),
    [((0, 1, 2), (1, 1, -1)), ((0, 1, 2), (-1, 1, 1)), ((0, 2, 1), (1, 1, 1)),
     ((1, 2, 0), (1, -1, 1)), ((0, 1, 2), (-1, -1, -1))],
)  # fmt: skip
def test_a_copters_wrong_gyros_are_found_and_what_is_advised_makes_them_right(tmp_path, order, signs):
    """Which way it points is unknown, but what it feels and how its course turns is not."""
    log = copter(60, nose=0.7, aside=1.0)
    gyros = log.imu[:, 1:4][:, order] * signs
    for attempt in range(3):  # the first advice may be for the vertical gyro alone
        imu = np.column_stack((log.imu[:, 0], gyros, log.imu[:, 4:]))
        folder = write(tmp_path / f"{attempt}", log._replace(imu=imu), 'vehicle = "copter"')
        try:
            read_sensor_log(folder)
        except GyroError as error:
            gyros = as_advised(gyros, str(error))
        else:
            assert attempt
            np.testing.assert_array_equal(gyros, log.imu[:, 1:4])
            return
    pytest.fail("the advice does not help")


def as_advised(gyros, message):
    """Return the columns, called otherwise as a message says."""
    right, said = gyros.copy(), re.findall(r"rate_(\w) is (-?)rate_(\w)", message)
    assert said
    for called, minus, real in said:
        right[:, "xyz".index(real)] = (-1 if minus else 1) * gyros[:, "xyz".index(called)]
        assert f'--column "RATE_{called.upper()}={minus}rate_{real}[rad/s]"' in message
    return right


def test_a_copter_that_looks_against_its_turns_passes(tmp_path):
    """Its course turns against its gyros, but what it feels shows that they are right."""
    read_sensor_log(write(tmp_path, copter(60, nose=0.7, aside=-1.0), 'vehicle = "copter"'))


@pytest.mark.proof
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
