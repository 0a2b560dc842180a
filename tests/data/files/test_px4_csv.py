"""The csv files that ulog2csv of pyulog makes of a PX4 log: a folder or a zip file of them is that log."""

from __future__ import annotations

import contextlib
import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from pyulog.ulog2csv import convert_ulog2csv
from sensor_logs import tables
from writers import ulog

from lab.missions import mission
from lab.missions.flight_import import read_log

LOGS = Path(__file__).parents[4] / "shared" / "logs"


def exported(log: Path, folder: Path) -> Path:
    """Return a folder with all topics of a log."""
    folder.mkdir()
    with contextlib.redirect_stdout(io.StringIO()):
        convert_ulog2csv(str(log), None, str(folder), ",", None, None)
    return folder


def zipped(folder: Path) -> Path:
    path = folder.with_suffix(".zip")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for one in sorted(folder.iterdir()):
            archive.write(one, one.name)
    return path


def assert_same(csv, own) -> None:
    """Assert that a log read of csv files is that of the ULog."""
    assert csv.epoch == pytest.approx(own.epoch, abs=1e-9)
    np.testing.assert_allclose(csv.time, own.time, atol=1e-8)
    # Text has eight or nine digits of a float32.
    np.testing.assert_allclose(csv.dtheta, own.dtheta, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(csv.dvelocity, own.dvelocity, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(csv.gnss.position[:, :2], own.gnss.position[:, :2], atol=1e-12)
    np.testing.assert_allclose(csv.gnss.velocity_n, own.gnss.velocity_n, atol=1e-6)
    assert not csv.auxiliary.forward_assumed


@pytest.mark.parametrize("name", ["copter_61.ulg", "px4_small.ulg"])
def test_real_logs_are_the_same_from_their_csv_files(tmp_path, name):
    log = LOGS / name
    if not log.is_file():
        pytest.skip("the shared logs are not there")
    folder = exported(log, tmp_path / "topics")
    own = read_log([log])
    for source in (folder, zipped(folder)):
        found = read_log([source])
        assert_same(found, own)
        said = " ".join(found.repairs)
        assert "forward is x, right is y, down is z" in said
        assert "vehicle_air_data_0.csv" in said


def test_the_estimators_attitude_is_the_reference_of_a_copter(tmp_path):
    log = LOGS / "copter_61.ulg"
    if not log.is_file():
        pytest.skip("the shared logs are not there")
    found = read_log([zipped(exported(log, tmp_path / "topics"))])
    assert found.reference is not None
    assert "vehicle_attitude_0.csv" in next(one for one in found.repairs if one.startswith("Attitude"))


def test_a_made_log_is_the_same(tmp_path):
    (tmp_path / "flight.ulg").write_bytes(ulog.write(mission("montreal").recording))
    folder = exported(tmp_path / "flight.ulg", tmp_path / "topics")
    own = read_log([tmp_path / "flight.ulg"])
    for source in (folder, zipped(folder)):
        found = read_log([source])
        np.testing.assert_allclose(found.time, own.time, atol=1e-8)
        np.testing.assert_allclose(found.gnss.position[:, :2], own.gnss.position[:, :2], atol=1e-12)
        np.testing.assert_allclose(found.dvelocity, own.dvelocity, rtol=1e-6, atol=1e-7)


def test_topics_since_2023_name_their_units(tmp_path):
    """sensor_gps since PX4 1.15: degrees and metres (msg/versioned/SensorGps.msg)."""
    drive = tables(30, 90)
    head = (
        "timestamp,timestamp_sample,latitude_deg,longitude_deg,altitude_msl_m,altitude_ellipsoid_m,time_utc_usec,"
        "device_id,s_variance_m_s,c_variance_rad,eph,epv,hdop,vdop,vel_m_s,vel_n_m_s,vel_e_m_s,vel_d_m_s,cog_rad"
    )
    rows = [
        f"{t * 1e6:.0f},0,{lat:.9f},{lon:.9f},{height - 30:.3f},{height:.3f},1707207945200000,1,0.25,0.1,0.6,"
        f"1.1,0.7,1.2,0,{north:.4f},{east:.4f},{down:.4f},0"
        for t, lat, lon, height, north, east, down, *_ in drive.gnss.tolist()
    ]
    (tmp_path / "log_vehicle_gps_position_0.csv").write_text("\n".join([head, *rows, ""]))
    head = (
        "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,"
        "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt"
    )
    rows = [
        f"{t * 1e6:.0f},{p:.9f},{q:.9f},{r:.9f},4000,0,{x:.8f},{y:.8f},{z:.8f},4000"
        for t, p, q, r, x, y, z in drive.imu.tolist()
    ]
    (tmp_path / "log_sensor_combined_0.csv").write_text("\n".join([head, *rows, ""]))
    log = read_log([tmp_path])
    np.testing.assert_allclose(np.hstack(log.rates), drive.imu[1:, 1:], atol=1e-6)
    np.testing.assert_allclose(log.gnss.position[:, 2], drive.gnss[:, 3], atol=1e-3)
    np.testing.assert_allclose(log.gnss.velocity_n, drive.gnss[:, 4:7], atol=1e-4)
    np.testing.assert_allclose(log.gnss.velocity_sigma, 0.25, atol=1e-9)
    np.testing.assert_allclose(log.gnss.position_sigma[:, 2], 1.1, atol=1e-9)
    assert np.isfinite(log.gnss.position_sigma).all()
