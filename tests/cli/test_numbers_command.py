"""``ins-lab numbers``: tables, lines for programs, and refusals; ``ins-lab receiver`` beside it."""

from __future__ import annotations

import json
import tempfile

import numpy as np
import pytest
from asking import ask, refused
from sensor_logs import IMU, tables, write, write_csv
from writers import WRITERS, sensor_csv, ulog
from xplane_simulator import montreal

from lab.missions import mission


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a log at rest, and with a drive whose receiver claims a 160th of its errors."""
    folder = tmp_path_factory.mktemp("numbers")
    rng = np.random.default_rng(1)
    rows = rng.normal(scale=[1e-3] * 3 + [0.02] * 3, size=(20_000, 6)) - [0, 0, 0, 0, 0, 9.8]
    write_csv(folder / "still.csv", IMU, np.column_stack((np.arange(20_000) / 100, rows)))
    log = tables(20, 200)
    log.gnss[:, 7:10] /= 160
    write(folder / "drive", log)
    return folder


def test_a_log_at_rest_gives_lines_for_a_program(folder):
    answer = ask("numbers", "--static", str(folder / "still.csv"), "--for", "kalibr")
    assert answer.exit_code == 0, answer.stderr
    assert "gyroscope_noise_density: " in answer.stdout
    assert "Without a drive, what the filter needs in the vehicle is not known" in answer.stdout
    table = ask("numbers", "--static", str(folder / "still.csv"))
    assert table.exit_code == 0, table.stderr
    for words in ("two-sided", "at rest", "unknown", "at most", "the Allan deviation of"):
        assert words in table.stdout
    facts = json.loads(ask("numbers", "--static", str(folder / "still.csv"), "--json", "--for", "px4").stdout)
    assert facts["moving"] is None
    assert "EKF2_GYR_NOISE" in facts["lines"]


def test_wrong_arguments_are_refused(folder):
    refused(ask("numbers"), "--static FILE, --moving MISSION|FILE, or both")
    refused(ask("numbers", "--moving", str(folder / "still.csv")), "still.csv")
    refused(ask("numbers", "--moving", "missions/montreal.csv.gz"), "simulated mission")
    refused(
        ask("numbers", "--static", str(folder / "still.csv"), "--for", "excel"), "accepted are kalibr, px4"
    )
    refused(ask("numbers", "--static", str(folder / "none.csv")), "none.csv")
    refused(ask("numbers", "--static", str(folder / "drive" / "imu.csv")), "accepted is a record at rest")
    refused(ask("numbers", "--moving", "montreal"), "simulated mission")


@pytest.mark.parametrize("speed", [0.0, 20.0])
def test_a_log_at_rest_whose_own_fixes_move_gives_no_number(speed, tmp_path):
    time, rng = np.arange(6000) / 50, np.random.default_rng(1)
    second = np.floor(time)
    rows = np.column_stack((
        1e3 * time, rng.normal((0, 0, 9.8), 0.02, size=(len(time), 3)),
        rng.normal(scale=1e-3, size=(len(time), 3)), 45 + speed * second / 111_200,
        np.full(len(time), -73.0), np.full(len(time), 100.0), np.full(len(time), 3.6 * speed), 0 * time,
    ))  # fmt: skip
    lines = [",".join(f"{one:.9f}" for one in row) for row in rows.tolist()]
    path = tmp_path / "straight.csv"
    path.write_text("\n".join([sensor_csv.HEADER, *lines, ""]), "utf-8")
    answer = ask("numbers", "--static", str(path))
    if not speed:
        assert answer.exit_code == 0, answer.stderr
    else:
        refused(answer, "the log at rest moved: its fixes move faster than 0.5 m/s for 119 s of 119 s")
        assert "°/s" not in answer.stdout


@pytest.mark.proof
def test_a_claim_160_times_too_small_is_found_and_said_in_one_sentence(folder, tmp_path):
    settings = tmp_path / "receiver.toml"
    answer = ask("receiver", str(folder / "drive"), "--settings", str(settings), "--json")
    assert answer.exit_code == 0, answer.stderr
    facts = json.loads(answer.stdout)
    level = facts["rows"][0]
    assert level["times_claimed"] == pytest.approx(160, rel=0.15)
    (sentence,) = [one for one in facts["sentences"] if "horizontal position" in one and "claims" in one]
    assert "times too small" in sentence
    assert facts["recommended"]
    assert facts["withheld_error_after_m"] < facts["withheld_error_before_m"]
    assert all(0.85 < row["nis"] < 1.15 for row in facts["rows"])
    again = ask("run", str(folder / "drive"), "--config", str(settings), "--json")
    assert again.exit_code == 0, again.stderr
    table = ask("receiver", str(folder / "drive"))
    assert "a horizontal error below" in table.stdout
    assert "passes" in table.stdout


def test_a_receiver_without_a_log_is_refused(folder, tmp_path):
    refused(ask("receiver", "montreal"), "simulated mission")
    refused(ask("receiver", str(tmp_path / "none.ubx")), "none.ubx")
    (tmp_path / "noise.ubx").write_bytes(bytes(range(256)) * 40)
    refused(ask("receiver", str(tmp_path / "noise.ubx")), "noise.ubx")


def test_fixes_that_repeat_one_place_give_no_number(tmp_path):
    """As a receiver without reception in a real log of a helicopter."""
    log = tables(20, 80)
    log.gnss[:, 1:7] = log.gnss[0, 1:7] * [1, 1, 1, 0, 0, 0]
    write(tmp_path / "frozen", log)
    refused(
        ask("receiver", str(tmp_path / "frozen")), "fixes are all at one place", "accepted are fixes of a"
    )


def test_a_height_that_is_always_the_same_is_said_and_the_rest_is_found(tmp_path):
    log = tables(20, 80)
    log.gnss[:, 3], log.gnss[:, 6] = log.gnss[0, 3], 0.0
    write(tmp_path / "level", log)
    answer = ask("receiver", str(tmp_path / "level"))
    assert answer.exit_code == 0, answer.stderr
    assert "The vertical position is the same in all" in answer.stdout
    assert "for the horizontal position" in answer.stdout


def test_a_csv_with_an_imu_and_fixes_is_read_and_20_s_of_it_give_no_number(tmp_path):
    path = tmp_path / "phone.csv"
    path.write_bytes(sensor_csv.write(montreal(20)))
    refused(ask("receiver", str(path)), "phone.csv: its fixes span 20 s; accepted are at least 30 s")
    refused(ask("calibrate", "mounting", str(path)), "phone.csv: ", "accepted are at least 120 s")


def test_a_track_holds_no_fixes_of_a_receiver(tmp_path):
    track = tmp_path / "track.gpx"
    track.write_bytes(WRITERS["GPX"](montreal(20)))
    refused(
        ask("receiver", str(track)), "is GPX, which holds no fixes as a receiver sent them", "NMEA or UBX"
    )


@pytest.mark.proof
def test_the_file_of_a_log_stands_in_place_of_a_mission(tmp_path, monkeypatch):
    """The same figures from a file and from the mission that an import of it makes; nothing stays behind."""
    monkeypatch.setenv("INS_LAB_MISSIONS", str(tmp_path / "missions"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    log = tmp_path / "drive.ulg"
    log.write_bytes(ulog.write(mission("los_angeles").recording))
    assert ask("import", str(log), "--as", "log", "--name", "same_drive").exit_code == 0
    for command in (("numbers", "--moving"), ("receiver",)):
        one, other = (ask(*command, name, "--json") for name in (str(log), "same_drive"))
        assert one.exit_code == 0, one.stderr
        there = one.stdout.replace("drive.ulg", "same_drive")
        assert str(tmp_path) not in there
        assert json.loads(there) | {"made": ""} == json.loads(other.stdout) | {"made": ""}
    refused(ask("receiver", str(log), "--settings", str(tmp_path / "out.toml")), "ins-lab import", "--as log")
    log.write_bytes(log.read_bytes()[:2000])
    refused(ask("numbers", "--moving", str(log)), "drive.ulg")
    assert not any((tmp_path / "temporary").iterdir())
