"""FlightGear's pair of protocols: in any order, one alone as far as it goes."""

from __future__ import annotations

import numpy as np
import pytest
from writers import flightgear as writer

from lab.data.formats import read_raw
from lab.missions import MissionError, mission

PAIR = writer.write(mission("montreal").recording)


@pytest.fixture
def gps(tmp_path):
    path = tmp_path / "one"
    path.write_bytes(PAIR["fgfs.gps"])
    return path


@pytest.fixture
def imu(tmp_path):
    path = tmp_path / "two"
    path.write_bytes(PAIR["fgfs.imu"])
    return path


def test_the_two_files_are_given_in_any_order(gps, imu):
    one, other = read_raw([gps, imu]), read_raw([imu, gps])
    np.testing.assert_array_equal(one.body_rate, other.body_rate)
    np.testing.assert_array_equal(one.velocity_n, other.velocity_n)
    np.testing.assert_array_equal(one.euler, other.euler)
    assert any("no attitude" in remark for remark in one.remarks)
    assert any("attitude is reconstructed" in remark for remark in one.remarks)
    assert any("above sea level" in remark for remark in one.remarks)


def test_position_alone_is_a_flight_and_rates_alone_are_not(gps, imu):
    flight = read_raw(gps)
    assert flight.body_rate is None
    assert flight.euler is None
    assert flight.height is not None and flight.height.mean() > 0
    with pytest.raises(MissionError, match=r"insgns-imu only; give the file of insgns-gps"):
        read_raw(imu)
    with pytest.raises(MissionError, match=r"same protocol"):
        read_raw([gps, gps])


def test_rows_outside_the_other_file_are_dropped(gps, imu):
    lines = imu.read_text().splitlines()
    # Ten seconds late, and the logger was started anew in between: its clock went back.
    imu.write_text("\n".join([*lines[500:900], *lines[880:]]))
    flight = read_raw([gps, imu])
    assert flight.time[0] == 40.0
    (dropped,) = flight.dropped
    assert (dropped.count, dropped.first_row) == (40, 1)
    imu.write_text("\n".join(f"{i}.0000" + "\t0.000000" * 3 + "\t0.00000" * 3 for i in range(5)))
    with pytest.raises(MissionError, match=r"accepted are files of the same flight"):
        read_raw([gps, imu])


def test_rates_that_are_all_zero_are_none(gps, imu):
    lines = [line.split("\t") for line in imu.read_text().splitlines()]
    imu.write_text("\n".join("\t".join([row[0], *["0.000000"] * 3, *row[4:]]) for row in lines))
    flight = read_raw([gps, imu])
    assert flight.body_rate is None
    assert flight.euler is None
    assert any("cannot be reconstructed" in remark for remark in flight.remarks)


def test_units_are_known_by_the_names_of_the_protocol(gps, imu):
    flight = read_raw([gps, imu], {"negative altitude (m)": "ft", "yaw rate (rad/sec)": "°/s"})
    plain = read_raw([gps, imu])
    assert flight.height is not None and plain.height is not None
    np.testing.assert_allclose(flight.height, plain.height * 0.3048, rtol=1e-12)
    with pytest.raises(MissionError, match="negative altitude"):
        read_raw(gps, {"altitude": "m"})
