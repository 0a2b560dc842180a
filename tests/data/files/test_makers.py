"""Files of other makers, in the words, units, axes and clocks that each of them writes.

The rows are those of a mission; the headings are those of the makers' programs.
"""

from __future__ import annotations

import zipfile

import numpy as np
import pandas as pd
import pytest
from foreign_tables import FLU, MPH, UNIX, is_track, moment, motion, phone, same, table, track

from lab.base.parameters.units import FOOT, KNOT, STANDARD_GRAVITY
from lab.data.formats import read_raw
from lab.data.sheets.column_names import heading_of
from lab.data.sheets.sheet_cells import numbers_of_cells
from lab.missions import MissionError
from lab.missions.flight_import import read_log


def rows_of(made, rate, force, stamp=float, fix=None):
    """Return rows with the samples of the IMU, and the latest fix in each, once one is known."""
    imu, gnss = made
    speed, course = motion(gnss)
    latest = np.clip(np.searchsorted(gnss[:, 0], imu[:, 0], side="right") - 1, 0, None)
    fixes = [fix(*gnss[i, 1:7], speed[i], course[i]) for i in range(len(gnss))]
    return [
        [stamp(t), *w, *f, *fixes[k]]
        for t, w, f, k in zip(imu[:, 0], rate, force, latest, strict=True)
    ]  # fmt: skip


def close(log, expected):
    """Check the samples, and the fixes where they are new: a logger repeats the latest one until then."""
    np.testing.assert_allclose(log.rates[0], expected.rates[0], atol=2e-6)
    np.testing.assert_allclose(log.rates[1], expected.rates[1], atol=2e-5)
    last = expected.gnss.position[-1]
    np.testing.assert_allclose(log.gnss.position[-1], last, atol=1e-8)


LOGS = {
    "DJI, with its own estimate beside the receiver": (
        "Clock:offsetTime,IMU_ATTI(0):gyroX,IMU_ATTI(0):gyroY,IMU_ATTI(0):gyroZ,IMU_ATTI(0):accelX,"
        "IMU_ATTI(0):accelY,IMU_ATTI(0):accelZ,IMU_ATTI(0):Longitude,IMU_ATTI(0):Latitude,IMU_ATTI(0):velN,"
        "IMU_ATTI(0):velE,GPS:Lat,GPS:Long,GPS:dateTimeStamp,GPS:heightMSL,GPS:velN,GPS:velE",
        lambda w, f: (np.degrees(w), f / STANDARD_GRAVITY),
        float,
        lambda lat, lon, h, vn, ve, *_: (
            lon + 1,
            lat + 1,
            99.0,
            99.0,
            lat,
            lon,
            "2023-11-14T22:13:20Z",
            h,
            vn,
            ve,
        ),
        "Clock:offsetTime",
    ),
    "OxTS, in cp1252": (
        "TimeFromStart (s),AngleRateX (deg/s),AngleRateY (deg/s),AngleRateZ (deg/s),AccelX (m/s²),"
        "AccelY (m/s²),AccelZ (m/s²),PosLat (deg),PosLon (deg),PosAlt (m),VelNorth (km/h),VelEast (km/h)",
        lambda w, f: (np.degrees(w), f),
        float,
        lambda lat, lon, h, vn, ve, *_: (lat, lon, h, 3.6 * vn, 3.6 * ve),
        "AngleRateX",
    ),
    "an iPhone, whose accelerations are along gravity": (
        "loggingTime(txt),gyroRotationX(rad/s),gyroRotationY(rad/s),gyroRotationZ(rad/s),"
        "accelerometerAccelerationX(G),accelerometerAccelerationY(G),accelerometerAccelerationZ(G),"
        "locationLatitude(WGS84),locationLongitude(WGS84),locationAltitude(m),locationSpeed(m/s),"
        "locationCourse(°)",
        lambda w, f: (phone(w), -phone(f) / STANDARD_GRAVITY),
        lambda t: moment(t, "%Y-%m-%d %H:%M:%S.%f") + " +0000",
        lambda lat, lon, h, vn, ve, vd, speed, course: (lat, lon, h, speed, course),
        "-accelerometerAccelerationX(G)",
    ),
    "VectorNav, in nanoseconds since switching on": (
        "TimeStartup,UncompGyro X,UncompGyro Y,UncompGyro Z,UncompAccel X,UncompAccel Y,UncompAccel Z,"
        "PosLla Lat,PosLla Lon,PosLla Alt,VelNed N,VelNed E,VelNed D",
        lambda w, f: (w, f),
        lambda t: f"{round((t - 900) * 1e9)}",
        lambda lat, lon, h, vn, ve, vd, *_: (lat, lon, h, vn, ve, vd),
        "TimeStartup, in ns",
    ),
}
"""IMU and fixes in one table: headings; rates and forces, stamp and fix as written; part of a remark."""


