"""The IMU of FIT files, written by fit-tool: calibrated samples, counts with a calibration, the velocity."""

from __future__ import annotations

import numpy as np
import pytest
from fit_tool.profile.messages.accelerometer_data_message import AccelerometerDataMessage
from fit_tool.profile.messages.gps_metadata_message import GpsMetadataMessage
from fit_tool.profile.messages.gyroscope_data_message import GyroscopeDataMessage
from fit_tool.profile.messages.three_d_sensor_calibration_message import ThreeDSensorCalibrationMessage
from fit_tool.profile.profile_type import SensorType
from sensor_logs import tables
from writers import fit as writer

from lab.data.formats import read_raw
from lab.missions import MissionError
from lab.missions.flight_import import read_log

EPOCH = 631_065_600_000
"""Where FIT counts from, since 1970 [ms]."""
START = 400
"""Time since the camera was switched on at the first sample [s]."""
LEVEL, OFFSET = 32_768, (120, -60, 15)
DIVISOR = 16_384
FACTORS = {"accel": 8, "gyro": 1000}
AXES = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""From the axes of the converter to those of the device."""


@pytest.fixture(scope="module")
def drive():
    """Return what sensors log: time, rates [rad/s], forces [m/s²], and fixes."""
    return tables(30, 90)


def stamp(message, seconds: float) -> None:
    milliseconds = round(1000 * seconds)
    message.timestamp, message.timestamp_ms = EPOCH + 1000 * (milliseconds // 1000), milliseconds % 1000


def samples(kind, name: str, time: np.ndarray, values: np.ndarray, form: str) -> list:
    """Return messages of thirty samples."""
    made = []
    for first in range(0, len(time), 30):
        part = slice(first, first + 30)
        message = kind()
        stamp(message, time[first])
        message.sample_time_offset = np.round(1000 * (time[part] - time[first])).astype(int).tolist()
        for axis, column in zip("xyz", values[part].T, strict=True):
            setattr(message, f"{form}{name}_{axis}", column.tolist())
        made.append(message)
    return made


def counts(name: str, values: np.ndarray) -> np.ndarray:
    """Return what the converter counts, by the inverse of the calibration as it is published."""
    own = values @ AXES
    return np.round(own * DIVISOR / FACTORS[name]).astype(int) + LEVEL + np.array(OFFSET)


def calibration(name: str, sensor: SensorType) -> ThreeDSensorCalibrationMessage:
    message = ThreeDSensorCalibrationMessage()
    message.timestamp, message.sensor_type = EPOCH + 1000 * START, sensor
    setattr(message, f"{name}_cal_factor", FACTORS[name])
    message.calibration_divisor, message.level_shift = DIVISOR, LEVEL
    message.offset_cal, message.orientation_matrix = list(OFFSET), AXES.ravel().tolist()
    return message


def fixes(gnss: np.ndarray, velocity: bool = True) -> list[GpsMetadataMessage]:
    made = []
    for time, latitude, longitude, height, north, east, down, *_ in gnss.tolist():
        message = GpsMetadataMessage()
        stamp(message, time)
        message.position_lat, message.position_long, message.enhanced_altitude = latitude, longitude, height
        if velocity:
            message.velocity = [east, north, -down]
        made.append(message)
    return made


def file(drive, form: str, path, *, velocity: bool = True, calibrated: bool = True):
    shift = START - drive.imu[0, 0]
    time = np.round(drive.imu[:, 0] + shift, 3)
    rates, forces = np.degrees(drive.imu[:, 1:4]), drive.imu[:, 4:] / 9.80665
    if not form:
        rates, forces = counts("gyro", rates), counts("accel", forces)
    elif form == "compressed":
        forces = np.round(1000 * forces).astype(int)
    gnss = drive.gnss.copy()
    gnss[:, 0] += shift
    messages = [
        *samples(GyroscopeDataMessage, "gyro", time, rates, form and "calibrated_"),
        *samples(
            AccelerometerDataMessage, "accel", time, forces,
            "compressed_calibrated_" if form == "compressed" else form and "calibrated_",
        ),
        *fixes(gnss, velocity),
    ]  # fmt: skip
    messages.sort(key=lambda one: one.timestamp + one.timestamp_ms)
    if calibrated:
        messages = [
            calibration("accel", SensorType.ACCELEROMETER), calibration("gyro", SensorType.GYROSCOPE),
            *messages,
        ]  # fmt: skip
    path.write_bytes(writer.log(messages))
    return path


@pytest.mark.parametrize(
    ("form", "rate", "force"), [("calibrated", 1e-6, 1e-5), ("", 7e-4, 4e-3), ("compressed", 1e-6, 6e-3)]
)
def test_a_camera_is_a_log(drive, tmp_path, form, rate, force):
    log = read_log([file(drive, form, tmp_path / "camera.fit")], vehicle="aeroplane")
    found = np.hstack(log.rates)
    assert len(found) == len(drive.imu) - 1
    np.testing.assert_allclose(found[:, :3], drive.imu[1:, 1:4], atol=rate)
    np.testing.assert_allclose(found[:, 3:], drive.imu[1:, 4:], atol=force)
    # The velocity is along longitude, latitude and altitude.
    inside = slice(1, -1)
    np.testing.assert_allclose(log.gnss.velocity_n[inside], drive.gnss[inside, 4:7], atol=6e-3)
    np.testing.assert_allclose(np.degrees(log.gnss.position[inside, :2]), drive.gnss[inside, 1:3], atol=1e-7)


def test_the_flight_has_the_velocity_with_its_vertical_part(drive, tmp_path):
    flight = read_raw(file(drive, "calibrated", tmp_path / "camera.fit"))
    np.testing.assert_allclose(flight.velocity_n, drive.gnss[:, 4:7], atol=6e-3)
    assert [unit.column for unit in flight.units[3:]] == ["velocity[1]", "velocity[0]"]


def test_sensors_at_other_times_are_interpolated(drive, tmp_path):
    shift = START - drive.imu[0, 0]
    time, gnss = np.round(drive.imu[:, 0] + shift, 3), drive.gnss.copy()
    gnss[:, 0] += shift
    messages = [
        *samples(GyroscopeDataMessage, "gyro", time, np.degrees(drive.imu[:, 1:4]), "calibrated_"),
        # Twice as slow, and 3 ms later.
        *samples(
            AccelerometerDataMessage, "accel", time[::2] + 0.003, drive.imu[::2, 4:] / 9.80665, "calibrated_"
        ),
        *fixes(gnss),
    ]  # fmt: skip
    (tmp_path / "camera.fit").write_bytes(writer.log(messages))
    log = read_log([tmp_path / "camera.fit"], vehicle="aeroplane")
    late = np.interp(log.time[1:] + log.epoch, time[::2] + 0.003, drive.imu[::2, 6])
    np.testing.assert_allclose(log.rates[1][:, 2], late, atol=1e-4)


def test_what_is_missing_is_said(drive, tmp_path):
    with pytest.raises(MissionError, match="have no calibration"):
        read_log([file(drive, "", tmp_path / "camera.fit", calibrated=False)])
    walk = [writer.record(t, 45.0, 7.0 + 1e-5 * t, 3.0, 1.0) for t in range(60)]
    (tmp_path / "watch.fit").write_bytes(writer.log(walk))
    with pytest.raises(MissionError, match="no gyroscope"):
        read_log([tmp_path / "watch.fit"])
    data = file(drive, "calibrated", tmp_path / "camera.fit").read_bytes()
    (tmp_path / "camera.fit").write_bytes(data[: len(data) // 2])
    assert 25 < read_log([tmp_path / "camera.fit"], vehicle="aeroplane").duration < 32


@pytest.mark.proof
def test_damaged_files_give_a_log_or_a_reason(drive, tmp_path):
    seed = 41
    rng = np.random.default_rng(seed)
    data = np.frombuffer(file(drive, "", tmp_path / "camera.fit").read_bytes(), np.uint8)
    taken = 0
    for _ in range(15):
        hostile = data.copy()
        hostile[rng.integers(0, len(data), rng.integers(1, 30))] = rng.integers(0, 256)
        (tmp_path / "camera.fit").write_bytes(hostile.tobytes())
        try:
            log = read_log([tmp_path / "camera.fit"])
            assert np.isfinite(log.dtheta).all(), seed
            taken += 1
        except MissionError as error:
            assert len(str(error)) > 10
    assert taken
