"""Exports of loggers whose headings, units or heights are easily taken for something else."""

import numpy as np
import pytest
from foreign_tables import MPH, UNIX, moment, table, track

from lab.base.parameters.units import FOOT
from lab.data.files.fields import SEA_LEVEL
from lab.data.formats import read_raw
from lab.missions import MissionError
from lab.missions.flight_import import read_log

KMH = 1 / 3.6
G, FRD = 9.80665, (1, 1, 1)
TAKEOFF = 40.0
"""Height of the place of take-off [m]."""


def test_heights_above_the_takeoff_are_not_called_above_sea_level(tmp_path, made):
    header = "time(millisecond),latitude,longitude,relative_altitude(feet),ascent_x,speed(mph),max_a,max_b,c"
    points = track(made)
    above = (points[:, 3] - TAKEOFF) / FOOT
    rows = [
        [1000 * t, lat, lon, h, h, v / MPH, above.max(), above.max(), 0.0]
        for (t, lat, lon, _, v, _), h in zip(points, above, strict=True)
    ]
    flight = read_raw(table(tmp_path / "drone.csv", header, rows))
    assert SEA_LEVEL not in flight.remarks
    assert any("above the place of take-off" in remark for remark in flight.remarks)


def test_an_acceleration_by_its_unit_below_is_no_sigma(tmp_path, made):
    header = (
        "Time,GPS Speed,GPS Heading,GPS Altitude,GPS PosAccuracy,GPS Latitude,GPS Longitude,VerticalAcc\n"
        "s,km/h,deg,m,mm,deg,deg,g\n"
    )
    rows = [[t, v / KMH, c, h, 2000.0, lat, lon, 0.98] for t, lat, lon, h, v, c in track(made)]
    before = "Format,AiM CSV File\nSample Rate,1\n\n"
    flight = read_raw(table(tmp_path / "aim.csv", header, rows, before=before))
    sigmas = [remark for remark in flight.remarks if remark.startswith("σ")]
    assert not any("VerticalAcc" in remark for remark in sigmas)
    assert any("GPS PosAccuracy, in mm" in remark and "over 1.515" in remark for remark in sigmas)


def test_minutes_and_seconds_since_the_takeoff_of_a_dji_record(tmp_path, made):
    points = track(made)
    points[:, 0] += 55 - points[0, 0]  # beyond a minute
    header = "OSD.flyTime,OSD.latitude,OSD.longitude,OSD.altitude [ft],OSD.hSpeed [MPH]"
    rows = [
        [f"{int(t // 60)}m {t % 60:.1f}s", lat, lon, h / FOOT, v / MPH] for t, lat, lon, h, v, _ in points
    ]
    flight = read_raw(table(tmp_path / "dji.csv", header, rows, before="sep=,\n"))
    np.testing.assert_allclose(np.diff(flight.time), np.diff(points[:, 0]), atol=0.11)


def test_an_imu_of_ros_is_no_phone(tmp_path, made):
    """REP 103: x forward, y left, z up; a robot at rest does not show which axis is forward."""
    imu, gnss = made
    still = gnss.copy()
    still[:, 1:4] = gnss[0, 1:4]
    still[:, 1] += 1e-7 * np.arange(len(still))
    stamps = [[f"{round((UNIX + t) * 1e9)}"] for t in imu[:, 0]]
    rng = np.random.default_rng(1)
    samples = np.column_stack((rng.normal(0, 1e-3, (len(imu), 3)), rng.normal(0, 0.02, (len(imu), 3))))
    samples[:, 5] += 9.81
    head = ",".join(
        ("%time", *(f"field.{name}.{axis}" for name in ("angular_velocity", "linear_acceleration")
                    for axis in "xyz"))
    )  # fmt: skip
    one = table(tmp_path / "imu.csv", head, [[*a, *b] for a, b in zip(stamps, samples, strict=True)])
    two = table(
        tmp_path / "fix.csv", "%time,field.latitude,field.longitude,field.altitude",
        [[f"{round((UNIX + row[0]) * 1e9)}", *row[1:4]] for row in still],
    )  # fmt: skip
    log = read_log([one, two])
    assert any(remark.startswith("Axes: forward is x, right is -y, down is -z") for remark in log.repairs)


def test_an_imu_alone_is_told_that_a_receiver_is_missing(tmp_path, made):
    imu, _ = made
    header = "time_s," + ",".join(f"{name}_{axis}" for name in ("gyro", "acc") for axis in "xyz")
    path = table(tmp_path / "imu.csv", header, imu)
    with pytest.raises(MissionError, match="It has an IMU, but no positions of a receiver") as refused:
        read_log([path])
    assert "import the two files together" in str(refused.value)


@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S.%f", "%d/%m/%Y %H:%M:%S:%f"])
def test_a_date_with_the_time_of_the_day_is_a_time_stamp(tmp_path, made, form):
    points = track(made)
    rows = [[moment(t, form)[:-3], lat, lon, h, v, c] for t, lat, lon, h, v, c in points]
    path = table(tmp_path / "record.csv", "Date,gps_lat,gps_lng,gps_alt,gps_speed,gps_bearing", rows)
    flight = read_raw(path)
    np.testing.assert_allclose(flight.time - flight.time[0], points[:, 0] - points[0, 0], atol=2e-3)


