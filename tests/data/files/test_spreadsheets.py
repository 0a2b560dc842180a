"""The same log as spreadsheets and loggers of other countries write it: stamps, signs, several tables."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
from foreign_tables import same, table

from lab.data.clock.stamps import seconds_of_texts
from lab.data.formats import read_raw
from lab.data.sheets.sheet import read_sheet
from lab.data.sheets.sheet_clock import find_clock
from lab.data.sheets.sheet_fixes import find_fixes
from lab.data.sheets.sheet_layout import as_utf8
from lab.missions import MissionError
from lab.missions.flight_import import read_log

IMU = "time,gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s],acc_x [m/s^2],acc_y [m/s^2],acc_z [m/s^2]"
PLACE = "time,latitude,longitude,altitude,vel_n [m/s],vel_e [m/s]"
NEW_YEAR = 1_483_228_800
"""Midnight after the leap second at the end of 2016, since 1970 [s]."""


def in_utc(since, form):
    """Return UTC at a time since 23:59:50 of that day, in which 11 s pass until midnight."""
    if 10 <= since < 11:
        return moment(NEW_YEAR - 11 + since, form).replace("59:59", "59:60").replace("5959", "5960")
    return moment(NEW_YEAR - 10 + since - (since >= 10), form)


def moment(time, form):
    return datetime.fromtimestamp(round(time, 3), UTC).strftime(form)


UTC_FORMS = {
    "ISO 8601": ("time", lambda t: in_utc(t, "%Y-%m-%dT%H:%M:%S.%fZ")),
    "time of day": ("time", lambda t: in_utc(t, "%H:%M:%S.%f")),
    "date and time": ("date,time", lambda t: in_utc(t, "%d.%m.%Y,%H:%M:%S.%f")),
    "hhmmss": ("utc", lambda t: in_utc(t, "%H%M%S.%f")),
    "Unix time that repeats the last second": ("time", lambda t: f"{NEW_YEAR - 10 + t - (t >= 10):.3f}"),
    "Unix time that repeats the first second": ("time", lambda t: f"{NEW_YEAR - 10 + t - (t >= 11):.3f}"),
}


@pytest.mark.parametrize("name", UTC_FORMS)
@pytest.mark.parametrize("rate", [1, 10, 100])
def test_a_leap_second_lasts_a_second(name, rate):
    heading, write = UTC_FORMS[name]
    since = np.arange(0, 20, 1 / rate) + 0.25 / rate
    rows = "".join(f"{write(t)},{t}\n" for t in since)
    clock = find_clock(read_sheet("a.csv", f"{heading},gyro_x\n{rows}".encode()), fast=rate > 10)
    np.testing.assert_allclose(np.diff(clock.time), 1 / rate, atol=2e-3)
    assert "leap second" in clock.unit


def test_a_second_is_not_added_at_another_midnight():
    since = np.arange(-5, 5, 0.1)
    rows = "".join(f"{1_700_006_400 + t - (t >= 0):.3f},{t}\n" for t in since)
    clock = find_clock(read_sheet("a.csv", f"time,gyro_x\n{rows}".encode()), fast=False)
    assert np.diff(clock.time).min() == pytest.approx(-0.9, abs=1e-3)


STAMPS = {
    "spreadsheet": lambda t: f"{t / 86400 + 25569:.10f}",
    "MATLAB": lambda t: f"{t / 86400 + 719529:.10f}",
    "part of the day": lambda t: f"{t / 86400 % 1:.10f}",
    "minutes and seconds": lambda t: moment(t, "%M:%S.%f"),
    "digits": lambda t: moment(t, "%Y%m%d%H%M%S.%f"),
    "digits and ms": lambda t: moment(t, "%Y%m%d%H%M%S%f")[:17],
    "ms without zeros": lambda t: f"{moment(t, '%H:%M:%S')}.{round(t % 1 * 1000) % 1000}",
    "ms without zeros, of a day": lambda t: f"{moment(t, '%Y-%m-%d %H:%M:%S')}:{round(t % 1 * 1000) % 1000}",
    "noon": lambda t: moment(t - 36_000, "%m/%d/%y %I:%M:%S.%f %p"),
}


@pytest.mark.parametrize("name", STAMPS)
def test_stamps_of_spreadsheets(name):
    """The hour, or the half of the day, ends during the log."""
    since = np.arange(0, 20, 0.02)
    rows = "".join(f"{STAMPS[name](1_700_085_590 + t)},{t}\n" for t in since)
    clock = find_clock(read_sheet("a.csv", f"time,gyro_x\n{rows}".encode()), fast=True)
    np.testing.assert_allclose(clock.time - clock.time[0], since, atol=1e-4)


def test_decimals_without_zeros_at_their_end_are_decimals():
    stamps = seconds_of_texts(["12:00:01.125", "12:00:01.5", "12:00:01.75", "12:00:02"])
    np.testing.assert_allclose(stamps - stamps[0], [0, 0.375, 0.625, 0.875])


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("time,lat,alt\n1,\u22125.5,\u22121\n2,\u20135.5,1\n", (-5.5, -1)),
        ("time,lat,alt\r1,-5.5,-1\r2,-5.5,1\r", (-5.5, -1)),
        ('time,lat,alt\n"1,5","-5,5","-1,000"\n"2,5","-5,5","1,000"\n', (-5.5, -1)),
        ('time,lat,alt\n1.5,-5.5,"-1,000.0"\n2.5,-5.5,"1,000.0"\n', (-5.5, -1000)),
        ("time;lat;alt\n;;\ns;deg;km\n1;-5,5;-1\n2;-5,5;1\n", (-5.5, -1)),
    ],
)
def test_signs_ends_of_lines_and_separators(text, values):
    sheet = read_sheet("a.csv", as_utf8(text.encode()))
    latitude, height = (sheet.all_of(name)[0] for name in ("latitude", "height"))
    assert (latitude[1][0], height[1][0]) == values
    assert height[0].unit == ("km" if "km" in text else "")


def test_a_number_that_stands_for_none():
    rows = "".join(f"{t},{-9999 if t % 5 == 0 else 48 + t * 1e-5},-9999,{-999 + t}\n" for t in range(20))
    sheet = read_sheet("a.csv", f"time,lat,alt,gyro_x\n{rows}".encode())
    assert np.isnan(sheet.all_of("latitude")[0][1]).sum() == 4
    assert not np.isnan(sheet.all_of("rate")[0][1]).any()  # numbers around -999 are numbers
    (told,) = sheet.remarks
    assert "lat: -9999 in 4 rows" in told


def test_stamps_that_are_not_understood_are_shown(tmp_path, made):
    imu, gnss = made
    one = table(tmp_path / "a.csv", IMU, [[f"day 3 at {row[0]}", *row[1:]] for row in imu[:300]])
    two = table(tmp_path / "b.csv", PLACE, gnss[:, :6])
    with pytest.raises(MissionError, match=r"not understood: 'day 3 at .*' in the column time; accepted are"):
        read_log([one, two])


def appended(path, *tables):
    """Write tables below each other."""
    text = ""
    for header, rows in tables:
        table(path, header, rows)
        text += path.read_text()
    path.write_text(text)
    return path


def test_two_tables_in_one_file(tmp_path, made, expected):
    imu, gnss = made
    same(read_log([appended(tmp_path / "a.csv", (IMU, imu), (PLACE, gnss[:, :6]))]), expected)
    same(read_log([appended(tmp_path / "a.csv", (PLACE, gnss[:, :6]), (IMU, imu))]), expected)


def test_a_file_that_was_appended_to(tmp_path, made, expected):
    imu, gnss = made
    fixes = gnss[:, :6]
    half, part = len(imu) // 2, len(gnss) // 2
    goes_on = [
        appended(tmp_path / "a.csv", (IMU, imu[:half]), (IMU, imu[half:])),
        appended(tmp_path / "b.csv", (PLACE, fixes[:part]), (PLACE, fixes[part:])),
    ]
    same(read_log(goes_on), expected)
    begins_again = [
        appended(tmp_path / "a.csv", (IMU, imu[:500]), (IMU, imu)),
        appended(tmp_path / "b.csv", (PLACE, fixes[:20]), (PLACE, fixes)),
    ]
    log = read_log(begins_again)
    same(log, expected)
    assert any("a.csv has 2 recordings" in remark and "recording 2" in remark for remark in log.repairs)


def test_columns_in_another_order_after_a_restart_are_not_taken_for_the_first(tmp_path, made, expected):
    imu, gnss = made
    names = IMU.split(",")
    order = [0, 4, 5, 6, 1, 2, 3]
    later = imu[:400, order] + [1000.0, *(0.0,) * 6]
    one = appended(tmp_path / "a.csv", (IMU, imu), (",".join(names[i] for i in order), later))
    log = read_log([one, table(tmp_path / "b.csv", PLACE, gnss[:, :6])])
    same(log, expected)
    assert any(f"from line {len(imu) + 2}" in remark and "not used" in remark for remark in log.repairs)


@pytest.mark.parametrize("how", ["reversed", "shuffled", "ring buffer"])
def test_rows_in_another_order_are_sorted(tmp_path, made, expected, how):
    imu, gnss = made
    seeds = np.random.default_rng(1)

    def other(rows):
        if how == "shuffled":
            return seeds.permutation(rows)
        return rows[::-1] if how == "reversed" else np.roll(rows, len(rows) // 3, axis=0)

    one = table(tmp_path / "a.csv", IMU, other(imu))
    log = read_log([one, table(tmp_path / "b.csv", PLACE, other(gnss[:, :6]))])
    same(log, expected)
    assert any("a.csv" in remark and "sorted by time" in remark for remark in log.repairs)


def test_gyros_and_accelerometers_are_of_one_imu(tmp_path, made, expected):
    """The second IMU is reversed; the first lacks the gyros of some samples, which says nothing about it."""
    imu, gnss = made
    first = imu.copy()
    first[5::50, 1:4] = np.nan
    header = ",".join(("time", *(f"imu{k}_{s}_{a}" for k in (0, 1) for s in ("gyro", "acc") for a in "xyz")))
    one = table(tmp_path / "a.csv", header, np.column_stack((first, -imu[:, 1:])))
    log = read_log([one, table(tmp_path / "b.csv", PLACE, gnss[:, :6])])
    np.testing.assert_allclose(log.dtheta[10:40], expected.dtheta[10:40], atol=1e-9)
    assert any(remark.startswith("Gyros: imu0_gyro_x") for remark in log.repairs)
    assert any("not used: imu1_gyro_x of a.csv" in remark for remark in log.repairs)


def test_rows_of_the_second_imu_and_receiver_are_not_mixed_in(tmp_path, made, expected):
    imu, gnss = made
    rows = [[row[0], k, *(row[1:] * (1 + 0.1 * k))] for row in imu for k in (0, 1)]
    one = table(tmp_path / "a.csv", IMU.replace("time", "time,instance"), rows)
    places = [[row[0] + 0.01 * k, k, row[1] + 0.001 * k, *row[2:]] for row in gnss[:, :6] for k in (0, 1)]
    log = read_log([one, table(tmp_path / "b.csv", PLACE.replace("time", "time,I"), places)])
    same(log, expected)
    assert any("instance is 0 in the rows that are read, and not 1" in remark for remark in log.repairs)


def test_the_light_that_a_phone_calls_i_is_no_second_imu(tmp_path, made, expected):
    imu, gnss = made
    rows = [[row[0], i // 300 % 3, *row[1:]] for i, row in enumerate(imu)]
    one = table(tmp_path / "a.csv", IMU.replace("time", "time,I"), rows)
    same(read_log([one, table(tmp_path / "b.csv", PLACE, gnss[:, :6])]), expected)


def test_another_receiver_in_the_table_is_named(made):
    rows = made[1][:, :6]
    header = "time,gps1_lat,gps1_lon,gps1_alt,gps2_lat,gps2_lon,gps2_alt"
    text = "\n".join(",".join(map(str, (*row[:4], *row[1:4]))) for row in rows)
    found = find_fixes([read_sheet("b.csv", f"{header}\n{text}\n".encode())])
    assert any("not used: gps2_lat" in remark for remark in found.remarks)


@pytest.mark.parametrize(
    "header",
    ["time,lat,lon,alt,vn,ve,vd", "time,latitude,longitude,altitude,vn,ve", "time,lat,lon,alt,vn,ve,phi"],
)
def test_swapped_coordinates_under_headings_of_a_simulator_are_named(tmp_path, header):
    """The message was that of JSBSim's reader, or none, with the heights in feet."""
    time = np.arange(60.0)
    rows = np.column_stack((time, 151.2 + 1e-4 * time, 0 * time - 33.8, 0 * time + 100))
    rows = np.column_stack((rows, np.tile((0.0, 9.2, 0.0), (60, 1))))[:, : header.count(",") + 1]
    with pytest.raises(MissionError, match=r"latitudes .* are beyond ±90°.*two columns look swapped"):
        read_raw(table(tmp_path / "b.csv", header, rows))


