"""Time stamps, accuracies and accelerations that headings name, of messages of ROS and of loggers of cars."""

from __future__ import annotations

import numpy as np
import pytest
from foreign_tables import UNIX, table, track
from sensor_logs import tables

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.formats import read_raw
from lab.data.sheets.column_names import heading_of
from lab.data.sheets.sensor_csv import recognises
from lab.data.sheets.sheet import read_sheet
from lab.data.sheets.sheet_clock import find_clock
from lab.missions.flight_import import read_log


def nanoseconds(seconds):
    return f"{round(1e9 * seconds)}"


@pytest.mark.parametrize(("since", "used"), [(UNIX, "field.header.stamp"), (0.0, "time")])
def test_the_stamp_in_the_header_of_a_message_is_that_of_the_measurement(tmp_path, since, used):
    """Unless it counts from another moment than the recorder, as of a sensor that was just switched on."""
    gnss = tables(30, 60).gnss
    late = np.random.default_rng(1).uniform(0.05, 0.3, len(gnss))
    rows = [
        (nanoseconds(UNIX + t + delay), i, nanoseconds(since + t), *place)
        for i, (t, delay, place) in enumerate(zip(gnss[:, 0], late, gnss[:, 1:4], strict=True))
    ]
    header = "%time,field.header.seq,field.header.stamp,field.latitude,field.longitude,field.altitude"
    flight = read_raw(table(tmp_path / "fix.csv", header, rows))
    assert any(remark.startswith(f"Time of the GPS: {used}, in ns") for remark in flight.remarks)
    expected = gnss[:, 0] + (UNIX if used != "time" else UNIX + late)
    np.testing.assert_allclose(flight.time, expected, atol=1e-6)


def test_accelerations_may_be_named_by_their_direction_and_their_unit_stand_below(tmp_path):
    """A vertical acceleration in g is no vertical accuracy."""
    made = tables(30, 90)
    imu, gnss = made.imu, made.gnss
    header = "Time,InlineAcc,LateralAcc,VerticalAcc,gyro_x,gyro_y,gyro_z\ns,g,g,g,deg/s,deg/s,deg/s"
    force = imu[:, 4:] * (1, -1, -1) / STANDARD_GRAVITY  # forward, left, up
    rate = np.degrees(imu[:, 1:4]) * (1, -1, -1)
    sensed = table(tmp_path / "car.csv", header, np.column_stack((imu[:, 0], force, rate)))
    fixes = table(tmp_path / "gps.csv", "Time,lat,lon,alt,vn,ve", gnss[:, :6])
    log = read_log([sensed, fixes])
    np.testing.assert_allclose(log.rates[1][-1], imu[-1, 4:], atol=1e-4)
    assert any("InlineAcc, LateralAcc, VerticalAcc" in remark for remark in log.repairs)


@pytest.mark.parametrize("signs", [(1, 1, 1, 1), (1, 1, 1, -1), (1, -1, -1, 1), (-1, 1, -1, 1)])
def test_the_motion_shows_to_which_side_a_racing_logger_counts(tmp_path, signs):
    """AiM's headings name directions: a lateral acceleration to the right is left-handed beside one up."""
    made = tables(30, 90)
    imu, gnss = made.imu[::2], made.gnss
    speed, course = np.hypot(*gnss[:, 4:6].T), np.degrees(np.arctan2(gnss[:, 5], gnss[:, 4])) % 360
    fix = np.clip(np.searchsorted(gnss[:, 0], imu[:, 0], side="right") - 1, 0, None)
    header = (
        "Time,GPS Speed,GPS Heading,GPS Altitude,GPS Latitude,GPS Longitude,InlineAcc,LateralAcc,VerticalAcc,"
        "RollRate,PitchRate,YawRate\ns,km/h,deg,m,deg,deg,g,g,g,deg/s,deg/s,deg/s\n"
    )
    force = imu[:, 4:] * (1, signs[3], -1) / STANDARD_GRAVITY
    place = np.column_stack((speed * 3.6, course, gnss[:, 3], gnss[:, 1:3]))[fix]
    rows = np.column_stack((imu[:, 0], place, force, np.degrees(imu[:, 1:4]) * signs[:3]))
    log = read_log([table(tmp_path / "aim.csv", header, rows, before="Format,AiM CSV File\n\n")])
    np.testing.assert_allclose(np.column_stack(log.rates)[-9:], imu[-9:, 1:], atol=1e-4)


