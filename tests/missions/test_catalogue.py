"""The catalogue: what has not changed is not read again, and what has changed is."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from lab.missions import MissionError, broken_missions, delete_mission, folder_listing, mission, missions
from lab.missions.catalogue import OWN_FOLDER_VARIABLE
from lab.missions.log_mission import LogMission
from lab.missions.mission import Mission


@pytest.fixture
def own(tmp_path, monkeypatch) -> Path:
    """Return a folder with three missions that were written a while ago."""
    monkeypatch.setenv(OWN_FOLDER_VARIABLE, str(tmp_path))
    monkeypatch.setattr(folder_listing, "_SETTLED", -1.0)
    for name in ("one", "two", "three"):
        write(tmp_path / f"{name}.toml", name)
        (tmp_path / f"{name}.csv").write_text("never read here")
    return tmp_path


@pytest.fixture
def read(monkeypatch) -> list[str]:
    """Return the names of the TOML files that are read from now on."""
    names: list[str] = []
    from_toml = Mission.from_toml.__func__

    def told(cls, path, name=None):
        names.append(path.name)
        return from_toml(cls, path, name)

    monkeypatch.setattr(Mission, "from_toml", classmethod(told))
    return names


def write(path: Path, title: str) -> None:
    path.write_text(f'title = "{title}"\nrecording = "{path.stem}.csv"\n')


def write_log(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    for name in ("imu.csv", "gnss.csv"):
        (folder / name).write_text("never read here")


def test_only_what_changed_is_read_again(own, read):
    assert {"one", "two", "three"} <= set(missions())
    read.clear()
    assert mission("two").title == "two"
    assert {"one", "two", "three"} <= set(missions())
    assert read == []
    write(own / "two.toml", "TWO")  # as long as before
    os.utime(own / "two.toml", (time.time() + 5,) * 2)
    assert missions()["two"].title == "TWO"
    assert read == ["two.toml"]


@pytest.mark.filterwarnings("ignore:mission left out")
def test_what_is_broken_or_a_log_is_not_read_again_either(own, monkeypatch):
    (own / "broken.toml").write_text("wrong = 3\n")
    write_log(own / "drive")
    assert "drive" in missions()
    monkeypatch.setattr(Mission, "from_toml", None)
    monkeypatch.setattr(LogMission, "at", None)
    monkeypatch.setattr(folder_listing, "is_log_folder", None)
    assert {"one", "drive"} <= set(missions())
    assert "there is no key 'wrong'" in broken_missions()["broken"]


@pytest.mark.filterwarnings("ignore:mission left out")
def test_a_log_whose_file_comes_later_is_listed_then(own):
    (own / "walk.toml").write_text('imu = "walk_imu.csv"\ngnss = "walk_gnss.csv"\n')
    (own / "walk_imu.csv").write_text("")
    (own / "drive").mkdir()
    assert "walk_gnss.csv: there is no such file" in broken_missions()["walk"]
    assert "drive" not in missions()
    (own / "walk_gnss.csv").write_text("")
    write_log(own / "drive")
    assert {"walk", "drive"} <= set(missions())
    (own / "drive" / "log.toml").write_text('title = "Drive to work"\n')
    assert missions()["drive"].title == "Drive to work"
    (own / "drive" / "gnss.csv").unlink()
    assert "gnss.csv: there is no such file" in broken_missions()["drive"]


@pytest.mark.filterwarnings("ignore:mission left out")
def test_what_is_new_or_gone_shows_at_once(own):
    assert "one" in missions()
    (own / "one.toml").unlink()
    (own / "two.csv").unlink()
    write(own / "four.toml", "four")
    (own / "four.csv").write_text("")
    found = missions()
    assert "one" not in found
    assert "four" in found
    assert "does not exist" in broken_missions()["two"]


def test_what_was_just_written_is_read_again(own, read, monkeypatch):
    monkeypatch.setattr(folder_listing, "_SETTLED", 2.0)
    missions()
    read.clear()
    missions()
    assert {"one.toml", "two.toml", "three.toml"} <= set(read)


def test_a_listing_does_not_keep_what_was_read_through_another(own):
    assert missions()["one"] is not missions()["one"]


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
@pytest.mark.filterwarnings("ignore:mission left out")
def test_links_in_a_circle_hide_no_other_mission(own):
    (own / "circle.toml").symlink_to("circle.toml")
    (own / "here.csv").symlink_to("here.csv")
    write(own / "here.toml", "here")
    assert {"one", "two", "three"} <= set(missions())
    assert {"circle", "here"} <= set(broken_missions())


@pytest.mark.parametrize("name", ["drive.csv", "drive.csv.gz", "drive.toml"])
def test_a_folder_with_a_log_may_be_called_like_a_file(tmp_path, name):
    write_log(tmp_path / name)
    assert isinstance(mission(str(tmp_path / name)), LogMission)


def test_a_message_names_some_of_many_missions(own):
    for number in range(60):
        write(own / f"many{number:02}.toml", "many")
        (own / f"many{number:02}.csv").write_text("never read here")
    with pytest.raises(MissionError, match=r"many16 and 46 more, or the path") as refused:
        mission("nowhere")
    assert len(str(refused.value)) < 500
    with pytest.raises(MissionError, match=r"Accepted are your own: .* and 43 more"):
        delete_mission("nowhere")