def test_heights_and_velocities_of_a_receiver_are_not_in_the_feet_of_a_simulator(tmp_path, made):
    """Time, latitude, longitude, altitude, vn and ve were read as JSBSim's, in feet and radians."""
    rows = made[1][:, :6]
    flight = read_raw(table(tmp_path / "b.csv", "time,latitude,longitude,altitude,vn,ve", rows))
    np.testing.assert_allclose(np.degrees(flight.latitude), rows[:, 1])
    np.testing.assert_allclose(flight.height, rows[:, 3])


def test_fixes_under_headings_of_a_simulator_are_a_flight(tmp_path, made):
    """JSBSim has these headings too, but its velocity has three components."""
    rows = made[1][:, :6]
    flight = read_raw(table(tmp_path / "b.csv", "time,lat,lon,alt,vn,ve", rows))
    np.testing.assert_allclose(np.degrees(flight.latitude), rows[:, 1])
    with pytest.raises(MissionError):
        read_raw(table(tmp_path / "b.csv", "time,lat,lon,alt,vn,ve", rows[:2]))


def test_dates_and_times_after_columns_of_hemispheres_keep_their_headings():
    """They had those of columns further on, or an IndexError at the end of the table."""
    rows = [f"48.{i},N,11.{i},W,300,2024-05-01,12:00:{i}" for i in range(10, 20)]
    sheet = read_sheet("fixes.csv", "\n".join(("lat,N/S,lon,E/W,alt,date,time", *rows, "")).encode())
    assert sheet is not None
    assert sheet.texts == {"date": "2024-05-01", "time": "12:00:10"}
    np.testing.assert_allclose(sheet.columns[1], [-float(f"11.{i}") for i in range(10, 20)])
