"""The same log as recorders write it whose clocks begin again, and that write angles in other ways."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest
from foreign_tables import motion, same, table

from lab.base.parameters.units import FOOT
from lab.data.files.fields import SEA_LEVEL
from lab.data.formats import read_raw
from lab.data.sheets.sheet import read_sheet
from lab.data.sheets.sheet_cells import angles_of_cells
from lab.data.sheets.sheet_clock import find_clock
from lab.missions import MissionError
from lab.missions.flight_import import read_log

IMU = "gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
PLACE = "latitude,longitude,altitude,vel_n,vel_e"
MIDNIGHT = 1_700_006_400
WEEK = 604_800


def stamped(folder, made, heading, stamp, place=PLACE, fix=None):
    """Write IMU and fixes with the stamps of another recorder; time 0 is the first sample."""
    imu, gnss = made
    first = imu[0, 0]
    rows = [[*stamp(t - first), *row] for t, row in zip(imu[:, 0], imu[:, 1:], strict=True)]
    fixes = gnss[:, 1:6] if fix is None else fix
    places = [[*stamp(t - first), *row] for t, row in zip(gnss[:, 0], fixes, strict=True)]
    return [
        table(folder / "imu.csv", f"{heading},{IMU}", rows),
        table(folder / "gps.csv", f"{heading},{place}", places),
    ]


def moment(seconds, form):
    return datetime.fromtimestamp(seconds, UTC).strftime(form)


CLOCKS = {
    "week": ("gps_tow", lambda t: [(WEEK - 20 + t) % WEEK]),
    "week and number": ("week,iTOW", lambda t: [2280.0 + (t >= 20), 1e3 * ((WEEK - 20 + t) % WEEK)]),
    "counter of 32 bits": ("time_us", lambda t: [round((2**32 - 20e6 + 1e6 * t) % 2**32)]),
    "time of day": ("time", lambda t: [moment(MIDNIGHT - 20 + t, "%H:%M:%S.%f")]),
    "date and time": (
        "date,time",
        lambda t: [moment(MIDNIGHT - 20 + t, "%d.%m.%Y"), moment(MIDNIGHT - 20 + t, "%H:%M:%S.%f")],
    ),
    "seconds of the day": ("time_s", lambda t: [(86_400 - 20 + t) % 86_400]),
}


@pytest.mark.proof
@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_begins_again_during_the_log(tmp_path, made, expected, name):
    same(read_log(stamped(tmp_path, made, *CLOCKS[name])), expected, 1e-3)


def test_a_long_log_passes_midnight(tmp_path):
    """A table is read in parts of 20,000 rows, and midnight may lie in any."""
    rows = [[moment(MIDNIGHT - 300 + t / 50, "%H:%M:%S.%f"), 0.0, 0.0, 9.8] for t in range(45_000)]
    path = table(tmp_path / "Accelerometer.csv", "time,x,y,z", rows)
    clock = find_clock(read_sheet(path.name, path.read_bytes()), fast=True)
    np.testing.assert_allclose(np.diff(clock.time), 0.02, atol=1e-5)


def nmea(angle, width, sides):
    return [f"{int(abs(angle)):0{width}d}{abs(angle) % 1 * 60:011.8f}", sides[int(angle < 0)]]


def ddmm(angle):
    return f"{np.sign(angle) * (abs(angle) // 1 * 100 + abs(angle) % 1 * 60):.8f}"


def minutes(angle, sides):
    return f"{int(abs(angle))}°{abs(angle) % 1 * 60:.8f}'{sides[int(angle < 0)]}"


def seconds(angle, sides):
    whole, part = divmod(abs(angle) * 60, 1)
    return f"{int(whole // 60)}° {int(whole % 60)}' {part * 60:.7f}'' {sides[int(angle < 0)]}"


def parts(angle, count):
    """Return whole degrees with the sign, and minutes, of which the last count has decimals."""
    cells, rest = [f"{'-' if angle < 0 else ''}{int(abs(angle))}"], abs(angle) % 1
    for _ in range(count - 1):
        cells.append(f"{int(60 * rest)}")
        rest = 60 * rest % 1
    return [*cells, f"{60 * rest:.9f}"]


@pytest.mark.parametrize(
    ("place", "write"),
    [("lat,ns,lon,ew", lambda lat, lon: [*nmea(lat, 2, "NS"), *nmea(lon, 3, "EW")]),
     ("latitude,longitude", lambda lat, lon: [minutes(lat, "NS"), minutes(lon, "EW")]),
     ("latitude,longitude", lambda lat, lon: [seconds(lat, "NS"), seconds(lon, "EW")]),
     ("lat,lon", lambda lat, lon: [ddmm(lat), ddmm(lon)]),
     ("lat_deg,lat_min,lon_deg,lon_min", lambda lat, lon: [*parts(lat, 1), *parts(lon, 1)]),
     ("longitude_degrees,longitude_minutes,latitude_degrees,latitude_minutes",
      lambda lat, lon: [*parts(lon, 1), *parts(lat, 1)]),
     ("Breite (Grad),Breite (Min),ns,Länge (Grad),Länge (Min),ew",
      lambda lat, lon: [*parts(abs(lat), 1), "NS"[int(lat < 0)], *parts(abs(lon), 1), "EW"[int(lon < 0)]]),
     ("LatDeg,LatMin,LatSec,LonDeg,LonMin,LonSec", lambda lat, lon: [*parts(lat, 2), *parts(lon, 2)])],
)  # fmt: skip
def test_degrees_and_minutes(tmp_path, made, expected, place, write):
    fix = [[*write(*row[1:3]), *row[3:6]] for row in made[1]]
    same(
        read_log(stamped(tmp_path, made, "time", lambda t: [t], f"{place},altitude,vel_n,vel_e", fix)),
        expected,
    )


def test_a_course_in_radians_and_a_speed_in_knots(tmp_path, made, expected):
    speed, course = motion(made[1])
    fix = [
        [*row[1:4], pace * 3600 / 1852, np.radians(angle)]
        for row, pace, angle in zip(made[1], speed, course, strict=True)
    ]
    place = "latitude,longitude,altitude,speed_kn,course"
    log = read_log(stamped(tmp_path, made, "time", lambda t: [t], place, fix))
    same(log, expected)
    assert any("course in rad (guessed" in remark for remark in log.repairs)


def test_angles_in_cells():
    import pandas as pd

    texts = ["48°07'02.5\"N", "48°7.0416667'N", "S 12° 30'", "-12.5", "W 0.25", "48 07 02.5 N", "none"]
    values = angles_of_cells(pd.Series(texts), False)
    north = 48 + 7 / 60 + 2.5 / 3600
    np.testing.assert_allclose(values, [north, north, -12.5, -12.5, -0.25, north, np.nan], atol=1e-7)


@pytest.mark.proof
def test_a_wrong_gyro_is_not_blamed_on_the_accelerometers(recordings, tmp_path):
    """With all accelerations reversed as well, nothing refuses the log, but the velocities do not fit."""
    imu, gnss = (
        np.loadtxt(recordings / "rtkx_walk" / f"{name}.csv", delimiter=",", skiprows=1)
        for name in ("imu", "gnss")
    )
    imu[:, 3] *= -1
    files = stamped(tmp_path, (imu, gnss), "time", lambda t: [t])
    with pytest.raises(MissionError, match="It seems that rate_z is -rate_z") as caught:
        read_log(files)
    assert "iPhones" not in str(caught.value)
    assert ".." not in str(caught.value)
    corrected = read_log(files, {"gyro_z_rad_s": "-rate_z[rad/s]"})
    assert corrected.gnss.time.size > 500


def test_a_header_that_ends_with_a_delimiter_and_rows_that_do_not(tmp_path):
    """Data loggers of MTK write it so; their texts, such as the state of the fix, make each row text."""
    rows = "".join(
        f"{i},2024-05-01,10:12:{i:02d},SPS,{51 + i * 1e-4:.4f},N,{12.4},E,{146 + i}\n" for i in range(9)
    )
    path = tmp_path / "log.csv"
    path.write_text(f"INDEX,DATE,TIME,VALID,LATITUDE,N/S,LONGITUDE,E/W,HEIGHT,\n{rows}")
    flight = read_raw(path)
    np.testing.assert_allclose(flight.height, 146.0 + np.arange(9))
    np.testing.assert_allclose(np.degrees(flight.latitude), 51 + 1e-4 * np.arange(9), rtol=1e-9)


def test_a_track_without_heights_is_a_flight_as_in_other_formats(tmp_path):
    rows = "".join(f"2024-05-01,10:12:{i:02d},{51 + i * 1e-4:.4f},12.4\n" for i in range(9))
    path = tmp_path / "log.csv"
    path.write_text(f"date,time,latitude,longitude\n{rows}")
    flight = read_raw(path)
    assert flight.height is None
    assert len(flight.time) == 9
    assert "No column with heights is found." in flight.remarks
    assert SEA_LEVEL not in flight.remarks
    assert [unit.column for unit in flight.units] == ["latitude", "longitude"]


@pytest.mark.parametrize(
    ("heading", "words"),
    [("altitudeRelative,altitudeAMSL", "above sea level"), ("alt,alt_ellipsoid", "above the ellipsoid"),
     ("Alt (MSL),Alt (HAE)", "above the ellipsoid"), ("height_msl,h_ellipsoid", "above the ellipsoid")],
)  # fmt: skip
def test_the_heights_are_those_above_the_ellipsoid_or_the_sea(tmp_path, heading, words):
    """QGroundControl, PX4 and u-center write two heights; the report names what the one that is read is."""
    rows = "".join(f"2024-05-01 10:12:{i:02d},{51 + i * 1e-4:.4f},12.4,{9 + i},{146 + i}\n" for i in range(9))
    path = tmp_path / "log.csv"
    path.write_text(f"Timestamp,gps.lat,gps.lon,{heading}\n{rows}")
    flight = read_raw(path)
    np.testing.assert_allclose(flight.height, 146.0 + np.arange(9))
    assert words in flight.remarks[-1]


def test_commas_separate_headings_of_several_words(tmp_path):
    """Torque writes a blank after the comma, and its words named more quantities than its cells."""
    header = (
        "GPS Time, Device Time, Longitude, Latitude,GPS Speed (Meters/second), "
        "Horizontal Dilution of Precision, Altitude, Bearing, G(x), G(y), G(z), G(calibrated)"
    )
    rows = "".join(
        f"Sat Jun 01 10:30:{i:02d} GMT+02:00 2024,01-Jun-2024 10:30:{i:02d}.250,12.4,"
        f"{51 + i * 1e-4:.4f},11.1,3,{146 + i},0.0,0,0,1,0\n"
        for i in range(9)
    )
    path = tmp_path / "trackLog.csv"
    path.write_text(f"{header}\n{rows}")
    flight = read_raw(path)
    np.testing.assert_allclose(np.degrees(flight.latitude), 51 + 1e-4 * np.arange(9), rtol=1e-9)
    np.testing.assert_allclose(flight.height, 146.0 + np.arange(9))
    np.testing.assert_allclose(np.diff(flight.time), 1.0)


def test_foreflight_writes_feet_and_another_log_in_knots_may(tmp_path):
    rows = [
        f"{1.7e9 + i:.3f},{51 + i * 46.3 / 111_250:.7f},12.4,{1000 + 10 * i},0.0,90.0,{{}}" for i in range(30)
    ]
    path = tmp_path / "track.csv"
    head = (
        "Pilot,Tail Number,Start Time\n,N1,1700000000000\nTimestamp,Latitude,Longitude,Altitude,Course,Speed"
    )
    path.write_text(
        f"{head},Bank,Pitch,Horizontal Error,Vertical Error\n" + "\n".join(rows).format(*["0,1,5,4"] * 30)
    )
    flight = read_raw(path)
    np.testing.assert_allclose(flight.height, FOOT * (1000 + 10 * np.arange(30)))
    assert "in ft (as ForeFlight writes)" in " ".join(flight.remarks)
    path.write_text(f"{head},bat\n" + "\n".join(rows).format(*["0"] * 30))
    other = read_raw(path)
    np.testing.assert_allclose(other.height, 1000 + 10 * np.arange(30))
    assert '--unit "Altitude=ft" says so' in " ".join(other.remarks)


def test_a_variable_of_simconnect_is_in_feet(tmp_path):
    rows = "".join(f"{i},{51 + i * 1e-4:.4f},12.4,{1000 + i}\n" for i in range(9))
    path = tmp_path / "log.csv"
    path.write_text(f"SIM TIME,PLANE LATITUDE,PLANE LONGITUDE,PLANE ALTITUDE\n{rows}")
    np.testing.assert_allclose(read_raw(path).height, FOOT * (1000 + np.arange(9)))


def test_a_table_without_a_time_is_told_that_it_lacks_one(tmp_path):
    rows = "".join(f"{1.7e9 + i:.1f},4b1815,{51 + i * 1e-4:.4f},12.4,{1000 + i}\n" for i in range(9))
    path = tmp_path / "log.csv"
    path.write_text(f"now,hex,lat,lon,altitude\n{rows}")
    with pytest.raises(
        MissionError, match="a table with lat, lon, altitude, and none of its headings names a"
    ):
        read_raw(path)
    assert len(read_raw(path, {"now": "time[s]"}).time) == 9
