"""Exports of the app Sensor Logger from iPhones and Android, whose signs and units differ by its documents.

The app's *CROSSPLATFORM.md*: on an iPhone accelerations and gravity have the other sign in all three axes,
unless frames are standardised; uncalibrated accelerations are in g there.
"""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from foreign_tables import UNIX, motion, phone, same, table

from lab.base.parameters.units import STANDARD_GRAVITY
from lab.data.files.sensor_log_csv import read_sensor_log
from lab.missions.flight_import import read_log

HEADER = "time,seconds_elapsed,z,y,x"
METADATA = (
    "version,device name,recording epoch time,recording time,recording timezone,platform,appVersion,"
    "device id,sensors,sampleRateMs,standardisation,platform version"
)


def stamps(time):
    return [f"{int((UNIX + t) * 1e9)}" for t in time]


def sensor(folder, name, time, vectors):
    rows = [[text, t - 1000, *v[::-1]] for text, t, v in zip(stamps(time), time, vectors, strict=True)]
    table(folder / f"{name}.csv", HEADER, rows)


def metadata(folder, platform, standardised="false"):
    row = ["3", "Phone", "0", "2023-11-14_22-13-20", "UTC", platform, "1.64", "id", "A|B", "10|10",
           standardised, "17"]  # fmt: skip
    table(folder / "Metadata.csv", METADATA, [row])


def export(folder, made, sign, *, uncalibrated=None):
    """Write gravity and the acceleration without it, as both systems do; signs and units are of iOS."""
    folder.mkdir()
    imu, gnss = made
    time, force = imu[:, 0], phone(imu[:, 4:])
    gravity = np.tile(np.median(force, axis=0), (len(force), 1))
    sensor(folder, "Gyroscope", time, phone(imu[:, 1:4]))
    sensor(folder, "Gravity", time, sign * gravity)
    sensor(folder, "Accelerometer", time, sign * (force - gravity))
    if uncalibrated:
        sensor(folder, "AccelerometerUncalibrated", time, sign * force / uncalibrated)
    speed, course = motion(gnss)
    rows = [
        [text, t - 1000, 5.0, s, c, h, lon, lat]
        for text, (t, lat, lon, h), s, c in zip(
            stamps(gnss[:, 0]), gnss[:, :4], speed, course, strict=True
        )
    ]  # fmt: skip
    header = "time,seconds_elapsed,horizontalAccuracy,speed,bearing,altitude,longitude,latitude"
    table(folder / "Location.csv", header, rows)
    return folder


def zipped(folder):
    with zipfile.ZipFile(folder.with_suffix(".zip"), "w") as archive:
        for path in sorted(folder.iterdir()):
            archive.write(path, path.name)
    return folder.with_suffix(".zip")


@pytest.mark.proof
@pytest.mark.parametrize(
    ("platform", "standardised", "sign"), [("ios", "false", -1), ("ios", "true", 1), ("android", "false", 1)]
)
def test_the_signs_are_those_of_the_platform(tmp_path, made, expected, platform, standardised, sign):
    folder = export(tmp_path / "phone", made, sign)
    metadata(folder, platform, standardised)
    for place in (folder, zipped(folder)):
        log = read_log([place])
        same(log, expected, 2e-3)
        assert ("signs of Gravity.csv are reversed" in " ".join(log.repairs)) == (sign < 0)


def test_uncalibrated_accelerations_in_g_are_of_an_iphone(tmp_path, made, expected):
    log = read_log([export(tmp_path / "phone", made, -1, uncalibrated=STANDARD_GRAVITY)])
    same(log, expected, 2e-3)
    assert any("AccelerometerUncalibrated.csv is in g, as on an iPhone" in one for one in log.repairs)