@pytest.mark.parametrize("maker", LOGS)
def test_a_log_in_one_table(tmp_path, made, expected, maker):
    header, sensed, stamp, fix, words = LOGS[maker]
    imu, _ = made
    rows = rows_of(made, *sensed(imu[:, 1:4], imu[:, 4:]), stamp=stamp, fix=fix)
    encoding = "cp1252" if "cp1252" in maker else "utf-8"
    log = read_log([table(tmp_path / "log.csv", header, rows, encoding=encoding)])
    close(log, expected)
    north = log.gnss.velocity_n[-1, :2]
    np.testing.assert_allclose(north, expected.gnss.velocity_n[-1, :2], atol=1e-6)
    assert any(words in remark for remark in log.repairs)


TRACKS = {
    "Airdata, with four heights": (
        "time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff(feet),"
        "altitude_above_seaLevel(feet),speed(mph),max_altitude(feet),altitude(feet)",
        lambda t, lat, lon, h, v, c: (
            1000 * t, moment(t, "%Y-%m-%d %H:%M:%S"), lat, lon, 5.0, h / FOOT, v / MPH, 9e3, 7.0
        ),
        False,
        "",
    ),
    "a DJI app": (
        "sep=,\nCUSTOM.date [local],OSD.flyTime [s],OSD.latitude,OSD.longitude,OSD.height [ft],"
        "OSD.altitude [ft],OSD.hSpeed [MPH],OSD.xSpeed [MPH],OSD.directionOfTravel,HOME.latitude,"
        "HOME.longitude",
        lambda t, lat, lon, h, v, c: (
            "11/14/2023", t - 1000, lat, lon, 5.0, h / FOOT, v / MPH, 1.0, c, 1.0, 2.0
        ),
        False,
        "",
    ),
    "a transmitter, whose place has a blank": (
        "Date,Time,GPS,GSpd(kmh),Hdg(°),Alt(m)",
        lambda t, lat, lon, h, v, c: (*clock(t, "%Y-%m-%d"), f"{lat:.8f} {lon:.8f}", 3.6 * v, c, h),
        True,
        "",
    ),
    "Qstarz, with units and hemispheres in cells": (
        "DATE,TIME,VALID,LATITUDE,N/S,LONGITUDE,E/W,HEIGHT,SPEED,HEADING",
        lambda t, lat, lon, h, v, c: (
            *clock(t, "%Y/%m/%d"), "SPS", f"{lat:.8f}", "N", f"{-lon:.8f}", "W", f"{h:.4f} M",
            f"{3.6 * v:.4f} km/h", c,
        ),
        True,
        "SPEED in km/h (named",
    ),
    "Columbus, with hemispheres in cells": (
        "DATE,TIME,LATITUDE N/S,LONGITUDE E/W,HEIGHT,SPEED,HEADING",
        lambda t, lat, lon, h, v, c: (
            moment(t, "%y%m%d"), moment(t, "%H%M%S.%f"), f"{lat:.8f}N", f"{-lon:.8f}W", f"{h:.4f}", 3.6 * v, c
        ),
        True,
        "",
    ),
    "Dynon, with blanks in its headings": (
        "Session Time,System Time,GPS Fix Quality,Number of Satellites,GPS Date & Time,Latitude (deg),"
        "Longitude (deg),GPS Altitude (feet),Ground Speed (knots),Ground Track (deg),Magnetic Heading (deg),"
        "Indicated Airspeed (knots),Pressure Altitude (ft),Lateral Accel (g),Vertical Accel(g)",
        lambda t, lat, lon, h, v, c: (
            t, moment(t, "%H:%M:%S"), 2, 9, moment(t, "%Y-%m-%d %H:%M:%S"), lat, lon, h / FOOT, v / KNOT, c,
            9.0, v / KNOT, h / FOOT + 90, 0.0, 1.0,
        ),
        True,
        "",
    ),
    "an Arduino, in kmph": (
        "millis,lat,lng,alt,speed_kmph,course",
        lambda t, lat, lon, h, v, c: (1000 * t, lat, lon, h, 3.6 * v, c),
        True,
        "",
    ),
}  # fmt: skip
"""Tracks: the headings, a point as it is written, whether its speed is read, and a part of a remark."""