@pytest.mark.parametrize("signs", [(1, 1, 1), (1, 1, -1), (-1, -1, -1), (1, -1, -1)])
def test_the_motion_shows_to_which_side_gyros_count_that_are_named_by_angles(tmp_path, signs):
    """RaceCapture has axes of accelerometers, and yaw, pitch and roll in °/s, to a side that none names."""
    made = tables(30, 90)
    imu, gnss = made.imu[::2], made.gnss
    fix = np.clip(np.searchsorted(gnss[:, 0], imu[:, 0], side="right") - 1, 0, None)
    header = '"Utc"|"ms"|0|0|1' + "".join(
        f',"{name}"|"{unit}"|-9|9|50' for name, unit in (
            ("AccelX", "G"), ("AccelY", "G"), ("AccelZ", "G"), ("Roll", "Deg/Sec"), ("Pitch", "Deg/Sec"),
            ("Yaw", "Deg/Sec"), ("Latitude", "Degrees"), ("Longitude", "Degrees"), ("Altitude", "m"),
            ("Speed", "mph"), ("Bearing", "Degrees")))  # fmt: skip
    speed, course = np.hypot(*gnss[:, 4:6].T), np.degrees(np.arctan2(gnss[:, 5], gnss[:, 4])) % 360
    place = np.column_stack((gnss[:, 1:4], speed / 0.44704, course))[fix]
    rate = np.degrees(imu[:, 1:4]) * signs
    rows = np.column_stack((1000 * imu[:, 0], imu[:, 4:] / STANDARD_GRAVITY, rate, place))
    log = read_log([table(tmp_path / "race.log", header, rows)])
    np.testing.assert_allclose(np.column_stack(log.rates)[-9:], imu[-9:, 1:], atol=1e-4)
    assert any("count to the other side" in one for one in log.repairs) == (signs != (1, 1, 1))


@pytest.mark.parametrize(
    ("text", "quantity", "axis"),
    [
        ("LateralAcc", "force", "y"), ("Long Accel [g]", "force", "x"),
        ("vertical acceleration (m/s²)", "force", "z"), ("VerticalAcc", "vertical_sigma", ""),
        ("sdn(m)", "north_sigma", ""), ("StdDev Lon", "east_sigma", ""),
        ("COG (deg T)", "course", ""), ("COG (°T)", "course", ""), ("ax_raw", "force", "x"),
        ("GyroZ (raw)", "rate", "z"), ("raw_ay", "force", "y"), ("AceleracionX(m/s2)", "force", "x"),
        ("giro_y", "rate", "y"), ("BeschleunigungZ", "force", "z"),
        ("sdu(m)", "vertical_sigma", ""), ("lat", "latitude", ""), ("gps_longitude", "longitude", ""),
    ],
)  # fmt: skip
def test_what_a_heading_names(text, quantity, axis):
    found = heading_of(text)
    assert (found.quantity, found.axis) == (quantity, axis)


@pytest.mark.parametrize(
    "text",
    ["GPS LatAcc", "lat_std (deg)", "sdne(m)", "stdev", "latAcc(m)", "t (deg)", "TWD (°T)", "temp_raw"],
)
def test_what_a_heading_does_not_name(text):
    assert heading_of(text) is None


def test_the_sigmas_of_rtklib_are_those_of_each_axis(tmp_path):
    made = tables(30, 90)
    rows = [(*row[:4], 0.25, 0.5, 0.75) for row in track(made[:2])]
    header = "time,latitude(deg),longitude(deg),height(m),sdn(m),sde(m),sdu(m)"
    imu = table(tmp_path / "imu.csv", "time,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", made.imu)
    log = read_log([imu, table(tmp_path / "rover.csv", header, rows)])
    np.testing.assert_allclose(log.gnss.position_sigma, np.tile((0.25, 0.5, 0.75), (len(rows), 1)))


