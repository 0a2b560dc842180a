"""Logs as missions: found by folder, TOML and name, cached by what is in them, shown as a card."""

from __future__ import annotations

import numpy as np
import pytest
from sensor_logs import POSITION, tables, write, write_csv

from lab.missions import LogMission, MissionError, broken_missions, delete_mission, mission, missions
from lab.missions.catalogue import OWN_FOLDER_VARIABLE


@pytest.fixture(scope="module")
def flown():
    return tables(60, 80)


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path))
    return tmp_path


def test_found_by_folder_and_by_toml(tmp_path, flown):
    folder = write(tmp_path / "drive", flown, 'title = "To work"\nlatency_s = 0.1')
    (folder / "other.toml").write_text('title = "Same files"\nimu = "imu.csv"')
    for path, title in (
        (folder, "To work"),
        (folder / "log.toml", "To work"),
        (folder / "other.toml", "Same files"),
    ):
        found = mission(path)
        assert isinstance(found, LogMission)
        assert found.title == title
        np.testing.assert_allclose(found.duration, 20, atol=0.05)
    assert mission(folder).log.gnss.latency == 0.1


def test_listed_by_the_folders_name(own, flown):
    write(own / "drive", flown)
    write(own / "montreal", flown)
    (own / "photos").mkdir()
    found = missions()
    assert isinstance(found["drive"], LogMission)
    assert isinstance(found["user:montreal"], LogMission)
    assert "photos" not in found
    assert mission("drive").path == mission(own / "drive").path
    assert mission(own / "drive").name == "drive"


def test_broken_logs_are_reported(own, flown):
    write(own / "no_gnss", flown, "title = 'no fixes'")
    (own / "no_gnss" / "gnss.csv").unlink()
    write(own / "wrong_key", flown, "lever_arm = [1, 2, 3]")
    broken = broken_missions()
    assert "gnss.csv: there is no such file" in broken["no_gnss"]
    assert "Did you mean lever_arm_m?" in broken["wrong_key"]
    with pytest.raises(MissionError, match=r"gnss\.csv"):
        mission("no_gnss")


def test_a_description_that_cannot_be_read_is_reported_and_does_not_block(own, flown, make_pipe):
    folder = write(own / "piped", flown)
    make_pipe(own / "piped" / "log.toml")
    (own / "alone").mkdir()
    make_pipe(own / "alone" / "log.toml")
    (own / "linked").mkdir()
    (own / "linked" / "log.toml").symlink_to(own / "nowhere.toml")
    broken = broken_missions()
    assert "log.toml: cannot be read: is not an ordinary file" in broken["piped"]
    assert "log.toml: cannot be read: is not an ordinary file" in broken["alone"]
    assert "log.toml: cannot be read: No such file" in broken["linked"]
    with pytest.raises(MissionError, match="not an ordinary file"):
        mission(folder)
    delete_mission("piped")
    assert not folder.exists()


def test_a_folder_without_a_log_is_refused(tmp_path):
    with pytest.raises(MissionError, match=r"is a folder without a log; accepted is one with log\.toml"):
        mission(tmp_path)


def test_a_log_is_no_flight_recording(tmp_path, flown):
    found = mission(write(tmp_path / "drive", flown))
    with pytest.raises(MissionError, match="its true flight is unknown"):
        _ = found.recording
    with pytest.raises(MissionError, match="cannot be flown again"):
        _ = found.plan


def test_content_counts_and_words_do_not(tmp_path, flown):
    folder = write(tmp_path / "drive", flown, 'title = "one"')
    first = mission(folder).content_hash
    (folder / "log.toml").write_text('title = "two"')
    assert mission(folder).content_hash == first
    (folder / "log.toml").write_text("latency_s = 0.1")
    assert mission(folder).content_hash != first
    (folder / "log.toml").write_text("")
    write_csv(folder / "gnss.csv", POSITION, flown.gnss[:-1, :4])
    assert mission(folder).content_hash != first


def test_card(tmp_path, flown):
    rows = (flown.imu[:, 0] > 1070.2) & (flown.imu[:, 0] < 1070.9)
    folder = write(tmp_path / "drive", flown._replace(imu=flown.imu[~rows]), 'title = "<b>To work"')
    card = mission(folder)._repr_html_()
    for words in (
        "&lt;b&gt;To work",
        "2000",
        "100 Hz",
        "2 Hz",
        "1, 0.7",
        "position, velocity, attitude",
        "svg",
    ):
        assert words in card
    assert "1 gap of the IMU" in card
    (folder / "imu.csv").write_text("t_s\n")
    assert "No log:" in mission(folder)._repr_html_()