def clock(seconds, day):
    """Return date and time of the day, in milliseconds."""
    return moment(seconds, day), moment(seconds, "%H:%M:%S.%f")[:-3]


@pytest.mark.parametrize("maker", TRACKS)
def test_a_track_in_one_table(tmp_path, made, maker):
    header, point, has_speed, words = TRACKS[maker]
    points = track(made)
    assert (points[:, 2] < 0).all()  # west
    flight = read_raw(table(tmp_path / "track.csv", header, [point(*row) for row in points]))
    is_track(flight, made)
    assert any(words in remark for remark in flight.remarks)
    assert (flight.velocity_n is not None) == has_speed
    if has_speed:
        speeds = np.hypot(*flight.velocity_n[:, :2].T)
        at = np.interp(flight.time - flight.time[0], points[:, 0] - points[0, 0], np.arange(len(points)))
        np.testing.assert_allclose(speeds, np.interp(at, np.arange(len(points)), points[:, 4]), rtol=1e-4)


def test_racechrono(tmp_path, made, expected):
    imu, gnss = made
    speed, course = motion(gnss)
    header = (
        "timestamp,fragment_id,accuracy,altitude,bearing,latitude,longitude,speed,lean_angle,"
        "x_acc,y_acc,z_acc,x_rate_of_rotation,y_rate_of_rotation,z_rate_of_rotation"
    )
    units = "unix time,,m,m,deg,deg,deg,m/s,deg,G,G,G,deg/s,deg/s,deg/s"
    source = ",,100: gps,100: gps,100: gps,100: gps,100: gps,100: gps,calc,101: acc,101: acc,101: acc"
    sensors = np.column_stack((phone(imu[:, 4:]) / STANDARD_GRAVITY, np.degrees(phone(imu[:, 1:4]))))
    rows = [[UNIX + t, "0", *[""] * 6, "0", *row] for t, row in zip(imu[:, 0], sensors, strict=True)]
    rows += [
        [UNIX + t, "0", 3.0, h, c, lat, lon, v, "0", *[""] * 6]
        for t, lat, lon, h, v, c in zip(*gnss[:, :4].T, speed, course, strict=True)
    ]
    rows.sort(key=lambda row: row[0])
    before = "This file is created using RaceChrono v8.0.6 ( http://racechrono.com/ ).\n\nFormat,3\n\n"
    path = table(tmp_path / "session.csv", f"{header}\n{units}\n{source}", rows, before=before)
    log = read_log([path])
    np.testing.assert_allclose(log.rates[0], expected.rates[0], atol=1e-5)
    assert any("x_rate_of_rotation" in remark and "°/s (named" in remark for remark in log.repairs)


@pytest.mark.proof
def test_accelerations_along_gravity_are_suspected_in_turns(tmp_path, made, expected):
    """Swapped gyros look alike, so that nothing is reversed without a word of a person."""
    imu, _ = made
    header = "time,wx,wy,wz,ax,ay,az,latitude,longitude,altitude,speed,course"
    rows = rows_of(
        made, phone(imu[:, 1:4]), -phone(imu[:, 4:]),
        fix=lambda lat, lon, h, vn, ve, vd, speed, course: (lat, lon, h, speed, course),
    )  # fmt: skip
    path = table(tmp_path / "app.csv", header, rows)
    with pytest.raises(MissionError, match="along gravity and not against it"):
        read_log([path])
    close(read_log([path], {f"a{axis}": f"-force_{axis}" for axis in "xyz"}), expected)


def test_a_table_that_a_simulator_could_have_written_goes_with_an_imu(tmp_path, made, expected):
    """Time, lat, lon, alt, vn and ve are headings of JSBSim too."""
    imu, gnss = made
    one = table(
        tmp_path / "imu_data.csv", "time,ax,ay,az,gyro_x,gyro_y,gyro_z", imu[:, [0, 4, 5, 6, 1, 2, 3]]
    )
    two = table(tmp_path / "gps_data.csv", "time,lat,lon,alt,vn,ve", gnss[:, :6])
    for paths in ([one, two], [tmp_path]):
        same(read_log(paths), expected)
    assert read_raw([one, two]).height is not None