@pytest.mark.parametrize(
    "names", ["sd_vn_m_s,sd_ve_m_s,sd_vd_m_s", "sdvn,sdve,sdvu", "VelStdN,VelStdE,VelStdD"]
)
def test_the_sigmas_of_a_velocity_are_those_of_each_axis(tmp_path, names):
    """As the lab writes them, whose logs lost them as they were imported again, and RTKLIB."""
    made = tables(30, 50)
    header = f"time,lat,lon,alt,vn_m_s,ve_m_s,vd_m_s,sd_n_m,sd_e_m,sd_d_m,{names}"
    gnss = made.gnss.copy()
    gnss[:, 7:] = 0.25, 0.5, 0.75, 0.1, 0.2, 0.3
    imu = table(tmp_path / "imu.csv", "time,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", made.imu)
    log = read_log([imu, table(tmp_path / "gnss.csv", header, gnss)])
    np.testing.assert_allclose(log.gnss.velocity_sigma, gnss[:, 10:])
    assert not any("not read" in remark for remark in log.repairs)


ABOVE = (
    ("// Start Time: 0\n// Sample rate: 100.0Hz\n// Firmware Version: 2.5.1", "\t", "Counter", 65_500),
    ("# Config: data_rate = 100 Hz, filter = 488 Hz, acc_range = 4 g, gyro_range = 250 dps", ",", "count", 1),
    ("------ Data File Created By GT3X+ date format M/d/yyyy at 100 Hz  Filter Normal ------", ",", "", 0),
    ("Abtastrate;100,0 Hz\nTiefpassfilter;20 Hz", ";", "", 0),
    ("Fréquence d'échantillonnage: 0,1 kHz", ";", "", 0),
    ("Sample Rate,100\nStart Time,12:00:00", ",", "sample", 0),
    ("@ IMU of a stranger, Sampling Rate:10ms", ",", "packet no", 7),
)
NOT_OF_SAMPLES = ("# low-pass filter: 50 Hz", "# Rate: 50 Hz, then 100 Hz", "# Samples: 4500")


def test_the_rate_of_samples_above_a_header_times_a_table_without_times(tmp_path):
    """Rows that are lost show where rows are counted, in 16 bits too."""
    made = tables(30, 90)
    since = made.imu[0, 0]
    imu = np.delete(made.imu, np.s_[700:703], axis=0) - [since, *(0.0,) * 6]
    names = [f"{one} ({unit})" for one, unit in zip(
        ("gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z"), ["rad/s"] * 3 + ["m/s²"] * 3, strict=True
    )]  # fmt: skip
    for above, mark, counter, first in ABOVE:
        numbers = [f"{(first + round(100 * t)) % 65_536:d}{mark}" if counter else "" for t in imu[:, 0]]
        cells = [mark.join(f"{value:.9f}" for value in row[1:]) for row in imu]
        header = mark.join([counter, *names] if counter else names)
        text = "\n".join((above, header, *map("".join, zip(numbers, cells, strict=True)))).encode()
        assert recognises(text[:4000]), above
        sheet = read_sheet("imu.txt", text)
        expected = (imu[:, 0] if counter else np.arange(len(imu)) / 100) + first / 100
        np.testing.assert_allclose(find_clock(sheet, fast=True).time, expected, atol=1e-6, err_msg=above)
    path = tmp_path / "imu.txt"
    path.write_bytes(text)
    gnss = made.gnss[:, :6] - [since - first / 100, *(0.0,) * 5]
    log = read_log([path, table(tmp_path / "gps.csv", "t (s),lat,lon,alt,vn,ve", gnss)])
    assert any("say 100 samples a second" in remark for remark in log.repairs)
    for above in NOT_OF_SAMPLES:
        assert not recognises("\n".join((above, mark.join(names), *cells)).encode()), above


def test_a_temperature_that_is_called_t_is_no_time():
    """Of a thermometer that counts in tenths, most readings repeat the one before."""
    rng = np.random.default_rng(4)
    warmth = 27.8 + 0.1 * (rng.random(600) < 0.3)
    rows = "".join(f"{2314 + 23 * i},0,0,9.8,0.1,0.2,0.1,{t:.2f}\n" for i, t in enumerate(warmth))
    sheet = read_sheet("log.txt", f"f,ax,ay,az,gx,gy,gz,t\n{rows}".encode())
    assert find_clock(sheet, fast=True) is None