@pytest.mark.parametrize(("written", "is_sea"), [("ellipsoidal", False), ("geodetic", True), ("", True)])
def test_heights_of_rtklib_are_above_what_its_header_says(tmp_path, made, written, is_sea):
    before = f"% program : RTKPOST\n% (lat/lon/height=WGS84/{written},Q=1:fix,2:float)\n"
    header = "%  UTC  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)"
    rows = [
        [moment(t, "%Y/%m/%d"), moment(t, "%H:%M:%S.%f"), lat, lon, h, 1, 12, 0.01, 0.01, 0.02]
        for t, lat, lon, h, *_ in track(made)
    ]
    flight = read_raw(table(tmp_path / "rover.pos", header, rows, " ", before=before))
    assert (SEA_LEVEL in flight.remarks) == is_sea
    assert any("above the ellipsoid, as the lines above" in remark for remark in flight.remarks) != is_sea


def test_milliseconds_beside_whole_seconds_are_their_fraction(tmp_path, made):
    """QStarz writes them in a column MS, and Advanced Navigation microseconds: alone they are no time."""
    rows = [
        [moment(t, "%Y/%m/%d"), moment(t, "%H:%M:%S"), (UNIX + t) % 1 * 1000, abs(lat), "N", abs(lon), "W", h,
         f"{v / KMH:.9f} km/h", c] for t, lat, lon, h, v, c in track(made)
    ]  # fmt: skip
    header = "UTC DATE,UTC TIME,MS,LATITUDE,N/S,LONGITUDE,E/W,HEIGHT,SPEED,HEADING"
    flight = read_raw(table(tmp_path / "log.csv", header, rows))
    np.testing.assert_allclose(flight.time, UNIX + track(made)[:, 0], atol=1e-5)
    rows = [[moment(t, "%Y-%m-%d %H:%M:%S"), int(UNIX + t), (UNIX + t) % 1 * 1e6, lat, lon, h]
            for t, lat, lon, h, *_ in track(made)]  # fmt: skip
    header = "Human Timestamp,Unix Time,Microseconds,Latitude,Longitude,Height"
    flight = read_raw(table(tmp_path / "state.csv", header, rows))
    np.testing.assert_allclose(flight.time, UNIX + track(made)[:, 0], atol=1e-5)


def test_a_flight_of_flightradar24_is_in_feet(tmp_path, made):
    header = "Timestamp,UTC,Callsign,Position,Altitude,Speed,Direction"
    rows = [[UNIX + t, moment(t, "%Y-%m-%dT%H:%M:%SZ"), "X1", f'"{lat},{lon}"', h / FOOT, v * 3600 / 1852, c]
            for t, lat, lon, h, v, c in track(made)]  # fmt: skip
    np.testing.assert_allclose(read_raw(table(tmp_path / "a.csv", header, rows)).height, track(made)[:, 3])


COUNTS = "GYROFLOW IMU LOG\nversion,1.3\ntscale,0.001\ngscale,0.00122\nascale,0.00048\n"
MADE_OF = {
    "gyroflow": ("t,gx,gy,gz,ax,ay,az", COUNTS, (1e-3, 0.00122, 0.00048 * G), FRD),
    "blackbox": (
        "time (us)," + ",".join(f"gyroADC[{i}] (deg/s)" for i in range(3))
        + "".join(f",accSmooth[{i}] (g)" for i in range(3)), "", (1e-6, np.pi / 180, G), FRD,
    ),
    "MoTeC": (
        "Time,Gyro Roll Rate,Gyro Pitch Rate,Gyro Yaw Rate,G Force Long,G Force Lat,G Force Vert\n"
        "s,deg/s,deg/s,deg/s,G,G,G", '"Format","MoTeC CSV File",,\n\n', (1.0, np.pi / 180, G), (1, -1, -1),
    ),
    "RaceCapture": (
        '"Utc"|"ms"|0|0|1,' + ",".join(f'"Gyro{a}"|"Deg/Sec"|-120|120|25' for a in "XYZ")
        + "".join(f',"Accel{a}"|"G"|-3.0|3.0|25' for a in "XYZ"), "", (1e-3, np.pi / 180, G), FRD,
    ),
}  # fmt: skip


@pytest.mark.parametrize("maker", MADE_OF)
def test_makers_that_write_units_in_their_own_way(tmp_path, made, maker):
    header, before, (second, rate, force), signs = MADE_OF[maker]
    imu, gnss = made
    rows = np.column_stack((imu[:, 0] / second, imu[:, 1:4] * signs / rate, imu[:, 4:] * signs / force))
    log = read_log([table(tmp_path / f"{maker}.csv", header, rows, before=before),
                    table(tmp_path / "gps.csv", "time_s,lat,lon,alt,vn,ve", gnss[:, :6])])  # fmt: skip
    np.testing.assert_allclose(np.column_stack(log.rates)[-99:], imu[-99:, 1:], atol=1e-4)
