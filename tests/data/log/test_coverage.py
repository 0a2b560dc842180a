"""The report says where the IMU or the receiver recorded alone, and where gaps are."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_logs import EPOCH, tables, write

from lab import Experiment
from lab.data.files.sensor_log_csv import read_sensor_log

UNIX = 1.7e9
"""A clock that counts from 1970 [s]."""


@pytest.fixture(scope="module")
def log():
    return tables(60, 100)


def kept(table, first, last):
    """Return the rows between two times of the flight."""
    return table[(table[:, 0] >= EPOCH + first) & (table[:, 0] <= EPOCH + last)]


def without(table, first, last):
    """Return the rows before and after two times of the flight."""
    return table[(table[:, 0] < EPOCH + first) | (table[:, 0] > EPOCH + last)]


@pytest.mark.parametrize(
    ("part", "first", "last", "said"),
    [
        ("imu", 75, 100, "The IMU starts 15 s after the first fix, at 1075 s of the file's clock: 30 fixes"),
        ("imu", 60, 85, "The IMU ends 14.5 s before the last fix, at 1085 s of the file's clock: 29 fixes"),
        ("gnss", 75, 100, "The first fix comes 15 s after the start of the IMU, at 1075 s"),
        ("gnss", 60, 85, "The last fix comes 15 s before the end of the IMU, at 1085 s"),
    ],
)
def test_what_only_one_of_the_two_recorded_is_reported(tmp_path, log, part, first, last, said):
    changed = log._replace(**{part: kept(getattr(log, part), first, last)})
    assert [one for one in read_sensor_log(write(tmp_path, changed)).repairs if said in one]


def test_sensors_that_start_and_end_nearly_together_need_no_remark(tmp_path, log):
    assert read_sensor_log(write(tmp_path, log._replace(imu=kept(log.imu, 61.5, 98)))).repairs == ()


def test_the_longest_gap_that_is_filled_is_named_by_its_place(tmp_path, log):
    gaps = without(without(log.imu, 70.005, 70.505), 80.005, 81.005)
    (said,) = read_sensor_log(write(tmp_path, log._replace(imu=gaps))).repairs
    assert said.startswith("2 gaps of the IMU")
    assert said.endswith("The longest is from 1080 to 1081.01 s of the file's clock.")


def test_times_of_a_clock_since_1970_are_told_to_the_millisecond(tmp_path, log):
    """A σ and a place: rounded to six digits, both ends of the coasting were 1.7e+09 s."""
    fixes = without(log.gnss, 75.1, 90.1)
    moved = [table + np.eye(1, table.shape[1]) * (UNIX - EPOCH) for table in (log.imu, fixes, log.reference)]
    remarks = Experiment(mission=str(write(tmp_path, type(log)(*moved)))).run().remarks
    said = next(one for one in remarks if "the navigator coasts" in one)
    assert "from 1700000075 s to 1700000090.5 s in the clock of the file" in said