def test_rates_without_a_unit_beside_g_may_be_radians(tmp_path, made, expected):
    imu, _ = made
    header = "time,acc_x_g,acc_y_g,acc_z_g,wx,wy,wz,Latitude,Longitude,Altitude,Speed (m/s),Bearing"
    rows = rows_of(
        made, phone(imu[:, 4:]) / STANDARD_GRAVITY, phone(imu[:, 1:4]),
        fix=lambda lat, lon, h, vn, ve, vd, speed, course: (lat, lon, h, speed, course),
    )  # fmt: skip
    # The turns of a copter do not show the unit, since it moves where it likes.
    log = read_log([table(tmp_path / "logger.csv", header, rows)], axes=("y", "x", "-z"), vehicle="copter")
    close(log, expected)
    assert any("rad/s (guessed" in remark for remark in log.repairs)


def test_gopro(tmp_path, made, expected):
    imu, gnss = made
    for name, vectors, unit in (
        ("Accelerometer", phone(imu[:, 4:]), "m/s²"), ("Gyroscope", phone(imu[:, 1:4]), "rad/s"),
    ):  # fmt: skip
        header = f"cts,date,{name} (z) [{unit}],{name} (x) [{unit}],{name} (y) [{unit}],temperature [°C]"
        rows = [
            [1000 * (t - 1000), "2023-11-14T22:13:20.000Z", z, x, y, "40"]
            for t, (x, y, z) in zip(imu[:, 0], vectors, strict=True)
        ]
        table(tmp_path / f"GH01-{name}.csv", header, rows)
    header = (
        "cts,date,GPS (Lat.) [deg],GPS (Long.) [deg],GPS (Alt.) [m],GPS (2D speed) [m/s],GPS (3D speed) [m/s]"
    )
    rows = [
        [1000 * (t - 1000), "2023-11-14T22:13:20.000Z", *row, "1", "1"]
        for t, row in zip(gnss[:, 0], gnss[:, 1:4], strict=True)
    ]
    table(tmp_path / "GH01-GPS5.csv", header, rows)
    log = read_log([tmp_path])
    np.testing.assert_allclose(log.rates[0], expected.rates[0], atol=1e-6)
    np.testing.assert_allclose(log.gnss.position, expected.gnss.position, atol=1e-9)


def test_a_folder_of_phyphox(tmp_path, made, expected):
    imu, gnss = made
    for name, vectors, unit in (
        ("Accelerometer", phone(imu[:, 4:]), "m/s^2"), ("Gyroscope", phone(imu[:, 1:4]), "rad/s"),
    ):  # fmt: skip
        header = ",".join(('"Time (s)"', *(f'"{axis} ({unit})"' for axis in "XYZ")))
        rows = [[t - 1000, *v] for t, v in zip(imu[:, 0], vectors, strict=True)]
        table(tmp_path / f"{name}.csv", header, rows)
    speed, course = motion(gnss)
    header = (
        '"Time (s)","Latitude (°)","Longitude (°)","Height (m)","Velocity (m/s)","Direction (°)",'
        '"Horizontal Accuracy (m)","Vertical Accuracy (°)"'
    )
    rows = [
        [*row, v, c, 4.0, 3.0] for row, v, c in zip(gnss[:, :4] - [1000, 0, 0, 0], speed, course, strict=True)
    ]
    table(tmp_path / "Location.csv", header, rows)
    same(read_log([tmp_path]), expected, 1e-5)


@pytest.mark.proof
def test_a_drive_of_kitti(tmp_path, made, expected):
    imu, gnss = made
    with zipfile.ZipFile(tmp_path / "drive.zip", "w") as archive:
        folder = "2011_09_26/2011_09_26_drive_0001_extract/oxts"
        stamps = []
        for i, (t, w, f) in enumerate(zip(imu[:, 0], imu[:, 1:4] * FLU, imu[:, 4:] * FLU, strict=True)):
            lat, lon, h, vn, ve, vd = gnss[max(np.searchsorted(gnss[:, 0], t, side="right") - 1, 0), 1:7]
            row = (lat, lon, h, 0, 0, 0, vn, ve, 0, 0, -vd, *f, *f, *w, *w, 0.05, 0.02, 4, 11, 6, 6, 6)
            archive.writestr(f"{folder}/data/{i:010d}.txt", " ".join(f"{one:.14g}" for one in row))
            stamps.append(moment(t, "%Y-%m-%d %H:%M:%S.%f") + "000")
        archive.writestr(f"{folder}/timestamps.txt", "\n".join(stamps) + "\n")
    log = read_log([tmp_path / "drive.zip"])
    close(log, expected)
    assert any("forward is x, right is -y, down is -z" in remark for remark in log.repairs)
    with zipfile.ZipFile(tmp_path / "drive.zip") as archive:
        archive.extractall(tmp_path)
    drive = tmp_path / folder
    for place in (drive.parent, drive, drive / "timestamps.txt"):
        close(read_log([place]), expected)


