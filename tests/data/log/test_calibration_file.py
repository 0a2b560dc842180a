"""The file of a calibration: what is accepted, and what it does to logs and streams."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.base.files.mission_error import MissionError
from lab.data.clock.timed_samples import TIMED_IMU
from lab.data.log.calibration import Calibration, Linear, read_calibration
from lab.data.protocols.samples import IMU
from lab.data.streams.axis_map import AxisMap
from lab.data.streams.vehicle_rows import VehicleRows
from lab.missions import read_sensor_log
from lab.motion.frames.rotation import C_nb_from_euler
from tests.sensor_logs import tables, write

K = np.array([[1.02, 0.01, 0.0], [-0.01, 0.98, 0.02], [0.0, 0.03, 1.01]])
BIAS = np.array([0.1, -0.2, 0.3])
WHOLE = Calibration(
    source="bench.csv",
    accelerometer=Linear(BIAS, K),
    gyro=Linear(0.1 * BIAS, K.T),
    magnetometer=Linear(100 * BIAS, K),
    mounting=np.radians([0.0, 0.5, -1.5]),
)


def test_the_file_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "cal.toml"
    WHOLE.write(path)
    again = read_calibration(path)
    assert again.source == "bench.csv"
    np.testing.assert_allclose(again.mounting, WHOLE.mounting, rtol=1e-8)
    for name, one in WHOLE.linear.items():
        np.testing.assert_allclose(again.linear[name].bias, one.bias, rtol=1e-8)
        np.testing.assert_allclose(again.linear[name].matrix, one.matrix, rtol=1e-8)


def test_a_later_calibration_keeps_what_it_does_not_know() -> None:
    other = Calibration(source="drive", mounting=np.radians([0.0, 1.0, 0.0]))
    both = WHOLE.with_other(other)
    assert both.source == "bench.csv, drive"
    assert both.gyro is WHOLE.gyro
    np.testing.assert_allclose(both.mounting, other.mounting)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no calibration"),
        ("x = ", "is not TOML"),
        ("[gyros]\nbias = [0, 0, 0]", "Did you mean gyro"),
        ("[gyro]\nbias = [0, 0, 0]", "a table with bias and matrix"),
        ("gyro = 3", "a table with bias and matrix"),
        ("[gyro]\nbias = [0, 0]\nmatrix = [[1,0,0],[0,1,0],[0,0,1]]", "gyro.bias"),
        ("[gyro]\nbias = [0, 0, nan]\nmatrix = [[1,0,0],[0,1,0],[0,0,1]]", "gyro.bias"),
        ("[gyro]\nbias = [0, 0, true]\nmatrix = [[1,0,0],[0,1,0],[0,0,1]]", "gyro.bias"),
        (f"[gyro]\nbias = [0, 0, {'9' * 400}]\nmatrix = [[1,0,0],[0,1,0],[0,0,1]]", "gyro.bias"),
        ("[gyro]\nbias = [0, 0, 90]\nmatrix = [[1,0,0],[0,1,0],[0,0,1]]", "beyond 50"),
        ("[gyro]\nbias = [0, 0, 0]\nmatrix = [[1,0,0],[0,1,0]]", "3 by 3 numbers"),
        ("[gyro]\nbias = [0, 0, 0]\nmatrix = [[-1,0,0],[0,-1,0],[0,0,1]]", "too far from the unit matrix"),
        (
            "[gyro]\nbias = [0, 0, 0]\nmatrix = [[1,0.9,0],[0.9,0.8,0],[0,0,1]]",
            "too far from the unit matrix",
        ),
        ("[mounting]\nroll_pitch_yaw = [0, 0, 90]", "beyond 45"),
        ("source = 3\n[mounting]\nroll_pitch_yaw = [0, 0, 1]", "text in quotes"),
    ],
)
def test_files_that_are_not_accepted(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "cal.toml"
    path.write_text(text)
    with pytest.raises(MissionError, match=words):
        read_calibration(path)


def test_a_log_folder_is_calibrated_in_the_axes_of_the_imu(tmp_path: Path) -> None:
    # What another IMU with these errors, mounted with these axes and angles, would have logged.
    made = tables(100.0, 130.0)
    plain = read_sensor_log(write(tmp_path / "plain", made))
    P = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # axes y, x, -z
    C = C_nb_from_euler(WHOLE.mounting) @ P
    imu = made.imu.copy()
    imu[:, 1:4] = (made.imu[:, 1:4] @ C) @ K + 0.1 * BIAS
    imu[:, 4:] = (made.imu[:, 4:] @ C) @ K.T + BIAS
    folder = write(
        tmp_path / "skewed", made._replace(imu=imu), 'axes = ["y", "x", "-z"]\ncalibration = "cal.toml"\n'
    )
    with pytest.raises(MissionError, match=r"cal.toml: there is no such file"):
        read_sensor_log(folder)
    WHOLE.write(folder / "cal.toml")
    log = read_sensor_log(folder)
    for one, other in zip(log.rates, plain.rates, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)
    assert any("A calibration was applied (cal.toml)" in remark for remark in log.repairs)
    (folder / "log.toml").write_text('calibration = "../cal.toml"\n')
    with pytest.raises(MissionError, match="file in the same folder"):
        read_sensor_log(folder)


def test_a_log_that_was_read_is_calibrated_with_its_axes(tmp_path: Path) -> None:
    plain = read_sensor_log(write(tmp_path / "log", tables(100.0, 130.0)))
    rates, forces = plain.rates
    P = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    dt = np.diff(plain.time)[:, None]
    of_device = (rates @ P) @ K + 0.1 * BIAS, (forces @ P) @ K.T + BIAS
    skewed = replace(plain, dtheta=dt * (of_device[0] @ P.T), dvelocity=dt * (of_device[1] @ P.T))
    known = replace(WHOLE, mounting=np.zeros(3))
    for one, other in zip(known.applied(skewed, P).rates, plain.rates, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("axes", ["x,y,z", "y,x,-z", "x,y,z,inverted force"])
def test_streams_are_calibrated_in_the_axes_of_the_device(axes: str) -> None:
    rng = np.random.default_rng(1)
    true = rng.normal(size=(3, 20, 3))
    mapped = AxisMap.of(axes)
    rows = np.zeros(20, IMU)
    sign = -1.0 if mapped.inverted_force else 1.0
    rows["rate"] = true[0] @ K + 0.1 * BIAS
    rows["force"] = sign * (true[1] @ K.T + BIAS)
    rows["magnetic"] = 1e-6 * (true[2] @ K.T + 100 * BIAS)
    rows["magnetic"][7] = 0.0  # no reading
    made = VehicleRows(mapped)
    made.calibration = WHOLE
    put = made.put(rows, np.arange(1.0, 21.0), 0.0, np.zeros(20, bool))
    assert put.dtype == TIMED_IMU
    C = WHOLE.turn @ mapped.matrix
    np.testing.assert_allclose(put["rate"], true[0] @ C.T, atol=1e-9)
    np.testing.assert_allclose(put["force"], true[1] @ C.T, atol=1e-9)
    read = np.arange(20) != 7
    np.testing.assert_allclose(put["magnetic"][read], 1e-6 * true[2][read] @ C.T, atol=1e-12)
    assert not put["magnetic"][7].any()
