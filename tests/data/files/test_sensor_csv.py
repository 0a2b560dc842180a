"""Tables with foreign headings: the same log in the words, units, axes and files of other programs."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from foreign_tables import UNIX, motion, phone, same, table

from lab.analysis import rest
from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.clock.stamps import seconds_of_texts
from lab.data.sheets.column_names import heading_of
from lab.missions import MissionError
from lab.missions.flight_import import prepare_import, read_log
from lab.missions.log_mission import LogMission


def test_ros(tmp_path, made, expected):
    imu, gnss = made
    stamps = [[float(int(t)), float(round(t % 1 * 1e9))] for t in imu[:, 0]]
    flu = np.array((1, -1, -1))
    rows = [
        [t + 7.0, *stamp, "imu_link", *(w * flu), *(f * flu)]
        for t, stamp, w, f in zip(imu[:, 0], stamps, imu[:, 1:4], imu[:, 4:], strict=True)
    ]
    header = "Time,header.stamp.secs,header.stamp.nsecs,header.frame_id"
    angular, linear = (
        ",".join(f"{name}.{axis}" for axis in "xyz") for name in ("angular_velocity", "linear_acceleration")
    )
    one = table(tmp_path / "imu.csv", f"{header},{angular},{linear}", rows)
    fixes = [
        [t + 7.0, float(int(t)), float(round(t % 1 * 1e9)), "gps", *row]
        for t, row in zip(gnss[:, 0], gnss[:, 1:6], strict=True)
    ]
    two = table(tmp_path / "fix.csv", f"{header},latitude,longitude,altitude,vel_n,vel_e", fixes)
    log = read_log([one, two])
    same(log, expected)
    assert any("forward is x, right is -y, down is -z" in remark for remark in log.repairs)
    assert any("angular_velocity.x" in remark and "rad/s (guessed" in remark for remark in log.repairs)
    assert any("header.frame_id" in remark for remark in log.repairs if "not read" in remark)


def sensor_logger(folder, made, gravity=True):
    """Write the files of a phone, with nanoseconds since 1970 and columns z, y, x."""
    imu, gnss = made
    force = phone(imu[:, 4:])
    sensors = {"Gyroscope": phone(imu[:, 1:4])}
    sensors |= (
        {"TotalAcceleration": force} if gravity else {"Accelerometer": force - np.median(force, axis=0)}
    )
    for name, vectors in sensors.items():
        rows = [
            [f"{int((UNIX + t) * 1e9)}", t - 1000, *v[::-1]] for t, v in zip(imu[:, 0], vectors, strict=True)
        ]
        table(folder / f"{name}.csv", "time,seconds_elapsed,z,y,x", rows)
    speed, course = motion(gnss)
    rows = [
        [f"{int((UNIX + t) * 1e9)}", t - 1000, 5.0, s, c, h, lon, lat]
        for t, lat, lon, h, s, c in zip(*gnss[:, :4].T, speed, course, strict=True)
    ]
    table(
        folder / "Location.csv",
        "time,seconds_elapsed,horizontalAccuracy,speed,bearing,altitude,longitude,latitude",
        rows,
    )
    table(folder / "Metadata.csv", "version,device name", [["3", "phone"]])


def test_a_phones_folder_and_its_zip_file(tmp_path, made, expected):
    folder = tmp_path / "phone"
    folder.mkdir()
    sensor_logger(folder, made)
    with zipfile.ZipFile(tmp_path / "phone.zip", "w") as archive:
        for path in folder.iterdir():
            archive.write(path, path.name)
    for place in (folder, tmp_path / "phone.zip"):
        log = read_log([place])
        same(log, expected, 2e-3)  # stamps in doubles are rounded to 0.2 µs, and one sensor is interpolated
        np.testing.assert_allclose(log.gnss.position_sigma[:, :2], 5 / np.sqrt(-2 * np.log(0.32)), rtol=0.01)
    flight = prepare_import([tmp_path / "phone.zip"])
    assert flight.log is not None
    assert flight.raw.latitude is not None and len(flight.raw.latitude) == len(expected.gnss.time)


def test_accelerations_without_gravity_are_refused_unless_gravity_is_beside(tmp_path, made, expected):
    sensor_logger(tmp_path, made, gravity=False)
    with pytest.raises(MissionError, match="without gravity; accepted is specific force"):
        read_log([tmp_path])
    up = np.median(phone(made[0][:, 4:]), axis=0)
    rows = [[f"{int((UNIX + t) * 1e9)}", *up] for t in made[0][:, 0]]
    table(tmp_path / "Gravity.csv", "time,x,y,z", rows)
    log = read_log([tmp_path])
    same(log, expected, 2e-3)
    assert any("Gravity.csv was added" in remark for remark in log.repairs)


@pytest.mark.parametrize("form", ["latin", "utf-16 with decimal commas"])
def test_one_table_with_the_latest_fix_in_every_row(tmp_path, made, expected, form):
    imu, gnss = made
    speed, course = motion(gnss)
    latest = np.searchsorted(gnss[:, 0], imu[:, 0] + 1e-6, side="right") - 1
    rows = []
    for i, (t, k) in enumerate(zip(imu[:, 0], latest, strict=True)):
        fix = (*gnss[k, 1:4], 3.6 * speed[k], course[k]) if k >= 0 else (0.0,) * 5
        rows.append((*phone(imu[i : i + 1, 4:])[0], *phone(imu[i : i + 1, 1:4])[0], *fix, 1e3 * t))
    header = ";".join((
        *(f"ACCELEROMETER {axis} (m/s²)" for axis in "XYZ"), *(f"GYROSCOPE {axis} (rad/s)" for axis in "XYZ"),
        "LOCATION Latitude : ", "LOCATION Longitude : ", "LOCATION Altitude ( m)", "LOCATION Speed ( Kmh)",
        "LOCATION ORIENTATION (°)", "Time since start in ms ",
    ))  # fmt: skip
    coded = "cp1252" if form == "latin" else "utf-16"
    log = read_log([table(tmp_path / "a.csv", header, rows, ";", coded, comma=coded == "utf-16")])
    same(log, expected)
    assert any("repeat the position of the row before" in remark for remark in log.repairs)


def test_units_in_names_of_columns_and_empty_cells(tmp_path, made, expected):
    imu, gnss = made
    speed, course = motion(gnss)
    rows = [
        [1e3 * t, *(f / STANDARD_GRAVITY), *np.degrees(w), *(np.nan,) * 5]
        for t, w, f in zip(imu[:, 0], imu[:, 1:4], imu[:, 4:], strict=True)
    ]
    rows += [
        [1e3 * row[0], *(np.nan,) * 6, *row[1:3], row[3] / 0.3048, s / 0.44704, c]
        for row, s, c in zip(gnss, speed, course, strict=True)
    ]
    rows.sort(key=lambda row: row[0])
    header = (
        "time_ms,accel_x_g,accel_y_g,accel_z_g,gyro_x_dps,gyro_y_dps,gyro_z_dps,gps_lat,gps_lon,gps_alt_ft,"
        "gps_speed_mph,gps_course"
    )
    same(read_log([table(tmp_path / "a.csv", header, rows)]), expected)


def test_units_that_no_heading_names_are_found_in_the_motion(tmp_path, made, expected):
    imu, gnss = made
    speed, course = motion(gnss)
    one = table(
        tmp_path / "a.csv",
        "t,ax,ay,az,gx,gy,gz",
        [[t, *f, *np.degrees(w)] for t, w, f in zip(imu[:, 0], imu[:, 1:4], imu[:, 4:], strict=True)],
    )
    two = table(
        tmp_path / "b.csv",
        "t,lat,lon,alt,speed,course",
        np.column_stack((gnss[:, :4], speed * 3600 / 1852, course)),
    )
    log = read_log([one, two])
    same(log, expected)
    assert any("°/s (guessed: rad/s contradicts the motion)" in remark for remark in log.repairs)
    assert any("speed in kt (guessed: the positions move 0.51" in remark for remark in log.repairs)


def test_an_autopilots_export_with_whole_numbers(tmp_path, made, expected):
    imu, gnss = made
    header = ",".join(
        (*(f"gyro_rad[{i}]" for i in range(3)), *(f"accelerometer_m_s2[{i}]" for i in range(3)))
    )
    one = table(
        tmp_path / "sensor_combined_0.csv",
        f"timestamp,{header}",
        np.column_stack((1e6 * imu[:, 0], imu[:, 1:])),
    )
    rows = np.column_stack(
        (1e6 * gnss[:, 0], np.round(1e7 * gnss[:, 1:3]), np.round(1e3 * gnss[:, 3]), gnss[:, 4:6])
    )
    two = table(tmp_path / "vehicle_gps_position_0.csv", "timestamp,lat,lon,alt,vel_n_m_s,vel_e_m_s", rows)
    log = read_log([one, two])
    np.testing.assert_allclose(log.gnss.position, expected.gnss.position, atol=5.1e-4)
    np.testing.assert_allclose(log.rates[0], expected.rates[0], atol=1e-6)


def test_rows_out_of_order_are_sorted_and_a_restart_is_refused(tmp_path, made, expected):
    imu, gnss = made
    two = table(tmp_path / "b.csv", "t,lat,lon,alt,vn,ve", gnss[:, :6])
    swapped = imu.copy()
    swapped[100:104] = swapped[103:99:-1]
    one = table(tmp_path / "a.csv", "t,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", swapped)
    log = read_log([one, two])
    same(log, expected)
    assert any(remark.startswith("3 rows of the IMU were out of order") for remark in log.repairs)
    swapped[2000:, 0] -= 15.0
    table(one, "t,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", swapped)
    with pytest.raises(MissionError, match=r"time runs backwards|increases from row to row"):
        read_log([one, two])


def test_what_a_person_says_of_columns(tmp_path, made, expected):
    imu, gnss = made
    one = table(
        tmp_path / "a.csv",
        "Zeit,A1,A2,A3,W1,W2,W3",
        [
            [t, -f[0] / STANDARD_GRAVITY, *f[1:] / STANDARD_GRAVITY, *w]
            for t, w, f in zip(imu[:, 0], imu[:, 1:4], imu[:, 4:], strict=True)
        ],
    )
    two = table(tmp_path / "b.csv", "Zeit,Breite,Laenge,Hoehe,N,O", gnss[:, :6])
    with pytest.raises(MissionError, match=r"its format is unknown.*--column HEADING=QUANTITY"):
        read_log([one, two])
    given = {
        "Zeit": "time[s]", "A1": "-force_x[g]", "A2": "force_y[g]", "A3": "force_z[g]", "W1": "rate_x[rad/s]",
        "W2": "rate_y[rad/s]", "W3": "rate_z[rad/s]", "Breite": "latitude[°]", "Laenge": "longitude[°]",
        "Hoehe": "height[m]", "N": "north[m/s]", "O": "east[m/s]",
    }  # fmt: skip
    same(read_log([one, two], given), expected)
    with pytest.raises(MissionError, match="'bread' is no quantity; accepted are rate_x"):
        read_log([one, two], given | {"A1": "bread[g]"})
    with pytest.raises(MissionError, match="A9, which is not read"):
        read_log([one, two], given | {"A9": "force_x[g]"})


def test_axes_that_a_person_gives(tmp_path, made, expected):
    imu, gnss = made
    turned = np.column_stack((imu[:, 0], imu[:, 2], -imu[:, 1], imu[:, 3], imu[:, 5], -imu[:, 4], imu[:, 6]))
    one = table(tmp_path / "a.csv", "t,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z", turned)
    two = table(tmp_path / "b.csv", "t,lat,lon,alt,vn,ve", gnss[:, :6])
    same(read_log([one, two], axes=("-y", "x", "z")), expected)
    same(read_log([one, two]), expected)  # found by gravity and motion
    with pytest.raises(MissionError, match="axes y,y,z are not a right-handed set"):
        read_log([one, two], axes=("y", "y", "z"))


def test_accelerations_without_gravity_are_no_g_in_a_wrong_unit(tmp_path, made):
    """Those of a lively ride are 0.5 to 1.5 m/s² long, as gravity in g is, and point anywhere."""
    imu, gnss = made
    force = np.random.default_rng(1).normal(0, 0.6, (len(imu), 3))
    header = '"Time (s)","X (m/s^2)","Y (m/s^2)","Z (m/s^2)"'
    files = [
        table(tmp_path / "Linear Accelerometer.csv", header, np.column_stack((imu[:, 0], force))),
        table(tmp_path / "Gyroscope.csv", header.replace("m/s^2", "rad/s"), imu[:, :4]),
        table(tmp_path / "b.csv", "t,lat,lon,alt", gnss[:, :4]),
    ]
    with pytest.raises(MissionError, match="so they are without gravity"):
        read_log(files)


def test_a_wrong_unit_in_a_heading_is_named(tmp_path, made):
    imu, gnss = made
    rows = np.column_stack((imu[:, :4], imu[:, 4:] / STANDARD_GRAVITY))
    one = table(tmp_path / "a.csv", "t,wx,wy,wz,ax [m/s^2],ay [m/s^2],az [m/s^2]", rows)
    two = table(tmp_path / "b.csv", "t,lat,lon,alt", gnss[:, :4])
    with pytest.raises(MissionError, match="look like g, although the heading names m/s²"):
        read_log([one, two])
    read_log([one, two], {f"a{axis} [m/s^2]": "g" for axis in "xyz"})


def test_what_is_missing_is_named(tmp_path, made):
    imu, gnss = made
    one = table(
        tmp_path / "a.csv", "t,acc_x,acc_y,acc_z,battery", np.column_stack((imu[:, 0], imu[:, 4:], imu[:, 0]))
    )
    two = table(tmp_path / "b.csv", "t,lat,lon,alt", gnss[:, :4])
    with pytest.raises(MissionError, match=r"no complete gyros found.*not understood: battery"):
        read_log([one, two])
    one = table(tmp_path / "a.csv", "t,wx,wy,wz,ax,ay,az", imu)
    with pytest.raises(MissionError, match="no columns of latitude and longitude found"):
        read_log([one])
    two = table(tmp_path / "b.csv", "t,lat,lon", gnss[:, :3])
    with pytest.raises(MissionError, match="no column with the height"):
        read_log([one, two])


HEADINGS = {
    "linear_acceleration.x": "force_x", "angular_velocity_covariance_0": "", "AccX": "force_x",
    "GyrZ": "rate_z",
    "accel_x_g": "force_x[g]", "gyro_y_dps": "rate_y[°/s]", "ax [m/s^2]": "force_x[m/s²]",
    "gFx": "force_x[g]",
    "wx": "rate_x", "w_RS_S_z [rad s^-1]": "rate_z[rad/s]", "a_RS_S_y [m s^-2]": "force_y[m/s²]",
    "accelerometerAccelerationX(G)": "force_x[g]", "motionRotationRateY(rad/s)": "rate_y[rad/s]",
    "accelerometer_lsm6ds3_c.x": "force_x", "rotation_Vector.x": "", "MAGNETIC FIELD X (μT)": "field_x[µT]",
    "Mag_X": "field_x",
    "Acceleration Sensor(X axis)(g)": "force_x[g]", "xacc": "force_x",
    "gyro_rad[2]": "rate_z[rad/s]", "header.stamp.nanosec": "fraction[ns]", "header.stamp.secs": "seconds[s]",
    "#timestamp [ns]": "time[ns]", "TimeUS": "time[µs]", "SampleTimeFine": "time[1e-4 s]", "HDop": "",
    "LOCATION Latitude : ": "latitude", "GPS_Speed_kmh": "speed[km/h]",
    "GPS Speed (Meters/second)": "speed[m/s]",
    "locationCourse(°)": "course[°]", "bearingAccuracy": "", "speedAccuracy": "speed_sigma", "GCrs": "course",
    "vel_d_m_s": "down[m/s]", "velocity_north": "north", "alt_ft": "height[ft]", "Satellites in range": "",
    "Magnetometer z": "field_z",
    "Gyroscope x (deg/s)": "rate_x[°/s]", "orientation.x": "q1", "yaw": "yaw", "temp": "",
}  # fmt: skip
"""Headings of real loggers, and what they are."""


@pytest.mark.parametrize("text", HEADINGS)
def test_headings(text):
    found = heading_of(text)
    if found is None:
        assert HEADINGS[text] == ""
        return
    name = f"{found.quantity}_{found.axis}" if found.axis else found.quantity
    assert name + (f"[{found.unit}]" if found.unit else "") == HEADINGS[text]


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("2020-01-01T00:00:00.5Z", 1577836800.5),
        ("2020-01-01T02:00:00.5+02:00", 1577836800.5),
        ("2020-01-01 00:00:00.500", 1577836800.5),
        ("2020-01-01 09:00:00.5 +0900", 1577836800.5),
        ("2020-01-01 00-00-00_500", 1577836800.5),
        ("01-Jan-2020 00:00:00.500", 1577836800.5),
        ("Wed Jan 01 00:00:00 UTC 2020", 1577836800.0),
        ("14:05:10:123", 50710.123),
        ("2:05:10.5 PM", 50710.5),
        ("2:05:10.5 p.m.", 50710.5),
        ("01.01.2020 00:00:00,500", 1577836800.5),
        ("1. Januar 2020 00:00:00,5", 1577836800.5),
        ("1 juil. 2020 00:00:00", 1593561600.0),
        ("Jan 1, 2020 12:00:00.5 AM", 1577836800.5),
        ("1/13/20 12:00:00.5 AM", 1578873600.5),
        ("13-01-2020 00:00:00.5", 1578873600.5),
        ("2020/01/01 12:00:00.5 AM", 1577836800.5),
        ("20200101T000000.5Z", 1577836800.5),
        ("2020-01-01 00:00:00.5 UTC", 1577836800.5),
        ("2020-01-01T01:00:00.5+01:00[Europe/Berlin]", 1577836800.5),
        ("2016-12-31T23:59:60.5Z", 1483228800.5),
    ],
)
def test_time_stamps_as_text(text, seconds):
    assert seconds_of_texts([text, "-"])[0] == pytest.approx(seconds, abs=1e-6)


def test_a_time_of_day_passes_midnight():
    np.testing.assert_allclose(seconds_of_texts(["23:59:59.5", "00:00:00.5"]), [86399.5, 86400.5])


def test_a_folder_of_a_log_with_other_headings_is_a_mission(tmp_path, made, expected):
    imu, gnss = made
    turned = np.column_stack((imu[:, :1], imu[:, 1:4] * (1, -1, -1), imu[:, 4:] * (1, -1, -1)))
    table(tmp_path / "imu.csv", "timestamp,gyro_x,gyro_y,gyro_z,A1,accel_y,accel_z", turned)
    late = np.column_stack((gnss[:, 0] + 0.2, gnss[:, 1:6]))
    table(tmp_path / "gnss.csv", "timestamp,latitude,longitude,altitude,vel_n,vel_e", late)
    toml = 'latency_s = 0.2\nlever_arm_m = [1, 0, 0]\n[columns]\nA1 = "force_x[m/s²]"\n'
    (tmp_path / "log.toml").write_text(toml, "utf-8")
    found = LogMission.at(tmp_path)
    assert found.duration == pytest.approx(expected.duration)
    log = found.log
    np.testing.assert_allclose(log.rates[1], expected.rates[1], atol=1e-6)
    np.testing.assert_allclose(log.gnss.time - log.gnss.latency, expected.gnss.time, atol=1e-6)
    assert log.gnss.lever_arm[0] == 1
    assert any("A1, accel_y, accel_z of imu.csv, in m/s²" in remark for remark in log.repairs)


def test_a_record_at_rest_with_other_headings(tmp_path):
    rng = np.random.default_rng(2)
    rate, force = rng.normal(scale=0.05, size=(4000, 3)), rng.normal((0, 0, 1), 1e-3, (4000, 3))
    rows = np.column_stack((10.0 * np.arange(4000), force, rate))
    header = "time_ms,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
    records = rest.read_log(table(tmp_path / "a.csv", header, rows))
    np.testing.assert_allclose(records["gyro"].rates, np.radians(rate), atol=1e-12)
    np.testing.assert_allclose(records["accelerometer"].rates, force * STANDARD_GRAVITY, atol=1e-12)
    assert records["gyro"].dt == pytest.approx(0.01)
    with pytest.raises(MissionError, match=r"gyr_x, gyr_y, gyr_z do not name their unit"):
        rest.read_log(table(tmp_path / "a.csv", "time_ms,acc_x_g,acc_y_g,acc_z_g,gyr_x,gyr_y,gyr_z", rows))