def test_flysight_2(tmp_path, made, expected):
    imu, gnss = made
    gps_time = UNIX - 315_964_800 + 18
    week, second = divmod(gps_time, 604_800)
    head = "$FLYS,1\n$VAR,FIRMWARE_VER,v2024.05.25\n"
    sensors = np.column_stack((np.degrees(phone(imu[:, 1:4])), phone(imu[:, 4:]) / STANDARD_GRAVITY))
    rows = [["$IMU", t - 1000, *row, "25"] for t, row in zip(imu[:, 0], sensors, strict=True)]
    rows[5:5] = [["$TIME", "33", f"{second + 1033}", f"{week:.0f}"], ["$BARO", "33", "97000", "25"]]
    table(
        tmp_path / "SENSOR.CSV",
        "$COL,BARO,time,pressure,temperature\n$UNIT,BARO,s,Pa,deg C\n"
        "$COL,IMU,time,wx,wy,wz,ax,ay,az,temperature\n$UNIT,IMU,s,deg/s,deg/s,deg/s,g,g,g,deg C\n"
        "$COL,TIME,time,tow,week\n$UNIT,TIME,s,s,\n$DATA",
        rows,
        before=head,
    )
    table(
        tmp_path / "TRACK.CSV",
        "$COL,GNSS,time,lat,lon,hMSL,velN,velE\n$UNIT,GNSS,,deg,deg,m,m/s,m/s\n$DATA",
        [["$GNSS", moment(row[0], "%Y-%m-%dT%H:%M:%S.%fZ"), *row[1:6]] for row in gnss],
        before=head,
    )
    log = read_log([tmp_path])
    np.testing.assert_allclose(log.gnss.time, expected.gnss.time, atol=1e-3)
    np.testing.assert_allclose(log.rates[0], expected.rates[0], atol=1e-3)


def test_the_clock_of_a_flysight_drifts(tmp_path, made, expected):
    """Its stamps of GPS time show by how much; the first came before the receiver knew the time."""
    imu, gnss = made
    drift = 5e-4

    def device(t):
        return (t - 1000) * (1 + drift)

    def stamp(t, error=0.0):
        week, second = divmod(UNIX + t - 315_964_800 + 18 + error, 604_800)
        return f"$TIME,{device(t):.6f},{second:.4f},{week:.0f}"

    lines = [stamp(imu[0, 0], -3e7), *(stamp(t) for t in np.arange(imu[0, 0], imu[-1, 0], 5.0))]
    sensors = np.column_stack((np.degrees(imu[:, 1:4]), imu[:, 4:] / STANDARD_GRAVITY))
    lines += [
        f"$IMU,{device(t):.6f},{','.join(f'{x:.9g}' for x in row)}"
        for t, row in zip(imu[:, 0], sensors, strict=True)
    ]
    head = "$FLYS,1\n$COL,IMU,time,wx,wy,wz,ax,ay,az\n$UNIT,IMU,s,deg/s,deg/s,deg/s,g,g,g\n$DATA\n"
    (tmp_path / "SENSOR.CSV").write_text(head + "\n".join(lines) + "\n")
    table(
        tmp_path / "TRACK.CSV",
        "$COL,GNSS,time,lat,lon,hMSL,velN,velE\n$UNIT,GNSS,,deg,deg,m,m/s,m/s\n$DATA",
        [["$GNSS", moment(row[0], "%Y-%m-%dT%H:%M:%S.%fZ"), *row[1:6]] for row in gnss],
        before="$FLYS,1\n",
    )
    log = read_log([tmp_path])
    np.testing.assert_allclose(log.gnss.time, expected.gnss.time, atol=1e-3)
    np.testing.assert_allclose(log.duration, expected.duration, atol=1e-3)