def test_what_a_person_says_of_the_signs_counts(tmp_path, made, expected):
    """A heading that a person gives is not reversed once more."""
    folder = export(tmp_path / "phone", made, -1)
    for axis in "xyz":
        path = folder / "Gravity.csv"
        path.write_text(path.read_text().replace(axis, f"g{axis}", 1))
        path = folder / "Accelerometer.csv"
        path.write_text(path.read_text().replace(axis, f"a{axis}", 1))
    metadata(folder, "ios")
    given = {f"a{axis}": f"-force_{axis}[m/s²]" for axis in "xyz"}
    given |= {f"g{axis}": f"-gravity_{axis}[m/s²]" for axis in "xyz"}
    same(read_log([folder], given), expected, 2e-3)


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    """Return IMU and GPS of a car that speeds up and brakes on a straight and level road, at 50 Hz."""
    rng = np.random.default_rng(0)
    time = np.arange(0, 60, 0.02) + 1000
    along = 2 * np.sin(2 * np.pi * (time - 1000) / 15)
    speed = np.cumsum(along) * 0.02 + 12
    north = np.cumsum(speed) * 0.02
    force = np.column_stack((along, 0 * along, np.full(time.size, -STANDARD_GRAVITY)))
    imu = np.column_stack((time, rng.normal(scale=1e-3, size=(time.size, 3)), force))
    imu[:, 4:] += rng.normal(scale=0.02, size=(time.size, 3))
    rows = slice(None, None, 50)
    zero = np.zeros(time[rows].size)
    gnss = np.column_stack((time[rows], 45 + north[rows] / 111_130, zero + 8, zero + 100, speed[rows], zero))
    return imu, gnss


def test_what_the_motion_does_not_show_of_the_signs_is_reported(tmp_path, straight):
    """A car on a straight road: both signs agree with the motion, each with axes of its own."""
    log = read_log([export(tmp_path / "phone", straight, 1)])
    (said,) = (one for one in log.repairs if one.startswith("Axes"))
    assert "forward is y, right is x, down is -z" in said
    assert "along gravity, as some do on iPhones, forward is -y, right is x, down is z" in said
    assert "--column HEADING=-force_x[m/s²]" in said
    folder = export(tmp_path / "known", straight, 1)
    metadata(folder, "android")
    assert not any("iPhones" in one for one in read_log([folder]).repairs)


def test_where_the_motion_shows_the_signs_nothing_is_said(tmp_path, made, expected):
    log = read_log([export(tmp_path / "phone", made, 1)])
    same(log, expected, 2e-3)
    assert not any("iPhones" in one for one in log.repairs)


def test_a_watch_beside_the_phone_is_another_imu(tmp_path, made, expected):
    """More samples, in other axes, with gravity of its own: nothing of it goes into the phone's."""
    folder = export(tmp_path / "phone", made, 1)
    metadata(folder, "android")
    time = np.arange(made[0][0, 0], made[0][-1, 0], 0.004)
    rng = np.random.default_rng(1)
    down = np.tile((0.0, -1.0, 0.0), (time.size, 1))
    cells = np.column_stack((rng.normal(size=(time.size, 3)), down, rng.normal(size=(time.size, 3))))
    header = ",".join(
        ("time", "seconds_elapsed",
         *(f"{name}{axis}" for name in ("rotationRate", "gravity", "acceleration") for axis in "XYZ"))
    )  # fmt: skip
    rows = [[text, t - 1000, *row] for text, t, row in zip(stamps(time), time, cells, strict=True)]
    table(folder / "WristMotion.csv", header, rows)
    log = read_log([folder])
    same(log, expected, 2e-3)
    assert any("Other gyros in the files are not used: rotationRateX of WristMotion.csv" in one
               for one in log.repairs)  # fmt: skip


def test_a_folder_of_the_labs_own_files_is_not_touched(tmp_path, recordings):
    """A file of that name beside other tables says nothing about them."""
    import shutil

    for name in ("imu.csv", "gnss.csv"):
        shutil.copy(recordings / "comma2k19" / name, tmp_path / name)
    before = read_sensor_log(tmp_path)
    metadata(tmp_path, "ios")
    np.testing.assert_array_equal(read_sensor_log(tmp_path).dvelocity, before.dvelocity)
