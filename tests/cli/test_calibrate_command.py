"""``ins-lab calibrate``: terms with σ and what they rest on, the file and its use; wrong logs in words."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from asking import ask, refused
from calibration_logs import Errors, bench, errors, fields, write_bench
from sensor_logs import tables, write, write_csv
from writers import WRITERS
from xplane_simulator import montreal

import lab
from lab.data.log.calibration import read_calibration
from lab.missions import mission


@pytest.fixture
def rests(tmp_path: Path) -> tuple[Path, Errors]:
    """Return a log of rests and turns, and the errors of its IMU."""
    rng = np.random.default_rng(1)
    made = errors(rng)
    return write_bench(tmp_path / "bench.csv", *bench(rng, made)), made


def test_an_imu_is_calibrated_and_the_file_holds_it(rests: tuple[Path, Errors], tmp_path: Path) -> None:
    path, made = rests
    out, card = tmp_path / "sensor.toml", tmp_path / "own.toml"
    answer = ask("calibrate", "imu", str(path), "--latitude", "45", "--out", str(out), "--card", str(card))
    assert answer.exit_code == 0, answer.output
    assert answer.stdout.count("misalignment") >= 12
    assert "The calibration of the accelerometer gains (specific force at rest" in answer.stdout
    assert "found by the spread of the samples" in answer.stdout
    known = read_calibration(out)
    assert known.gyro is not None
    np.testing.assert_allclose(known.gyro.matrix, made.K_g, atol=1e-3)
    np.testing.assert_allclose(known.gyro.bias, made.b_g, atol=2e-4)
    # The card simulates the same errors.
    settings = lab.card(card, assumed=False).settings()
    np.testing.assert_allclose(settings["gyro"]["scale_factor"], 100 * (np.diag(made.K_g) - 1), atol=0.1)
    again = ask("calibrate", "imu", str(path), "--out", str(out))
    assert again.exit_code == 2
    assert "--force renews" in again.stderr


def test_json_has_what_the_table_has(rests: tuple[Path, Errors]) -> None:
    facts = json.loads(ask("calibrate", "imu", str(rests[0]), "--json").stdout)
    assert len(facts["terms"]) == 24
    assert all(one["low"] < one["value"] < one["high"] for one in facts["terms"])
    assert [one["gains"] for one in facts["judgements"]] == [True, True, True]


def test_a_file_keeps_the_other_sensors(rests: tuple[Path, Errors], tmp_path: Path) -> None:
    out, compass = tmp_path / "sensor.toml", tmp_path / "compass.csv"
    hard = np.array([20.0, -10.0, 5.0])
    time, values = fields(np.random.default_rng(1), np.eye(3), hard)
    write_csv(compass, ("t_s", "mx_uT", "my_uT", "mz_uT"), np.column_stack((time, values)))
    assert ask("calibrate", "magnetometer", str(compass), "--out", str(out)).exit_code == 0
    answer = ask("calibrate", "imu", str(rests[0]), "--out", str(out), "--force")
    assert answer.exit_code == 0, answer.output
    known = read_calibration(out)
    assert set(known.linear) == {"accelerometer", "gyro", "magnetometer"}
    assert known.magnetometer is not None
    np.testing.assert_allclose(known.magnetometer.bias, hard, atol=0.2)


def test_an_import_removes_the_errors(tmp_path: Path) -> None:
    made = tables(100.0, 140.0)
    plain = mission(str(write(tmp_path / "plain", made))).log
    skewed = made.imu.copy()
    skewed[:, 1:4] = 1.05 * skewed[:, 1:4] + 0.01
    imu, gnss = tmp_path / "imu.csv", tmp_path / "gnss.csv"
    write(tmp_path / "skewed", made._replace(imu=skewed))
    (tmp_path / "skewed" / "imu.csv").rename(imu)
    (tmp_path / "skewed" / "gnss.csv").rename(gnss)
    known = tmp_path / "cal.toml"
    known.write_text(
        f"[gyro]\nbias = [{np.degrees(0.01)}, {np.degrees(0.01)}, {np.degrees(0.01)}]\n"
        "matrix = [[1.05, 0, 0], [0, 1.05, 0], [0, 0, 1.05]]\n"
    )
    given = ["import", str(imu), str(gnss), "--as", "log", "--calibration", str(known)]
    refused(ask(*given, "--name", "unstated"), "is in the axes of the device", "--axes x,y,z")
    answer = ask(*given, "--name", "calibrated", "--axes", "x,y,z")
    assert answer.exit_code == 0, answer.output
    assert "A calibration was applied" in answer.stdout
    log = mission("calibrated").log
    np.testing.assert_allclose(log.rates[0], plain.rates[0], atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("imu", ["rests in 1 attitude", "accepted are at least 6"]),
        ("magnetometer", ["has no magnetometer"]),
        ("mounting", ["faster than 3 m/s for 0 s", "accepted are at least 120 s"]),
    ],
)
def test_a_log_at_rest_is_refused(tmp_path: Path, kind: str, words: list[str]) -> None:
    made = tables(0.0, 40.0)
    still = made.imu.copy()
    still[:, 1:] = np.random.default_rng(1).normal(scale=1e-3, size=(len(still), 6)) - [0, 0, 0, 0, 0, 9.8]
    gnss = made.gnss.copy()
    gnss[:, 1:4], gnss[:, 4:7] = gnss[0, 1:4], 0.0
    refused(
        ask("calibrate", kind, str(write(tmp_path / "still", made._replace(imu=still, gnss=gnss)))), *words
    )


def test_swapped_and_other_files_are_refused(rests: tuple[Path, Errors], tmp_path: Path) -> None:
    flight = write(tmp_path / "flight", tables(100.0, 140.0))
    refused(ask("calibrate", "imu", str(flight)), "accepted")
    refused(ask("calibrate", "magnetometer", str(rests[0])), "has no magnetometer")
    refused(ask("calibrate", "mounting", str(rests[0])), "bench.csv")
    refused(ask("calibrate", "mounting", "montreal"), "is a simulated mission")
    refused(ask("calibrate", "imu", "montreal"), "is a simulated mission")
    refused(ask("calibrate", "imu", str(tmp_path / "nothing.csv")), "nothing.csv")
    track = tmp_path / "track.gpx"
    track.write_bytes(WRITERS["GPX"](montreal(20)))
    refused(ask("calibrate", "imu", str(track)), "no IMU")
    (tmp_path / "empty.csv").write_bytes(b"")
    refused(ask("calibrate", "mounting", str(tmp_path / "empty.csv")), "the file is empty")
    (tmp_path / "nothing").mkdir()
    for kind in ("imu", "magnetometer"):
        refused(ask("calibrate", kind, str(tmp_path / "nothing")), "is a folder without a log")
    out = tmp_path / "sensor.txt"
    refused(ask("calibrate", "imu", str(rests[0]), "--out", str(out)), ".toml")


def test_nothing_is_written_of_what_does_not_gain(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    path = write_bench(tmp_path / "exact.csv", *bench(rng, errors(rng, 0.0)))
    out = tmp_path / "sensor.toml"
    answer = ask("calibrate", "imu", str(path), "--latitude", "49.15", "--out", str(out))
    assert answer.exit_code == 2
    assert "refused, since it gains nothing" in answer.output
    assert not out.exists()