@pytest.mark.parametrize(
    "lines",
    [
        "$TIME,1\n$IMU,abc",
        "$COL,IMU,time,wx\n$UNIT,IMU,s,deg/s\n$TIME,a,b,c\n$IMU,1,2",
        "$COL,IMU,time,wx,wy,wz\n$TIME,1,2,3\n$IMU,x,2",
        "$COL,IMU,\n$TIME,1,2,3\n$IMU,",
        "$COL\n$UNIT\n$IMU,1,2",
    ],
)
def test_damaged_files_of_flysight_are_refused(tmp_path, lines):
    path = tmp_path / "SENSOR.CSV"
    path.write_text(f"$FLYS,1\n{lines}\n")
    with pytest.raises(MissionError):
        read_log([path])


def test_counts_of_betaflight(tmp_path, made, expected):
    imu, gnss = made
    header = ", ".join(
        (
            "loopIteration",
            "time (us)",
            *(f"gyroADC[{i}]" for i in range(3)),
            *(f"accSmooth[{i}]" for i in range(3)),
        )
    )
    force = np.round(imu[:, 4:] * FLU / STANDARD_GRAVITY * 2048)
    rows = [
        [f"{i}", t * 1e6, *w, *f]
        for i, (t, w, f) in enumerate(zip(imu[:, 0], np.degrees(imu[:, 1:4]) * FLU, force, strict=True))
    ]
    one = table(tmp_path / "LOG.01.csv", header, rows, separator=", ")
    speed, course = motion(gnss)
    header = (
        "time (us), GPS_numSat, GPS_coord[0], GPS_coord[1], GPS_altitude, GPS_speed (m/s), GPS_ground_course"
    )
    rows = [
        [t * 1e6, "12", lat, lon, h, v, c]
        for t, lat, lon, h, v, c in zip(*gnss[:, :4].T, speed, course, strict=True)
    ]
    log = read_log([one, table(tmp_path / "LOG.01.gps.csv", header, rows, separator=", ")])
    np.testing.assert_allclose(log.rates[1], expected.rates[1], atol=0.5 / 2048 * STANDARD_GRAVITY * 1.01)
    assert any("2048 of which are 1 g" in remark for remark in log.repairs)


def test_a_place_in_one_cell_and_the_feet_of_a_transponder(tmp_path, made):
    points = track(made)[::1]
    level = np.round((points[:, 3] + 40 * np.arange(len(points))) / FOOT / 25) * 25
    rows = [
        [f"{UNIX + t:.3f}", "N1", f'"{lat:.8f},{lon:.8f}"', f"{h:.0f}", v / KNOT, c]
        for (t, lat, lon, _, v, c), h in zip(points, level, strict=True)
    ]
    flight = read_raw(
        table(tmp_path / "fr24.csv", "Timestamp,Callsign,Position,Altitude,Speed,Direction", rows)
    )
    np.testing.assert_allclose(flight.height, level * FOOT, atol=1e-6)
    np.testing.assert_allclose(np.degrees(flight.longitude), points[:, 2], atol=1e-8)
    assert any("in ft (guessed: all are multiples of 25" in remark for remark in flight.remarks)
    assert any("Speed in kt (guessed" in remark for remark in flight.remarks)


def test_vbox_counts_minutes_and_west(tmp_path, made):
    rows = [
        ["012", moment(t, "%H%M%S.%f"), f"{60 * lat:+.8f}", f"{-60 * lon:+.8f}", v / KNOT, c, h, 0.0]
        for t, lat, lon, h, v, c in track(made)
    ]
    before = (
        "File created on 28/05/2023 at 12:21:10\n\n[header]\nsatellites\ntime\nlatitude\nlongitude\n"
        "velocity knots\nheading\nheight\nvertical velocity m/s\n\n[comments]\nx\n\n[column names]\n"
    )
    path = table(
        tmp_path / "lap.vbo", "sats time lat long velocity heading height vert-vel\n\n[data]", rows,
        separator=" ", before=before,
    )  # fmt: skip
    flight = read_raw(path)
    is_track(flight, made)
    assert flight.velocity_n is not None
    speeds = np.hypot(*flight.velocity_n[:, :2].T)
    np.testing.assert_allclose(speeds, track(made)[:, 4], rtol=1e-6)
    other = read_raw(path, {"velocity": "mph"})
    assert other.velocity_n is not None
    np.testing.assert_allclose(np.hypot(*other.velocity_n[:, :2].T), speeds * MPH / KNOT, rtol=1e-6)


@pytest.mark.parametrize(
    ("cells", "separated", "values", "unit"),
    [
        (["2,114.8", "999.1", ""], True, [2114.8, 999.1, np.nan], ""),
        (["12,345", "999"], True, [12345, 999], ""),
        (["12,345", "9,1"], False, [12.345, 9.1], ""),
        (["1,212,345.5", "9"], False, [1212345.5, 9], ""),
        (["245.5 m", "-3 m"], True, [245.5, -3], "m"),
        (["→ 84°", "?"], True, [84, np.nan], "°"),
    ],
)
def test_numbers_in_cells(cells, separated, values, unit):
    numbers, found = numbers_of_cells(pd.Series(cells), separated)
    np.testing.assert_allclose(numbers, values)
    assert found == unit


def test_the_order_of_day_and_month_is_said_where_it_is_assumed(tmp_path, made):
    for form, words in (("%d/%m/%Y", ""), ("%m/%d/%Y", "")):
        rows = [[moment(t, f"{form} %H:%M:%S.%f"), lat, lon, h] for t, lat, lon, h, *_ in track(made)]
        flight = read_raw(table(tmp_path / "day.csv", "time,lat,lon,alt", rows))
        assert round(flight.time[0]) == round(UNIX + track(made)[0, 0]), words
        assert not any("before the month" in remark for remark in flight.remarks)
    rows = [[f"03/04/2023 {moment(t, '%H:%M:%S.%f')}", lat, lon, h] for t, lat, lon, h, *_ in track(made)]
    flight = read_raw(table(tmp_path / "day.csv", "time,lat,lon,alt", rows))
    assert any("the day is assumed to come before the month" in remark for remark in flight.remarks)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("#timestamp, p_RS_R_x [m], p_RS_R_y [m]\n1,2,3\n", "positions in metres from an origin"),
        ("# timestamp tx ty tz qx qy qz qw\n1 2 3 4 5 6 7 8\n", "positions in metres from an origin"),
        ("#BESTPOSA,COM1,0,78.5;SOL_COMPUTED,SINGLE,51,0\n", "NovAtel"),
        (
            "%RAWIMUSXA,2200,10.01;00,31,2200,10.01,0,-1054447,-1582,43061,-3792,19302,4345*1dd0481d\n",
            "--as log",
        ),
        ("$GPGGA,120000,5130.0,N,00007.0,W,1,9,1,10,M,,,,\n" * 3, "right checksum"),
        ('{"a": [1, 2]}\n', "JSON"),
        ("     3.04           OBSERVATION DATA    M                   RINEX VERSION / TYPE\n", "RINEX"),
    ],
)
def test_what_is_not_read_is_named(tmp_path, text, words):
    (tmp_path / "file").write_text(text)
    with pytest.raises(MissionError, match=words):
        read_raw(tmp_path / "file")


@pytest.mark.parametrize(
    ("text", "quantity", "axis", "unit"),
    [
        ("I.pqr[1]", "rate", "y", ""), ("lla[2]", "height", "", ""), ("GPS_coord[1]", "longitude", "", ""),
        ("YawRate", "rate", "z", ""), ("altitudeAboveMeanSeaLevel", "height", "", ""),
        ("feet", "height", "", "ft"), ("kts", "speed", "", "kt"), ("VSpd(m/s)", "up", "", "m/s"),
        ("Shimmer_9DB2_Accel_LN_X_CAL", "force", "x", ""), ("IMU_ATTI(1):gyroZ", "rate", "z", ""),
        ("LatitudeDegrees", "latitude", "", "°"), ("SpeedAccuracyMps", "speed_sigma", "", "m/s"),
        ("UncalGyroXRadPerSec", "rate", "x", "rad/s"), ("AccelZMps2", "force", "z", "m/s²"),
        ("altitudeFeet", "height", "", "ft"), ("AccuracyMeters", "horizontal_sigma", "", "m"),
        ("OSD.hSpeed [MPH]", "speed", "", "mph"), ("Direction (°)", "course", "", "°"),
    ],
)  # fmt: skip
def test_headings_of_makers(text, quantity, axis, unit):
    found = heading_of(text)
    assert found is not None
    assert (found.quantity, found.axis, found.unit) == (quantity, axis, unit)
